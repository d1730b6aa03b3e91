"""What is left of the yaw rate and the pose."""

from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from ...threads import each
from ..answer.result import Unexplained
from ..body.body import CAUSES, Body
from ..body.fit import residual
from ..body.lane import BodyFit
from ..body.search import BodyFinding, BodySearch
from ..signals.colour import whiten
from ..signals.disturbance import demands, moving, scores
from ..signals.noise import slow_noise
from ..signals.runs import Runs
from ..signals.unexplained import SMALL, beside_response, events, slow_error, structure
from . import stand_ins
from .heading import by_heading
from .leftover import (
    LOUD,
    SEEN,
    is_rounding,
    of_a_kind,
    puzzles,
    refuted,
    steps_of,
    taken_for_noise,
)
from .questions import asked_of_body
from .regression import explained, weighed

_JUMPS = 10.0  # `disturbance.scores` of events, from which a pose surely jumps: clean drives of two
# exams had up to 7.8, jumps of a satellite receiver 13
_PEAKED = 10.0  # kurtosis of its innovations, from which half of that tells: clean ones had to 5.8
_OF_A_KIND = 0.5  # of a slow error of the yaw rate, that a kind explains which is no wind then


@dataclass(frozen=True, eq=False)
class BodyLeft:
    """What the final model of the body leaves: structure, and the causes that only stand in for a
    kind of error that the library lacks."""

    found: tuple[Unexplained, ...]
    outdone: tuple[tuple[BodyFinding, Unexplained], ...]

    @classmethod
    def of(cls, runs: Runs, bodily: BodySearch) -> "BodyLeft":
        """Look at what the model leaves."""
        looks = [partial(_of_yaw_rate, runs, bodily), partial(_of_compass, runs, bodily)]
        # a speed that was made of the position has its jumps itself: errors of making it are left
        if not any("v" in record.windows for record in runs.records):
            looks.append(partial(jumps_of_pose, runs.begins, bodily))
        found = sum(each(lambda look: look(), looks), [])
        return cls(tuple(found), tuple(stand_ins.of_body(runs, bodily)))


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
            rare = scores(e, np.empty((0, *e.shape)), moves, body.dt).rare
            peaked = np.mean(white[known] ** 4) > _PEAKED * np.mean(white[known] ** 2) ** 2
            sure = rare > (0.5 if peaked else 1.0) * _JUMPS
            jumps = events("pose", e, white, known, begins, body.dt, sure)
            left += [replace(u, size=SMALL) for u in jumps]
    return sorted(left, key=lambda u: -u.fraction)[:1]


def _of_compass(runs: Runs, found: BodySearch) -> list[Unexplained]:
    """What goes with the heading in the way aside."""
    body = found.body
    if not {"aside", "psi"} <= body.measured.keys():
        return []
    masks = body.mask["aside"], body.held_out["aside"]
    aside = residual(body, found.final, "aside", masks[0] | masks[1])
    return by_heading(
        aside, body.measured["forward"], body.measured["psi"], runs.channel("psi"), masks
    )


def _of_yaw_rate(runs: Runs, found: BodySearch) -> list[Unexplained]:
    body, final = found.body, found.final
    if "r" not in body.measured:
        return []
    masks = (body.mask["r"], body.held_out["r"])
    e, white = _left(body, final, "r")
    causes = [CAUSES[finding.number].cause for finding in found.findings]
    kind = explained(weighed(*asked_of_body(runs, body, final)), causes)
    left = of_a_kind("r", kind, causes, e, body.measured["r"], masks[0])
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
    if not (puzzles(left) or is_rounding(steps_of(runs.records, "r"), e[known])):
        left += taken_for_noise("r", e, white, response, known, bool(causes))
    left = beside_response(left, e, response, known)
    for failed in found.failed:
        if failed.finding.gain > LOUD and failed.share > SEEN and not failed.usual:
            cause = CAUSES[failed.finding.number]
            place = f"{cause.where} {cause.channel}" if cause.channel else cause.where
            broken = refuted(f"{cause.cause} ({place})", failed.channel, failed.share)
            known = body.mask[failed.channel] | body.held_out[failed.channel]
            e = residual(body, final, failed.channel, known)
            left += beside_response([broken], e, body.measured[failed.channel], known)
    return left
