"""Drives of the car, and the logs that they leave."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from ..errors import InputError
from ..files import write_text
from .car import Car, PoseSensor
from .engine import ROW, Engine, State, states


class Sighting(NamedTuple):
    """A pose that the sensor saw.

    Attributes:
        row: when.
        pose: x, y, m, and psi, rad.
    """

    row: int
    pose: Float[np.ndarray, "3"]


Driver = Callable[[int, Sighting], tuple[float, float]]
"""From the number of the row and the last sighting that is known to both commands (m/s, rad)."""

DECIMALS = {"t": 2, "delta_cmd": 5, "delta": 5, "r": 5, "x": 3, "y": 3, "psi": 5}
"""Places after the point in a log, below the noise; 4 for what is not named."""


@dataclass(frozen=True)
class Drive:
    """What a car did and what was seen of it, row by row.

    Attributes:
        t: s.
        v_cmd, delta_cmd: the commands of the rows, m/s and rad.
        truth: columns as in `State`.
        pose: what the pose sensor saw, straight between two scans.
    """

    t: Float[np.ndarray, " N"]
    v_cmd: Float[np.ndarray, " N"]
    delta_cmd: Float[np.ndarray, " N"]
    truth: Float[np.ndarray, "N 6"]
    pose: Float[np.ndarray, "N 3"]

    def log(self, *, direct: bool = False) -> dict[str, np.ndarray]:
        """The columns of a log: commands and poses, as the paper's lidar gives them.

        Args:
            direct: add speed, angle and yaw rate without noise, as no lidar can tell them.
        """
        told = {"t": self.t, "v_cmd": self.v_cmd, "delta_cmd": self.delta_cmd}
        if direct:
            told |= dict(zip(("v", "delta", "r"), self.truth[:, [3, 5, 4]].T, strict=True))
        return told | dict(zip(("x", "y", "psi"), self.pose.T, strict=True))


def drive(car: Car, driver: Driver, *, duration: float, seed: int) -> Drive:
    """Let a car drive from rest at the origin, heading along x.

    Args:
        car: what drives.
        driver: is asked at every row.
        duration: s.
        seed: of the sensor's noise.

    Raises:
        InputError: MuJoCo is not installed, or the sensor's rate does not divide that of the rows.
    """
    rows = round(duration / ROW) + 1
    every = _rows_per_scan(car.sensor)
    late = round(car.sensor.latency / ROW)
    level = np.array([car.sensor.place_noise] * 2 + [car.sensor.heading_noise])
    noise = level * np.random.default_rng(seed).standard_normal((rows // every + 2, 3))
    engine = Engine(car)
    truth: list[State] = [engine.state]
    commands = np.empty((rows, 2))
    for k in range(rows):
        scan = max(k - late, 0) // every
        seen = np.array(truth[scan * every][:3]) + noise[scan]
        commands[k] = driver(k, Sighting(scan * every, seen))
        truth.append(engine.step(float(commands[k, 0]), float(commands[k, 1])))
    whole = states(truth[:rows])
    t = ROW * np.arange(rows)
    scans = whole[::every, :3] + noise[: len(whole[::every])]
    stamps = t[::every] + car.causes.sensor_delay
    pose = np.stack([np.interp(t, stamps, column) for column in scans.T], axis=1)
    return Drive(t, commands[:, 0], commands[:, 1], whole, pose)


def replay(v_cmd: Float[np.ndarray, " N"], delta_cmd: Float[np.ndarray, " N"]) -> Driver:
    """A driver that looks at nothing: given commands row by row, the last one held."""

    def driver(k: int, _: Sighting) -> tuple[float, float]:
        k = min(k, len(v_cmd) - 1)
        return float(v_cmd[k]), float(delta_cmd[k])

    return driver


def write_log(path: str | Path, columns: Mapping[str, np.ndarray]) -> Path:
    """Write columns as canonical CSV, atomically, rounded as `DECIMALS` says."""
    places = [DECIMALS.get(name, 4) for name in columns]
    lines = [",".join(columns)]
    for row in zip(*columns.values(), strict=True):
        lines.append(",".join(_short(value, n) for value, n in zip(row, places, strict=True)))
    return write_text(path, "\n".join(lines) + "\n")


def _short(value: float, places: int) -> str:
    text = f"{value:.{places}f}".rstrip("0").rstrip(".")
    return "0" if text == "-0" else text


def vehicle_toml(car: Car) -> str:
    """The configuration of a car's logs: geometry, and speed, yaw rate and steering angle derived
    from the pose as in the paper's section 5.1."""
    d = car.dimensions
    window = 7.0 / car.sensor.rate
    return f"""# The test vehicle, with table 1 of the paper. Its logs hold commands and poses of a
# lidar; speed, yaw rate and steering angle follow from these.

[vehicle]
l_f = {d.l_f}          # m, centre of gravity to front axle
l_r = {d.l_r}          # m, centre of gravity to rear axle

[derive]
v = {{ rule = "speed_from_pose", window = {window:g} }}
r = {{ rule = "yaw_rate_from_heading", window = {window:g} }}
delta = "steering_from_yaw_rate" # Ackermann's geometry
"""


def _rows_per_scan(sensor: PoseSensor) -> int:
    every = round(1.0 / (sensor.rate * ROW))
    if every < 1 or abs(every * sensor.rate * ROW - 1.0) > 1e-9:
        mend = "give 100, 50, 25, 20, 10, ..."
        problem = f"{sensor.rate:g} scans a second do not fit rows of {ROW:g} s"
        raise InputError("PoseSensor", "rate", problem, mend)
    return every
