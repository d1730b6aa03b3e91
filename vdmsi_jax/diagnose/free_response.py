"""The response of a plant to its states at the start of a run."""

import numpy as np
from jaxtyping import Float


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
    step = _expm(A * dt)
    found, power = np.eye(n)[:1], step
    with np.errstate(over="ignore", invalid="ignore"):  # of what grows, which counts as nothing
        while len(found) < rows:
            found = np.concatenate([found, found @ power])
            power = power @ power
    found = found[:rows]
    found = np.where(np.isfinite(found) & (np.abs(found) < 1e6), found, 0.0)
    basis = np.linalg.qr(found / np.maximum(np.abs(found).max(axis=0), 1e-300))[0]
    return basis / np.abs(basis).max(axis=0)


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
