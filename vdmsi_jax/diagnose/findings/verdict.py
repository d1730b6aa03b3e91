"""From what was found to the verdict: confirmed on held-out data, ranked, and what is left."""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial

import numpy as np

from ...config import PlantSpec
from ...data.record import Record
from ..actuator.hypothesis import Refit
from ..answer.result import Budget, Detectable, Diagnosis, Finding, Gain, Rival, Unexplained
from ..answer.words import apart, in_words, sentence, summary
from ..body.body import ASKEW, CAUSES
from ..body.search import BodySearch, at_fixed, chained
from ..residual.of_body import BodyLeft
from ..residual.remains import Remains, unexplained
from ..search.found import FEW, MARGIN, Search, output_of
from ..search.judge import NEARLY_ALL, Scored, Trial, confirmed, gain_of
from ..signals.angle import steering_angle
from ..signals.runs import Runs
from .body_detectability import detectable_in_body
from .body_naming import of_body
from .budget import of_channel, of_path, of_turning
from .channels import channel_scores, responses, units_of
from .experiment import experiment
from .extension import extended_model, plain_model
from .looked import Looked
from .merging import merged, of_yaw_rate
from .minor import (
    LITTLE,
    MENDS,
    NO_SPEED,
    SLOW,
    SPOILS,
    WEAK,
    Weighed,
    changes_somehow,
    crowd,
    overshadowed,
    worsens,
)
from .naming import Named, of_stage, with_form
from .road import Road
from .rounding import COARSE, quantised, tells_rounding
from .weighing import Weighing, of_innovations

_TWINS = {"powertrain": "v", "steering": "delta"}
_SMALL_ELSEWHERE = 0.25  # of what a cause of the body takes, in response spreads: less than that in
# another channel is not what the cause stands in for
_SENSED = {"transport_delay": "sensor_delay", "offset": "sensor_bias"}


@dataclass
class Evidence:
    """Everything that was found, on its way to a diagnosis."""

    records: Sequence[Record]
    runs: Runs
    plants: Mapping[PlantSpec, Looked]
    bodily: BodySearch | None
    unseen: tuple[str, ...]

    @cached_property
    def searches(self) -> dict[PlantSpec, Search]:
        """What was found in each plant."""
        return {spec: looked.search for spec, looked in self.plants.items()}

    def diagnosis(self) -> Diagnosis:
        """Confirm on data held out, rank, and look at what is left."""
        road = self._road()
        if self.bodily is not None and self.bodily.findings:
            if road is not None and road.ruined:
                return self._beside(road, self.bodily, SPOILS)
            if self.bodily.all_late:
                return self._beside(road, self.bodily, NO_SPEED)
        models = (self.runs, self.searches, self.bodily)
        remains = self._remains()
        plain, extended = (channel_scores(*models[1:], extended=e) for e in (False, True))
        rounded = quantised(self.records, extended)
        trials = [(cause, self._trial(cause)) for cause in self._causes()]
        sure = [t for t in trials if t[1].worth > 0.0 and not tells_rounding(*t, rounded)]
        weighing = Weighing(self.searches, self.runs, plain, extended)
        findings, minor, crowds = self._weighed(sure, trials, weighing, remains, road)
        findings += [f for f in rounded if f.share >= COARSE]
        minor += [apart(f, LITTLE) for f in rounded if f.share < COARSE]
        beside = [f for f in findings if overshadowed(f, findings)]
        findings = sorted((f for f in findings if f not in beside), key=_rank)
        minor += [apart(f, "it may mend the form of a much stronger one") for f in beside]
        left = [*remains.structure, *crowds]
        open_ = unexplained(
            left,
            {f.gain.channel for f in findings},
            {f.channel: f.share for f in rounded if f.channel is not None},
            partial(_taken, weighing, findings),
        )
        explained = "explained" if findings else "no_effect"
        told = Diagnosis(
            verdict="unexplained_structure" if open_ else explained,
            findings=tuple(findings),
            minor=tuple(sorted(minor, key=_rank)),
            unexplained=tuple(left),
            disturbances=tuple(remains.disturbances),
            baseline=plain_model(self.searches, self.records),
            model=extended_model(self.searches, self.bodily, self.records),
            orders={s.name: f.baseline.hypothesis.order for s, f in self.searches.items()},
            channels=plain,
            extended=extended,
            ate=None if road is None else road.ate(),
            budget=tuple(self._budget([cause for cause, _ in sure], road, remains.structure_left)),
            detectable=self._detectable(),
            unseen=self.unseen,
            responses=tuple(responses(self.records, *models)),
            paths=() if road is None else tuple(road.paths()),
            records=tuple(self.records),
            held_out=self._held_out(),
            summary="",
        )
        return replace(told, summary=summary(told))

    def _beside(self, road: Road | None, bodily: BodySearch, why: str) -> Diagnosis:
        """Without the causes of the body, which together are none: they are minor, and leave the
        model. What an actuator may have done as well is told as that one's."""
        alone = [c for c in self._causes() if c.body is not None and c.search is None]
        trials = [(c, self._trial(c)) for c in alone]
        spoil = [self._finding(c, trial, road) for c, trial in trials if trial.worth > 0.0]
        without = replace(self, bodily=replace(bodily, final=bodily.plain, findings=()))
        told = without.diagnosis()
        minor = (*told.minor, *(apart(found, why) for found in spoil))
        told = replace(told, minor=tuple(sorted(minor, key=_rank)))
        return replace(told, summary=summary(told))

    def _detectable(self) -> tuple[Detectable, ...]:
        """What the logs would have shown, of the actuators and of the body."""
        sizes = [shown for looked in self.plants.values() for shown in looked.detectable]
        return (*sizes, *([] if self.bodily is None else detectable_in_body(self.bodily)))

    def _remains(self) -> Remains:
        """What all models leave."""
        body = None if self.bodily is None else BodyLeft.of(self.runs, self.bodily)
        return Remains.of({spec: looked.left for spec, looked in self.plants.items()}, body)

    def _weighed(
        self,
        sure: Sequence[tuple[Named, Trial]],
        trials: Sequence[tuple[Named, Trial]],
        weighing: Weighing,
        remains: Remains,
        road: Road | None,
    ) -> tuple[list[Finding], list[Finding], list[Unexplained]]:
        """Of the sure causes those that matter and those that are minor, and the crowds of them
        that are one without a name, as is a change with time of no sure form."""
        findings, minor, crowds, of_plant = [], [], [], {}
        for cause, trial in sure:
            leads, told, less = weighing.leads(cause, trials), cause, None
            if leads:  # each would take nearly as much without the other: what they take together
                assert cause.search is not None
                less = cause.search.plain
                trial = self._trial(cause, less)
                told = _or_else(cause, [c for c, _ in weighing.of_its_kind(cause, trials)])
            found = self._finding(told, trial, road, less, alone=len(trials) == 1)
            channel = trial.gain.channel
            puzzle = _doubt(remains.puzzle, cause, trial.gain)
            disturbance = _doubt(remains.disturbance, cause, trial.gain)
            of = Weighed(weighing, cause, trial, found, trials, puzzle, disturbance, leads)
            why = of.why_minor() or _lost(cause, found, remains, channel, of.share)
            why = why or _of_another_form(of, remains)
            if why:
                minor.append(apart(found, why))
                if changes_somehow(found, why):
                    said = f"it changes with time, of which {in_words(cause.cause)} is no sure form"
                    crowds.append(Unexplained(channel, of.share, ("t",), (), said, puzzling=True))
                continue
            findings.append(found)
            if cause.search is not None:
                of_plant.setdefault(id(cause.search), []).append(found)
        for spec, own in self.searches.items():
            many, said = crowd(of_plant.get(id(own), []))
            if many:
                findings = [f for f in findings if f not in many]
                minor += [apart(f, "several causes would have to explain one error") for f in many]
                taken = min(weighing.taken(spec.output), 1.0)
                crowds.append(Unexplained(spec.output, taken, (), (), said, puzzling=True))
        return findings, minor, crowds

    def _causes(self) -> list[Named]:
        found = []
        for spec, own in self.searches.items():
            for cause in of_stage(own, units_of(self.records, spec)):
                found.append(self._with_twin(spec, cause))
        if self.bodily is not None:
            found += of_body(self.bodily)
        found, vehicle = merged(found), self.records[0].vehicle
        if vehicle is None or any("delta" in record for record in self.records):
            return found
        per_angle = float(np.median(np.abs(self.runs.channel("v")))) / abs(vehicle.wheelbase)
        return [of_yaw_rate(cause, per_angle) for cause in found]

    def _with_twin(self, spec: PlantSpec, cause: Named) -> Named:
        """A cause of an actuator whose sensor may have done the same, if the body lets it."""
        word, channel = _SENSED.get(cause.cause), _TWINS.get(spec.role)
        if word is None or channel is None:
            return cause
        lack = 0.0
        if self.bodily is not None:
            lack = self._lack_of_twin(word, channel, cause)
        rival = Rival(word, "sensor", lack, lack < MARGIN, channel)
        return replace(cause, rivals=tuple(sorted((*cause.rivals, rival), key=lambda r: r.deficit)))

    def _lack_of_twin(self, word: str, channel: str, cause: Named) -> float:
        assert self.bodily is not None
        number = next(
            (i for i, c in enumerate(CAUSES) if (c.cause, c.channel) == (word, channel)), None
        )
        value = next(iter(cause.parameters.values())).value
        if number is None and word == "sensor_bias":  # of the angle: as wheels that stand otherwise
            number, value = ASKEW, -value
        if number is None or number in self.bodily.final.active:
            return 0.0
        return at_fixed(self.bodily, number, value)

    # ---- gains -----------------------------------------------------------------------------

    def _trial(self, cause: Named, less: Refit | None = None) -> Trial:
        """What a cause is worth on data held out, in the channel that it is worth most in; of an
        actuator's beside the model `less`, the one without it by default."""
        tried, sure, faint = [], [], False
        if cause.search is not None and cause.finding is not None:
            stage, final = cause.search.stage, cause.search.final
            name = output_of(self.searches, cause.search)
            promised = cause.finding.promised
            held, use = bool(stage.held_out.sum() > FEW), cause.search.judges
            less = less or cause.search.usable_without(cause.finding)
            scored = replace(
                Scored.of_stage(stage, less, final),
                channel=name,
                memory=stage.scales.time_constant,
            )
            sure.append(confirmed(scored, use, self.runs.dt))
            faint = held and scored.faint(stage.mask, use)
            step = None if promised is None else replace(scored, after=promised.y)
            tried.append((scored, use, held, step))
        if cause.body is not None and self.bodily is not None:
            body, final = self.bodily.body, self.bodily.final
            bare, promised = cause.body.less, cause.body.promised
            for c in body.measured:
                scored, use, held = chained(body, final, bare, c)
                sure.append(confirmed(scored, use, body.dt))
                whole = replace(scored, before=bare.predicted[c], after=final.predicted[c])
                far = near = None
                if promised is not None:
                    far = replace(whole, after=promised.predicted[c])
                    near = chained(body, promised, bare, c)[0]
                tried += [(whole, use, held, far), (scored, use, held, near)]
        scored, use, held, step = max(tried, key=lambda t: t[0].taken(t[1]))
        worth, variance = (sum(parts) for parts in zip(*sure, strict=True))
        gain = gain_of(scored, use, held, self.runs.dt)
        predicted = None if step is None else gain_of(step, use, held, self.runs.dt)
        steady = worth / max(math.sqrt(variance), 1e-300)
        fast = scored.fast(use, self.runs.dt)
        return Trial(gain, predicted, worth if held else cause.statistic, steady, fast, faint)

    def _finding(
        self,
        cause: Named,
        trial: Trial,
        road: Road | None,
        less: Refit | None = None,
        alone: bool = False,
    ) -> Finding:
        gain = trial.gain
        share = max(
            1.0 - gain.mse_after / max(gain.mse_before, 1e-300), of_innovations(cause, trial)
        )
        if road is not None:
            before, after = road.without(cause, less), road.extended_mean
            if alone:  # the baseline, whose order may be another, is a model without it, too
                before = min(before, road.baseline_mean)
            gain = replace(gain, ate_before=before, ate_after=after)
        open_ = [r for r in cause.rivals if r.indistinguishable]
        settles = experiment(cause, open_, self.bodily) if open_ else None
        found = Finding(
            cause=cause.cause,
            where=cause.where,
            channel=cause.channel,
            form=cause.form,
            parameters=with_form(cause.parameters),
            statistic=cause.statistic,
            p_value=_chi_squared(cause.statistic, cause.freedom),
            gain=gain,
            predicted_gain=trial.predicted,
            share=share,
            rivals=cause.rivals,
            separating_experiment=settles,
            sentence="",
        )
        return replace(found, sentence=sentence(found))

    def _road(self) -> Road | None:
        """The drives on the road; None where there are none, or no speed is known on them."""
        if self.bodily is None or "forward" not in self.bodily.body.measured:
            return None
        angle = steering_angle(self.runs)
        assert angle is not None
        searches = {spec.output: own for spec, own in self.searches.items()}
        road = Road(self.runs, searches, self.bodily, angle[0])
        return road if math.isfinite(road.baseline_mean + road.extended_mean) else None

    def _budget(
        self, causes: Sequence[Named], road: Road | None, structure: Mapping[str, float]
    ) -> list[Budget]:
        found = [
            of_channel(
                spec.output,
                units_of(self.records, spec)[1],
                own,
                [c for c in causes if c.search is own],
                structure.get(spec.output, 0.0),
            )
            for spec, own in self.searches.items()
        ]
        if self.bodily is not None and "r" in self.bodily.body.measured:
            found.append(of_turning(self.bodily, causes, structure.get("r", 0.0)))
        return found if road is None else [*found, of_path(road, causes)]

    def _held_out(self) -> str:
        runs = self.runs
        if all(runs.judged):
            return "three tenths of each stretch of the logs, which lie apart"
        return "whole logs: " + ", ".join(runs.judging())


def _rank(found: Finding) -> tuple[float, float]:
    """What orders findings: what they cost on the road, and then the share of their channel."""
    return -found.gain.cost, -found.share


def _taken(weighing: Weighing, findings: Sequence[Finding], channel: str) -> float:
    """Share of a channel's error that findings took, of a baseline with the poles that tell a mode
    or a delay as well, or of the model without the one that took most; where they were fitted or on
    data held out, whichever is less."""
    shares = [f.share for f in findings if f.gain.channel == channel]
    return min(max([weighing.taken(channel), *shares]), weighing.fitted(channel))


def _lost(cause: Named, found: Finding, remains: Remains, channel: str, share: float) -> str:
    """Why a cause is minor beside what no cause accounts for; empty where it is not."""
    outdone = any(f in (cause.finding, cause.body) for f in remains.outdone)
    lags = cause.body is not None and remains.lags(found.cause)
    if outdone or lags or remains.outdoes(found.cause, channel, share):
        return "a kind of error that has no name here explains it better"
    if remains.comes_and_goes(found.cause, channel, found.share):
        return SLOW
    if remains.drowns(channel, found.share, cause.hides_small):
        return "a load that a controller answers is much larger"
    if remains.echoes(channel, found.share, found.statistic, cause.hides_small):
        return "a controller makes the commands, which may know what else is wrong"
    otherwise = remains.moves_otherwise and found.share < NEARLY_ALL
    if cause.search is not None and otherwise and worsens(found.gain):
        return SPOILS
    # that the vehicle moves faster than its speed says is told by that sensor, too
    sensor = "v" if cause.cause == "speed_scale" else cause.channel
    stands_still = remains.stands_still(found.cause, cause.channel)
    if stands_still or (cause.where in ("sensor", "vehicle") and sensor in remains.dropping):
        return "its sensor drops out"
    return ""


def _of_another_form(of: Weighed, remains: Remains) -> str:
    """Why a cause is minor that takes little of all that its channel errs by, beside one of its
    actuator that only stands in for what has no name; empty where it is not."""
    search = of.cause.search
    beside = () if search is None else search.findings
    outdone = any(f in remains.outdone for f in beside)
    return MENDS if outdone and 0.0 <= of.part < WEAK else ""


def _or_else(cause: Named, others: Sequence[Named]) -> Named:
    """A cause that others of its model could stand in for."""
    stand_ins = [Rival(other.cause, other.where, 0.0, True) for other in others]
    names = {(r.cause, r.where) for r in stand_ins}
    rest = [r for r in cause.rivals if (r.cause, r.where) not in names]
    return replace(cause, rivals=(*stand_ins, *rest))


def _doubt(share: Callable[[str, float], float], cause: Named, gain: Gain) -> float:
    """Share of what is left that casts doubt where a cause is told; of the body, in its yaw rate
    and in the responses of the actuators as well, by which it moves. What is small there makes no
    large error elsewhere."""
    own = share(gain.channel, 0.0)
    if cause.body is None:
        return own
    before, after = (1.0 - 0.01 * fit for fit in (gain.before, gain.after))
    least = _SMALL_ELSEWHERE * math.sqrt(max(before**2 - after**2, 0.0))
    return max(own, *(share(c, least) for c in {"r", *_TWINS.values()} - {gain.channel}))


def _chi_squared(statistic: float, freedom: int) -> float:
    """Probability that a chi-squared variable exceeds `statistic`, by its finite sums."""
    x, k = 0.5 * max(statistic, 0.0), freedom
    if k % 2 == 0:
        terms = [x**i / math.factorial(i) for i in range(k // 2)]
        return math.exp(-x) * sum(terms) if x < 700 else 0.0
    tail = math.erfc(math.sqrt(x))
    terms = [x ** (i + 0.5) / math.gamma(i + 1.5) for i in range(k // 2)]
    return tail + (math.exp(-x) * sum(terms) if x < 700 else 0.0)
