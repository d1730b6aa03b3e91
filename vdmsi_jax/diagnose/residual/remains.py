"""What a model leaves: what weighs against its causes, and whether the logs are explained by it."""

import math
from collections.abc import Callable, Collection, Iterable, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property

from ...config import PlantSpec
from ..answer.result import Unexplained
from ..signals.unexplained import BURSTS, SMALL
from .families import HYSTERESIS, MEMORY, OF_STATES, PACE, PACE_BY_OTHER, STICKING
from .of_body import BodyLeft
from .of_plant import PlantLeft

_SERIOUS, _MOSTLY = 0.05, 0.3  # share of structure in a residual that is spoken of, and that weighs
_FEEBLE, _HARDLY = 0.025, 0.2  # size beside the response, and share, below which both structure is
# but noise that is louder where more is asked: of a clean log 0.02 and 0.14, and of eight exams and
# 2000 hunted logs no other so little
_SETTLED = 0.75  # share of a channel's error from which on findings have explained it
_OPEN = 0.12  # share of it that is left and structure, from which on they have not
_PLAIN, _PART = 0.1, 0.1  # slow error, of a response's spread, and share of what is left that it
# is, from which on it is open whatever noise is around it
_EVIDENT, _MOST = 0.05, 0.6  # the same where it is most of what is left: of 1500 logs beside one
# right name (0.07 and 0.87, a limit of its own form), and beside wrong ones from 0.06 and 0.64
_ELSEWHERE = 0.08  # slow error, of a response's spread, that weighs beside findings elsewhere,
_WIND_ELSEWHERE = 0.12  # and one that goes with nothing commanded
_NO_WIND, _NO_EVEN_WIND = 0.085, 0.16  # the same, beyond which an error is no disturbance, and one
# that nothing hints at being another thing: of clean exams up to 0.084, even ones 0.14; of what
# the library lacks 0.09 to 0.33
_NO_LOAD = 1.0  # the same of one that a controller answers: a load may be all that moves a loop
_DROWNED = 0.33  # share of a channel's error, below which a cause beside such a load is minor
_ECHOED = 100.0  # twice the log-likelihood, below which it is beside any error that one answers: a
# friction of a clean loop had 59, right names in loops from 200
_PLAYED = 0.5  # the same of a play of the command: of clean loops 0.26, 0.38 and 0.48, of true
# ones from 0.59
_BY_STATES = 0.15  # share of a channel's error, that some function of states takes beside a cause
# that stands in for it: beside right names up to 0.12, beside wrong ones 0.06 to 0.27
_MOSTLY_BY_STATES = 0.06, 0.4  # the same of one that sticks, where that is so much of what is left
# of it: beside right names up to 0.04 and 0.25, beside wrong ones from 0.094 and 0.45
_BY_TURNS = 0.05  # likewise a hysteresis: beside wrong names from 0.096, beside no right one
_BY_PACE, _BY_MEMORY = 0.01, 0.01  # likewise these: beside wrong names from 0.02 and 0.014,
# beside one right name of 1500 alone, 0.002
_PACED_LIMIT = 0.1  # a limit that is not sharp leaves such, too: a right one 0.073, wrong from 0.13
_LINE = 0.5  # share of a line beside structure: of the hunt and eight exams no right one had less
_LAGS_OF_BODY = ("tyre_relaxation", "yaw_inertia", "sensor_lag", "sensor_delay")
_NOW_AND_THEN = (
    0.1  # share of what is left of a channel, in short windows, beside which a lag of its
)
# sensor is that: of fourteen exams no right one had any, messages that freeze 0.19
_LAGGING = 0.3  # share of what is left of an actuator, that its changing lag is beside such a lag
_BENDS = ("gain_nonlinearity", "saturation", "gain_asymmetry", "drag")
_OF_STATES = (*_BENDS, "rate_limit", "dead_zone", "coulomb_friction", "backlash")
_WORN = (*_BENDS, "offset", "gain_drift", "regime_change")
_FREER = (
    (OF_STATES, (*_OF_STATES, "periodic_disturbance"), _BY_STATES, 0.0),
    (OF_STATES, STICKING, *_MOSTLY_BY_STATES),
    (HYSTERESIS, STICKING, _BY_TURNS, 0.0),
    (PACE, _BENDS, _BY_PACE, 0.0),
    (PACE, ("rate_limit",), _PACED_LIMIT, 0.0),
    (MEMORY, _WORN, _BY_MEMORY, 0.0),
)  # kinds of error, causes that may be a part of such, and the least share, and of what is left


@dataclass(frozen=True, eq=False)
class Remains:
    """What is left when all causes are in the model.

    Attributes:
        found: structure that no cause accounts for, disturbances among it.
        outdone: the causes (findings of an actuator or of the body) that only stand in for a kind
            of error that the library lacks.
        structure_left: by channel, the largest share of what is left that is structure.
        echoing: channels whose commands a controller makes.
    """

    found: tuple[Unexplained, ...]
    outdone: tuple[object, ...]
    structure_left: Mapping[str, float] = field(default_factory=dict)
    echoing: frozenset[str] = frozenset()

    @classmethod
    def of(cls, plants: Mapping[PlantSpec, PlantLeft], body: BodyLeft | None) -> "Remains":
        """What the models of the plants and of the body leave together."""
        every = [*plants.values(), *([] if body is None else [body])]
        left = [u for own in every for u in own.found]
        outdone = [pair for own in every for pair in own.outdone]
        structure = _largest(u for u in left if not u.steady)
        left += [u for _, u in outdone if u.fraction > 0.0]
        echoing = frozenset(spec.output for spec, own in plants.items() if own.echoing)
        return cls(tuple(left), tuple(f for f, _ in outdone), structure, echoing)

    @cached_property
    def disturbances(self) -> list[Unexplained]:
        """Steady slow errors that go with nothing commanded, as wind."""
        return [u for u in self.found if u.steady and not _too_large(u)]

    @cached_property
    def structure(self) -> list[Unexplained]:
        """All else, with the slow errors that are too large for wind."""
        said = "{}, which goes with nothing commanded".format
        return [u for u in self.found if not u.steady] + [
            replace(u, test=said(u.test)) for u in self._beyond
        ]

    def puzzle(self, channel: str, least: float = 0.0) -> float:
        """The largest share of a channel that casts doubt on causes beside it, of what is so large
        at the least, as a share of the response's spread."""
        puzzling = [u for u in self.found if u.puzzling and not u.steady]
        every = (*puzzling, *self._beyond)
        return _largest(u for u in every if u.size >= least).get(channel, 0.0)

    def outdoes(self, cause: str, channel: str, share: float) -> bool:
        """Whether a kind of error takes so much more of a channel's beside a cause of that kind,
        that this, which takes a `share`, is but a part of what the library lacks."""
        for kind, causes, least, most in _FREER:
            by_kind = _largest(u for u in self.found if u.kind == kind).get(channel, 0.0)
            if cause in causes and by_kind > most and by_kind * (1.0 - share) > least:
                return True
        return False

    def lags(self, cause: str) -> bool:
        """Whether an actuator lags by another time constant now and then, or the measurement of the
        steering stands still, so that a lag of the body that it moves may be a part of that."""
        slower = [u.fraction for u in self.found if u.kind in (PACE, PACE_BY_OTHER)]
        now_and_then = max(slower, default=0.0) > _LAGGING or "delta" in self.dropping
        return cause in _LAGS_OF_BODY and now_and_then

    def comes_and_goes(self, cause: str, channel: str, share: float) -> bool:
        """Whether a line takes so small a `share` beside structure that is no form of a cause, that
        it may be a part of that, as of all that comes and goes."""
        left = any(u.channel == channel and not (u.of_form or u.steady) for u in self.found)
        return cause == "periodic_disturbance" and share < _LINE and left

    def echoes(
        self, channel: str, share: float, statistic: float, hides_small: bool = False
    ) -> bool:
        """Whether a controller makes the commands of a channel, and a cause takes so small a
        `share`, so unsurely, that it may tell what these know of the error: more than its past
        does, where the controller has a sensor of its own. One that is quicker than the log moves
        its commands between the rows, too, so that a play seems to hide what is logged of that."""
        if channel not in self.echoing:
            return False
        hidden = hides_small and share < _PLAYED
        return hidden or (share < _DROWNED and statistic < _ECHOED)

    def drowns(self, channel: str, share: float, hides_small: bool = False) -> bool:
        """Whether most of what is left of a channel is a load that a controller answers, beside
        which a cause takes so small a `share` that it may tell what the commands know of it: as a
        play of the command does, which `hides_small` moves, and those are the answers."""
        loads = _largest(u for u in self.found if u.answered)
        return loads.get(channel, 0.0) > _SETTLED and share < (_PLAYED if hides_small else _DROWNED)

    def disturbance(self, channel: str, least: float = 0.0) -> float:
        """Likewise the largest share of a steady slow error."""
        return _largest(u for u in self.found if u.steady and u.size >= least).get(channel, 0.0)

    @cached_property
    def dropping(self) -> set[str]:
        """Channels whose measurement drops out."""
        return self._in_bursts(_MOSTLY)

    @cached_property
    def moves_otherwise(self) -> bool:
        """Whether the yaw rate or the pose has structure, so that a vehicle may not do what speed
        and angle say: wheels that spin, an encoder off its centre."""
        return any(u.channel in ("r", "pose") for u in self.structure)

    def stands_still(self, cause: str, channel: str | None) -> bool:
        """Whether the lag of a sensor may be that of a measurement that stands still now and then,
        as of messages that freeze."""
        return cause in ("sensor_lag", "sensor_delay") and channel in self._in_bursts(_NOW_AND_THEN)

    def _in_bursts(self, least: float) -> set[str]:
        """Channels of which short windows are more than a share."""
        return {u.channel for u in self.structure if u.kind == BURSTS and u.fraction > least}

    @cached_property
    def _beyond(self) -> list[Unexplained]:
        return [u for u in self.found if u.steady and _too_large(u)]


def _too_large(disturbance: Unexplained) -> bool:
    """Whether it is larger than what wind, rough ground and loads do."""
    if disturbance.answered:
        return disturbance.size > _NO_LOAD
    return disturbance.size > (_NO_EVEN_WIND if disturbance.even else _NO_WIND)


def unexplained(
    left: Iterable[Unexplained],
    touched: Collection[str],
    rounds: Mapping[str, float],
    taken: Callable[[str], float],
) -> bool:
    """Whether what is left says that the logs are not explained.

    Args:
        left: structure that is left.
        touched: channels that findings act on; none where nothing was found.
        rounds: by channel, the share that a rounding may differ by itself.
        taken: share of a channel's error that findings took.
    """
    serious = [
        u
        for u in left
        if u.fraction > _SERIOUS
        and u.size >= (SMALL if u.fraction > _HARDLY else _FEEBLE)
        and not u.of_form
        and (u.puzzling or u.fraction > rounds.get(u.channel, 0.0))
    ]
    if not touched:
        return bool(serious)
    turned = {"r"} if "psi" in touched else set()  # one motion tells both
    if any(_plain(u) and u.channel in turned.union(touched) for u in serious):
        return True
    return any(
        u.fraction > _MOSTLY
        and not _settled(u, taken(u.channel))
        and (u.channel in touched or u.size > (_WIND_ELSEWHERE if u.steady else _ELSEWHERE))
        for u in serious
    )


def _plain(left: Unexplained) -> bool:
    """Whether it is a slow error that is large beside the response, and no disturbance."""
    slow = left.puzzling and not left.steady and math.isfinite(left.size)
    large = left.size > _PLAIN and left.fraction > _PART
    return slow and (large or (left.size > _EVIDENT and left.fraction > _MOST))


def _settled(left: Unexplained, taken: float) -> bool:
    """Whether findings that took a share of a channel's error have explained it all the same."""
    return taken > _SETTLED and left.fraction * (1.0 - taken) < _OPEN


def _largest(left: Iterable[Unexplained]) -> dict[str, float]:
    """The largest fraction in each channel."""
    found: dict[str, float] = {}
    for u in left:
        found[u.channel] = max(found.get(u.channel, 0.0), u.fraction)
    return found
