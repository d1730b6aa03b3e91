"""Forward selection of causes."""

from collections.abc import Iterable, Mapping, Sequence
from functools import partial

from ..actuator.hypothesis import Hypothesis, Refit
from ..actuator.lanes import POLES
from ..actuator.outcome import steadiness
from ..actuator.refit import PATIENT, refit
from ..actuator.screen import Candidate, leading, screen
from ..actuator.stage import Stage
from ..actuator.starts import (
    bent,
    delayed,
    errs_slowly,
    hilly,
    late,
    mirrored,
    nested,
    refined,
    ringing,
    scanned,
)
from ..actuator.sticking import dragged, pulled_back, stuck
from .baseline import best_of_each, closest, grown, order_of
from .disguise import backward, levelled, shifted, waiting
from .elimination import is_late, rings
from .price import price, score

_REFITTED = 7  # causes of a screen that are refitted
_SMALLER = 2  # smaller plants that are screened
_FROM_SMALLER = 4  # candidates of the screens of smaller plants that are refitted
_CLOSER = 0.7  # of the squared error of the plants screened, of one that is screened, too
_SMALL = ((1, 0), (2, 0), (2, 1), (3, 0), (3, 1))
_ALL_POLE = ((2, 0), (3, 0))
_MOST_CAUSES = 4
_PROGRESS = 0.5  # of the score by a model beside a cause, below which nothing has got better
_STEADY = 1.5  # standard errors over blocks that a second cause must be likelier by
_FINER = 4  # starts of finer forms that are refitted
_GROWS, _GROWN = 50.0, 3  # what a cause in a small plant must gain for larger ones to be tried with
# it, and how many causes or forms are
_REACH = 60.0  # that a candidate may lie behind the best after a few steps
_PASSED, _PASSED_BY = 0.4, 2  # of what the first cause is worth, from which on another may be the
# better beginning, and how many are followed


def climbed(
    stage: Stage, plain: Refit, grid: Mapping[tuple[int, int], Refit]
) -> tuple[Refit, dict[tuple, Refit]]:
    """The plain plant with one cause after another, for as long as they are worth their price; and
    all fits on the way."""
    seen: dict[tuple, Refit] = {f.hypothesis.kind: f for f in grid.values()}
    now, named, aside = _first(stage, plain, grid, seen)
    more = None if now is plain else now
    while more is not None:
        now = more
        full = len(now.hypothesis.active) >= _MOST_CAUSES
        more = None if full else _next(stage, now, aside, named, seen)
        aside = []
    return now, seen


def _first(
    stage: Stage,
    plain: Refit,
    grid: Mapping[tuple[int, int], Refit],
    seen: dict[tuple, Refit],
) -> tuple[Refit, bool, list[Refit]]:
    """The plant with the cause that is worth most, or the plain one; whether that is a mode told by
    its name; and what was passed by. Unlike later ones, a first cause is looked for in smaller
    plants as well, since the plain one may imitate it, and from starts of its own."""
    promising = _promising(stage, plain)
    starts = [c.beside(plain.hypothesis) for c in promising] + _in_smaller(stage, plain, grid)
    patient = [*waiting(stage, plain, grid), *ringing(stage, plain), *shifted(stage, plain, grid)]
    # one knot of a profile promises little, and a slow line would take their place
    patient += hilly(stage, plain.hypothesis) if errs_slowly(stage, plain) else []
    fits = _refitted(stage, promising, starts, patient, _afresh(stage, plain, grid))
    fits += [f for small in _strongest(stage, fits, grid) for f in grown(stage, small)]
    seen |= {f.hypothesis.kind: f for f in fits}
    better = [f for f in fits if score(stage, f) > score(stage, plain)]
    gained = max((score(stage, f) - score(stage, plain) for f in better), default=0.0)
    modes = [f for f in fits if rings(stage, f, plain, seen, gained)]
    better = modes or better or [f for f in fits if is_late(stage, f, plain, seen)]
    if not better:
        return plain, False, []
    best = max(better, key=lambda f: score(stage, f))
    return best, bool(modes), _passed_by(stage, plain, best, fits)


def _next(
    stage: Stage,
    now: Refit,
    aside: Sequence[Refit],
    named: bool,
    seen: dict[tuple, Refit],
) -> Refit | None:
    """A model with one cause more, or with another plant, that is worth more and steadily so; None
    where there is none.

    Args:
        aside: models that were passed by, to which a cause may be added as well.
        named: whether a mode is told by its name, which a larger plant would take back.
        seen: all fits so far, to which those made here are added.
    """
    promising = _promising(stage, now)
    starts = [c.beside(now.hypothesis) for c in promising]
    patient = levelled(stage, now.hypothesis)
    lost = backward(now.hypothesis).size > 0  # zeros that tell a delay better at first
    for h in (h for order in _SMALL for h in late(stage, now, order)):
        (patient if lost or _waits(stage, h) else starts).append(h)
    starts += pulled_back(stage, now) + closest(stage, refined(stage, now), _FINER)
    starts += [h for f in aside for h in _beside(stage, f, score(stage, now))]
    patient += [h for f in aside if backward(f.hypothesis).size for h in _waiting(stage, f)]
    if not named:
        starts += closest(stage, list(nested(stage, now.hypothesis)), 1)
    fits = _refitted(stage, promising, starts, patient)
    seen |= {f.hypothesis.kind: f for f in fits}
    size, least = now.hypothesis.size(stage), score(stage, now) + _PROGRESS
    better = [
        f
        for f in fits
        if score(stage, f) > least
        and (f.hypothesis.size(stage) < size or steadiness(stage, now, f) > _STEADY)
    ]
    return max(better, key=lambda f: score(stage, f), default=None)


def _promising(stage: Stage, now: Refit) -> list[Candidate]:
    """The causes of a screen that are worth a refit."""
    return leading(stage, (c for c in screen(stage, now) if c.gain > 4.0), _REFITTED)


def _refitted(
    stage: Stage,
    promising: Sequence[Candidate],
    starts: Sequence[Hypothesis],
    patient: Sequence[Hypothesis],
    afresh: Sequence[Hypothesis] = (),
) -> list[Refit]:
    """The best fit of each kind from some starts, those whose way is long (`patient`), and others
    that compete among themselves alone (`afresh`)."""

    def worth(h: Hypothesis, loglik: float) -> float:
        return 2.0 * loglik - price(stage, h)

    allowed = set(stage.allowed)
    starts, patient = ([h for h in own if allowed >= set(h.active)] for own in (starts, patient))
    most = max((c.gain for c in promising), default=0.0)
    several = partial(refit, worth=worth, reach=max(_REACH, 0.5 * most))
    fits = [*several(stage, starts), *refit(stage, patient, rounds=PATIENT)]
    fits += several(stage, afresh) if afresh else []
    return best_of_each([*fits, *refit(stage, mirrored(stage, fits))])


def _passed_by(stage: Stage, plain: Refit, now: Refit, fits: Iterable[Refit]) -> list[Refit]:
    """The best models with one other cause, each in its own plant and in that of the plain model:
    the best cause alone may be one that imitates two. And the best with a plainer form of the same
    cause: what the finer one has beside may be another cause's."""
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
    size = now.hypothesis.size(stage)
    forms = [
        f
        for f in fits
        if f.hypothesis.size(stage) < size
        and had == {stage.slots[k].cause for k in f.hypothesis.active}
        and score(stage, f) > least
    ]
    plainer = max(forms, key=lambda f: score(stage, f), default=None)
    passed = [f for own in picked.values() for f in own]
    return passed if plainer is None else [*passed, plainer]


def _beside(stage: Stage, f: Refit, least: float) -> list[Hypothesis]:
    """Causes beside those of a model that promise to make it better than `least`."""
    able = (c for c in screen(stage, f, fine=False) if score(stage, f) + c.gain > least)
    return [c.beside(f.hypothesis) for c in leading(stage, able, _REFITTED)]


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
        starts += [c.beside(smaller.hypothesis) for c in own]
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
