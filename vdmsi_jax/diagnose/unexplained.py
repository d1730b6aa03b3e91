"""Is there structure left? Tests on what a model leaves that need no hypothesis.

Of `structure` there are three: does a regression on inputs, states and time, judged on blocks that
it has not seen, explain more of the innovations than of the same ones shifted in time; is the
energy of short windows beyond what their spread allows (drop-outs, knocks); and is the error on
data held out larger than on those fitted. `slow_error` is the fourth.
"""

from collections.abc import Mapping

import numpy as np
from jaxtyping import Bool, Float

from .result import Unexplained
from .windows import SLOW, moving_mean

_SHIFTS = 80
_SURE = 5.0  # standard deviations of the shifted ones
_WORTH = 0.01  # share of the innovations' variance below which structure is not spoken of
_SHARP = (4.5, 1.6)  # of white windows: spreads of the logarithm of energy, and its least excess
_BROAD = (8.0, 3.0)  # of coloured ones, whose energies differ more
_WORSE = 1.5  # innovations on data held out, beside those fitted; runs differ in noise by 1.4
LARGE = 0.045
"""Slow error, of a response's spread, that is told where it was fitted: made-up drives without a
cause leave 0.005 to 0.042."""
LARGE_HELD_OUT = 0.08
"""The same where it was not fitted, and 0.02 to 0.053."""
_OF_LEVEL = 0.25  # of the largest response, which counts as spread where it is larger
_BESIDE = 1.2  # innovations
_BLOCKS = 8
_WINDOW = 0.5  # s


def structure(
    channel: str,
    residual: Float[np.ndarray, "R N"],
    innovations: Float[np.ndarray, "R N"],
    mask: Bool[np.ndarray, "R N"],
    held_out: Bool[np.ndarray, "R N"],
    regressors: Mapping[str, Float[np.ndarray, "R N"]],
    runs: tuple[str, ...],
    dt: float,
    seed: int = 0,
) -> list[Unexplained]:
    """What is left in a channel, by the three tests; empty if nothing is.

    Args:
        channel: its name.
        residual: what the model leaves; slow structure shows in it.
        innovations: the same whitened; fast structure shows in it.
        mask: samples that were fitted; `held_out`: those that were not.
        regressors: what structure may depend on.
        runs: names of the runs.
        dt: sample period, s.
        seed: of the random features.
    """
    found = []
    tried = [_dependence(e, mask, regressors, seed) for e in (innovations, residual)]
    dependent = max((d for d in tried if d is not None), default=None)
    if dependent is not None:
        share, names = dependent
        found.append(Unexplained(channel, share, names, (), "it depends on inputs and states"))
    known = mask | held_out
    bursts = _bursts(innovations, known, runs, dt, *_SHARP)
    bursts = bursts or _bursts(residual, known, runs, dt, *_BROAD)
    if bursts is not None:
        share, when = bursts
        found.append(Unexplained(channel, share, ("t",), when, "energy of short windows"))
    worse = _worse(innovations, mask, held_out, dt)
    if worse is not None:
        found.append(
            Unexplained(channel, worse, ("run",), (), "the error on data held out is larger")
        )
    return found


def slow_error(
    channel: str,
    residual: Float[np.ndarray, "R N"],
    innovations: Float[np.ndarray, "R N"],
    response: Float[np.ndarray, "R N"],
    mask: Bool[np.ndarray, "R N"],
    dt: float,
    least: float = LARGE,
) -> Unexplained | None:
    """A slow error that is large beside the response: noise with a colour can imitate anything that
    is slow, so no innovation shows it, and its size is what tells it.

    Args:
        channel: its name.
        residual: what the model leaves; `innovations`: the same whitened.
        response: what was measured.
        mask: samples that count.
        dt: sample period, s.
        least: share of the response's spread, from which it is told.
    """
    if not mask.any():
        return None
    slow = moving_mean(np.where(mask, residual, 0.0), SLOW, dt)
    size = float(np.sqrt(np.mean(slow[mask] ** 2)))
    fast = float(np.sqrt(np.mean(innovations[mask] ** 2)))
    values = response[mask]
    spread = max(float(np.std(values)), _OF_LEVEL * float(np.abs(values).max()))
    if size < least * spread or size < _BESIDE * fast:
        return None
    share = min(size**2 / max(float(np.mean(residual[mask] ** 2)), 1e-300), 1.0)
    words = f"a slow error of {100.0 * size / spread:.0f} % of the response's spread"
    return Unexplained(channel, share, ("t",), (), words, puzzling=True, size=size / spread)


def _dependence(e, mask, regressors, seed) -> tuple[float, tuple[str, ...]] | None:
    names = [
        n for n, x in regressors.items() if np.std(x[mask]) > 1e-9 * (1 + np.abs(x[mask]).max())
    ]
    if not names or mask.sum() < 40 * _BLOCKS:
        return None
    scaled = {}
    for n in names:
        x = regressors[n]
        middle, spread = np.mean(x[mask]), np.std(x[mask])
        scaled[n] = np.clip((x - middle) / spread, -4, 4)
    share, sure = _judge(e, mask, _features(scaled, names, seed))
    if share < _WORTH or sure < _SURE:
        return None
    alone = []
    for n in names:
        own, certain = _judge(e, mask, _features(scaled, [n], seed))
        if certain > _SURE and own > 0.3 * share:
            alone.append((own, n))
    return share, tuple(n for _, n in sorted(alone, reverse=True)) or tuple(names)


def _features(scaled: Mapping[str, np.ndarray], names: list[str], seed: int) -> np.ndarray:
    """Powers of each regressor, and random cosines of all together."""
    rng = np.random.default_rng(seed)
    stack = np.stack([scaled[n] for n in names])
    powers = [x**k for x in stack for k in (1, 2, 3)] + [np.sign(x) for x in stack]
    weights = rng.normal(size=(24, len(names)))
    phases = rng.uniform(0, 2 * np.pi, 24)
    waves = np.cos(np.tensordot(weights, stack, 1) + phases[:, None, None])
    return np.concatenate([np.stack(powers), waves])


def history(x: Float[np.ndarray, "R N"], seconds: float, dt: float) -> Float[np.ndarray, "R N"]:
    """Exponential mean of the past, over a time constant in s."""
    n = x.shape[1]
    size = 1 << (2 * n).bit_length()
    weights = np.exp(-dt / seconds * np.arange(n))
    summed = np.fft.irfft(np.fft.rfft(x, size) * np.fft.rfft(weights, size), size)[:, :n]
    return summed / np.cumsum(weights)


def _judge(e, mask, features) -> tuple[float, float]:
    """Share of the variance that a ridge regression explains on blocks that it has not seen, and by
    how many standard deviations that is beyond the innovations shifted in time; of a share too
    small to be worth telling, none."""
    rows, X = e[mask], features[:, mask]
    X = (X - X.mean(axis=1, keepdims=True)) / (X.std(axis=1, keepdims=True) + 1e-12)
    n, rng = len(rows), np.random.default_rng(1)
    rows = rows - rows.mean()
    edges = np.linspace(0, n, _BLOCKS + 1).astype(int)
    blocks = [slice(a, b) for a, b in zip(edges[:-1], edges[1:], strict=True)]
    grams = np.stack([X[:, b] @ X[:, b].T for b in blocks])
    others = grams.sum(axis=0) - grams + 0.02 * n * np.eye(len(X))

    def explained(targets: np.ndarray) -> np.ndarray:
        pulls = np.stack([X[:, b] @ targets[:, b].T for b in blocks])
        shares = np.linalg.solve(others, pulls.sum(axis=0) - pulls)
        # |t - X's|^2 over all blocks, without the residuals themselves
        taken = np.sum(shares * (2.0 * pulls - grams @ shares), axis=(0, 1))
        return taken / np.sum(targets**2, axis=1)

    share = float(explained(rows[None])[0])
    if share < _WORTH:
        return share, 0.0
    shifts = rng.integers(n // 10, n - n // 10, _SHIFTS)
    chance = explained(np.stack([np.roll(rows, s) for s in shifts]))
    spread = max(float(np.std(chance)), 1e-6)
    return share, (share - float(np.mean(chance))) / spread


def _bursts(e, known, runs, dt, spreads: float, least: float):
    """Windows whose energy is beyond the spread of the others."""
    length = max(4, round(_WINDOW / dt))
    energies, places = [], []
    for r, (row, use) in enumerate(zip(e, known, strict=True)):
        for start in range(0, len(row) - length + 1, length):
            if use[start : start + length].all():
                energies.append(float(np.mean(row[start : start + length] ** 2)))
                places.append((r, start))
    if len(energies) < 20:
        return None
    values = np.array(energies)
    logs = np.log(np.maximum(values, 1e-300))
    middle = np.median(logs)
    spread = max(1.4826 * float(np.median(np.abs(logs - middle))), np.sqrt(2.0 / length))
    wild = np.flatnonzero(logs > middle + max(spreads * spread, least))
    if wild.size == 0:
        return None
    excess = float(np.sum(values[wild] - np.median(values)) / np.sum(values))
    order = wild[np.argsort(-values[wild])][:5]
    when = tuple(
        (runs[places[k][0]], places[k][1] * dt, (places[k][1] + length) * dt) for k in order
    )
    return (excess, when) if excess > 2 * _WORTH else None


def _worse(e, mask, held_out, dt):
    settled = held_out.copy()
    settled[:, : round(2.0 / dt)] = False
    if settled.sum() < 200 or mask.sum() < 200:
        return None
    ratio = float(np.mean(e[settled] ** 2) / np.mean(e[mask] ** 2))
    return 1.0 - 1.0 / ratio if ratio > _WORSE else None
