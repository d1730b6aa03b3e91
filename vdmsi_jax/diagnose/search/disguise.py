"""What poles and zeros of a plant tell of causes by another name, and plants that cannot.

Zeros in the right half plane tell a delay, a pole that lingers an offset, and a mode that hardly
decays what swings along.
"""

from collections.abc import Iterable, Mapping

import numpy as np

from ..actuator import swing
from ..actuator.hypothesis import Hypothesis, Refit
from ..actuator.stage import Stage
from ..actuator.starts import added, number_of, plant, shifted_by

_BEHIND = ((2, 0), (2, 1), (3, 1), (3, 2))  # orders that may lie behind a delay
_BACKWARD = 0.1  # of their distance to the origin, by which zeros of a mode are beyond the axis: of
# modes that there were, at most 0.04; of those that told a delay, from 0.2 on
_LINGERS = 2.5  # over the length of the runs, the fastest pole that may tell an offset by its start
_NEVER = 2.0  # times the gain without a mode that lingers, beyond which its own is never reached
_LEVEL = 0.05  # of the response, by which it is tried to be off


def backward(h: Hypothesis) -> np.ndarray:
    """Zeros of a plant in the right half plane, in its unit of frequency."""
    zeros = np.roots(h.num)
    return zeros[zeros.real > 0.0]


def rings_backward(stage: Stage, h: Hypothesis) -> bool:
    """Whether a resonance has zeros in the right half plane, far from the axis along which light
    modes have theirs: what it does then is to answer late, as a rational function."""
    mode = next((stage.slots[k] for k in h.active if stage.slots[k].cause == "resonance"), None)
    if mode is None:
        return False
    _, damping, share, lead = h.theta[list(mode.index)]
    zeros = np.roots([1.0 - share, 2.0 * damping * (1.0 - share) + lead, 1.0])
    return bool(zeros.size == 2 and np.any(zeros.real > _BACKWARD * np.abs(zeros)))


def lingers(stage: Stage, h: Hypothesis) -> bool:
    """Whether a pole that outlasts the better part of the runs has a zero beside it, so that the
    command hardly moves it: what it tells is an offset of each run, as the state at its start."""
    once = 1.0 / (stage.u.shape[1] * stage.dt * stage.pace)
    poles, zeros = np.roots(h.den), np.roots(h.num)
    near = np.abs(poles[:, None] - zeros) < once
    return bool(np.any(near & (np.abs(poles) < _LINGERS * once)[:, None]))


def levelled(stage: Stage, h: Hypothesis) -> list[Hypothesis]:
    """The same with an offset, up or down, for a mode that lingers and its zero."""
    number = number_of(stage, "offset")
    if number in h.active or (bare := _fleeting(stage, h)) is None:
        return []
    as_slow = (h.num[-1] / h.den[-1]) / (bare.num[-1] / bare.den[-1])
    if 1.0 / _NEVER < as_slow < _NEVER:
        bare = plant(bare, stage, bare.den, bare.num * as_slow)
    size = _LEVEL * stage.scales.response
    return [added(stage, bare, number, bias) for bias in (-size, size)]


def _fleeting(stage: Stage, h: Hypothesis) -> Hypothesis | None:
    """The same without a mode that lingers and its zero; None where there is none."""
    if not lingers(stage, h):
        return None
    poles, zeros = np.roots(h.den), np.roots(h.num)
    slow, near = np.argmin(np.abs(poles)), np.argmin(np.abs(zeros))
    if len(poles) == 1 or poles[slow].imag != 0.0 or zeros[near].imag != 0.0:
        return None
    den = np.real(np.poly(np.delete(poles, slow)))
    num = np.atleast_1d(np.real(np.poly(np.delete(zeros, near))))
    return plant(h, stage, den, num * np.trim_zeros(h.num, "f")[0])


def shifted(
    stage: Stage, plain: Refit, grid: Mapping[tuple[int, int], Refit]
) -> Iterable[Hypothesis]:
    """Plants with an offset for one that tells it by a mode that lingers: a small one beside those
    that tell none, and for that mode and its zero as much as they tell, which is the whole level of
    a plant that rests far from zero."""
    if not lingers(stage, plain.hypothesis):
        return
    number = number_of(stage, "offset")
    for h in (f.hypothesis for f in grid.values()):
        if (bare := _fleeting(stage, h)) is not None:
            yield shifted_by(stage, bare, number)
        elif not lingers(stage, h):
            yield added(stage, h, number, 0.01 * stage.scales.response)


def all_pole(stage: Stage, h: Hypothesis) -> Hypothesis:
    """The same without zeros: what a delay is worth shows beside a plant that cannot tell it."""
    return plant(h, stage, h.den, h.num[-1:])


def stilled(stage: Stage, h: Hypothesis) -> Hypothesis:
    """The same without modes that swing on: what a periodic disturbance is worth shows beside a
    plant that cannot tell it."""
    poles = np.roots(h.den)
    kept = poles[~swing.goes_on(stage, poles)]
    if len(kept) in (0, len(poles)):
        return h
    den = np.real(np.poly(kept))
    return plant(h, stage, den, h.num[-1:] * den[-1] / h.den[-1])


def waiting(
    stage: Stage, plain: Refit, grid: Mapping[tuple[int, int], Refit]
) -> Iterable[Hypothesis]:
    """Plants with a delay for one that tells it by zeros in the right half plane. A Pade
    approximation has twice the delay that its zeros amount to, and a low one falls short of it."""
    amounts = float(np.sum(np.real(1.0 / backward(plain.hypothesis)))) / stage.pace
    if amounts <= 0.0:
        return
    number = number_of(stage, "transport_delay")
    for order in [o for o in _BEHIND if o in grid]:
        for factor in (1.0, 2.0):
            yield added(stage, grid[order].hypothesis, number, factor * amounts)
