"""What `diagnosis.json` says of a diagnosis."""

import math
from collections.abc import Mapping
from typing import Any

from ...files import plain
from ...model_file import Model, Plant, geometry
from .result import (
    Budget,
    ChannelScore,
    Detectable,
    Diagnosis,
    Estimate,
    Finding,
    Gain,
    Rival,
    Unexplained,
)

DIAGNOSIS = "vdmsi.diagnosis/1"


def diagnosis_document(diagnosis: Diagnosis) -> dict[str, Any]:
    """The contents of `diagnosis.json`: plain data that strict JSON can hold.

    What is not finite is null. A parameter that is infinite is left out: it is a limit on the side
    on which there is none.
    """
    ate = diagnosis.ate or {}
    document = {
        "schema": DIAGNOSIS,
        "verdict": diagnosis.verdict,
        "summary": diagnosis.summary,
        "logs": [record.log for record in diagnosis.records],
        "held_out": diagnosis.held_out,
        "baseline": {
            "model": model_document(diagnosis.baseline, diagnosis.orders),
            "channels": _channels(diagnosis.channels),
            "ate": ate.get("baseline"),
        },
        "extended": {"channels": _channels(diagnosis.extended), "ate": ate.get("model")},
        "findings": [finding_document(finding) for finding in diagnosis.findings],
        "minor": [finding_document(finding) for finding in diagnosis.minor],
        "unexplained": [_unexplained(left) for left in diagnosis.unexplained],
        "disturbances": [_unexplained(left) for left in diagnosis.disturbances],
        "noise_ceiling": {
            channel: {"fit": score.ceiling} for channel, score in diagnosis.channels.items()
        },
        "budget": [_budget(budget) for budget in diagnosis.budget],
        "detectability": [_detectable(cause) for cause in diagnosis.detectable],
        "contradictions": list(diagnosis.contradictions),
        "unseen": list(diagnosis.unseen),
        "repairs": [
            f"{record.log}: {told}" for record in diagnosis.records for told in record.repairs
        ],
    }
    return plain(document)


def model_document(model: Model, orders: Mapping[str, str]) -> dict[str, Any]:
    """The linear plants of a model as a model file holds them, each with the name of its order."""
    plants = {name: _plant(plant, orders.get(name)) for name, plant in model.plants.items()}
    vehicle = {} if model.vehicle is None else {"vehicle": geometry(model.vehicle)}
    return {"plants": plants, **vehicle}


def _plant(plant: Plant, order: str | None) -> dict[str, Any]:
    linear: Any = getattr(plant.model, "plant", plant.model)
    return {
        "input": plant.spec.input,
        "output": plant.spec.output,
        "order": linear.order if order is None else order,
        "num": linear.num,
        "den": linear.den,
        "delay": 0.0 if linear.delay is None else linear.delay,
        "offset": 0.0 if linear.offset is None else linear.offset,
    }


def _channels(scores: Mapping[str, ChannelScore]) -> dict[str, Any]:
    return {
        channel: {"fit": score.fit, "mse": score.mse, "noise_std": score.noise_std}
        for channel, score in scores.items()
    }


def finding_document(finding: Finding) -> dict[str, Any]:
    """A finding, major or minor; `channel` is there for a sensor's cause only."""
    predicted = finding.predicted_gain
    return {
        "cause": finding.cause,
        "where": finding.where,
        **({} if finding.channel is None else {"channel": finding.channel}),
        "form": finding.form,
        "sentence": finding.sentence,
        "parameters": {
            name: _estimate(estimate)
            for name, estimate in finding.parameters.items()
            if not math.isinf(estimate.value)
        },
        "statistic": finding.statistic,
        "p_value": finding.p_value,
        "share": finding.share,
        "predicted_gain": None if predicted is None else _gain(predicted),
        "gain": _gain(finding.gain),
        "rivals": [_rival(rival) for rival in finding.rivals],
        "indistinguishable_from": list(finding.indistinguishable_from),
        "separating_experiment": finding.separating_experiment,
    }


def _estimate(estimate: Estimate) -> dict[str, Any]:
    return {"value": estimate.value, "std": estimate.std, "unit": estimate.unit}


def _gain(gain: Gain) -> dict[str, Any]:
    return {
        "metric": "fit",
        "channel": gain.channel,
        "before": gain.before,
        "after": gain.after,
        "se": gain.se,
        "held_out": gain.held_out,
        "mse_before": gain.mse_before,
        "mse_after": gain.mse_after,
        "ate_before": gain.ate_before,
        "ate_after": gain.ate_after,
    }


def _rival(rival: Rival) -> dict[str, Any]:
    return {
        "cause": rival.cause,
        "where": rival.where,
        **({} if rival.channel is None else {"channel": rival.channel}),
        "deficit": rival.deficit,
        "indistinguishable": rival.indistinguishable,
    }


def _unexplained(left: Unexplained) -> dict[str, Any]:
    return {
        "channel": left.channel,
        "fraction": left.fraction,
        "depends_on": list(left.depends_on),
        "when": [{"run": run, "start": start, "stop": stop} for run, start, stop in left.when],
        "test": left.test,
    }


def _budget(budget: Budget) -> dict[str, Any]:
    return {
        "name": budget.name,
        "unit": budget.unit,
        "total": budget.total,
        "parts": dict(budget.parts),
        "noise": budget.noise,
        "unexplained": budget.unexplained,
    }


def _detectable(cause: Detectable) -> dict[str, Any]:
    return {
        "cause": cause.cause,
        "where": cause.where,
        "parameter": cause.parameter,
        "smallest": cause.smallest,
        "unit": cause.unit,
        "excited": math.isfinite(cause.smallest),
        "inseparable": list(cause.inseparable),
        "manoeuvre": cause.manoeuvre,
        "channel": cause.channel,
    }
