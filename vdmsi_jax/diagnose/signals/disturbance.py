"""Is an error that lasts a disturbance, which every drive has, or does something make it?

Wind and rough ground are steady: a Gaussian process that does not ask what is commanded. An error
that the model makes is large where much is asked of the actuator, and what comes in events is small
most of the time. Both are compared with surrogates that have the spectrum of the error, and phases
of their own, so nothing is asked of its colour.

Source: Theiler et al., Testing for nonlinearity in time series: the method of surrogate data
(Physica D 58, 1992).
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float

from .windows import history, slow_part

IMITATORS = frozenset(
    ("gain_drift", "regime_change", "periodic_disturbance", "road_grade", "offset", "resonance")
)
"""Causes that change or swing by themselves, and so can draw any error that lasts."""
_SURROGATES, _AT_ONCE = 200, 20
_STRETCH = 0.5  # s, over which energy is summed
_PASTS = (0.3, 1.0, 3.0)  # s, of what is asked, that an error may remember
_FLOOR = 1e-3  # of the mean energy, below which a stretch is as good as quiet
_LASTS = 20.0  # s, of a run that has a mean
_STANDS = 0.1  # of the usual speed, below which a vehicle stands
_PARTS, _BEYOND = 4, 16.0  # of a run, and times the variance that its mean has by theirs, below
# which it is no news: of disturbances with a memory of a third of a run 7 % are beyond
_FEW = 20  # stretches, below which nothing can be told


class Scores(NamedTuple):
    """By how many of their standard deviations an error is beyond its surrogates; zero where there
    is too little to tell.

    Attributes:
        along: in how its energy goes with what is asked.
        rare: in how rare its large values are.
        to_a_side: in how much further it goes to one side than to the other, as what brakes now
            and then.
    """

    along: float
    rare: float
    to_a_side: float


def demands(
    u: Float[np.ndarray, "R N"],
    y: Float[np.ndarray, "R N"],
    mask: Bool[np.ndarray, "R N"],
    dt: float,
) -> Float[np.ndarray, "4 R N"]:
    """How much is asked of an actuator: the sizes of a command and of a simulated response, and of
    their rates."""
    rates = [np.abs(np.gradient(x, dt, axis=1)) for x in (u, y)]
    return np.stack([*rates, np.abs(u - u[mask].mean()), np.abs(y)])


def moving(v: Float[np.ndarray, "R N"], mask: Bool[np.ndarray, "R N"]) -> Bool[np.ndarray, "R N"]:
    """Where a vehicle moves; everywhere if no speed is known."""
    usual = float(np.quantile(np.abs(v[mask]), 0.95)) if mask.any() else 0.0
    return np.abs(v) >= _STANDS * usual


def scores(
    e: Float[np.ndarray, "R N"],
    asked: Float[np.ndarray, "k R N"],
    mask: Bool[np.ndarray, "R N"],
    dt: float,
) -> Scores:
    """Compare an error with its surrogates.

    Args:
        e: the error.
        asked: `demands`, or none.
        mask: samples that count.
        dt: sample period, s.
    """
    rng = np.random.default_rng(0)
    length = max(1, round(_STRETCH / dt))
    whole = _stretches(mask.astype(float), length) > 0.999
    if whole.sum() < _FEW:
        return Scores(0.0, 0.0, 0.0)
    recent = [history(x, seconds, dt) for seconds in _PASTS for x in asked]
    rows = _stretches(np.reshape(recent, (-1, *e.shape)), length)[:, whole]
    rows = rows - rows.mean(axis=1, keepdims=True)
    sizes = np.sqrt(np.sum(rows**2, axis=1))
    rows = rows[sizes > 0] / sizes[sizes > 0, None]

    def told(e: Float[np.ndarray, "S R N"]) -> Float[np.ndarray, "3 S"]:
        energy = _stretches(e**2, length)[:, whole]
        energy = np.log(energy + _FLOOR * energy.mean(axis=1, keepdims=True) + 1e-300)
        energy = energy - energy.mean(axis=1, keepdims=True)
        along = np.abs(energy @ rows.T).max(axis=1, initial=0.0)
        along /= np.sqrt(np.sum(energy**2, axis=1) + 1e-300)
        slow = slow_part(e, dt)[:, mask]
        slow = slow - slow.mean(axis=1, keepdims=True)
        squares = slow * slow
        second = squares.mean(axis=1)
        third, fourth = (np.einsum("sn,sn->s", squares, x) / x.shape[1] for x in (slow, squares))
        return np.stack([along, np.log(fourth / second**2), third / second**1.5])

    e = np.where(mask, e, 0.0)
    spectrum, others = np.fft.rfft(e, axis=1), []
    for _ in range(_SURROGATES // _AT_ONCE):
        phases = np.exp(2j * np.pi * rng.random((_AT_ONCE, *spectrum.shape)))
        surrogates = np.fft.irfft(spectrum * phases, e.shape[1], axis=2)
        others.append(told(np.where(mask, surrogates, 0.0)))
    every = np.concatenate(others, axis=1)
    middle, spread = every.mean(axis=1), every.std(axis=1)
    along, rare, to_a_side = (told(e[None])[:, 0] - middle) / np.maximum(spread, 1e-12)
    return Scores(float(along), float(rare), abs(float(to_a_side)))


def apart(e: Float[np.ndarray, "R N"], mask: Bool[np.ndarray, "R N"], dt: float) -> float:
    """Share of a slow error that is the difference of its means in the runs: of a disturbance a
    small one, since it comes and goes within a run. Zero where runs are short, or there is but one,
    or where the means of their parts differ as much.

    Args:
        e: the error.
        mask: samples that count.
        dt: sample period, s.
    """
    slow = slow_part(np.where(mask, e, 0.0), dt)
    runs = [row[use] for row, use in zip(slow, mask, strict=True) if use.sum() * dt > _LASTS]
    if len(runs) < 2:
        return 0.0
    every = np.concatenate(runs)
    between = sum(row.size * (row.mean() - every.mean()) ** 2 for row in runs)
    parts = np.array([[part.mean() for part in np.array_split(row, _PARTS)] for row in runs])
    within = float(np.mean(parts.var(axis=1, ddof=1))) / _PARTS
    if float(np.var(parts.mean(axis=1), ddof=1)) < _BEYOND * within:
        return 0.0  # the error wanders as far in each
    return float(between / max(float(np.sum(every**2)), 1e-300))


def _stretches(x: Float[np.ndarray, "... N"], length: int) -> Float[np.ndarray, "... K"]:
    """Means over stretches of so many rows."""
    count = x.shape[-1] // length
    return x[..., : count * length].reshape(*x.shape[:-1], count, length).mean(axis=-1)
