"""What all causes together leave: structure, in each channel, that the library has no name for."""

import math
from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace
from functools import partial

import numpy as np

from ...config import PlantSpec
from ...threads import each
from ..actuator.stage import Stage
from ..answer.result import Diagnosis, Unexplained
from ..body.body import CAUSES, Body
from ..body.fit import BodyFit, residual
from ..body.search import BodySearch
from ..search.found import Search
from ..search.search import FREE, lasts
from ..signals.colour import unsteadiness, whiten
from ..signals.disturbance import IMITATORS, demands, moving, scores
from ..signals.noise import slow_noise
from ..signals.runs import Runs
from ..signals.unexplained import (
    LARGE_HELD_OUT,
    PUZZLING,
    SMALL,
    WORSE,
    beside_response,
    events,
    extent,
    slow_error,
    slow_sizes,
    structure,
)
from .families import HYSTERESIS, PACE, Explained, explained, weighed
from .heading import by_heading
from .questions import asked, asked_of_body, evenly_of
from .stand_ins import took
from .travelled import line_over

_STEP = 0.1  # by which what repeats with the place may differ from the step of a rounding
_LOUD = 100.0  # of twice the log-likelihood, from which a cause that fails on other data is told
_LOUD_ECHO = 300.0  # the same where a controller makes the commands, which know of the error
_SEEN = 0.005  # of the squared error, from which on it is
_ANOTHER = (
    2.5  # times the slow error on data fitted, from which on data held out are of another kind
)
_JUMPS = 10.0  # `disturbance.scores` of events, from which a pose surely jumps: clean drives of two
# exams had up to 7.8, jumps of a satellite receiver 13
_PEAKED = (
    10.0  # kurtosis of its innovations, from which half of it tells: clean drives had up to 5.8
)
_OF_A_KIND = 0.5  # of a slow error of the yaw rate, that a kind explains which is no wind then
_MOST = 0.5  # of the response's spread, an error from which on a model says little of it: of seven
# exams no clean log, and none of a cause that the library has, was left with more than 0.4
_COMES_AND_GOES = 10.0  # `unsteadiness`, from which on an error is no noise: 173 channels of clean
# logs had up to 2.6, measured vehicles, whose noise goes with their speed, 8.6, a machine that runs
# up 50
_COLOURFUL = 0.02, 0.1  # of a response's spread, such an error beside no cause and beside some
_OF_ITSELF = {HYSTERESIS: PUZZLING, PACE: 0.1}  # share of what is left, from which on these are no
# form of a play, friction or limit of a rate: of 2800 hunted drives no such name was right
_NEXT_TO = 0.02  # of the time, that a change may lie before or behind a part


def leftover(
    runs: Runs,
    searches: Mapping[PlantSpec, Search],
    bodily: BodySearch | None,
    loops: Collection[str],
    echoing: Collection[str],
) -> list[Unexplained]:
    """What the final models leave in the responses of the plants, of which a controller answers
    those of `loops` and makes the commands of those that are `echoing`, and in the yaw rate."""
    looks = [
        partial(_of_stage, runs, spec, own, spec.output in loops, spec.output in echoing)
        for spec, own in searches.items()
    ]
    if bodily is not None:
        looks += [
            partial(_of_body, runs, bodily),
            partial(jumps_of_pose, runs.begins, bodily),
            partial(_of_compass, runs, bodily),
        ]
    return [left for every in each(lambda look: look(), looks) for left in every]


def is_another(own: Search) -> bool:
    """Whether a plant errs much more, and slowly, on the data held out than where it was fitted: of
    what happens there alone no fit can know."""
    stage = own.stage
    masks = (stage.mask, stage.held_out)
    sizes = slow_sizes(stage.y - own.final.y, stage.y, masks, stage.dt)
    return sizes[1] > LARGE_HELD_OUT and sizes[1] > _ANOTHER * sizes[0]


def breaks_where_judged(own: Search) -> bool:
    """Whether a change of regime was found whose moment lies in a part that is held out, or next to
    one: no fit can know it better."""
    stage = own.stage
    found = [(f, own.final) for f in own.findings] + [(f.finding, f.final) for f in own.failed]
    for finding, final in found:
        slot = stage.slots[finding.number]
        if slot.cause != "regime_change":
            continue
        clock = np.asarray(stage.signals.clock(getattr(slot.effect, "over", "run")))
        near = np.abs(clock - final.hypothesis.theta[slot.index[0]]) < _NEXT_TO * np.ptp(clock)
        if np.any(near & stage.held_out):
            return True
    return False


def only_where_judged(found: Diagnosis, judging: Collection[str]) -> bool:
    """Whether nothing but structure was found, and that in runs that no fit has seen alone: they
    may ask for what the others do not show, faster steps of the same size or turns at a higher
    speed."""
    left = [u for u in found.unexplained if u.size >= SMALL]
    alone = (
        u.kind == WORSE or (u.when and all(run in judging for run, *_ in u.when)) for u in left
    )
    nothing_else = found.verdict == "unexplained_structure" and not found.findings
    return nothing_else and all(alone)


def _broken(label: str, channel: str, fraction: float, size: float = math.inf) -> Unexplained:
    """A cause that explains what was fitted and fails on what was held out; told as small where all
    that it explains is that beside the response."""
    words = f"{label} would explain the data fitted, and fails on the data held out"
    left = Unexplained(channel, fraction, ("run",), (), words, puzzling=fraction > PUZZLING)
    return replace(left, size=size) if size < SMALL else left


def _of_stage(
    runs: Runs, spec: PlantSpec, own: Search, loaded: bool, echoes: bool
) -> list[Unexplained]:
    stage, final = own.stage, own.final
    loud = _LOUD_ECHO if echoes else _LOUD
    e = np.where(stage.mask | stage.held_out, stage.y - final.y, 0.0)
    evenly = evenly_of(runs, spec)
    white = whiten(e[None], final.colour[None])[0] * evenly
    masks = (stage.mask, stage.held_out)
    causes = [stage.slots[finding.number].cause for finding in own.findings]
    kind = explained(weighed(*asked(spec, stage, final.y, evenly)), causes)
    found = _of_a_kind(spec.output, kind, causes, e, stage.y, stage.mask)
    logged = [r for r in runs.records if spec.output in r]
    steps = [step for r in logged if (step := r.step(spec.output)) is not None]
    found += _of_the_way(spec.output, final.y, e, white, stage, steps)
    found += structure(spec.output, e * evenly, white, *masks, runs.begins, stage.dt)
    needs = demands(stage.u, final.y, stage.mask | stage.held_out, stage.dt)
    moves = moving(np.asarray(stage.signals.v), stage.mask | stage.held_out)
    known = stage.noise.slow
    if loaded:  # what is asked goes with the error, and not the other way round
        needs = needs[:0]
    about = spec.output, e, white, stage.y, needs, masks, stage.dt
    slow = slow_error(*about, known, moves, stage.scales.time_constant)
    if slow is not None:
        found.append(replace(slow, answered=loaded))
    if not loaded and not _puzzles(found):
        use, beside = stage.mask | stage.held_out, bool(causes)
        found += _taken_for_noise(spec.output, e, white, stage.y, use, beside, _MOST)
    # what may have drawn the noise, or the disturbance, of the data fitted; a mean that is another
    # in each run is slow, and told by that if it is large
    drawn = IMITATORS if slow is not None and slow.steady else {"resonance", "offset"}
    broken: dict[str, tuple[float, float]] = {}  # of several forms or plants with it, the most
    for failed in own.failed:
        slot = stage.slots[failed.finding.number]
        label = f"{slot.cause} ({slot.where})"
        fraction = took(stage, failed.finding, failed.final)
        if slot.cause in drawn or slot.cause in causes:  # of which another form is borne out
            continue
        if slot.weight < FREE and failed.finding.gain > loud and fraction > _SEEN:
            size = math.sqrt(fraction * failed.finding.less.error(stage))
            told = fraction, size / extent(stage.y[stage.mask])
            broken[label] = max(broken.get(label, (0.0, 0.0)), told)
    found += [_broken(label, spec.output, *shares) for label, shares in broken.items()]
    return beside_response(found, e, stage.y, stage.mask | stage.held_out)


def _puzzles(left: Sequence[Unexplained]) -> bool:
    return any(u.puzzling and u.fraction > PUZZLING for u in left)


def _taken_for_noise(
    channel: str,
    e: np.ndarray,
    white: np.ndarray,
    y: np.ndarray,
    use: np.ndarray,
    beside: bool,
    most: float = math.inf,
) -> list[Unexplained]:
    """An error that one estimated colour takes for noise, and is none: it is `most` of a response
    and lasts, and a model that tells so little of a response has not told why; or it is large,
    `beside` a cause or none, and its frequencies come and go."""
    error, variance = float(np.mean(e[use] ** 2)), float(np.mean(white[use] ** 2))
    size = math.sqrt(error) / extent(y[use])
    if size >= most and lasts(error, variance, y[use]):
        how = "which lasts"
    elif size >= _COLOURFUL[beside] and unsteadiness(white, use) >= _COMES_AND_GOES:
        how = "whose frequencies change"
    else:
        return []
    words = f"an error of {100.0 * size:.0f} % of the response's spread, {how}"
    return [Unexplained(channel, 1.0 - variance / error, ("t",), (), words, puzzling=True)]


def _of_a_kind(
    channel: str,
    kind: Explained | None,
    causes: Sequence[str],
    e: np.ndarray,
    y: np.ndarray,
    use: np.ndarray,
) -> list[Unexplained]:
    """What a kind explains of an error in a response: told as the form of a cause that was found
    where it is of its kind, and as small where it is that beside the response."""
    if kind is None:
        return []
    words, on = f"{kind.family.words} would explain it", kind.family.depends_on
    size = float(np.sqrt(kind.share * np.mean(e[use] ** 2))) / extent(y[use])
    known = [c for c in causes if c in (kind.family.causes or ())]
    if kind.share > _OF_ITSELF.get(kind.family.words, 1.0):
        known = []
    if known:
        words = f"{known[0]} has another form; {words}"
    if size < SMALL:
        words += f"; {100.0 * size:.1f} % of the response's spread"
    if known or size < SMALL:
        return [Unexplained(channel, kind.share, on, (), words, size=size, of_form=bool(known))]
    puzzling = kind.share > PUZZLING and not (causes and kind.by_fit_alone)
    family = kind.family.words
    return [Unexplained(channel, kind.share, on, (), words, puzzling=puzzling, kind=family)]


def _of_the_way(
    channel: str,
    response: np.ndarray,
    e: np.ndarray,
    white: np.ndarray,
    stage: Stage,
    steps: Sequence[float],
) -> list[Unexplained]:
    """What repeats with the way, which is the integral of the response: that of a speed. Or with
    the way of the vehicle, or with the place, which is the response itself: that of a position,
    unless it is logged in such steps."""
    use = stage.mask | stage.held_out
    along = np.cumsum(response, axis=1) * stage.dt
    unit = "m of way" if channel == "v" else f"of the integral of {channel}"
    ways = [(along, f"integral of {channel}", unit, False)]
    travelled = np.asarray(stage.signals.distance)
    if channel != "v" and np.ptp(travelled) > 0.0:  # a wheel out of balance shakes the steering
        ways.append((travelled, "way", "m of way", False))
    ways.append((response, channel, f"of {channel}", True))
    lines = ((line_over(x, e, white, use, stage.dt, place), *told) for x, *told, place in ways)
    line, on, unit = next((one for one in lines if one[0] is not None), (None, "", ""))
    if line is None or any(abs(line.period - step) < _STEP * step for step in steps):
        return []
    words = f"it repeats every {line.period:.3g} {unit}"
    size = float(np.sqrt(line.share * np.mean(e[use] ** 2))) / extent(stage.y[use])
    if size < SMALL:
        words += f"; {100.0 * size:.1f} % of the response's spread"
        return [Unexplained(channel, line.share, (on,), (), words, size=size)]
    return [Unexplained(channel, line.share, (on,), (), words, puzzling=line.share > PUZZLING)]


def _left(body: Body, final: BodyFit, channel: str) -> tuple[np.ndarray, np.ndarray]:
    """What the model leaves of a channel of the body, and the same whitened."""
    e = residual(body, final, channel, body.mask[channel] | body.held_out[channel])
    return e, whiten(e[None], final.colour[channel][None])[0]


def jumps_of_pose(begins: tuple[tuple[str, float], ...], found: BodySearch) -> list[Unexplained]:
    """Jumps of the position: in the way over half a second, the larger of forward and aside. They
    are the sensor's, or a start's: told, they leave the verdict on causes that were found."""
    body, final, left = found.body, found.final, []
    for c in ("forward", "aside"):
        if c in body.measured:
            known = body.mask[c] | body.held_out[c]
            e, white = _left(body, final, c)
            moves = known & moving(body.v, known)
            rare = scores(e, np.empty((0, *e.shape)), moves, body.dt)[1]
            peaked = np.mean(white[known] ** 4) > _PEAKED * np.mean(white[known] ** 2) ** 2
            sure = rare > (0.5 if peaked else 1.0) * _JUMPS
            jumps = events("pose", e, white, known, begins, body.dt, sure)
            left += [replace(u, size=SMALL) for u in jumps]
    return sorted(left, key=lambda u: -u.fraction)[:1]


def _of_compass(runs: Runs, found: BodySearch) -> list[Unexplained]:
    """What goes with the heading in the way aside."""
    body = found.body
    if "aside" not in body.measured:
        return []
    masks = body.mask["aside"], body.held_out["aside"]
    aside = residual(body, found.final, "aside", masks[0] | masks[1])
    return by_heading(
        aside, body.measured["forward"], body.measured["psi"], runs.channel("psi"), masks
    )


def _of_body(runs: Runs, found: BodySearch) -> list[Unexplained]:
    body, final = found.body, found.final
    if "r" not in body.measured:
        return []
    masks = (body.mask["r"], body.held_out["r"])
    e, white = _left(body, final, "r")
    causes = [CAUSES[finding.number].cause for finding in found.findings]
    kind = explained(weighed(*asked_of_body(runs, body, final)), causes)
    left = _of_a_kind("r", kind, causes, e, body.measured["r"], masks[0])
    left += structure("r", e, white, *masks, runs.begins, body.dt)
    response = body.measured["r"]
    known = masks[0] | masks[1]
    needs, moves = demands(body.delta, response - e, known, body.dt), moving(body.v, known)
    noise = slow_noise(body.repeats, e, known, body.dt)
    slow = slow_error("r", e, white, response, needs, masks, body.dt, noise, moves, ground=True)
    if slow is not None and slow.steady and kind is not None and kind.share > _OF_A_KIND:
        slow = replace(slow, steady=False, puzzling=True)
    if slow is not None:
        left.append(slow)
    if not _puzzles(left):
        left += _taken_for_noise("r", e, white, response, known, bool(causes))
    left = beside_response(left, e, response, known)
    for failed in found.failed:
        if failed.finding.gain > _LOUD and failed.share > _SEEN and not failed.usual:
            cause = CAUSES[failed.finding.number]
            place = f"{cause.where} {cause.channel}" if cause.channel else cause.where
            broken = _broken(f"{cause.cause} ({place})", failed.channel, failed.share)
            known = body.mask[failed.channel] | body.held_out[failed.channel]
            e = residual(body, final, failed.channel, known)
            left += beside_response([broken], e, body.measured[failed.channel], known)
    return left
