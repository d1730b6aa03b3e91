"""From a stage to the causes that explain it: baseline, forward selection, elimination, rivals."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace

import numpy as np

from .baseline import baselines, best_of_each, closest, grown, key_of, order_of
from .found import Failed, Finding, Search
from .judge import Scored, confirmed, gain_of
from .outcome import completed, steadiness
from .price import CAUSE_COST, lack, price, score
from .refit import Hypothesis, Refit, refit
from .screen import RAGGED, Candidate, screen
from .stage import FIRST_CAUSE, LEADS, POLES, Stage
from .starts import (
    all_pole,
    backward,
    bent,
    hilly,
    late,
    mirrored,
    nested,
    ringing,
    scanned,
    shifted,
    waiting,
)

_REFITTED = 10  # candidates of a screen that are refitted
_SMALLER = 2  # smaller plants that are screened
_FROM_SMALLER = 4  # candidates of the screens of smaller plants that are refitted
_SMALL = ((1, 0), (2, 0), (2, 1), (3, 0), (3, 1))
_MOST_CAUSES = 4
_STEADY = 1.5  # standard errors over blocks that a second cause must be likelier by
_APART = 1.7  # standard errors over blocks, from which two causes are told apart
_CLOSE, _FORM, _FAR = 15.0, 0.1, 50.0  # lack, the same as a share of the gain, and lack again, up
# to which blocks are asked; beyond, it is no matter of form: 61 answers of four exams
_LOOPS = {"backlash", "coulomb_friction"}
_LOOP = 0.25  # share of the gain, up to which blocks are asked which of them it is
_LOOP_APART = 1.5  # standard errors that do: of ten answers wrong ones had up to 1.2
SWAPS = 3
SWAPPED = 2.0  # by which another cause must be better to take a place
_RIVALS = 8  # that are told
_LIGHT, _NAME = 0.15, 20.0  # damping of a mode, and what its name may cost
_TOLD = 10.0  # what a pole for a delay may cost
_MENDS = 0.06  # of what other causes are worth, likewise
_LITTLE = 0.02  # of what the poles are worth that tell a mode, which its name may cost
_GROWS = 50.0  # that a cause in a small plant must gain for larger ones to be tried with it
_MUCH, _SURE = 0.4, 2.5  # share of the error, and standard errors, that data held out bear out
_SLOW = 4.0  # squared error over innovations, from which on a part of it is slow
_WORSENED = 0.2  # of the squared error on data held out, by which a cause may usually raise it
_MADE_UP = 0.05  # of it, that it must take on the whole if it does
FREE = 6.0
"""Weight of a cause from which on it can draw nearly any error."""
_BORNE_OUT = 0.25  # of what such a cause takes where it is fitted, that must last elsewhere
_REACH = 60.0  # that a candidate may lie behind the best after a few steps


def search(stage: Stage) -> Search:
    """Find the causes that a stage's data support."""
    whole, stage = stage, stage.fitting
    grid = baselines(stage)
    plain = max(grid.values(), key=lambda f: score(stage, f))
    now, screened, seen = climbed(stage, plain, grid)
    now, findings = _swapped(stage, now, seen, set())
    failed: list[Failed] = []
    while True:
        found = _whole(whole, stage, plain, grid, now, findings)
        worth = [_confirmed(found, f) for f in found.findings]
        numbers = {f.finding.number for f in failed}
        against = Scored("", whole.y, found.plain.y, found.final.y, found.final.colour)
        if not worth or (min(worth) > 0.0 and not _worse(against, whole)):
            more = _borne_out(found, seen, numbers)
            if more is None:
                told = _foretold(whole, found.findings)
                return replace(found, findings=told, screened=tuple(screened), failed=tuple(failed))
            now = more
        else:
            worst = _first_out(found.findings, worth)
            failed.append(Failed(found.findings[worst], found.final))
            numbers.add(findings[worst].number)
            now = _instead(stage, findings[worst].less, seen, numbers)
        now, findings = _swapped(stage, now, seen, numbers)


def _swapped(
    stage: Stage, now: Refit, seen: dict[tuple, Refit], failed: set[int]
) -> tuple[Refit, tuple[Finding, ...]]:
    """A model without needless causes, and with others in their place where those explain more and
    have not failed; and what its causes are worth."""
    for _ in range(SWAPS):
        now = _eliminate(stage, now, seen)
        findings, other = _findings(stage, now, seen)
        if other is None or failed & set(other.hypothesis.active):
            return now, findings
        if score(stage, other) < score(stage, now) + SWAPPED:
            return now, findings
        now = other
    return now, _findings(stage, now, seen)[0]


def _first_out(findings: Sequence[Finding], worth: Sequence[float]) -> int:
    """Of several causes that fail together, the one that gained least: it may spoil the others."""
    failing = [k for k, w in enumerate(worth) if w <= 0.0] or [worth.index(min(worth))]
    return min(failing, key=lambda k: findings[k].gain)


def _whole(
    whole: Stage,
    stage: Stage,
    plain: Refit,
    grid: Mapping[tuple[int, int], Refit],
    now: Refit,
    findings: Sequence[Finding],
) -> Search:
    """What was found in the runs that were fitted, over all runs."""
    bare = replace(now.hypothesis, active=(), theta=_cleared(stage, now.hypothesis))
    order = order_of(now.hypothesis)
    baseline = grid[order] if order in grid else refit(stage, [bare])[0]
    if score(stage, plain) > score(stage, baseline) or not findings:
        baseline = plain
    if not findings:
        now = plain
    kept = [plain, baseline, now, *(f.less for f in findings)]
    plain, baseline, now, *less = completed(whole, kept)
    findings = tuple(replace(f, less=k) for f, k in zip(findings, less, strict=True))
    return Search(whole, plain, baseline, now, findings, ())


def _foretold(whole: Stage, findings: Sequence[Finding]) -> tuple[Finding, ...]:
    """Findings with what the screen had promised over all runs."""
    known = [f.promised for f in findings if f.promised is not None]
    every = iter(completed(whole, known) if known else [])
    return tuple(f if f.promised is None else replace(f, promised=next(every)) for f in findings)


def _confirmed(found: Search, finding: Finding) -> float:
    """Twice the log-likelihood that a cause gains on data held out, beside all the others, or as
    much less than nothing where the plain error gets clearly worse; what it gained in the fit where
    none is held out."""
    stage = found.stage
    if stage.held_out.sum() <= 50:
        return finding.gain
    less = found.without(finding)
    scored = Scored("", stage.y, less.y, found.final.y, found.final.colour)
    worth = confirmed(scored, stage.held_out, stage.dt)[0]
    fails = _worse(scored, stage) or _drawn(stage, finding.number, scored)
    return -abs(worth) if fails else worth


def _drawn(stage: Stage, number: int, scored: Scored) -> bool:
    """Whether a cause with many parameters has drawn the error that was fitted, and tells little of
    that of data held out."""
    if stage.slots[number].weight < FREE:
        return False
    return scored.taken(stage.held_out) < _BORNE_OUT * scored.taken(stage.mask)


def _worse(scored: Scored, stage: Stage) -> bool:
    """Whether the plain error of data held out usually gets clearly larger, and is not made up for
    on the whole."""
    use = stage.held_out
    if use.sum() <= 50 or scored.taken(use) > _MADE_UP:
        return False
    return bool(np.median(scored.parts(use, stage.dt)) < -_WORSENED)


def _instead(stage: Stage, less: Refit, seen: Mapping[tuple, Refit], failed: set[int]) -> Refit:
    """The best model without what failed: `less`, or one that was passed by on the way. The causes
    beside it that failed may have served it alone."""
    fits = [f for f in seen.values() if not failed & set(f.hypothesis.active)]
    return max([less, *fits], key=lambda f: score(stage, f))


def _borne_out(found: Search, seen: Mapping[tuple, Refit], failed: set[int]) -> Refit | None:
    """The final model with a cause more that is not worth its price where it was fitted, and yet
    takes much of the error, there and on data held out: of what is slow, an estimated colour takes
    most of the evidence. Hills, which are slow, are always among them."""
    stage, final = found.stage, found.final
    if stage.held_out.sum() <= 50:
        return None
    seen_error = final.error(stage)
    had = set(final.hypothesis.active)
    h = final.hypothesis
    if h.swing is not None:
        h = replace(h, swing=h.swing[stage.mask.any(axis=1)])
    more = [] if seen_error < _SLOW * final.variance else hilly(stage.fitting, h)
    fits = [
        f
        for f in [*seen.values(), *refit(stage.fitting, more)]
        if had < set(f.hypothesis.active) and len(f.hypothesis.active) == len(had) + 1
        if not failed & set(f.hypothesis.active)
        if f.loglik > final.loglik and f.error(stage.fitting) < (1.0 - _MUCH) * seen_error
    ]
    best, most = None, _MUCH
    for f, whole in zip(fits, completed(stage, fits) if fits else [], strict=True):
        scored = Scored("", stage.y, final.y, whole.y, whole.colour)
        gain = gain_of(scored, stage.held_out, True, stage.dt)
        worth = confirmed(scored, stage.held_out, stage.dt)[0]
        sure = gain.after - gain.before > _SURE * gain.se
        if sure and worth > CAUSE_COST and scored.taken(stage.held_out) > most:
            best, most = f, scored.taken(stage.held_out)
    return best


def climbed(
    stage: Stage, plain: Refit, grid: Mapping[tuple[int, int], Refit]
) -> tuple[Refit, list[Candidate], dict[tuple, Refit]]:
    """The plain plant with one cause after another, for as long as they are worth their price; the
    screen of the plain one; and all fits on the way. Beside zeros in the right half plane a delay
    is waited for, since they tell it better at first."""

    def worth(h: Hypothesis, loglik: float) -> float:
        return 2.0 * loglik - price(stage, h)

    now, rings = plain, False
    screened: list[Candidate] = []
    seen: dict[tuple, Refit] = {key_of(f.hypothesis): f for f in grid.values()}
    while len(now.hypothesis.active) < _MOST_CAUSES:
        candidates = screen(stage, now)
        screened = screened or candidates
        promising = [c for c in candidates if c.gain > 4.0][:_REFITTED]
        starts = [joined(now.hypothesis, c) for c in promising]
        patient: list[Hypothesis] = []
        if now is plain:
            starts += _in_smaller(stage, plain, grid)
        else:
            smaller = [h for order in _SMALL for h in late(stage, now, order)]
            (patient if backward(now.hypothesis).size else starts).extend(smaller)
            if not rings:  # or the plant would take the mode back
                starts += closest(stage, list(nested(stage, now.hypothesis)), 1)
        most = max((c.gain for c in promising), default=0.0)
        fits = refit(stage, starts, worth=worth, reach=max(_REACH, 0.5 * most))
        fits += refit(stage, patient)
        fits = best_of_each([*fits, *refit(stage, mirrored(stage, fits))])
        if now is plain:
            fits += _afresh(stage, plain, grid)
            fits += [f for small in _strongest(stage, fits, grid) for f in grown(stage, small)]
        seen |= {key_of(f.hypothesis): f for f in fits}
        better = [f for f in fits if score(stage, f) > score(stage, now)]
        if now is plain and not better:
            better = [f for f in fits if _rings(stage, f, plain, seen)]
            rings = bool(better)
        if now is not plain:
            size = now.hypothesis.size(stage)
            better = [
                f
                for f in better
                if f.hypothesis.size(stage) < size or steadiness(stage, now, f) > _STEADY
            ]
        if not better:
            break
        now = max(better, key=lambda f: score(stage, f))
    return now, screened, seen


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
    return list(picked.values())[:2]


def joined(h: Hypothesis, candidate: Candidate) -> Hypothesis:
    theta = candidate.theta.copy()
    theta[: LEADS[0]] = h.theta[: LEADS[0]]
    active = tuple(sorted({*h.active, candidate.number}))
    return replace(h, active=active, theta=theta, swing=candidate.swing)


def _smaller(stage: Stage, grid: Mapping[tuple[int, int], Refit], plain: Refit) -> list[Refit]:
    """The best of the smaller plants, which a cause may make enough, and of those without zeros: a
    servo's or a motor's own, as which it scores badly while its friction is not told."""
    coefficients = sum(order_of(plain.hypothesis))
    small = [f for o, f in grid.items() if sum(o) < coefficients and o in _SMALL]
    small = sorted(small, key=lambda f: -score(stage, f))
    return small[:_SMALLER] + [f for f in small[_SMALLER:] if f.hypothesis.zeros == 0][:1]


def _cleared(stage: Stage, h: Hypothesis, keep: Iterable[int] = ()) -> np.ndarray:
    """The vector with all causes off but those to keep."""
    theta = stage.off.copy()
    theta[:FIRST_CAUSE] = h.theta[:FIRST_CAUSE]
    for number in keep:
        index = list(stage.slots[number].index)
        theta[index] = h.theta[index]
    return theta


def _without(stage: Stage, h: Hypothesis, number: int) -> Hypothesis:
    kept = tuple(k for k in h.active if k != number)
    return replace(h, active=kept, theta=_cleared(stage, h, kept))


def _eliminate(stage: Stage, now: Refit, seen: dict[tuple, Refit]) -> Refit:
    """Take causes out again that others have made needless, or a plant of another order: what was
    seen without one is refitted from where it stood. A pole is believed rather than a delay, and a
    resonance rather than the poles that could stand for it."""
    while now.hypothesis.active:
        starts = [_without(stage, now.hypothesis, number) for number in now.hypothesis.active]
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
    if poles.hypothesis.poles > late.hypothesis.poles + 1:
        return 0.0
    if backward(poles.hypothesis).size:  # a delay by another name
        return _TOLD
    plain = max(score(stage, f) for f in seen.values() if not f.hypothesis.active)
    return max(_TOLD, _MENDS * (score(stage, poles) - plain))


def _findings(
    stage: Stage, final: Refit, seen: Mapping[tuple, Refit]
) -> tuple[tuple[Finding, ...], Refit | None]:
    """Each cause of the final model with what it is worth there and what could stand in its
    place; and the best fit with another in the place of one."""
    found, tried = [], []
    for number in final.hypothesis.active:
        less = refit(stage, [_without(stage, final.hypothesis, number)])[0]
        if stage.slots[number].cause == "transport_delay" and backward(less.hypothesis).size:
            less = refit(stage, [all_pole(stage, less.hypothesis)])[0]
        gain = 2.0 * (final.loglik - less.loglik)
        screened = screen(stage, less, fine=stage.slots[number].cause in RAGGED)
        probes = [joined(less.hypothesis, c) for c in screened if c.number == number]
        promised = next(iter(refit(stage, probes, rounds=1)), None)
        others = [c for c in screened if c.number != number and c.gain > 0.2 * gain][:6]
        fits = refit(stage, [joined(less.hypothesis, c) for c in others])
        kept, own = set(less.hypothesis.active), stage.slots[number]
        fits += [
            f
            for f in seen.values()
            if kept < set(f.hypothesis.active) and len(f.hypothesis.active) == len(kept) + 1
            if number not in f.hypothesis.active
            # the cause itself, not a larger plant that imitates the one it stands for
            if (bare := seen.get((*order_of(f.hypothesis), frozenset(kept)))) is not None
            and score(stage, f) > score(stage, bare)
        ]
        best: dict[int, Refit] = {}
        for f in fits:
            other = next(k for k in f.hypothesis.active if k not in kept)
            if other not in best or score(stage, f) > score(stage, best[other]):
                best[other] = f
        tried += best.values()
        rivals = [
            (k, lack(stage, final, f)) for k, f in best.items() if stage.slots[k].cause != own.cause
        ]
        rivals = sorted(rivals, key=lambda pair: pair[1])[:_RIVALS]
        near = [k for k, lacks in rivals if _near(own.cause, stage.slots[k].cause, lacks, gain)]
        alike = [
            k
            for k in near
            if steadiness(stage, best[k], final) < _apart(own.cause, stage.slots[k].cause)
        ]
        found.append(Finding(number, gain, less, tuple(rivals), promised, tuple(alike)))
    best_other = max(tried, key=lambda f: score(stage, f), default=None)
    return tuple(sorted(found, key=lambda f: -f.gain)), best_other


def _near(cause: str, other: str, lacks: float, gain: float) -> bool:
    """Whether a cause lacks so little that the form of another may not be exact enough to part
    them: of a play and friction, which each make the other's loop, more than of the rest."""
    if {cause, other} == _LOOPS:
        return lacks < max(_CLOSE, _LOOP * gain)
    return lacks < min(_FAR, max(_CLOSE, _FORM * gain))


def _apart(cause: str, other: str) -> float:
    """Standard errors over blocks from which the two are told apart."""
    return _LOOP_APART if {cause, other} == _LOOPS else _APART


def _afresh(stage: Stage, plain: Refit, grid: Mapping[tuple[int, int], Refit]) -> list[Refit]:
    """Fits of causes that are not reached from the best plain plant."""
    plants = [plain, *_smaller(stage, grid, plain)[:1]]
    starts = [*bent(stage, grid[1, 0]), *waiting(stage, plain, grid), *ringing(stage, plain)]
    starts += [*shifted(stage, plain, grid), *(h for at in plants for h in scanned(stage, at))]
    fits = refit(stage, starts)
    return best_of_each([*fits, *refit(stage, mirrored(stage, fits))])


def _rings(stage: Stage, f: Refit, plain: Refit, seen: Mapping[tuple, Refit]) -> bool:
    """Whether a fit tells lightly damped poles of a larger plant by their name, as well as it, or
    nearly all of what they are worth, and the mode is worth more than its name costs."""
    h, others = f.hypothesis, set(plain.hypothesis.active)
    named = [stage.slots[number] for number in h.active if number not in others]
    if [slot.cause for slot in named] != ["resonance"] or not others < set(h.active):
        return False
    (slot,) = named
    damping = h.theta[slot.index[slot.names.index("damping")]]
    bare = seen.get((*order_of(h), frozenset(others)))
    if bare is None or score(stage, bare) > score(stage, f):
        return False
    smaller = sum(order_of(h)) < sum(order_of(plain.hypothesis))
    worth, lacks = (score(stage, plain) - score(stage, other) for other in (bare, f))
    most = min(0.5 * worth, max(_NAME, _LITTLE * worth))
    return smaller and damping < _LIGHT and lacks < most
