"""What to drive, or to log, to tell a cause from those that it cannot be told from."""

from collections.abc import Sequence

from ..actuator.hypothesis import Refit
from ..actuator.manoeuvres import better, separate
from ..actuator.refit import refit
from ..actuator.screen import screen
from ..answer.result import Rival
from ..body.body import CAUSES
from ..body.search import BodySearch
from ..search.found import Search
from .body_naming import SEEN_BY_POSE
from .naming import Named

_POSE = (
    "log the pose, heading included, beside the yaw rate: it tells how far the vehicle has come, "
    "and where to"
)
_BY_HAND = (
    "turn the wheels by hand while the motor is held, which only a gap lets them do; for a gap "
    "outside the servo's loop, {}"
)
_SENSOR = (
    "log the yaw rate and the pose beside this channel: a sensor's fault is not seen in them, "
    "and an actuator's is"
)


def experiment(cause: Named, rivals: Sequence[Rival], bodily: BodySearch | None) -> str:
    """The manoeuvre of the catalogue that parts a cause from its rivals best, in words with what it
    is predicted to reach, or the channel that would part them; `bodily` is what was found in the
    body."""
    names = {(r.cause, r.where) for r in rivals}
    if cause.body is not None:
        posed = bodily is not None and "aside" in bodily.body.measured
        if not posed and all(r.cause in SEEN_BY_POSE for r in rivals):
            return _POSE
        return better(CAUSES[cause.body.number].effect, [r.cause for r in rivals])
    assert cause.search is not None and cause.finding is not None
    stage = cause.search.stage
    for k, _ in cause.finding.others:
        if (stage.slots[k].cause, stage.slots[k].where) in names:
            other = _in_place(cause.search, cause.finding.less, k)
            told = separate(stage, cause.search.final, other)
            friction = (cause.cause, cause.where) == ("coulomb_friction", "steering")
            gap = any(r.cause == "backlash" and r.deficit == 0.0 for r in rivals)
            return _BY_HAND.format(told) if friction and gap else told
    for beside in cause.search.findings:
        slot = stage.slots[beside.number]
        if (slot.cause, slot.where) in names:
            return separate(stage, beside.less, cause.finding.less)
    return _SENSOR


def _in_place(found: Search, less: Refit, number: int) -> Refit:
    """The model with another cause in the place of one; itself where it has that, in some form."""
    alone = found.stage.but(set(found.stage.allowed) - {number})
    starts = [c.beside(less.hypothesis) for c in screen(alone, less)[:1]]
    return next(iter(refit(found.stage, starts)), less)
