"""Significant is not important: which of the causes that the data support matter."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from ..config import PlantSpec
from .disguise import backward
from .found import Search, output_of
from .judge import NEARLY_ALL, Trial
from .naming import Named
from .noise import BriefNoise
from .result import RESTS, ChannelScore, Finding, Gain
from .runs import Runs
from .swing import FEWEST

MINOR = 0.03
"""Share of the held-out squared error of its channel, with no cause or with all others, below which
a significant cause is minor: cars on a physics engine, whose causes are none, reach 0.026."""

LITTLE = "it takes little of the error"
"""Why a cause is minor that is significant and of no weight."""

SLOW = "any slow error has such a part"
"""Why one is that changes with time, or is there all the time."""

_MUCH, _POINTS, _CERTAIN = 0.2, 2.0, 500.0  # of what all others leave, of FIT, and of twice the
# log-likelihood: from either one a cause matters however small it is beside them; of eight blind
# exams wrong names so small had up to 0.02, 0.1 and 220, right ones 0.23, 0.5 and 500
_TRACE, _TRACE_POINTS, _TRACE_SHARE = 0.005, 0.5, 0.3  # of what its channel errs by with no cause,
# of FIT, and of what all others leave, below which a cause is a trace beside another's form
_NEXT_TO_NOTHING = 0.1  # points of FIT, below which it is one however sure
_SLIGHT, _SLIGHT_POINTS = 60.0, 0.3  # twice the log-likelihood and FIT, below which both a cause of
# the body, the road or a sensor is what no vehicle is without
_WEAK, _STRONG = 0.05, 0.5  # shares: below the first beside one above the second a cause is minor,
_FAINT = 100.0  # and below twice the first, where twice its log-likelihood is below this
_DOUBTFUL = 0.05  # share of a cause that makes the path no better, below which it is minor
_LITTLE = 0.3  # share, below which one that is so faint mends a bend beside it, or spoils the path:
_WORSE, _MUCH_WORSE = 1.1, 2.0  # times of its error, and whatever its share: of seven exams right
# names that do so had shares from 0.38, and as faint ones 1.1
_NOTHING = 0.5  # standard errors, below which a parameter is nothing, whatever it takes
_CLEAR, _FEW = 2.0, 3  # standard errors, below which a parameter may be nothing; of so many
_SURE = 2.5  # standard errors of the gain in FIT held out, from which on a cause is one beside no
# structure: poles and zeros may take over so much of its size that it is lost all the same
_PUZZLE = 0.1  # share of the error without a cause that must puzzle beside it, to doubt its name
_AGING = frozenset({"gain_drift", "regime_change"})
_CHANGED = 4.5  # standard errors of these, below which they are minor beside a steady slow error:
# the hunt's and ten exams' right ones had from 5.2, but for one beside none, wrong ones 3.3 and 3.5
_PERIODS = 6.0  # in the longest run, of a periodic disturbance beside what nothing explains
_EXACT = 20.0  # standard errors, from which on the size of a delay is known beside slow errors
_BUS, _LATE = 0.02, 2.5  # s and points of FIT, below which both a delay is every bus's
_SAME = 0.01  # of a yaw rate, that no body is known better by
_DRAGGED, _DRAG = 0.5, 0.25  # points of FIT and share, below which both a speed that falls in bends
# and leaves the path as it was is every vehicle's: of a physics engine's cars up to 0.28 and 0.15
_TURNS = 0.1  # s, below which a body's lag by its inertia is every vehicle's
_BLURRED = 0.2  # of a swing, that the frequency may be off over the longest run: wind had 0.29
_DAMPED = 0.24  # ratio, from which a mode is rather two poles that the plant lacks
_KINDS = (
    frozenset({"coulomb_friction", "backlash"}),
    frozenset({"road_grade", "periodic_disturbance"}),
    frozenset({"rate_limit", "resonance"}),  # a loop whose drive is limited rings as it lets go
)  # causes of which one tells what the form of the other misses
_MANY = 4  # rivals that explain the logs as well, from which on a cause beside others is anything
_CROWD = 4  # causes of one actuator, from which on they are one that the library lacks
_TAKEN = 0.4  # share, below which a cause that only brief noise shows may mend what is slow
_BENDS = frozenset({"gain_nonlinearity", "saturation", "gain_asymmetry"})  # of one characteristic
_REACHED = 0.1  # of the largest command, above which all are where nothing shows the one at zero
_WEIGHED = 5.0  # standard errors, that the weight of a mode must have beside its plant
_LIGHT, _ADDS = 0.15, 0.3  # ratio, and share of the baseline's error, that a mode with more damping
# must take by itself


@dataclass(frozen=True, eq=False)
class Weighing:
    """What causes are weighed against.

    Attributes:
        searches: of the plants.
        runs: that were looked at.
        baseline, extended: scores by channel, on data held out.
    """

    searches: Mapping[PlantSpec, Search]
    runs: Runs
    baseline: Mapping[str, ChannelScore]
    extended: Mapping[str, ChannelScore]

    def leads(self, cause: Named, trials: Sequence[tuple[Named, Trial]]) -> bool:
        """Whether a cause takes most of all of its actuator where none takes more than little: each
        stands in for the others where it is missing, and together they take much."""
        taken = [
            (self._of_all(other, trial.gain), trial.gain.channel, other)
            for other, trial in trials
            if other.search is cause.search and self._told_by(other, trial.gain)
        ]
        if len(taken) < 2:
            return False
        most, channel, first = max(taken, key=lambda one: one[0])
        return first is cause and most < MINOR and self._much_together(channel)

    def of_its_kind(
        self, cause: Named, trials: Sequence[tuple[Named, Trial]]
    ) -> list[tuple[Named, Trial]]:
        """Other causes of an actuator that are told by the same: what one misses the other has."""
        alike = next((kind for kind in _KINDS if cause.cause in kind), frozenset())
        return [
            (other, trial)
            for other, trial in trials
            if other.search is cause.search and other is not cause and other.cause in alike
        ]

    def why_minor(
        self,
        cause: Named,
        trial: Trial,
        found: Finding,
        puzzle: float,
        disturbance: float,
        leads: bool,
        trials: Sequence[tuple[Named, Trial]],
    ) -> str:
        """Why a cause is minor, in words; empty where it is not.

        Args:
            cause: that is sure.
            trial: what it is worth.
            found: the same as a finding.
            puzzle: share of what is left in its channel that nothing explains, if that is much.
            disturbance: share of it that a steady disturbance is.
            leads: whether it is the first of several that stand in for each other.
            trials: all causes, and what they are worth.
        """
        share, points = max(found.share, trial.gain.typical), trial.gain.after - trial.gain.before
        puzzling, disturbed = (x * (1.0 - share) > _PUZZLE for x in (puzzle, disturbance))
        wandering = disturbance if cause.cause == "periodic_disturbance" else 0.0
        exact = not puzzling and _exact(found)
        if not exact and self._little(cause, trial, found, leads):
            return LITTLE
        if found.share < _MUCH and 0.0 <= points < min(trial.gain.se, _POINTS):
            if found.statistic < _CERTAIN:  # elsewhere it may be a loss
                return "its gain differs too much from block to block"
        if puzzling and 0.0 <= self._of_all(cause, trial.gain) < _TRACE:
            return "it may mend the form of what nothing explains"
        if not (exact or trial.believed(share, puzzling, disturbed)):
            return "data held out do not bear it out surely enough beside what is left"
        if max(puzzle, wandering) * (1.0 - share) > share:
            return "what it leaves unexplained is more than it takes"
        if puzzling and cause.search is not None and self._wanders(found):
            return SLOW
        if disturbed and _unsure(found):
            return SLOW
        if trial.gain.typical <= 0.0 and self._imitated(cause, trial.gain):
            return "poles and zeros tell it as well"
        # the share of a delay is told against a plant without zeros, and says less
        doubted = share < _STRONG or cause.cause == "transport_delay"
        pays = trial.gain.sureness > _SURE and max(puzzle, disturbance) == 0.0
        if (doubted and not pays and _vague(cause, found)) or _sizeless(found):
            return "its size is lost in its standard error"
        brief = share < _TAKEN and _by_brief_noise(cause) and self._beside(cause, trials)
        bent = cause.cause in _BENDS and _faint(found)
        bent = bent and self._beside(cause, [one for one in trials if one[0].cause in _BENDS])
        if brief or bent or self._mends(cause, trial.gain, trials, leads):
            return "it may only mend the form of a cause beside it"
        if _of_a_bend(cause, trials):
            return "it is where the tangent of the bent characteristic meets zero"
        if found.form == RESTS:
            return "it is the level at which the plant rests"
        if self._negligible(found):
            return "so much of it every vehicle, plant or bus has"
        if _spoils(found):
            return "the path gets worse with it"
        return ""

    def _little(self, cause: Named, trial: Trial, found: Finding, leads: bool) -> bool:
        """Whether a cause takes little of its channel's error: of what is left without it, or of
        all that no cause takes, where it is little of the rest as well."""
        share = max(found.share, trial.gain.typical)
        part, points = self._of_all(cause, trial.gain), trial.gain.after - trial.gain.before
        nothing = points < _NEXT_TO_NOTHING and cause.cause != "transport_delay"  # zeros tell it
        trace = nothing or (0.0 <= part < _TRACE and points < _TRACE_POINTS)
        rest = share < (_TRACE_SHARE if trace else _MUCH) and points < _POINTS
        rest = rest and (nothing or found.statistic < _CERTAIN)
        return share < MINOR or (rest and 0.0 <= part < MINOR and not leads)

    def _mends(
        self, cause: Named, gain: Gain, trials: Sequence[tuple[Named, Trial]], leads: bool = False
    ) -> bool:
        """Whether a cause of an actuator only mends the form of another one: a little of what is
        told of its kind, unless it leads, or what many others would tell as well."""
        beside = [c for c, _ in trials if c.search is cause.search and c is not cause]
        if cause.search is None or not beside:
            return False
        little = 0.0 <= self._of_all(cause, gain) < MINOR and not leads
        little = little and bool(self.of_its_kind(cause, trials))
        return little or sum(r.indistinguishable for r in cause.rivals) >= _MANY

    def _beside(self, cause: Named, trials: Sequence[tuple[Named, Trial]]) -> bool:
        """Whether another cause of the same actuator takes more."""
        own = {c: t.gain.mse_before for c, t in trials if c.search is cause.search}
        return own[cause] < max(own.values())

    def _told_by(self, cause: Named, gain: Gain) -> bool:
        """Whether a cause of an actuator is worth most in that actuator's response."""
        return gain.channel == output_of(self.searches, cause.search)

    def _of_all(self, cause: Named, gain: Gain) -> float:
        """Share that a cause takes of what its channel errs by with no cause at all; NaN where an
        actuator's is told by another channel."""
        if cause.search is not None and not self._told_by(cause, gain):
            return math.nan
        return self._part(gain)

    def _part(self, gain: Gain) -> float:
        """Share that a cause takes of what its channel errs by with no cause; 0 where that is
        unknown."""
        if gain.channel not in self.baseline:
            return 0.0
        return (gain.mse_before - gain.mse_after) / max(self.baseline[gain.channel].mse, 1e-300)

    def taken(self, channel: str) -> float:
        """Share of the baseline's squared error that all causes take; 0 where none is known."""
        if channel not in self.baseline:
            return 0.0
        return 1.0 - self.extended[channel].mse / max(self.baseline[channel].mse, 1e-300)

    def fitted(self, channel: str) -> float:
        """The same of an actuator where it was fitted, or of the model without the cause that takes
        most there; 1 for other channels."""
        for spec, own in self.searches.items():
            if spec.output == channel:
                less = [own.baseline, *(f.less for f in own.findings)]
                errors = [float(np.mean((own.stage.y - f.y)[own.stage.mask] ** 2)) for f in less]
                left = float(np.mean((own.stage.y - own.final.y)[own.stage.mask] ** 2))
                return 1.0 - left / max(*errors, 1e-300)
        return 1.0

    def _much_together(self, channel: str) -> bool:
        """Whether all causes take more than half of the baseline's squared error, or a good part of
        it that is clear in FIT as well."""
        taken = self.taken(channel)
        if taken <= _MUCH:
            return False
        points = self.extended[channel].fit - self.baseline[channel].fit
        return taken > _STRONG or points > _POINTS

    def _imitated(self, cause: Named, gain: Gain) -> bool:
        """Whether the best plant without causes is as good on data held out: its poles and zeros
        tell what the cause does. Not for zeros in the right half plane, since a delay is what they
        imitate, and a mode has a rule of its own."""
        if cause.search is None or not self._told_by(cause, gain) or cause.cause == "resonance":
            return False
        late = cause.cause == "transport_delay" and backward(cause.search.baseline.hypothesis).size
        return not late and self.taken(gain.channel) <= 0.0

    def _wanders(self, found: Finding) -> bool:
        """Whether any slow error has what it tells: a mean or a drift that is not nearly all of
        it, or a period that fits into the longest run only a few times."""
        if found.cause in ("offset", "gain_drift"):
            return found.share < NEARLY_ALL
        slow = found.cause == "periodic_disturbance"
        return slow and found.parameters["frequency"].value * self._longest < _PERIODS

    @property
    def _longest(self) -> float:
        """Duration of the longest run, s."""
        return self.runs.length * self.runs.dt

    def _negligible(self, found: Finding) -> bool:
        """Whether it is less than a body's or a plant's own: a sensor that is late by less than
        half a sample, tyres by less than one that tell little, a body that turns with its tyres, a
        response that is early or late by what every bus takes, a mode that poles of the baseline
        tell as well, or what hardly swings in these logs, at no frequency of its own, or between
        their samples; a body that is slightly another, or slower in bends; or a small gain in one
        channel that is none on the road.
        """
        value, dt = next(iter(found.parameters.values())).value, self.runs.dt
        none, g = False, found.gain
        if found.cause in ("sensor_delay", "sensor_lag"):
            none = abs(value) < 0.5 * dt
        elif found.cause == "tyre_relaxation":
            short = value < dt * float(np.mean(np.abs(self.runs.channel("v"))))
            none = short and found.share < _STRONG  # what every vehicle has tells a part of it
        elif found.cause == "understeer":
            same = abs(value) * float(np.mean(self.runs.channel("v") ** 2)) < _SAME
            none = same and g.after - g.before < _SLIGHT_POINTS
        elif found.cause == "cross_coupling" and found.where == "powertrain":
            none = found.share < _DRAG and g.after - g.before < _DRAGGED and not _shorter(g)
        elif found.cause == "yaw_inertia":
            none = value * float(np.mean(np.abs(self.runs.channel("v")))) < _TURNS
        elif found.cause == "transport_delay":
            none = value < 0.0 or (value < _BUS and g.after - g.before < _LATE)
        elif found.cause == "periodic_disturbance":
            frequency = found.parameters["frequency"]
            none = frequency.value * self._longest < FEWEST
            none = none or frequency.std * self._longest > _BLURRED
        elif found.cause == "resonance":
            damping = found.parameters["damping"].value
            none = damping > _DAMPED or (damping > _LIGHT and self._part(g) < _ADDS)
            frequency = found.parameters["frequency"].value
            none = none or frequency * self._longest < FEWEST or frequency * dt > 0.5
        if found.where in ("vehicle", "sensor"):
            none = none or (found.statistic < _SLIGHT and g.after - g.before < _SLIGHT_POINTS)
        worse = g.ate_before is not None and g.ate_after is not None and g.ate_after > g.ate_before
        return none or (worse and max(found.share, g.typical) < _DOUBTFUL)


def _of_a_bend(cause: Named, trials: Sequence[tuple[Named, Trial]]) -> bool:
    """Whether an offset is but where the tangent of a bent characteristic meets zero, which its
    actuator never comes near."""
    if cause.cause != "offset" or cause.search is None:
        return False
    stage = cause.search.stage
    sizes = np.abs(stage.u[stage.mask | stage.held_out])
    bent = any(c.search is cause.search and c.cause == "gain_nonlinearity" for c, _ in trials)
    return bent and bool(sizes.min() > _REACHED * sizes.max())


def of_innovations(cause: Named, trial: Trial) -> float:
    """Share that a delay takes of the innovations of data held out: where a slow error is most of
    what a model leaves, a chain of lags errs as little, and follows a command otherwise."""
    if cause.cause != "transport_delay" or cause.search is None:
        return 0.0
    return 1.0 - math.exp(-max(trial.worth, 0.0) / float(cause.search.judges.sum()))


def _by_brief_noise(cause: Named) -> bool:
    """Whether noise of the error's own colour would not show it."""
    return cause.search is not None and isinstance(cause.search.stage.noise, BriefNoise)


def _shorter(gain: Gain) -> bool:
    """Whether the error of the path is clearly less."""
    if gain.ate_before is None or gain.ate_after is None:
        return False
    return gain.ate_after < (1.0 - _DOUBTFUL) * gain.ate_before


def _faint(found: Finding) -> bool:
    """Whether a cause takes little, and that not surely."""
    return found.share < _LITTLE and found.statistic < _FAINT


def _spoils(found: Finding) -> bool:
    """Whether a cause that is not sure makes the path worse, the more so the more it takes."""
    before, after = found.gain.ate_before, found.gain.ate_after
    if before is None or after is None or found.statistic >= _FAINT:
        return False
    return after > (_WORSE if found.share < _LITTLE else _MUCH_WORSE) * before


def _sizeless(found: Finding) -> bool:
    """Whether the size of a cause is lost in its standard error: of a mode its weight, since noise
    has a frequency, too, and a plant of more poles has every weight; of others every parameter."""
    told = found.parameters
    if found.cause == "resonance" and "weight" in told:
        return abs(told["weight"].value) < _WEIGHED * told["weight"].std
    return all(abs(e.value) < _NOTHING * e.std for e in told.values())


def _exact(found: Finding) -> bool:
    """Whether a delay is sure by its size: it shows at what is fast, and noise or a slow error that
    is most of all error hides what it takes, and takes it from block to block."""
    if found.cause != "transport_delay" or found.statistic < _CERTAIN:
        return False
    delay = found.parameters["delay"]
    return delay.value > _EXACT * delay.std


def _unsure(found: Finding) -> bool:
    """Whether a change with time is known so badly that a part of a steady slow error may be it."""
    told = [e for name, e in found.parameters.items() if name not in ("time", "slowing")]
    return found.cause in _AGING and all(abs(e.value) < _CHANGED * e.std for e in told)


def changes_somehow(found: Finding, why: str) -> bool:
    """Whether a change with time that is minor as part of what is slow takes so much that there is
    one all the same."""
    return why == SLOW and found.cause in _AGING and found.share > _STRONG


def _vague(cause: Named, found: Finding) -> bool:
    """Whether few parameters are not told from nothing, each by itself and all together, since
    blocks of the data disagree."""
    told = list(found.parameters.values())
    if len(told) > _FEW or any(abs(e.value) >= _CLEAR * e.std for e in told):
        return False
    if cause.search is None or cause.finding is None or len(told) == 1:
        return True
    each, together = cause.search.away(cause.finding)
    return together < _CLEAR**2 * each.size


def overshadowed(found: Finding, findings: Sequence[Finding]) -> bool:
    """Whether it is next to nothing beside a strong finding, whose form it may mend: a fade that is
    not quite straight, a part that is not quite a formula. A delay that is known exactly mends
    none but one of its own actuator."""
    weak = _WEAK if found.statistic >= _FAINT else 2.0 * _WEAK
    strong = [f for f in findings if f.share > _STRONG]
    if _exact(found):
        strong = [f for f in strong if f.where == found.where]
    return found.share < weak and bool(strong)


def crowd(findings: Sequence[Finding]) -> tuple[list[Finding], str]:
    """Of the findings of one actuator those that are one cause without a name, and what is said of
    them: four or more, or several that bend one characteristic where none takes half of the error
    by itself."""
    said = "it takes {} together, as what has no name here would"
    if len(findings) >= _CROWD:
        return list(findings), said.format("four causes")
    bends = [f for f in findings if f.cause in _BENDS]
    formed = any(f.cause == "gain_nonlinearity" for f in bends)
    if len(bends) > 1 and formed and all(f.share < _STRONG for f in bends):
        return bends, said.format(f"{len(bends)} bends of its characteristic")
    return [], ""
