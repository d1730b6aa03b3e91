"""A model, how it is written, and how it is read again."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from ..config import PlantSpec, VehicleGeometry
from ..decode import decode
from ..effects import ACTUATOR, SENSOR, VEHICLE, AbstractEffect
from ..errors import InputError, nearest
from ..files import read_json, write_json
from ..models.bicycle import Bicycle
from ..models.extended_plant import ExtendedPlant
from ..models.plant import AbstractPlant
from ..models.transfer_function import TransferFunction, improper_reason
from ..models.vehicle import SpeedInput, Vehicle
from ._effects import EffectEntry, all_made, documents, in_order

MODEL = "vdmsi.model/1"
IDENTIFY = "vdmsi.identify/1"
_MOST_SUBSTEPS = 1000


@dataclass(frozen=True)
class Plant:
    """An actuator and the channels that it stands between.

    Attributes:
        spec: its name, its command, its response.
        model: the transfer function, or one with effects.
        baseline: the transfer function that explains the logs best without effects, which is not
            what is left of a `model` when its effects are taken out: the two were fitted together.
            None where nothing else than that is known.
    """

    spec: PlantSpec
    model: TransferFunction | ExtendedPlant
    baseline: TransferFunction | None = None

    @property
    def linear(self) -> TransferFunction:
        """The transfer function in the model."""
        return self.model.plant if isinstance(self.model, ExtendedPlant) else self.model

    @property
    def plain(self) -> TransferFunction:
        """The plant as VDM-SI has it: without effects."""
        return self.linear if self.baseline is None else self.baseline


@dataclass(frozen=True)
class Model:
    """What was identified: plants by name, the geometry if they are a vehicle's, and the causes
    that were found.

    Attributes:
        plants: by name; those with causes hold an `ExtendedPlant`.
        vehicle: geometry.
        body: effects of body and road, in the order of `vdmsi_jax.effects.VEHICLE`.
        sensors: what sensors add to the channel that they measure, in the order of
            `vdmsi_jax.effects.SENSOR`; the channel `pose` stands for `x`, `y` and `psi`.
    """

    plants: Mapping[str, Plant]
    vehicle: VehicleGeometry | None = None
    body: tuple[AbstractEffect, ...] = ()
    sensors: tuple[tuple[str, AbstractEffect], ...] = ()

    def __repr__(self) -> str:
        models = {name: plant.model for name, plant in self.plants.items()}
        plants = [f"{name}={model!r}" for name, model in models.items()]
        more = [repr(effect) for effect in self.body]
        more += [f"{effect!r} of {channel}" for channel, effect in self.sensors]
        geometry = [] if self.vehicle is None else [repr(self.vehicle)]
        told = ",\n".join([*plants, *more, *geometry])
        return f"<Model {told}>"

    @property
    def extended(self) -> bool:
        """Whether there is an effect anywhere."""
        models = [plant.model for plant in self.plants.values()]
        inside = any(isinstance(model, ExtendedPlant) and model.effects for model in models)
        return inside or bool(self.body or self.sensors)

    def plant(self, command: str, response: str) -> Plant | None:
        """The plant between two channels, if there is one."""
        for plant in self.plants.values():
            if (plant.spec.input, plant.spec.output) == (command, response):
                return plant
        return None

    def to_vehicle(self, *, dynamics: bool = True, effects: bool = True) -> Vehicle:
        """The model as one pytree to simulate: extended, VDM-SI without its `effects`, and VDM
        without its `dynamics`, which leaves the effects out too. VDM-SI has the `Plant.baseline` of
        each plant, whose poles and zeros may imitate an effect: a P4Z3 answers nearly as late as a
        transport delay.

        A bicycle without slip may be seen from any point of its axis. With the distances of the
        reference point in place of the centre of gravity's, speed and pose are those of the
        reference point, as they were logged.

        Raises:
            InputError: the model has no geometry.
        """
        if self.vehicle is None:
            mend = "describe the vehicle in [vehicle] of the configuration and identify again"
            if self.plants and all(plant.spec.role == "plant" for plant in self.plants.values()):
                name = next(iter(self.plants))
                mend = f'of a plant alone take model.plants["{name}"].model.simulate(u, dt).y'
            raise InputError("model", "vehicle", "has no geometry, so it has no path", mend)
        powertrain, steering = self.plant("v_cmd", "v"), self.plant("delta_cmd", "delta")
        powertrain, steering = (
            (plant.model if effects else plant.plain) if dynamics and plant else None
            for plant in (powertrain, steering)
        )
        return Vehicle(
            Bicycle.at_reference(self.vehicle),
            powertrain,
            steering,
            speed_input=SpeedInput.VELOCITY,
            effects=self.body if dynamics and effects else (),
        )


def load_model(path: str | Path) -> Model:
    """Read a model that `save_model` wrote, or the chosen orders of an `identify.json`.

    Raises:
        InputError: the file is no such model; the message names the key.
    """
    source = str(path)
    document = read_json(path)
    schema = document.get("schema") if isinstance(document, dict) else None
    if schema not in (MODEL, IDENTIFY):
        mend = nearest(str(schema), (MODEL, IDENTIFY))
        if str(schema).startswith("vdmsi.diagnosis/"):
            mend = "give the model.json that stands beside it"
        raise InputError(source, "schema", f"unknown schema {schema!r}", mend)
    if schema == IDENTIFY:
        document = {
            "schema": MODEL,
            "vehicle": document.get("vehicle"),
            "plants": {
                name: _chosen(plant, source, f"plants {name}")
                for name, plant in _table(document, "plants", source, "plants").items()
            },
        }
    document = {key: value for key, value in document.items() if value is not None}
    file = decode(_File, document, source=source)
    plants = {name: entry.to_plant(name) for name, entry in file.plants.items()}
    try:
        body = all_made(file.body, VEHICLE, "body")
        seen = {"v", "delta", "r", "psi", "pose", *(plant.spec.output for plant in plants.values())}
        sensors = all_made(file.sensors, SENSOR, "sensors", seen)
    except InputError as error:
        raise error.within(source, "") from None
    channels = [str(entry.channel) for entry in file.sensors]
    return Model(
        plants,
        file.vehicle,
        tuple(body[i] for i in in_order(body, VEHICLE)),
        tuple((channels[i], sensors[i]) for i in in_order(sensors, SENSOR, channels)),
    )


def save_model(path: str | Path, model: Model) -> Path:
    """Write a model, atomically.

    Raises:
        ValueError: an effect is none of the project's, or effects do not stand in the order of the
            registry, in which they would be read.
        InputError: it is no model, or the folder is not there.
    """
    if not isinstance(model, Model):
        problem = f"{type(model).__name__} is no model"
        mend = "give the path first: save_model(path, model)"
        if isinstance(model, Vehicle | AbstractPlant):
            mend = (
                'make one of its parts: Model({"steering": Plant(PlantSpec("steering", '
                '"delta_cmd", "delta"), vehicle.steering)}, VehicleGeometry(l_f, l_r))'
            )
        raise InputError("model", "", problem, mend)
    document: dict[str, Any] = {
        "schema": MODEL,
        "plants": {name: _plant_document(plant) for name, plant in model.plants.items()},
    }
    if model.vehicle is not None:
        document["vehicle"] = geometry(model.vehicle)
    if model.body:
        document["body"] = documents(model.body, VEHICLE, "VEHICLE")
    if model.sensors:
        channels, sensors = zip(*model.sensors, strict=True)
        document["sensors"] = documents(sensors, SENSOR, "SENSOR", channels)
    return write_json(path, document)


def geometry(vehicle: VehicleGeometry) -> dict[str, Any]:
    """A vehicle's table as a model file holds it."""
    table = {"l_f": vehicle.l_f, "l_r": vehicle.l_r, "reference_point": vehicle.reference_point}
    return table if vehicle.lever_arm is None else table | {"lever_arm": vehicle.lever_arm}


def _plant_document(plant: Plant) -> dict[str, Any]:
    model = plant.model
    document = {"input": plant.spec.input, "output": plant.spec.output, **_linear(plant.linear)}
    if plant.baseline is not None:
        document["baseline"] = _linear(plant.baseline)
    if isinstance(model, ExtendedPlant) and model.effects:
        document["effects"] = documents(model.effects, ACTUATOR, "ACTUATOR")
        document |= {"leads": model.leads, "substeps": model.substeps}
    return document


def _linear(plant: TransferFunction) -> dict[str, Any]:
    return {
        "num": plant.num,
        "den": plant.den,
        "delay": 0.0 if plant.delay is None else plant.delay,
        "offset": 0.0 if plant.offset is None else plant.offset,
    }


def _refuse_not_finite(entry: Any, *names: str) -> None:
    for name in names:
        value = getattr(entry, name)
        if not all(map(math.isfinite, value if isinstance(value, tuple) else (value,))):
            raise InputError("model", name, "is not finite", "write the file anew")


def _transfer_function(entry: "_Linear | _Entry") -> TransferFunction:
    """What a table of the file holds.

    Raises:
        InputError: it is none that can be simulated.
    """
    _refuse_not_finite(entry, "num", "den", "delay", "offset")
    if not entry.num or len(entry.den) < 2 or entry.den[0] != 1.0:
        mend = "give num and den in descending powers of s, den beginning with 1"
        raise InputError("model", "den", "is no denominator of a transfer function", mend)
    improper = improper_reason(len(entry.den) - 1, len(entry.num) - 1)
    if improper:
        raise InputError("model", "num", improper, "give no more zeros than poles")
    if entry.delay < 0.0:
        raise InputError("model", "delay", f"{entry.delay} is negative", "give seconds")
    num, den = np.array(entry.num), np.array(entry.den)
    return TransferFunction(num, den, delay=entry.delay or None, offset=entry.offset or None)


@dataclass(frozen=True)
class _Linear:
    num: tuple[float, ...]
    den: tuple[float, ...]
    delay: float = 0.0
    offset: float = 0.0

    def __post_init__(self):
        _transfer_function(self)


@dataclass(frozen=True)
class _Entry:
    input: str
    output: str
    num: tuple[float, ...]
    den: tuple[float, ...]
    delay: float = 0.0
    offset: float = 0.0
    effects: tuple[EffectEntry, ...] = ()
    leads: tuple[float, ...] = (0.0, 0.0)
    substeps: int = 4
    baseline: _Linear | None = None

    def __post_init__(self):
        _transfer_function(self)
        _refuse_not_finite(self, "leads")
        if len(self.leads) != 2 or min(self.leads) < 0.0:
            mend = "give two numbers, s and s^2, none of them negative"
            raise InputError("model", "leads", f"{list(self.leads)} are no leads", mend)
        if not 1 <= self.substeps <= _MOST_SUBSTEPS:
            mend = f"give a whole number from 1 to {_MOST_SUBSTEPS}"
            raise InputError("model", "substeps", f"{self.substeps} is out of range", mend)
        all_made(self.effects, ACTUATOR, "effects")

    def to_plant(self, name: str) -> Plant:
        model = _transfer_function(self)
        spec = PlantSpec(name, self.input, self.output)
        plain = None if self.baseline is None else _transfer_function(self.baseline)
        if not self.effects:
            return Plant(spec, model, plain)
        made = all_made(self.effects, ACTUATOR, "effects")
        made = tuple(made[i] for i in in_order(made, ACTUATOR))
        extended = ExtendedPlant(model, made, leads=np.array(self.leads), substeps=self.substeps)
        return Plant(spec, extended, plain)


@dataclass(frozen=True)
class _File:
    schema: str
    plants: Mapping[str, _Entry]
    vehicle: VehicleGeometry | None = field(default=None)
    body: tuple[EffectEntry, ...] = ()
    sensors: tuple[EffectEntry, ...] = ()


def _table(document: Any, key: str, source: str, place: str) -> Mapping[str, Any]:
    value = document.get(key) if isinstance(document, dict) else None
    if not isinstance(value, dict):
        raise InputError(source, place, "missing", "give a file that vdmsi identify wrote")
    return value


def _chosen(plant: Any, source: str, place: str) -> dict[str, Any]:
    orders = _table(plant, "orders", source, f"{place} orders")
    order = str(plant.get("chosen"))
    fit = _table(orders, order, source, f"{place} orders {order}")
    if "num" not in fit:
        problem = f"the chosen order {order} has no model ({fit.get('status')})"
        raise InputError(source, place, problem, "identify the plant anew")
    kept = {key: plant[key] for key in ("input", "output") if key in plant}
    if (kept.get("input"), kept.get("output")) == ("v_cmd", "a"):
        if "speed" not in fit:
            problem = (
                f"of the acceleration, the chosen order {order} has no zero, or is of an older file"
            )
            mend = "identify it anew, with [identify] zeros = [1, 2, 3]"
            raise InputError(source, place, problem, mend)
        kept, fit = kept | {"output": "v"}, _table(fit, "speed", source, f"{place} speed")
    return kept | {key: fit[key] for key in ("num", "den", "delay", "offset") if key in fit}
