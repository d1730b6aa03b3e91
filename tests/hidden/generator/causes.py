"""The causes: where each may sit, how its size is drawn, and by what physics it acts.

A cause turns into maps of the command at the log's rows (memoryless ones), effects inside the 1 ms
loop (`effects.py`), properties of a lane, or biases and steps of the sensors.
"""

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from .vehicle import Actuator, Vehicle

SIZES = {"small": 0.4, "middle": 1.0, "large": 2.5}
POWERTRAIN, STEERING = 0, 1
PLACES = {"powertrain": POWERTRAIN, "steering": STEERING, "plant": 0}
SENSED = {"v": (0,), "delta": (1,), "r": (2,), "pose": (3, 4, 5)}

_ACTUATORS = ("powertrain", "steering", "plant")
_SENSORS = ("sensor:v", "sensor:delta", "sensor:r")
CATALOGUE: dict[str, tuple[str, ...]] = {
    **{
        word: _ACTUATORS
        for word in (
            "transport_delay dead_zone backlash saturation rate_limit coulomb_friction "
            "gain_asymmetry gain_nonlinearity gain_drift regime_change resonance "
            "periodic_disturbance"
        ).split()
    },
    "quantization": (*_ACTUATORS, *_SENSORS),
    "offset": ("powertrain", "steering", "vehicle", "plant"),
    "speed_dependent_gain": ("steering",),
    "understeer": ("vehicle",),
    "tyre_relaxation": ("vehicle",),
    "geometry_scale": ("vehicle",),
    "speed_scale": ("vehicle",),
    "road_grade": ("vehicle",),
    "bank": ("vehicle",),
    "drag": ("vehicle", "powertrain"),
    "cross_coupling": ("powertrain", "steering"),
    "sensor_delay": (*_SENSORS, "sensor:pose"),
    "sensor_bias": _SENSORS,
    "sensor_lag": _SENSORS,
}
"""The contract's words and where each may sit; a sensor's channel follows a colon."""

OUTSIDE: dict[str, tuple[str, ...]] = {
    "dropout": _ACTUATORS,
    "gust": ("vehicle",),
    "hysteresis_smooth": _ACTUATORS,
    "thermal_power_loss": _ACTUATORS,
    "memory_gain": _ACTUATORS,
    "tyre_saturation": ("vehicle",),
    "state_dependent_lag": _ACTUATORS,
}
"""Causes that the contract's table does not hold."""


@dataclass(frozen=True)
class CauseTruth:
    """A cause by the contract's names. `parameters`: name -> (value, unit); `form`: what physics.

    `details` holds what the contract has no name for (SI).
    """

    word: str
    where: str
    channel: str | None
    parameters: dict[str, tuple[float, str]]
    form: str
    details: dict[str, float] = field(default_factory=dict)


@dataclass
class Drawn:
    """What a cause does to the lanes of its drive.

    Attributes:
        static: (actuator, map of its command at the rows), or None.
        effects: (name, where, parameters) in every run.
        per_run: the same, one list for each run.
        lane: attributes of the lane that it sets.
        bias, step: by channel index, of the sensor.
    """

    truth: CauseTruth
    static: tuple[int, Callable[[np.ndarray], np.ndarray]] | None = None
    effects: list[tuple[str, int, dict]] = field(default_factory=list)
    per_run: list[list[tuple[str, int, dict]]] = field(default_factory=list)
    lane: dict[str, float] = field(default_factory=dict)
    bias: dict[int, float] = field(default_factory=dict)
    step: dict[int, float] = field(default_factory=dict)


@dataclass
class Setting:
    """What the size of a cause is drawn from.

    Attributes:
        rng: of this cause alone.
        word, where, channel: of the contract.
        size: about 0.4, 1 or 2.5, with some scatter.
        commands: of each run (rows, actuator), before the cause.
        t: times of the rows, s.
        actuators: those of the vehicle, or the plant.
        vehicle: None for a single plant.
    """

    rng: np.random.Generator
    word: str
    where: str
    channel: str | None
    size: float
    commands: list[np.ndarray]
    t: np.ndarray
    actuators: list[Actuator]
    vehicle: Vehicle | None

    @property
    def place(self) -> int:
        return PLACES[self.where]

    @property
    def actuator(self) -> Actuator:
        return self.actuators[self.place]

    @property
    def u(self) -> np.ndarray:
        """All commands of this actuator, whatever the run."""
        return np.concatenate([c[:, self.place] for c in self.commands])

    @property
    def unit(self) -> str:
        return {"powertrain": "m/s", "steering": "rad", "vehicle": "rad"}.get(self.where, "1")

    def of(self, powertrain: float, steering: float, plant: float) -> float:
        """A size that suits this actuator; that of a plant is a share of its commands' spread."""
        if self.where == "plant":
            return plant * float(self.u.std()) * 2.0
        return powertrain if self.where == "powertrain" else steering

    def sign(self) -> float:
        return float(self.rng.choice([-1.0, 1.0]))

    def truth(
        self, parameters: dict[str, tuple[float, str]], form: str, **details: float
    ) -> CauseTruth:
        return CauseTruth(
            self.word,
            self.where,
            self.channel,
            {name: (float(value), unit) for name, (value, unit) in parameters.items()},
            form,
            {name: float(value) for name, value in details.items()},
        )
