"""The models that a diagnosis leaves: identified plants, without and with their causes."""

from collections.abc import Mapping, Sequence

import jax.numpy as jnp
import numpy as np

from ...config import PlantSpec
from ...data.record import Record
from ...effects import AbstractEffect
from ...model_file import Model, Plant
from ...models.extended_plant import ExtendedPlant
from ...models.transfer_function import TransferFunction
from ...parameters import with_values
from ..actuator import swing
from ..actuator.hypothesis import Hypothesis
from ..actuator.lanes import FIRST_CAUSE, LEADS, POLES, Unravel
from ..actuator.stage import Stage
from ..body.body import CAUSES, INDEX
from ..body.search import BodySearch
from ..search.found import Search


def plain_model(searches: Mapping[PlantSpec, Search], records: Sequence[Record]) -> Model:
    """The baseline: plants without causes."""
    plants = {
        spec.name: Plant(spec, transfer_function(found.stage, found.baseline.hypothesis))
        for spec, found in searches.items()
    }
    return Model(plants, records[0].vehicle)


def extended_model(
    searches: Mapping[PlantSpec, Search],
    bodily: BodySearch | None,
    records: Sequence[Record],
) -> Model:
    """The same kind of model with the causes in it: all of the final fit, the minor ones too, since
    the others were judged beside them."""
    plants = {}
    for spec, found in searches.items():
        h = found.final.hypothesis
        late, shift, slow = _sensor_of(bodily, spec.output)
        linear = _without_sensor(transfer_function(found.stage, h), shift, slow)
        plain = transfer_function(found.stage, found.baseline.hypothesis)
        if not h.active:
            plants[spec.name] = Plant(spec, linear, plain)
            continue
        theta = h.theta.copy()
        for slot in found.stage.slots:
            if slot.cause == "transport_delay" and late > 0.0:
                theta[slot.index[0]] = max(theta[slot.index[0]] - late, 0.0)
        frequency, number = h.frequency(found.stage), swing.number_of(found.stage, h.active)
        if number is not None and frequency is not None and h.swing is not None:
            size, phase, _ = swing.strength(found.stage, h.swing, frequency)
            sine, cosine = found.stage.slots[number].index[1:]
            theta[sine], theta[cosine] = size * np.cos(phase), size * np.sin(phase)
        effects = Unravel(found.stage.effects)(theta[FIRST_CAUSE:])
        on = tuple(effects[k] for k in h.active)
        substeps = found.stage.signals.substeps
        leads = h.theta[list(LEADS)] / found.stage.pace ** np.arange(1, 3)
        model = ExtendedPlant(linear, on, leads=leads, substeps=substeps)
        plants[spec.name] = Plant(spec, model, plain)
    body, sensors = ((), ()) if bodily is None else _body(bodily)
    return Model(plants, records[0].vehicle, body=body, sensors=sensors)


def transfer_function(stage: Stage, h: Hypothesis) -> TransferFunction:
    """The linear plant of a hypothesis, in seconds."""
    powers = stage.pace ** np.arange(POLES + 1)
    num = h.num * powers[h.poles - h.zeros : h.poles + 1]
    return TransferFunction(num, h.den * powers[: h.poles + 1])


def _body(found: BodySearch) -> tuple[tuple[AbstractEffect, ...], tuple]:
    body, sensors = [], []
    for k, cause in enumerate(CAUSES):
        if k not in found.final.active:
            continue
        effect = with_values(cause.effect, jnp.asarray(found.final.theta[list(INDEX[k])]))
        if cause.channel is None:
            body.append(effect)
        else:
            sensors.append((cause.channel, effect))
    return tuple(body), tuple(sensors)


def _sensor_of(found: BodySearch | None, channel: str) -> tuple[float, float, float]:
    """Delay, bias and time constant of a channel's sensor, which the fit of its plant took for the
    plant's."""
    told = {"sensor_delay": 0.0, "sensor_bias": 0.0, "sensor_lag": 0.0}
    if found is None:
        return 0.0, 0.0, 0.0
    for k in found.final.active:
        if CAUSES[k].channel == channel:
            told[CAUSES[k].cause] = float(found.final.theta[INDEX[k][0]])
    return told["sensor_delay"], told["sensor_bias"], told["sensor_lag"]


def _without_sensor(plant: TransferFunction, bias: float, lag: float) -> TransferFunction:
    """The plant alone, where it was fitted with its sensor's bias and lag."""
    num, den = np.asarray(plant.num), np.asarray(plant.den)
    if lag > 0.0 and num.size < den.size:
        num = np.polymul(num, [lag, 1.0])
    return TransferFunction(num, den, offset=-bias if bias else None)
