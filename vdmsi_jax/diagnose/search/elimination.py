"""The elimination of causes that others, or poles, have made needless."""

import math
from collections.abc import Collection, Mapping

import numpy as np

from ..actuator.hypothesis import Hypothesis, Refit, without
from ..actuator.refit import refit
from ..actuator.stage import Stage
from .baseline import best_of_each, order_of
from .disguise import backward
from .price import score

_LIGHT, _NAME = 0.11, 20.0  # damping of a mode, and what its name may cost
_LIGHTISH, _ABOUT = 0.3, 2.0  # damping of the poles that tell it, and how far they may lie off it
_BESIDE = 0.1  # of what these are worth, that another cause may gain, or it comes first
_LITTLE = 0.02  # of what the poles are worth that tell a mode, which its name may cost
_TOLD = 10.0  # what a pole for a delay may cost
_LIKELIER = 4.0  # in twice the log-likelihood, that a smaller plant with a delay must be
_LIKELIEST = 6.0  # likewise one that is as large
_MENDS = 0.06  # of what other causes are worth, likewise


def eliminate(
    stage: Stage, now: Refit, seen: dict[tuple, Refit], borne: Collection[int] = ()
) -> Refit:
    """Take causes out again that others have made needless, or a plant of another order, but none
    of those borne out: what was seen without one is refitted from where it stood. A pole is
    believed rather than a delay, and a resonance rather than the poles that could stand for it."""
    while out := [number for number in now.hypothesis.active if number not in borne]:
        starts = [without(stage, now.hypothesis, number) for number in out]
        known = []
        for kept in (set(h.active) for h in starts):
            own = [f for f in seen.values() if set(f.hypothesis.active) == kept]
            known += sorted(own, key=lambda f: -score(stage, f))[:1]
        again = [f.hypothesis for f in known if f.hypothesis.active]
        fits = best_of_each([*refit(stage, starts + again), *known])
        best = max(fits, key=lambda f: score(stage, f))
        gone = next(iter(set(now.hypothesis.active) - set(best.hypothesis.active)))
        late = stage.slots[gone].cause == "transport_delay"
        spared = _spared(stage, now, best, seen) if late else 0.0
        if score(stage, best) < score(stage, now) - spared:
            return now
        if rings(stage, now, best, seen):
            return now
        now = best
    return now


def _spared(stage: Stage, late: Refit, poles: Refit, seen: Mapping[tuple, Refit]) -> float:
    """What poles for a delay may cost: one pole a little, two more nothing; and beside other causes
    a part of what those are worth, since where their form is not exact, a delay mends it."""
    if is_late(stage, late, poles, seen):
        return -math.inf
    if poles.hypothesis.poles > late.hypothesis.poles + 1:
        return 0.0
    if backward(poles.hypothesis).size:  # a delay by another name
        return _TOLD
    plain = max(score(stage, f) for f in seen.values() if not f.hypothesis.active)
    return max(_TOLD, _MENDS * (score(stage, poles) - plain))


def is_late(stage: Stage, late: Refit, poles: Refit, seen: Mapping[tuple, Refit]) -> bool:
    """Whether a plant with a delay, and nothing else more, is likelier than one without that is
    larger, or as large while a pole or a zero more would not be likelier either: what a cause costs
    keeps poles from being told as a delay, but these are less likely, too."""
    active = set(poles.hypothesis.active)
    more = set(late.hypothesis.active) - active
    lead, own = 2.0 * (late.loglik - poles.loglik), late.hypothesis.size(stage)
    if [stage.slots[number].cause for number in more] != ["transport_delay"]:
        return False
    if own != poles.hypothesis.size(stage):
        return own < poles.hypothesis.size(stage) and lead > _LIKELIER
    beyond = (f for f in seen.values() if set(f.hypothesis.active) == active)
    larger = (f.loglik for f in beyond if f.hypothesis.size(stage) == own + 1)
    return lead > _LIKELIEST and late.loglik > max(larger, default=-math.inf)


def rings(
    stage: Stage, f: Refit, plain: Refit, seen: Mapping[tuple, Refit], other: float = 0.0
) -> bool:
    """Whether a fit tells lightly damped poles of a larger plant by their name, as well as it, or
    nearly all of what they are worth, and the mode is worth more than its name costs, and far more
    than what any `other` cause gains in the larger plant."""
    h, others = f.hypothesis, set(plain.hypothesis.active)
    named = [stage.slots[number] for number in h.active if number not in others]
    if [slot.cause for slot in named] != ["resonance"] or not others < set(h.active):
        return False
    (slot,) = named
    frequency, damping = (
        h.theta[slot.index[slot.names.index(n)]] for n in ("frequency", "damping")
    )
    if not _swings(stage, plain.hypothesis, 2.0 * np.pi * frequency):
        return False
    bare = seen.get((*order_of(h), frozenset(others)))
    if bare is None or score(stage, bare) > score(stage, f):
        return False
    smaller = sum(order_of(h)) < sum(order_of(plain.hypothesis))
    worth, lacks = (score(stage, plain) - score(stage, other) for other in (bare, f))
    most = min(0.5 * worth, max(_NAME, _LITTLE * worth))
    return bool(smaller and damping < _LIGHT and lacks < most and other < _BESIDE * worth)


def _swings(stage: Stage, h: Hypothesis, frequency: float) -> bool:
    """Whether a plant has lightly damped poles about a frequency, rad/s."""
    poles = np.roots(h.den) * stage.pace
    size = np.abs(poles)
    about = (size > frequency / _ABOUT) & (size < frequency * _ABOUT)
    return bool(np.any(about & (np.abs(poles.real) < _LIGHTISH * size)))


def rings_rather(stage: Stage, f: Refit, other: Refit, seen: Mapping[tuple, Refit]) -> bool:
    """Whether a fit tells by its name a mode that another one tells by poles, beside a cause that
    is worth little."""
    shared = frozenset(f.hypothesis.active) & set(other.hypothesis.active)
    poles = seen.get((*order_of(other.hypothesis), shared))
    if poles is None:
        return False
    return rings(stage, f, poles, seen, score(stage, other) - score(stage, poles))
