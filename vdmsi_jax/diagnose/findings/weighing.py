"""What causes are weighed against: what each takes where others, or none, are in the model."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from ...config import PlantSpec
from ..answer.result import ChannelScore, Gain
from ..search.disguise import backward
from ..search.found import Search, output_of
from ..search.judge import Trial
from ..signals.runs import Runs
from .naming import Named

MINOR = 0.03
"""Share of the held-out squared error of its channel, with no cause or with all others, below which
a significant cause is minor: cars on a physics engine, whose causes are none, reach 0.026."""

MUCH = 0.2
"""Share of what all others leave, from which on a cause matters however small it is beside them."""

_MOST, _POINTS = 0.5, 2.0  # share of the error, and points of FIT, that causes take together
_KINDS = (
    frozenset({"coulomb_friction", "backlash"}),
    frozenset({"road_grade", "periodic_disturbance"}),
    frozenset({"rate_limit", "resonance"}),  # a loop whose drive is limited rings as it lets go
)  # causes of which one tells what the form of the other misses
_MANY = 4  # rivals that explain the logs as well, from which on a cause beside others is anything


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
            (self.of_all(other, trial.gain), trial.gain.channel, other)
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

    def mends(
        self, cause: Named, gain: Gain, trials: Sequence[tuple[Named, Trial]], leads: bool = False
    ) -> bool:
        """Whether a cause of an actuator only mends the form of another one: a little of what is
        told of its kind, unless it leads, or what many others would tell as well."""
        beside = [c for c, _ in trials if c.search is cause.search and c is not cause]
        if cause.search is None or not beside:
            return False
        little = 0.0 <= self.of_all(cause, gain) < MINOR and not leads
        little = little and bool(self.of_its_kind(cause, trials))
        return little or sum(r.indistinguishable for r in cause.rivals) >= _MANY

    def _told_by(self, cause: Named, gain: Gain) -> bool:
        """Whether a cause of an actuator is worth most in that actuator's response."""
        return gain.channel == output_of(self.searches, cause.search)

    def of_all(self, cause: Named, gain: Gain) -> float:
        """Share that a cause takes of what its channel errs by with no cause at all; NaN where an
        actuator's is told by another channel."""
        if cause.search is not None and not self._told_by(cause, gain):
            return math.nan
        return self.part(gain)

    def part(self, gain: Gain) -> float:
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
        if taken <= MUCH:
            return False
        points = self.extended[channel].fit - self.baseline[channel].fit
        return taken > _MOST or points > _POINTS

    def imitated(self, cause: Named, gain: Gain) -> bool:
        """Whether the best plant without causes is as good on data held out: its poles and zeros
        tell what the cause does. Not for zeros in the right half plane, since a delay is what they
        imitate, and a mode has a rule of its own."""
        if cause.search is None or not self._told_by(cause, gain) or cause.cause == "resonance":
            return False
        late = cause.cause == "transport_delay" and backward(cause.search.baseline.hypothesis).size
        return not late and self.taken(gain.channel) <= 0.0


def of_innovations(cause: Named, trial: Trial) -> float:
    """Share that a delay takes of the innovations of data held out: where a slow error is most of
    what a model leaves, a chain of lags errs as little, and follows a command otherwise."""
    if cause.cause != "transport_delay" or cause.search is None:
        return 0.0
    return 1.0 - math.exp(-max(trial.worth, 0.0) / float(cause.search.judges.sum()))
