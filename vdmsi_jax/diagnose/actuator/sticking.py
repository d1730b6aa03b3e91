"""Where refits of what friction or drag holds start: no small step leads to these from a plant that
a linear fit took them for."""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from .hypothesis import Hypothesis, Refit, without
from .lanes import LEADS, NUMERATOR, POLES
from .stage import Stage
from .starts import added, plant, with_gains

_DRAGGED, _DRAG = ((1, 0), (2, 0)), (0.35, 0.7)  # plants, and shares of their damping
_STUCK_PACES, _STUCK_DAMPINGS, _STUCK = (1.0, 2.0, 4.0), (0.3, 1.0), (0.0, 0.01, 0.03, 0.1)
_STICKS = 0.9  # of the error without friction, below which plants with it are begun from
_HELD_PACES, _HELD_DAMPING = np.array([1.0, 2.0]), 0.5  # of a body that friction holds on a spring


def dragged(stage: Stage, grid: Mapping[tuple[int, int], Refit]) -> list[Hypothesis]:
    """Plants of which a part of the damping is drag: what is left brakes less, and at the usual
    speed both together as much as the plant that a linear fit took them for, whose pole is far from
    either where drag is strong."""
    numbers = [k for k in stage.allowed if stage.slots[k].cause == "drag"]
    usual = float(np.mean(np.abs(stage.y[stage.mask])))
    made = []
    for number in numbers if usual > 0.0 else []:
        for order in _DRAGGED:
            h = grid[order].hypothesis
            pull, damping = h.den[-1], h.den[-2]
            for share in _DRAG:
                theta = h.theta.copy()
                theta[h.poles - 1] = (1.0 - share) * pull
                theta[NUMERATOR] *= 1.0 - 0.5 * share
                spent = 0.5 * share * pull / max(abs(damping), 1e-9) * stage.pace / usual
                theta[stage.slots[number].index[0]] = spent
                made.append(replace(h, active=(number,), theta=theta))
    return made


def stuck(stage: Stage) -> list[Hypothesis]:
    """Plants of two poles that friction holds, the gain by least squares, where they explain the
    response itself better than the same without: a linear fit takes the lag of what sticks for
    poles and zeros, from which no refit finds back."""
    made = []
    for number in _against_motion(stage):
        slot = stage.slots[number]
        levels = np.array(_STUCK) * stage.scales.command
        ladder = [(w, zeta) for w in _STUCK_PACES for zeta in _STUCK_DAMPINGS]
        thetas = np.repeat(stage.off[None], len(levels) * len(ladder), axis=0)
        paces, dampings = np.tile(np.array(ladder).T, len(levels))
        thetas[:, 0], thetas[:, 1] = 2.0 * dampings * paces, paces**2
        thetas[:, POLES + 1] = paces**2
        thetas[:, slot.index[0]] = np.repeat(levels, len(ladder))
        errors, scaled = with_gains(stage, thetas)
        free = errors[: len(ladder)].min()
        best = np.argsort(errors)[:2]
        made += [Hypothesis(2, 0, (number,), scaled[k]) for k in best if errors[k] < _STICKS * free]
    return made


def held(stage: Stage, h: Hypothesis, number: int) -> list[Hypothesis]:
    """Friction in the place of a play: what it holds is a body on a spring behind the rest of the
    plant, as a valve's stem behind its actuator, whose fastest poles a mode takes the place of.
    None where that friction is beside the play already."""
    slot, bare = stage.slots[number], without(stage, h, number)
    poles = np.roots(bare.den)
    poles = poles[np.argsort(np.abs(poles))]
    gain, fastest = bare.num[-1] / bare.den[-1], poles[-1]
    behind = poles[: -2 if fastest.imag else -1]
    if not behind.size or behind.size > POLES - 2 or behind[0].imag or gain == 0.0:
        return []
    made, level = [], abs(0.5 * h.theta[slot.index[0]] / gain)
    for k in (k for k in _against_motion(stage) if k not in h.active):
        for pace in _HELD_PACES * abs(fastest):
            mode = [1.0, 2.0 * _HELD_DAMPING * pace, pace**2]
            den = np.polymul(np.poly(behind).real, mode)
            start = plant(bare, stage, den, np.array([gain * den[-1]]))
            own = added(stage, start, k, (level, 0.3 * level, 0.0))
            own.theta[LEADS[0]] = 1.0 / abs(behind[0])
            made.append(own)
    return made


def pulled_back(stage: Stage, now: Refit) -> list[Hypothesis]:
    """What pulls back a response that friction holds, bent: beside sticking and slipping a small
    step tells little of it, and the screen nothing."""
    h, made = now.hypothesis, []
    active = [stage.slots[number] for number in h.active]
    if not any(slot.rough for slot in active):
        return []
    for number in stage.allowed:
        slot = stage.slots[number]
        if getattr(slot.effect, "by", None) != "stiffness":
            continue
        if any(own.cause == slot.cause for own in active):
            continue
        made += [added(stage, h, number, p) for p in slot.effect.probes(stage.scales)]
    return made


def _against_motion(stage: Stage) -> list[int]:
    """Numbers of the friction that holds what rests, and no speed."""
    own = ((k, stage.slots[k]) for k in stage.allowed)
    return [
        k
        for k, slot in own
        if slot.cause == "coulomb_friction" and getattr(slot.effect, "against", "") == "rate"
    ]
