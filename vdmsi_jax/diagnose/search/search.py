"""From a stage to the causes that explain it: baseline, forward selection, elimination, rivals,
and what data held out bear out of it."""

import math
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from jaxtyping import Bool, Float

from ..actuator import swing
from ..actuator.feedback import is_answered
from ..actuator.hypothesis import Refit, cleared, responses, without
from ..actuator.outcome import completed
from ..actuator.refit import PATIENT, at_rest, refit
from ..actuator.screen import acts_in_steps
from ..actuator.stage import Stage
from ..actuator.starts import errs_slowly, hilly
from ..signals.colour import whiten
from ..signals.disturbance import IMITATORS
from ..signals.noise import BriefNoise, OwnNoise
from ..signals.unexplained import extent
from .baseline import baselines, order_of
from .disguise import stilled
from .elimination import eliminate, rings_rather
from .found import FEW, Failed, PlantFinding, Search
from .judge import Scored, confirmed, gain_of
from .price import CAUSE_COST, score
from .rivals import findings_of, worths
from .selection import climbed

SWAPS = 3
_MOVED = 1.0  # gain on the way to rest, after which a cause may have become needless
SWAPPED = 2.0  # by which another cause must be better to take a place
_SIMPLER = 3  # parameters less, from which on it may be worse by as much
_AGAIN = 2  # failures after which the way is gone again without what failed
_MUCH, SURE = 0.4, 2.5  # share of the error, and standard errors, that data held out bear out
_SURER = 3.0  # standard errors likewise, of a cause that can draw nearly any error
_CLOSE, _LASTS = 5.0, 0.2  # of the score, that a cause may lack; share that it must take elsewhere
WORSENED = 0.2  # of the squared error on data held out, by which a cause may usually raise it
MADE_UP = 0.05  # of it, that it must take on the whole if it does
FREE = 6.0
"""Weight of a cause from which on it can draw nearly any error."""
_CLEAR = 2.0  # standard deviations, below which a parameter may be nothing
_SHOWN = 0.45  # of what a rounding does, that the error without it holds: of 24 right ones of the
# hunt and of exams it was 0.62 to 1.08, of wrong ones 0.32 and 0.01
_BORNE_OUT = 0.25  # of what such a cause takes where it is fitted, that must last elsewhere

_BRIEF = 0.1  # of the plant's time constant, that noise may last
_LARGE, _LASTING = 0.04, 3.0  # of the response's spread, and of the innovations' variance, beyond
# which an error is asked for by brief noise
_TAKES = 0.25  # of it, that the causes found so must take from data held out


class ActsInSteps(Exception):  # noqa: N818 - no error: it asks for the log's own rows
    """A command acts in steps that only the rows of the log itself can tell."""


def search(stage: Stage, may_step: bool = True) -> Search:
    """Find the causes that a stage's data support; where noise of its own colour leaves an error
    that is large and lasts, those by noise that is brief, if data held out bear these out.

    Raises:
        ActsInSteps: `may_step`, and the stage's rows are means of the log's own, and those have to
            be looked at.
    """
    found = _search(stage, may_step)
    if not _lasts(found):
        return found
    stage = found.stage
    brief = BriefNoise(_BRIEF * stage.scales.time_constant, stage.dt)
    known = {f.number for f in found.findings}
    # what is linear shows in the innovations, whatever their colour
    barred = (IMITATORS | {"transport_delay"}) - {"offset"}
    asked = tuple(k for k in stage.allowed if k in known or stage.slots[k].cause not in barred)
    other = _search(replace(stage, noise=brief, allowed=asked))
    return other if _bears_out(found, other) else found


def _lasts(found: Search) -> bool:
    """Whether the model leaves an error that `lasts`. Not where a controller answers it, whose
    commands tell it by themselves."""
    stage, error = found.stage, found.final.error(found.stage)
    if not isinstance(stage.noise, OwnNoise) or stage.held_out.sum() <= FEW:
        return False
    large = lasts(error, found.final.variance, stage.y[stage.mask])
    return large and not is_answered(stage, found.final)


def _bears_out(found: Search, other: Search) -> bool:
    """Whether data held out bear another search out."""
    if not other.findings:
        return False
    stage = found.stage
    scored = Scored.of_stage(stage, found.final, other.final)
    return clearly_less(scored, stage.held_out, stage.dt)


def lasts(error: float, variance: float, response: Float[np.ndarray, " n"]) -> bool:
    """Whether a mean squared error is large beside the response and much larger than its
    innovations': a colour that is estimated takes it for noise, whatever makes it."""
    return math.sqrt(error) > _LARGE * extent(response) and error > _LASTING * variance


def clearly_less(scored: Scored, use: Bool[np.ndarray, "R N"], dt: float) -> bool:
    """Whether the error of data held out is less after than before, surely and by much."""
    return gain_of(scored, use, True, dt).sureness > SURE and scored.taken(use) > _TAKES


@dataclass
class _Path:
    """Where a search has been: what it must not try again, so that it comes to an end."""

    failed: list[Failed] = field(default_factory=list)
    borne: set[int] = field(default_factory=set)  # that data held out bear out, whatever they cost
    swapped: set[tuple] = field(default_factory=set)  # kinds that took a place
    swaps: int = 0  # since a cause last failed or was borne out

    @property
    def barred(self) -> set[int]:
        """Causes that data held out did not bear out."""
        return {f.finding.number for f in self.failed}

    def may_swap(self, kind: tuple) -> bool:
        """Whether a model may take the place: one that had it, and failed, would do so for ever."""
        return self.swaps < SWAPS and kind not in self.swapped

    def swap(self, kind: tuple) -> None:
        """Note the kind of a model that takes the place."""
        self.swapped.add(kind)
        self.swaps += 1


def _search(stage: Stage, may_step: bool = False) -> Search:
    """What one kind of noise lets the data support."""
    whole, stage = stage, stage.fitting
    grid = baselines(stage)
    plain = max(grid.values(), key=lambda f: score(stage, f))
    if may_step and acts_in_steps(stage, plain):
        raise ActsInSteps
    if is_answered(stage, plain):
        whole, stage = whole.looped(), stage.looped()
    now, seen = climbed(stage, plain, grid)
    path = _Path()
    while True:
        now = _settled(stage, now, seen, path.borne)
        findings = worths(stage, now)
        found = _whole(whole, stage, plain, grid, now, findings)
        worst = _failing(found)
        if worst is not None:  # before what could stand in its place, which takes long
            smaller = _in_smaller_plant(found, now, seen)
            if smaller is not None and path.may_swap(smaller.hypothesis.kind):
                path.swap(smaller.hypothesis.kind)
                path.swapped.add(now.hypothesis.kind)
                now = smaller
                continue
            path.failed.append(Failed(found.findings[worst], found.final))
            path.swaps, again = 0, None
            if len(path.failed) <= _AGAIN:
                again, more = climbed(stage.but(path.barred), plain, grid)
                seen |= more
            now = _instead(stage, findings[worst].less, seen, path.barred)
            if again is not None and not now.hypothesis.active:
                now = again  # a name that is worth less than its price, and yet told
            continue
        findings, other = findings_of(stage, findings, now, seen, path.barred)
        if (
            other is not None
            and path.may_swap(other.hypothesis.kind)
            and _takes_over(stage, now, other, seen)
        ):
            path.swap(other.hypothesis.kind)
            now = other
            continue
        pairs = zip(findings, found.findings, strict=True)
        found = replace(found, findings=tuple(replace(f, less=own.less) for f, own in pairs))
        more = _borne_out(found, seen, path.barred | path.borne)
        if more is None:
            told = _foretold(whole, found.findings)
            failed = tuple(path.failed)
            return replace(found, findings=told, failed=failed)
        path.borne |= set(more.hypothesis.active) - set(now.hypothesis.active)
        path.swaps, now = 0, more


def _settled(stage: Stage, now: Refit, seen: dict[tuple, Refit], borne: Collection[int]) -> Refit:
    """A model without what is needless in it, at the end of its way: from there, little must not
    decide what a cause is worth on data held out."""
    least = eliminate(stage, now, seen, borne)
    rested = at_rest(stage, least) if least.hypothesis.active else least
    moved = 2.0 * (rested.loglik - least.loglik) > _MOVED
    return eliminate(stage, rested, seen, borne) if moved else rested


def _takes_over(stage: Stage, now: Refit, other: Refit, seen: Mapping[tuple, Refit]) -> bool:
    """Whether a model with another cause in the place of one explains more, or as much with clearly
    fewer parameters: where a delay tells what a damped mode does, little of the mode is known."""
    sizes = [f.hypothesis.size(stage) for f in (now, other)]
    simpler = sizes[1] <= sizes[0] - _SIMPLER
    least = score(stage, now) + (-SWAPPED if simpler else SWAPPED)
    return score(stage, other) >= least and not rings_rather(stage, now, other, seen)


def _failing(found: Search) -> int | None:
    """Which cause data held out do not bear out, if any."""
    worth = [_confirmed(found, f) for f in found.findings]
    if len(worth) > 1 and _untold(found, found.findings[-1]):
        worth[-1] = min(worth[-1], 0.0)
    against = Scored.of_stage(found.stage, found.plain, found.final)
    if not worth or (min(worth) > 0.0 and not _worse(against, found.stage)):
        return None
    return _first_out(found.findings, worth)


def _in_smaller_plant(found: Search, now: Refit, seen: Mapping[tuple, Refit]) -> Refit | None:
    """The same causes in the best smaller plant that is worth more with them than the plain one,
    and with which data held out bear them out: a large one may have learnt what they do."""
    whole, size = found.stage, sum(order_of(now.hypothesis))
    stage, least = whole.fitting, score(whole.fitting, found.plain)
    if whole.held_out.sum() <= FEW:
        return None
    fits = [
        f
        for f in seen.values()
        if f.hypothesis.active == now.hypothesis.active
        if sum(order_of(f.hypothesis)) < size and score(stage, f) > least
    ]
    for f in sorted(fits, key=lambda f: -score(stage, f)):
        scored = Scored.of_stage(whole, found.plain, completed(whole, [f])[0])
        taken, learnt = (scored.taken(use) for use in (whole.held_out, whole.mask))
        sure = gain_of(scored, whole.held_out, True, whole.dt).sureness > SURE
        if sure and taken > _MUCH and taken > _BORNE_OUT * learnt:
            return f
    return None


def _first_out(findings: Sequence[PlantFinding], worth: Sequence[float]) -> int:
    """Of several causes that fail together, the one that gained least: it may spoil the others."""
    failing = [k for k, w in enumerate(worth) if w <= 0.0] or [worth.index(min(worth))]
    return min(failing, key=lambda k: findings[k].gain)


def _whole(
    whole: Stage,
    stage: Stage,
    plain: Refit,
    grid: Mapping[tuple[int, int], Refit],
    now: Refit,
    findings: Sequence[PlantFinding],
) -> Search:
    """What was found in the runs that were fitted, over all runs."""
    bare = replace(now.hypothesis, active=(), theta=cleared(stage, now.hypothesis))
    order = order_of(now.hypothesis)
    baseline = grid[order] if order in grid else refit(stage, [bare])[0]
    if score(stage, plain) > score(stage, baseline) or not findings:
        baseline = plain
    if not findings:
        now = plain
    swings = any(stage.slots[f.number].cause == swing.CAUSE for f in findings)
    if swings and not _damped(stage, baseline):
        damped = [f for f in grid.values() if _damped(stage, f)]
        baseline = max(damped, key=lambda f: score(stage, f), default=baseline)
    kept = [plain, baseline, now, *(f.less for f in findings)]
    plain, baseline, now, *less = completed(whole, kept)
    findings = tuple(replace(f, less=k) for f, k in zip(findings, less, strict=True))
    return Search(whole, plain, baseline, now, findings)


def _damped(stage: Stage, fit: Refit) -> bool:
    """Whether no mode of a plant swings on through the runs, as what disturbs it does."""
    return stilled(stage, fit.hypothesis) is fit.hypothesis


def _foretold(whole: Stage, findings: Sequence[PlantFinding]) -> tuple[PlantFinding, ...]:
    """Findings with what the screen had promised over all runs."""
    known = [f.promised for f in findings if f.promised is not None]
    every = iter(completed(whole, known) if known else [])
    return tuple(f if f.promised is None else replace(f, promised=next(every)) for f in findings)


def _confirmed(found: Search, finding: PlantFinding) -> float:
    """Twice the log-likelihood that a cause gains on data held out, beside all the others, or as
    much less than nothing where the plain error gets clearly worse; what it gained in the fit where
    none is held out."""
    stage = found.stage
    if stage.held_out.sum() <= FEW:
        return finding.gain
    less = found.without(finding)
    scored = Scored.of_stage(stage, less, found.final)
    worth = confirmed(scored, stage.held_out, stage.dt)[0]
    drawn = _drawn(stage, finding.number, scored) or _hardly_shown(found, finding)
    return -abs(worth) if drawn or _worse(scored, stage) else worth


def _untold(found: Search, finding: PlantFinding) -> bool:
    """Whether the data tell no parameter of a cause from nothing, nor all of them together: it
    takes what is left of another, and blurs that one."""
    each, together = found.away(finding)
    return bool(each.size and each.max() < _CLEAR and together < _CLEAR**2 * each.size)


def _drawn(stage: Stage, number: int, scored: Scored) -> bool:
    """Whether a cause with many parameters has drawn the error that was fitted, and tells little of
    that of data held out, or too little to be sure where these are parts of the same runs: a slow
    error goes on from one part to the next."""
    if stage.slots[number].weight < FREE:
        return False
    if scored.taken(stage.held_out) < _BORNE_OUT * scored.taken(stage.mask):
        return True
    gain = gain_of(scored, stage.held_out, True, stage.dt)
    parts = np.any(stage.mask.any(axis=1) & stage.held_out.any(axis=1))
    return bool(parts) and gain.sureness < SURE


def _hardly_shown(found: Search, finding: PlantFinding) -> bool:
    """Whether the error without a rounding holds little of what it does. Its errors are known to
    the last digit where its step is, so that all of them have to be there; where they are not, one
    of very many steps happened to suit what is slow, and the plant beside it did the rest."""
    stage, h = found.stage, found.final.hypothesis
    if stage.slots[finding.number].cause != "quantization":
        return False
    less = found.without(finding)
    exact, rounded = responses(stage, [without(stage, h, finding.number), h])
    both = np.where(stage.mask, np.stack([stage.y - less.y, rounded - exact]), 0.0)
    error, does = whiten(both[None], less.colour[None])[0] * stage.mask
    return float(np.sum(error * does)) < _SHOWN * float(np.sum(does**2))


def _worse(scored: Scored, stage: Stage) -> bool:
    """Whether the plain error of data held out usually gets clearly larger, and is not made up for
    on the whole."""
    use = stage.held_out
    if use.sum() <= FEW or scored.taken(use) > MADE_UP:
        return False
    return bool(np.median(scored.parts(use, stage.dt)) < -WORSENED)


def _instead(stage: Stage, less: Refit, seen: Mapping[tuple, Refit], failed: set[int]) -> Refit:
    """The best model without what failed: `less`, or one that was passed by on the way. The causes
    beside it that failed may have served it alone."""
    fits = [f for f in seen.values() if not failed & set(f.hypothesis.active)]
    return max([less, *fits], key=lambda f: score(stage, f))


def _borne_out(found: Search, seen: Mapping[tuple, Refit], known: set[int]) -> Refit | None:
    """The final model with a cause more that is not worth its price where it was fitted, and yet
    takes much of the error, there and on data held out: of what is slow, an estimated colour takes
    most of the evidence. Hills, which are slow, are always among them. Or one that is nearly as
    good where it was fitted, and usually better elsewhere. None of those known."""
    stage, final = found.stage, found.final
    if stage.held_out.sum() <= FEW:
        return None
    seen_error, as_good = final.error(stage), score(stage, final) - _CLOSE

    def takes_much(f: Refit) -> bool:
        return f.error(stage.fitting) < (1.0 - _MUCH) * seen_error

    had = set(final.hypothesis.active)
    h = final.hypothesis
    if h.swing is not None:
        h = replace(h, swing=h.swing[stage.mask.any(axis=1)])
    more = hilly(stage.fitting, h) if errs_slowly(stage, final) else []
    fits = [
        f
        for f in [*seen.values(), *refit(stage.fitting, more, rounds=PATIENT)]
        if f.adds_one_to(had)
        if not known & (set(f.hypothesis.active) - had)
        if f.loglik > final.loglik and (takes_much(f) or score(stage, f) > as_good)
    ]
    best, most = None, 0.0
    for f, whole in zip(fits, completed(stage, fits) if fits else [], strict=True):
        scored = Scored.of_stage(stage, final, whole)
        gain = gain_of(scored, stage.held_out, True, stage.dt)
        worth = confirmed(scored, stage.held_out, stage.dt)[0]
        taken = scored.taken(stage.held_out)
        (new,) = set(f.hypothesis.active) - had
        least = _SURER if stage.slots[new].weight >= FREE else SURE
        if takes_much(f):
            elsewhere = taken > _MUCH and worth > CAUSE_COST
        else:
            elsewhere = taken > _LASTS and gain.typical > 0.0 and worth > 0.0
        if gain.sureness > least and elsewhere and taken > most:
            best, most = f, taken
    return best
