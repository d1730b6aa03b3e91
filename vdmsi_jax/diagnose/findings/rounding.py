"""Sensors that round: found in the steps of what they measure, and not by a fit."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from ...data.lattice import FEWEST
from ...data.record import Record
from ..answer.result import ChannelScore, Estimate, Finding, Gain
from ..residual.leftover import steps_of
from ..search.found import Search
from ..search.judge import Trial
from .naming import Named
from .weighing import MINOR

COARSE = 0.1
"""Share of a rounding in what a model leaves, from which on it is a finding."""

_SAME_STEP = 2.0  # times the step of a sensor, up to which that of its plant's rounding is the same


def quantised(records: Sequence[Record], scores: Mapping[str, ChannelScore]) -> list[Finding]:
    """Sensors whose measurements come in steps that matter beside what the model leaves."""
    made = []
    for channel, score in scores.items():
        if not all(channel in record for record in records):
            continue  # made of others, so not a sensor's
        step = _sensor_step(records, channel)
        if step is None or step**2 / 12.0 < MINOR * score.mse:
            continue
        unit = records[0].units.get(channel, "1")
        gain = Gain(channel, score.fit, score.fit, 0.0, score.mse, score.mse)
        found = Finding(
            cause="quantization", where="sensor", channel=channel, form="",
            parameters={"step": Estimate(step, 0.0, unit)}, statistic=math.inf, p_value=0.0,
            gain=gain, predicted_gain=None, share=min(step**2 / 12.0 / score.mse, 1.0),
            rivals=(), separating_experiment=None, sentence="",
        )  # fmt: skip
        said = f"{channel} sensor: quantization, step {step:.3g} {unit}. Its rounding is "
        said += f"{100.0 * found.share:.0f} % of what the model leaves of {channel}."
        made.append(replace(found, sentence=said[:1].upper() + said[1:]))
    return made


def tells_rounding(cause: Named, trial: Trial, rounded: Sequence[Finding]) -> bool:
    """Whether a quantization in the plant is that of its sensor, told once more, or an offset is
    within half a step of it, or a play of the response narrower than a step."""
    channels = {cause.channel, trial.gain.channel}
    steps = [f.parameters["step"].value for f in rounded if f.channel in channels]
    if cause.cause == "quantization":
        return any(_same_step(cause.parameters["step"].value, step) for step in steps)
    if cause.cause in ("offset", "sensor_bias"):
        return any(abs(cause.parameters["bias"].value) < 0.5 * step for step in steps)
    if cause.cause == "backlash" and cause.form.startswith("of the response"):
        return any(cause.parameters["gap"].value < step for step in steps)
    return False


def of_the_sensor(found: Search, records: Sequence[Record], channel: str) -> set[int]:
    """Numbers of the causes of a plant that are a rounding which the sensor of its response, the
    channel, makes as well."""
    step = _sensor_step(records, channel)
    theta, slots = found.final.hypothesis.theta, found.stage.slots
    return {
        f.number
        for f in found.findings
        if step is not None and slots[f.number].cause == "quantization"
        if _same_step(float(theta[slots[f.number].index[0]]), step)
    }


def _sensor_step(records: Sequence[Record], channel: str) -> float | None:
    """Size of the steps in which a channel was measured, where more than half of the records were
    in which it has enough values to tell; else None."""
    steps = steps_of(records, channel)
    told = [r for r in records if channel in r]
    telling = [r for r in told if np.unique(r[channel]).size >= FEWEST]
    return float(np.median(steps)) if 2 * len(steps) > len(telling) else None


def _same_step(plant: float, sensor: float) -> bool:
    """Whether a rounding that a plant seems to have is that of the sensor of its response."""
    return sensor / _SAME_STEP < plant < _SAME_STEP * sensor
