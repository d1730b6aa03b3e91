"""Models on disk: versioned JSON, checked when it is read, never code."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from .config import PlantSpec, VehicleGeometry
from .decode import decode
from .errors import InputError, nearest
from .files import read_json, write_json
from .models.bicycle import Bicycle
from .models.transfer_function import TransferFunction, improper_reason
from .models.vehicle import SpeedInput, Vehicle

MODEL = "vdmsi.model/1"
IDENTIFY = "vdmsi.identify/1"


@dataclass(frozen=True)
class Plant:
    """An actuator and the channels that it stands between.

    Attributes:
        spec: its name, its command, its response.
        model: the transfer function.
    """

    spec: PlantSpec
    model: TransferFunction


@dataclass(frozen=True)
class Model:
    """What was identified: plants by name, and the geometry if they are a vehicle's."""

    plants: Mapping[str, Plant]
    vehicle: VehicleGeometry | None = None

    def plant(self, command: str, response: str) -> Plant | None:
        """The plant between two channels, if there is one."""
        for plant in self.plants.values():
            if (plant.spec.input, plant.spec.output) == (command, response):
                return plant
        return None

    def to_vehicle(self, *, dynamics: bool = True) -> Vehicle:
        """The model as one pytree to simulate: VDM-SI, or VDM without its `dynamics`.

        A bicycle without slip may be seen from any point of its axis. With the distances of the
        reference point in place of the centre of gravity's, speed and pose are those of the
        reference point, as they were logged.

        Raises:
            InputError: the model has no geometry.
        """
        if self.vehicle is None:
            mend = "describe the vehicle in [vehicle] of the configuration and identify again"
            raise InputError("model", "vehicle", "has no geometry, so it has no path", mend)
        behind = self.vehicle.rear_to_reference
        powertrain, steering = self.plant("v_cmd", "v"), self.plant("delta_cmd", "delta")
        return Vehicle(
            Bicycle(self.vehicle.wheelbase - behind, behind),
            powertrain.model if dynamics and powertrain else None,
            steering.model if dynamics and steering else None,
            speed_input=SpeedInput.VELOCITY,
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
        raise InputError(
            source, "schema", f"unknown schema {schema!r}", nearest(str(schema), (MODEL, IDENTIFY))
        )
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
    return Model({name: entry.to_plant(name) for name, entry in file.plants.items()}, file.vehicle)


def save_model(path: str | Path, model: Model) -> Path:
    """Write a model, atomically."""
    plants = {
        name: {
            "input": plant.spec.input,
            "output": plant.spec.output,
            "num": plant.model.num,
            "den": plant.model.den,
            "delay": 0.0 if plant.model.delay is None else plant.model.delay,
            "offset": 0.0 if plant.model.offset is None else plant.model.offset,
        }
        for name, plant in model.plants.items()
    }
    document = {"schema": MODEL, "plants": plants}
    if model.vehicle is not None:
        document["vehicle"] = geometry(model.vehicle)
    return write_json(path, document)


def geometry(vehicle: VehicleGeometry) -> dict[str, Any]:
    """A vehicle's table as a model file holds it."""
    table = {"l_f": vehicle.l_f, "l_r": vehicle.l_r, "reference_point": vehicle.reference_point}
    return table if vehicle.lever_arm is None else table | {"lever_arm": vehicle.lever_arm}


@dataclass(frozen=True)
class _Entry:
    input: str
    output: str
    num: tuple[float, ...]
    den: tuple[float, ...]
    delay: float = 0.0
    offset: float = 0.0

    def __post_init__(self):
        for name in ("num", "den", "delay", "offset"):
            value = getattr(self, name)
            if not all(map(math.isfinite, value if isinstance(value, tuple) else (value,))):
                raise InputError("model", name, "is not finite", "write the file anew")
        if not self.num or len(self.den) < 2 or self.den[0] != 1.0:
            mend = "give num and den in descending powers of s, den beginning with 1"
            raise InputError("model", "den", "is no denominator of a transfer function", mend)
        improper = improper_reason(len(self.den) - 1, len(self.num) - 1)
        if improper:
            raise InputError("model", "num", improper, "give no more zeros than poles")
        if self.delay < 0.0:
            raise InputError("model", "delay", f"{self.delay} is negative", "give seconds")

    def to_plant(self, name: str) -> Plant:
        num, den = np.array(self.num), np.array(self.den)
        model = TransferFunction(num, den, delay=self.delay, offset=self.offset)
        return Plant(PlantSpec(name, self.input, self.output), model)


@dataclass(frozen=True)
class _File:
    schema: str
    plants: Mapping[str, _Entry]
    vehicle: VehicleGeometry | None = field(default=None)


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
    return kept | {key: fit[key] for key in ("num", "den", "delay", "offset") if key in fit}
