"""What a plant answers to what happened before a run: to its states at the start, and to commands
that were on their way."""

import numpy as np
from jaxtyping import Float


def begun(
    whole: Float[np.ndarray, " _"],
    den: Float[np.ndarray, " n"],
    num: Float[np.ndarray, " m"],
    delay: float,
    dt: float,
    rows: int,
) -> Float[np.ndarray, "rows q"]:
    """What a run may begin with: the states of a plant and of the modes before it (`whole` is the
    denominator of both), and where it has a delay, what is on its way."""
    states = free_response(whole, dt, rows)
    if delay <= 0.0:
        return states
    return np.concatenate([states, on_its_way(den, num, delay, dt, rows)[:, None]], axis=1)


def mode(frequency: float, damping: float) -> Float[np.ndarray, "3"]:
    """Denominator of a mode, its frequency in radians."""
    return np.array([1.0, 2.0 * damping * frequency, frequency**2])


def free_response(
    den: Float[np.ndarray, " _"], dt: float, rows: int
) -> Float[np.ndarray, "rows n"]:
    """Responses at the rows that the states at the first row may have, as many as there are states,
    orthogonal, the largest value of each 1: how a plant tells its states decides nothing then, of
    which a fast one would need huge values.

    Args:
        den: denominator, highest power first, the leading coefficient 1.
        dt: between rows, in the unit of time of the denominator.
        rows: how many.
    """
    n = len(den) - 1
    A = np.eye(n, k=1)
    A[:, 0] -= den[1:]
    found = _outputs(A, dt, rows)
    basis = np.linalg.qr(found / np.maximum(np.abs(found).max(axis=0), 1e-300))[0]
    return basis / np.abs(basis).max(axis=0)


def on_its_way(
    den: Float[np.ndarray, " _"],
    num: Float[np.ndarray, " m"],
    delay: float,
    dt: float,
    rows: int,
) -> Float[np.ndarray, " rows"]:
    """Response at the rows to a command that lies in the delay when a run begins and ends there,
    its largest value 1.

    Args:
        den, num: of the plant, highest power first.
        delay: more than zero, in the unit of time of the denominator.
        dt: between rows, likewise.
        rows: how many.
    """
    n = len(den) - 1
    if len(num) > n:  # what passes at once is gone with the command
        num = num[1:] - num[0] * den[1:]
    A = np.eye(n + 1, k=1)  # of the plant and its command, which is held
    A[:n, 0] -= den[1:]
    A[n - len(num) : n, n] = num
    step = _outputs(A, dt, rows)[:, n]
    t = dt * np.arange(rows)
    column = step - np.interp(t - delay, t, step, left=0.0)
    return column / max(float(np.abs(column).max()), 1e-300)


def _outputs(A: Float[np.ndarray, "n n"], dt: float, rows: int) -> Float[np.ndarray, "rows n"]:
    """What the first state becomes of each, at the rows; what grows without end counts as
    nothing."""
    found, power = np.eye(len(A))[:1], _expm(A * dt)
    with np.errstate(over="ignore", invalid="ignore"):
        while len(found) < rows:
            found = np.concatenate([found, found @ power])
            power = power @ power
    found = found[:rows]
    return np.where(np.isfinite(found) & (np.abs(found) < 1e6), found, 0.0)


def _expm(M: np.ndarray) -> np.ndarray:
    norm = np.abs(M).sum(axis=1).max()
    squarings = int(np.clip(np.ceil(np.log2(max(norm, 1e-300) / 0.25)), 0, 60))
    scaled, term, total = M / 2**squarings, np.eye(len(M)), np.eye(len(M))
    for k in range(1, 14):
        term = term @ scaled / k
        total = total + term
    for _ in range(squarings):
        total = total @ total
    return total
