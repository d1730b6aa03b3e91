"""What a search finds in a stage: causes, their worth, and what could stand in their place."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float

from ...config import PlantSpec
from ..actuator.hypothesis import Refit
from ..actuator.stage import Stage
from .disguise import backward, lingers

MARGIN = 7.5
"""Two explanations whose log-likelihoods differ by less than half of this are not told apart: with
it the truth stands in the set in 99.7 % of cases."""
FEW = 50
"""Samples, of which more must be held out to judge by."""
_LINEAR = ("transport_delay", "resonance", "offset", "periodic_disturbance")
"""Causes that poles and zeros can imitate."""
_BROKEN = 1.5  # times the squared error of the plain plant, from which a model is of no use


@dataclass(frozen=True, eq=False)
class PlantFinding:
    """A cause that the evidence supports.

    Attributes:
        number: of the effect in its stage.
        gain: twice the log-likelihood that it is worth in the final model.
        less: the final model without it, refitted.
        others: numbers of the effects that were tried in its place, with what they lack in twice
            the log-likelihood; those within `MARGIN` explain the data as well.
        alike: those of them that lack more, but not from block to block of the data (Vuong,
            Likelihood ratio tests for model selection and non-nested hypotheses, 1989).
        promised: the first round of a refit from the screen's best probe, under the colour that it
            starts with.
    """

    number: int
    gain: float
    less: Refit
    others: tuple[tuple[int, float], ...] = ()
    promised: Refit | None = None
    alike: tuple[int, ...] = ()

    @property
    def rivals(self) -> tuple[int, ...]:
        """The effects that explain the data as well."""
        return tuple(k for k, lack in self.others if lack < MARGIN or k in self.alike)


@dataclass(frozen=True, eq=False)
class Failed:
    """A cause that the data of the fit support, and the data held out do not: `final` had it."""

    finding: PlantFinding
    final: Refit


@dataclass(frozen=True, eq=False)
class Search:
    """What was found in a stage.

    Attributes:
        stage: the data.
        plain: the best plant without causes.
        baseline: the plant of the final order without causes.
        final: the plant with its causes.
        findings: the strongest first.
        failed: what was taken out again, since it fails on data held out.
    """

    stage: Stage
    plain: Refit
    baseline: Refit
    final: Refit
    findings: tuple[PlantFinding, ...]
    failed: tuple[Failed, ...] = ()

    def without(self, finding: PlantFinding) -> Refit:
        """The model without a cause: the best plant without any, where it is the only one and that
        plant is no larger, since a larger one may imitate a cause by poles and zeros that are none,
        and does not tell a delay by its zeros."""
        plain, final = self.baseline.hypothesis, self.final.hypothesis
        larger = plain.poles + plain.zeros > final.poles + final.zeros
        delayed = self.stage.slots[finding.number].cause == "transport_delay"
        told = delayed and backward(plain).size > 0
        several = len(self.findings) > 1
        return finding.less if larger or several or told else self.baseline

    def usable_without(self, finding: PlantFinding) -> Refit:
        """The model without a cause, or the plain plant where the other causes are of no use
        without it: nobody would take a model that errs by so much more. Not for what poles and
        zeros tell, as a mode that outlasts the runs tells a drift."""
        less, stage = self.without(finding), self.stage
        cause = stage.slots[finding.number].cause
        if cause in _LINEAR or (cause == "gain_drift" and lingers(stage, self.plain.hypothesis)):
            return less
        errors = [float(np.mean((stage.y - f.y)[self.judges] ** 2)) for f in (less, self.plain)]
        return self.plain if errors[0] > _BROKEN * errors[1] else less

    @property
    def judges(self) -> Bool[np.ndarray, "R N"]:
        """The samples that judge: those held out, or where they are none, those of the fit."""
        stage = self.stage
        return stage.held_out if stage.held_out.sum() > FEW else stage.mask

    def away(self, finding: PlantFinding) -> tuple[Float[np.ndarray, " k"], float]:
        """How far the free parameters that make a cause large are from nothing: each in its own
        standard deviations, and the square of it for all together. A frequency makes none."""
        fit = self.final
        free = fit.hypothesis.free(self.stage).tolist()
        off, own = self.stage.off, self.stage.slots[finding.number].index
        index = [i for i in own if i in free and off[i] == 0.0]
        at = [free.index(i) for i in index]
        away = fit.hypothesis.theta[index]
        covariance = fit.covariance[np.ix_(at, at)]
        each = np.abs(away) / np.sqrt(np.maximum(np.diag(covariance), 1e-300))
        return each, float(away @ np.linalg.pinv(covariance, hermitian=True) @ away)


def output_of(searches: Mapping[PlantSpec, Search], own: Search | None) -> str:
    """The response in which a search was made; empty where it is none of these."""
    return next((spec.output for spec, search in searches.items() if search is own), "")
