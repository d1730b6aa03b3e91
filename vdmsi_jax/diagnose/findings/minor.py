"""Significant is not important: why a cause that the data support does not matter.

Every rule is a sentence that the report gives and a function that says whether it holds. The
sizes beside them are those that parted right names from wrong ones in exams and in the hunt.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ..answer.result import RESTS, Finding, Gain
from ..search.judge import NEARLY_ALL, Trial
from ..signals.noise import BriefNoise
from .everyday import is_everyday
from .naming import Named
from .weighing import MINOR, MUCH, Weighing

LITTLE = "it takes little of the error"
"""Of what is significant and of no weight."""

MENDS = "it may mend the form of what nothing explains"
SPOILS = "the path gets worse with it"
NO_SPEED = "all but the speed would be late, as where that is none of the vehicle's"
SLOW = "any slow error has such a part"
"""Of what changes with time, or is there all the time."""
BEGINS = "it is there only as the runs begin or end, as what warms up is"
"""Of a change of regime."""

_POINTS, _CERTAIN = 2.0, 500.0  # of FIT, and of twice the log-likelihood: from either one, or from
# `MUCH` of what all others leave, a cause matters however small it is beside them; of eight blind
# exams wrong names so small had up to 0.02, 0.1 and 220, right ones 0.23, 0.5 and 500
_TRACE, _TRACE_POINTS, _TRACE_SHARE = 0.005, 0.5, 0.3  # of what its channel errs by with no cause,
# of FIT, and of what all others leave, below which a cause is a trace beside another's form
_NEXT_TO_NOTHING = 0.1  # points of FIT, below which it is one however sure
_STRONG = 0.5  # share, from which on a cause needs no sure size
_FAINT = 100.0  # twice the log-likelihood, below which a cause is not sure
_LITTLE = 0.3  # share, below which one that is so faint mends a bend beside it, or spoils the path:
_WORSE, _MUCH_WORSE = 1.1, 2.0  # times of its error, and whatever its share: of seven exams right
# names that do so had shares from 0.38, and as faint ones 1.1
_ASTRAY = 3.0  # times the error of a path
_LONGER, _SURELY = 1.25, 200.0  # likewise of a cause of an actuator, and its statistic: of eleven
# exams one little cause is so, a right one
_BORNE_OUT = 4.0  # standard errors of its gain, from which on what is so faint only happens to
# spoil one path: of twelve exams a right name that does so had 5.4, wrong ones up to 1.6
_NOTHING = 0.5  # standard errors, below which a parameter is nothing, whatever it takes
_NO_CHANGE = 1.5  # likewise of a change of regime, whose moment and lag fit what is slow
_CLEAR, _FEW = 2.0, 3  # standard errors, below which a parameter may be nothing; of so many
_SURE = 2.5  # standard errors of the gain in FIT held out, from which on a cause is one beside no
# structure: poles and zeros may take over so much of its size that it is lost all the same
_PUZZLE = 0.1  # share of the error without a cause that must puzzle beside it, to doubt its name
_AGING = frozenset({"gain_drift", "regime_change"})
_WHEN = ("time", "ramp")  # parameters of a change that tell no size
_CHANGED = 4.9  # standard errors of these, below which they are minor beside a steady slow error:
# the hunt's and ten exams' right ones had from 5.2, but for two beside none, wrong ones 3.3 to 4.7
_EDGE = 0.08  # of the longest run, that a change lies before or behind: of fourteen exams right
# ones lay from 0.28 to 0.56, a motor that warms up at 0.04
_PERIODS = 6.0  # in the longest run, of a periodic disturbance beside what nothing explains
_EXACT = 20.0  # standard errors, from which on the size of a delay is known beside slow errors
_TAKEN = 0.4  # share, below which a cause that only brief noise shows may mend what is slow
_REACHED = 0.1  # of the largest command, above which all are where nothing shows the one at zero
_WEIGHED = 5.0  # standard errors, that the weight of a mode must have beside its plant
WEAK = 0.05
"""Share, below which a cause is next to nothing beside one above half, and below twice of which
where it is faint."""
_CROWD = 4  # causes of one actuator, from which on they are one that the library lacks
BENDS = frozenset({"gain_nonlinearity", "saturation", "gain_asymmetry"})
"""Of one characteristic."""


@dataclass(frozen=True, eq=False)
class Weighed:
    """A cause that is sure, and all that it is weighed against.

    Attributes:
        weighing: the searches and scores.
        cause: what is weighed.
        trial: what it is worth.
        found: the same as a finding.
        trials: all causes, and what they are worth.
        puzzle: share of what is left in its channel that nothing explains, if that is much.
        disturbance: share of it that a steady disturbance is.
        leads: whether it is the first of several that stand in for each other.
    """

    weighing: Weighing
    cause: Named
    trial: Trial
    found: Finding
    trials: Sequence[tuple[Named, Trial]]
    puzzle: float = 0.0
    disturbance: float = 0.0
    leads: bool = False

    def why_minor(self) -> str:
        """Why it does not matter, in words; empty where it does."""
        return next((words for words, holds in RULES if holds(self)), "")

    @property
    def share(self) -> float:
        """Of the error without it, that it takes on the whole or in most blocks."""
        return max(self.found.share, self.trial.gain.typical)

    @property
    def points(self) -> float:
        """Of FIT on data held out."""
        return self.trial.gain.after - self.trial.gain.before

    @cached_property
    def part(self) -> float:
        """Share that it takes of what its channel errs by with no cause at all; NaN where an
        actuator's is told by another channel."""
        return self.weighing.of_all(self.cause, self.trial.gain)

    def doubts(self, left: float) -> bool:
        """Whether so much of what is left is much of the error without the cause."""
        return left * (1.0 - self.share) > _PUZZLE

    @property
    def puzzling(self) -> bool:
        """Whether much beside it is what nothing explains."""
        return self.doubts(self.puzzle)

    @property
    def disturbed(self) -> bool:
        """Whether much beside it is a steady disturbance."""
        return self.doubts(self.disturbance)

    @property
    def exact(self) -> bool:
        """Whether it is sure by its size, beside no puzzle."""
        return not self.puzzling and _exact(self.found)

    def beside(self, *causes: str) -> bool:
        """Whether another cause of the same actuator, of these words if any, takes more."""
        own = {
            c: t.gain.mse_before
            for c, t in self.trials
            if c.search is self.cause.search and (not causes or c.cause in causes)
        }
        return own[self.cause] < max(own.values())


def _takes_little(of: Weighed) -> bool:
    """Of what is left without it, or of all that no cause takes, where it is little of the rest as
    well."""
    if of.exact or _leads_astray(of) or _adds_up(of.found):
        return False
    late = of.cause.cause == "transport_delay"  # which zeros tell
    nothing = of.points < _NEXT_TO_NOTHING and not late
    trace = nothing or (0.0 <= of.part < _TRACE and of.points < _TRACE_POINTS)
    rest = of.share < (_TRACE_SHARE if trace else MUCH) and of.points < _POINTS
    rest = rest and (nothing or of.found.statistic < _CERTAIN)
    return of.share < MINOR or (rest and 0.0 <= of.part < MINOR and not of.leads)


def _leads_astray(of: Weighed) -> bool:
    """Whether without it the path errs several times as much, of a vehicle whose position alone is
    measured: noise hides in its steps what adds up on its way."""
    before, after = of.found.gain.ate_before, of.found.gain.ate_after
    if before is None or after is None or of.cause.body is None:
        return False
    astray = of.found.statistic > _FAINT and before > _ASTRAY * after
    return astray and not of.weighing.runs.seen("psi").any()


def _adds_up(found: Finding) -> bool:
    """Whether the path errs by clearly more without a cause of an actuator that is sure, which
    noise hides in its response."""
    before, after = found.gain.ate_before, found.gain.ate_after
    if before is None or after is None or found.where not in ("powertrain", "steering"):
        return False
    return found.statistic > _SURELY and before > _LONGER * after


def _differs(of: Weighed) -> bool:
    """So that elsewhere it may be a loss."""
    small = of.found.share < MUCH and of.found.statistic < _CERTAIN
    return small and 0.0 <= of.points < min(of.trial.gain.se, _POINTS)


def _is_a_trace(of: Weighed) -> bool:
    return of.puzzling and 0.0 <= of.part < _TRACE


def _is_not_borne_out(of: Weighed) -> bool:
    return not (of.exact or of.trial.believed(of.share, of.puzzling, of.disturbed))


def _leaves_more(of: Weighed) -> bool:
    wandering = of.disturbance if of.cause.cause == "periodic_disturbance" else 0.0
    return max(of.puzzle, wandering) * (1.0 - of.share) > of.share


def _is_slow(of: Weighed) -> bool:
    """A mean, a drift or a change that is not nearly all of an error, or a period that fits into
    the longest run only a few times, beside a puzzle; a change that is hardly known beside a
    disturbance. Of all exams right changes had no puzzle beside them."""
    if of.disturbed and _unsure(of.found):
        return True
    if not of.puzzling or of.cause.search is None:
        return False
    if of.found.cause in ("offset", "gain_drift", "regime_change"):
        return of.found.share < NEARLY_ALL
    if of.found.cause != "periodic_disturbance":
        return False
    return of.found.parameters["frequency"].value * of.weighing.runs.longest < _PERIODS


def _only_begins(of: Weighed) -> bool:
    """Whether a change lies at the edge of the runs that it is counted in."""
    search, finding = of.cause.search, of.cause.finding
    if of.found.cause != "regime_change" or search is None or finding is None:
        return False
    if getattr(search.stage.slots[finding.number].effect, "over", "run") != "run":
        return False
    at = of.found.parameters["time"].value / of.weighing.runs.lasting
    return not _EDGE < at < 1.0 - _EDGE


def _is_imitated(of: Weighed) -> bool:
    return of.trial.gain.typical <= 0.0 and of.weighing.imitated(of.cause, of.trial.gain)


def _has_no_size(of: Weighed) -> bool:
    """Unless it takes half of the error, or surely pays beside nothing that is open. The share of a
    delay is told against a plant without zeros, and says less."""
    doubted = of.share < _STRONG or of.cause.cause == "transport_delay"
    pays = of.trial.gain.sureness > _SURE and max(of.puzzle, of.disturbance) == 0.0
    return (doubted and not pays and _vague(of.cause, of.found)) or _sizeless(of.found)


def _mends(of: Weighed) -> bool:
    """Whether only brief noise shows it beside another, or it is a faint bend beside another, or a
    little of what is told of its kind."""
    if of.share < _TAKEN and _by_brief_noise(of.cause) and of.beside():
        return True
    if of.cause.cause in BENDS and _faint(of.found) and of.beside(*BENDS):
        return True
    return of.weighing.mends(of.cause, of.trial.gain, of.trials, of.leads)


def _is_of_a_bend(of: Weighed) -> bool:
    """Of an offset whose actuator never comes near zero."""
    search = of.cause.search
    if of.cause.cause != "offset" or search is None:
        return False
    sizes = np.abs(search.stage.u[search.stage.mask | search.stage.held_out])
    bent = any(c.search is search and c.cause == "gain_nonlinearity" for c, _ in of.trials)
    return bent and bool(sizes.min() > _REACHED * sizes.max())


def _rests(of: Weighed) -> bool:
    return of.found.form == RESTS


def _is_everyday(of: Weighed) -> bool:
    return is_everyday(of.found, of.weighing.runs, of.weighing.part(of.found.gain))


def _ends(of: Weighed) -> bool:
    """Of a cause of the body beside what nothing explains."""
    return of.cause.body is not None and of.cause.body.ends and of.puzzle > 0.0


def _spoils(of: Weighed) -> bool:
    """Whether a cause that is not sure makes the path worse, the more so the more it takes, and the
    surer data held out bear it out."""
    if of.found.statistic >= _FAINT:
        return False
    slight = of.found.share < _LITTLE and of.trial.gain.sureness < _BORNE_OUT
    return worsens(of.found.gain, _WORSE if slight else _MUCH_WORSE)


def worsens(gain: Gain, least: float = _WORSE) -> bool:
    """Whether the path gets so many times worse with a cause."""
    before, after = gain.ate_before, gain.ate_after
    return before is not None and after is not None and after > least * before


RULES: tuple[tuple[str, Callable[[Weighed], bool]], ...] = (
    (LITTLE, _takes_little),
    ("its gain differs too much from block to block", _differs),
    (MENDS, _is_a_trace),
    ("data held out do not bear it out surely enough beside what is left", _is_not_borne_out),
    ("what it leaves unexplained is more than it takes", _leaves_more),
    (SLOW, _is_slow),
    (BEGINS, _only_begins),
    ("poles and zeros tell it as well", _is_imitated),
    ("its size is lost in its standard error", _has_no_size),
    ("it goes as far as is tried, and leaves much", _ends),
    ("it may only mend the form of a cause beside it", _mends),
    ("it is where the tangent of the bent characteristic meets zero", _is_of_a_bend),
    ("it is the level at which the plant rests", _rests),
    ("so much of it every vehicle, plant or bus has", _is_everyday),
    (SPOILS, _spoils),
)
"""In their order: the first that holds is the reason."""


def _by_brief_noise(cause: Named) -> bool:
    """Whether noise of the error's own colour would not show it."""
    return cause.search is not None and isinstance(cause.search.stage.noise, BriefNoise)


def _faint(found: Finding) -> bool:
    """Whether a cause takes little, and that not surely."""
    return found.share < _LITTLE and found.statistic < _FAINT


def _sizeless(found: Finding) -> bool:
    """Whether the size of a cause is lost in its standard error: of a mode its weight, since noise
    has a frequency, too, and a plant of more poles has every weight; of others every parameter but
    the time at which something changes, which is none."""
    told = found.parameters
    if found.cause == "resonance" and "weight" in told:
        return abs(told["weight"].value) < _WEIGHED * told["weight"].std
    least = _NO_CHANGE if found.cause == "regime_change" else _NOTHING
    return all(abs(e.value) < least * e.std for name, e in told.items() if name not in _WHEN)


def _exact(found: Finding) -> bool:
    """Whether a delay is sure by its size: it shows at what is fast, and noise or a slow error that
    is most of all error hides what it takes, and takes it from block to block."""
    if found.cause != "transport_delay" or found.statistic < _CERTAIN:
        return False
    delay = found.parameters["delay"]
    return delay.value > _EXACT * delay.std


def _unsure(found: Finding) -> bool:
    """Whether a change with time is known so badly that a part of a steady slow error may be it."""
    told = [e for name, e in found.parameters.items() if name not in (*_WHEN, "slowing")]
    return found.cause in _AGING and all(abs(e.value) < _CHANGED * e.std for e in told)


def changes_somehow(found: Finding, why: str) -> bool:
    """Whether a change with time that is minor as part of what is slow, or of how runs begin, takes
    so much that there is one all the same."""
    least = {SLOW: _STRONG, BEGINS: _LITTLE}.get(why, np.inf)
    return found.cause in _AGING and found.share > least


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
    none but one of its own actuator, and what adds up on the path is more than nothing."""
    if _adds_up(found):
        return False
    weak = WEAK if found.statistic >= _FAINT else 2.0 * WEAK
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
    bends = [f for f in findings if f.cause in BENDS]
    formed = any(f.cause == "gain_nonlinearity" for f in bends)
    if len(bends) > 1 and formed and all(f.share < _STRONG for f in bends):
        return bends, said.format(f"{len(bends)} bends of its characteristic")
    return [], ""
