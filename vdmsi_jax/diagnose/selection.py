"""Forward selection of causes, and the elimination of those that others have made needless."""

import math
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import replace
from functools import partial

import numpy as np

from .baseline import best_of_each, closest, grown, order_of
from .disguise import backward, levelled, shifted, waiting
from .hypothesis import Hypothesis, Refit
from .lanes import FIRST_CAUSE, LEADS, POLES
from .outcome import steadiness
from .price import price, score
from .refit import refit
from .screen import Candidate, leading, screen
from .stage import Stage
from .starts import (
    bent,
    delayed,
    dragged,
    late,
    mirrored,
    nested,
    pulled_back,
    ringing,
    scanned,
    stuck,
)

_REFITTED = 7  # causes of a screen that are refitted
_SMALLER = 2  # smaller plants that are screened
_FROM_SMALLER = 4  # candidates of the screens of smaller plants that are refitted
_CLOSER = 0.7  # of the squared error of the plants screened, of one that is screened, too
_SMALL = ((1, 0), (2, 0), (2, 1), (3, 0), (3, 1))
_ALL_POLE = ((2, 0), (3, 0))
_MOST_CAUSES = 4
_PROGRESS = 0.5  # of the score by a model beside a cause, below which nothing has got better
_STEADY = 1.5  # standard errors over blocks that a second cause must be likelier by
_LIGHT, _NAME = 0.15, 20.0  # damping of a mode, and what its name may cost
_LIGHTISH, _ABOUT = 0.3, 2.0  # damping of the poles that tell it, and how far they may lie off it
_BESIDE = 0.1  # of what these are worth, that another cause may gain, or it comes first
_LITTLE = 0.02  # of what the poles are worth that tell a mode, which its name may cost
_TOLD = 10.0  # what a pole for a delay may cost
_LIKELIER = 4.0  # in twice the log-likelihood, that a smaller plant with a delay must be
_LIKELIEST = 6.0  # likewise one that is as large
_MENDS = 0.06  # of what other causes are worth, likewise
_GROWS, _GROWN = 50.0, 3  # what a cause in a small plant must gain for larger ones to be tried with
# it, and how many causes or forms are
_REACH = 60.0  # that a candidate may lie behind the best after a few steps
_PATIENT = 5  # rounds of a refit whose way is long
_PASSED, _PASSED_BY = 0.4, 2  # of what the first cause is worth, from which on another may be the
# better beginning, and how many are followed


def climbed(
    stage: Stage, plain: Refit, grid: Mapping[tuple[int, int], Refit]
) -> tuple[Refit, list[Candidate], dict[tuple, Refit]]:
    """The plain plant with one cause after another, for as long as they are worth their price; the
    screen of the plain one; and all fits on the way. Beside zeros in the right half plane a delay
    is waited for, since they tell it better at first."""

    def worth(h: Hypothesis, loglik: float) -> float:
        return 2.0 * loglik - price(stage, h)

    now, rings, allowed = plain, False, set(stage.allowed)
    aside: list[Refit] = []
    screened: list[Candidate] = []
    seen: dict[tuple, Refit] = {f.hypothesis.kind: f for f in grid.values()}
    while len(now.hypothesis.active) < _MOST_CAUSES:
        candidates = screen(stage, now)
        screened = screened or candidates
        promising = leading(stage, (c for c in candidates if c.gain > 4.0), _REFITTED)
        starts = [joined(now.hypothesis, c) for c in promising]
        if now is plain:
            starts += _in_smaller(stage, plain, grid)
            patient = [*waiting(stage, plain, grid), *ringing(stage, plain)]
            patient += shifted(stage, plain, grid)
        else:
            smaller = [h for order in _SMALL for h in late(stage, now, order)]
            lost = backward(now.hypothesis).size > 0
            patient = levelled(stage, now.hypothesis)
            for h in smaller:
                (patient if lost or _waits(stage, h) else starts).append(h)
            starts += pulled_back(stage, now)
            starts += [h for f in aside for h in _beside(stage, f, score(stage, now))]
            hidden = [f for f in aside if backward(f.hypothesis).size]
            patient += [h for f in hidden for h in _waiting(stage, f)]
            if not rings:  # or the plant would take the mode back
                starts += closest(stage, list(nested(stage, now.hypothesis)), 1)
        starts, patient = (
            [h for h in own if allowed >= set(h.active)] for own in (starts, patient)
        )
        most = max((c.gain for c in promising), default=0.0)
        several = partial(refit, worth=worth, reach=max(_REACH, 0.5 * most))
        fits = several(stage, starts)
        fits += refit(stage, patient, rounds=_PATIENT)
        fits += several(stage, _afresh(stage, plain, grid)) if now is plain else []
        fits = best_of_each([*fits, *refit(stage, mirrored(stage, fits))])
        if now is plain:
            fits += [f for small in _strongest(stage, fits, grid) for f in grown(stage, small)]
        seen |= {f.hypothesis.kind: f for f in fits}
        least = score(stage, now) + (0.0 if now is plain else _PROGRESS)
        better = [f for f in fits if score(stage, f) > least]
        if now is plain:
            gained = max((score(stage, f) - score(stage, plain) for f in better), default=0.0)
            modes = [f for f in fits if _rings(stage, f, plain, seen, gained)]
            rings, better = bool(modes), modes or better
            better = better or [f for f in fits if _is_late(stage, f, plain, seen)]
        if now is not plain:
            size = now.hypothesis.size(stage)
            better = [
                f
                for f in better
                if f.hypothesis.size(stage) < size or steadiness(stage, now, f) > _STEADY
            ]
        if not better:
            break
        first, now = now is plain, max(better, key=lambda f: score(stage, f))
        aside = _passed_by(stage, plain, now, fits) if first else []
    return now, screened, seen


def _passed_by(stage: Stage, plain: Refit, now: Refit, fits: Iterable[Refit]) -> list[Refit]:
    """The best models with one other cause, each in its own plant and in that of the plain model:
    the best cause alone may be one that imitates two."""
    least = score(stage, plain) + _PASSED * (score(stage, now) - score(stage, plain))
    had = {stage.slots[k].cause for k in now.hypothesis.active}
    picked: dict[tuple[int, ...], list[Refit]] = {}
    for f in sorted(fits, key=lambda f: -score(stage, f)):
        active = f.hypothesis.active
        if not active or had & {stage.slots[k].cause for k in active}:
            continue
        if score(stage, f) > least and len(picked) < _PASSED_BY:
            picked.setdefault(active, [f])
        elif active in picked and order_of(f.hypothesis) == order_of(plain.hypothesis):
            picked[active].append(f)
    return [f for own in picked.values() for f in own]


def _beside(stage: Stage, f: Refit, least: float) -> list[Hypothesis]:
    """Causes beside those of a model that promise to make it better than `least`."""
    able = (c for c in screen(stage, f, fine=False) if score(stage, f) + c.gain > least)
    return [joined(f.hypothesis, c) for c in leading(stage, able, _REFITTED)]


def _waiting(stage: Stage, f: Refit) -> list[Hypothesis]:
    """A model's causes in plants without zeros, which may have told a delay, and that delay."""
    own = (h for order in _ALL_POLE for h in late(stage, f, order))
    return [h for h in own if len(h.active) > len(f.hypothesis.active)]


def _in_smaller(
    stage: Stage, plain: Refit, grid: Mapping[tuple[int, int], Refit]
) -> list[Hypothesis]:
    """Causes in smaller plants, which they may make enough, a delay among them."""
    coefficients = sum(order_of(plain.hypothesis))
    orders = [o for o in _SMALL if sum(o) < coefficients]
    starts = [h for order in orders for h in late(stage, plain, order)]
    for smaller in _smaller(stage, grid, plain):
        own = screen(stage, smaller, fine=False)[:_FROM_SMALLER]
        starts += [joined(smaller.hypothesis, c) for c in own]
    return starts


def _strongest(
    stage: Stage, fits: Sequence[Refit], grid: Mapping[tuple[int, int], Refit]
) -> list[Refit]:
    """The small plants with a cause that gained most over the same plants without."""
    gained = []
    for f in fits:
        bare = grid.get(order_of(f.hypothesis))
        if bare is not None and f.hypothesis.active and f.hypothesis.poles < POLES:
            gained.append((score(stage, f) - score(stage, bare), f))
    gained = [(g, f) for g, f in gained if g > _GROWS]
    picked: dict[tuple[int, ...], Refit] = {}
    for _, f in sorted(gained, key=lambda pair: -pair[0]):
        picked.setdefault(f.hypothesis.active, f)
    return list(picked.values())[:_GROWN]


def _waits(stage: Stage, h: Hypothesis) -> bool:
    """Whether a delay is on, whose way to its best is long."""
    return any(stage.slots[number].cause == "transport_delay" for number in h.active)


def joined(h: Hypothesis, candidate: Candidate) -> Hypothesis:
    theta = candidate.theta.copy()
    theta[: LEADS[0]] = h.theta[: LEADS[0]]
    active = tuple(sorted({*h.active, candidate.number}))
    return replace(h, active=active, theta=theta, swing=candidate.swing)


def _smaller(stage: Stage, grid: Mapping[tuple[int, int], Refit], plain: Refit) -> list[Refit]:
    """The best of the smaller plants, which a cause may make enough, and of those without zeros: a
    servo's or a motor's own, as which it scores badly while its friction is not told. And what errs
    much less than these and yet scores worse: a colour of noise may take a slow error so well that
    no cause shows beside it."""
    coefficients = sum(order_of(plain.hypothesis))
    small = [f for o, f in grid.items() if sum(o) < coefficients and o in _SMALL]
    small = sorted(small, key=lambda f: -score(stage, f))
    small = small[:_SMALLER] + [f for f in small[_SMALLER:] if f.hypothesis.zeros == 0][:1]
    least = min(grid.values(), key=lambda f: f.error(stage))
    erring = min(f.error(stage) for f in [plain, *small])
    return [*small, least] if least.error(stage) < _CLOSER * erring else small


def _afresh(stage: Stage, plain: Refit, grid: Mapping[tuple[int, int], Refit]) -> list[Hypothesis]:
    """Causes that are not reached from the best plain plant."""
    plants = [plain, *_smaller(stage, grid, plain)[:1]]
    small = [*bent(stage, grid[1, 0]), *delayed(stage, grid[1, 0])]
    small += [*dragged(stage, grid), *stuck(stage)]
    return [*small, *(h for p in plants for h in scanned(stage, p))]


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
        spared = _told(stage, now, best, seen) if late else 0.0
        if score(stage, best) < score(stage, now) - spared:
            return now
        if _rings(stage, now, best, seen):
            return now
        now = best
    return now


def _told(stage: Stage, late: Refit, poles: Refit, seen: Mapping[tuple, Refit]) -> float:
    """What poles for a delay may cost: one pole a little, two more nothing; and beside other causes
    a part of what those are worth, since where their form is not exact, a delay mends it."""
    if _is_late(stage, late, poles, seen):
        return -math.inf
    if poles.hypothesis.poles > late.hypothesis.poles + 1:
        return 0.0
    if backward(poles.hypothesis).size:  # a delay by another name
        return _TOLD
    plain = max(score(stage, f) for f in seen.values() if not f.hypothesis.active)
    return max(_TOLD, _MENDS * (score(stage, poles) - plain))


def _is_late(stage: Stage, late: Refit, poles: Refit, seen: Mapping[tuple, Refit]) -> bool:
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


def without(stage: Stage, h: Hypothesis, number: int) -> Hypothesis:
    kept = tuple(k for k in h.active if k != number)
    return replace(h, active=kept, theta=cleared(stage, h, kept))


def cleared(stage: Stage, h: Hypothesis, keep: Iterable[int] = ()) -> np.ndarray:
    """The vector with all causes off but those to keep."""
    theta = stage.off.copy()
    theta[:FIRST_CAUSE] = h.theta[:FIRST_CAUSE]
    for number in keep:
        index = list(stage.slots[number].index)
        theta[index] = h.theta[index]
    return theta


def _rings(
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
    return _rings(stage, f, poles, seen, score(stage, other) - score(stage, poles))
