"""Figure 7: the car drives on when its sensors are cut at the entrance of the bend, and a model is
the only source of pose for whoever steers."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from ..models.commands import Commands
from ..models.vehicle import Vehicle
from ..simulate import simulate
from ..testbed import ROW, Car, Sighting, drive
from .course import Course, Pursuer

COLUMNS = ("t", "x", "y", "psi", "x_model", "y_model", "psi_model")
"""Of a recorded run: the sensor, which goes on in a separate program, and the model."""

KEPT = 5
"""Rows per row of a recorded run: 20 a second are kept."""


class DeadReckoning:
    """Localisation by the sensor up to the entrance of the bend, and by a model from there on.

    The model has heard every command since the car stood still; at the cut its path is laid on the
    last pose that was sighted. It is simulated anew at every look, by the same `simulate` as
    everywhere: a motion depends on no later command.

    **Arguments:**

    - `vehicle`: VDM, VDM-SI or the extended model, at rest at first.
    - `course`: its first arc is where the sensor is cut.
    - `rows`: of the whole drive.

    `cut` is the row of the last sighting that was taken, or None before.
    """

    def __init__(self, vehicle: Vehicle, course: Course, rows: int):
        self.vehicle, self.course, self.rows = vehicle, course, rows
        self.cut: int | None = None
        self._anchor = np.zeros(3)

    def __call__(
        self, k: int, seen: Sighting, commands: Float[np.ndarray, "N 2"]
    ) -> Float[np.ndarray, "3"]:
        """The pose at row `k`."""
        if self.cut is None:
            if self.course.progress(seen.pose[None])[0] < self.course.entrance:
                return seen.pose
            self.cut, self._anchor = seen.row, seen.pose
        held = np.concatenate([commands, np.repeat(commands[-1:], self.rows - k, axis=0)])
        poses = np.asarray(simulate(self.vehicle, Commands(held[:, 0], held[:, 1], ROW)).poses)
        return moved(poses[k], poses[self.cut], self._anchor)


def moved(
    pose: Float[np.ndarray, "3"], origin: Float[np.ndarray, "3"], target: Float[np.ndarray, "3"]
) -> Float[np.ndarray, "3"]:
    """A pose after the rigid motion that takes `origin` to `target`."""
    turn = target[2] - origin[2]
    c, s = np.cos(turn), np.sin(turn)
    dx, dy = (pose - origin)[:2]
    return np.array([target[0] + c * dx - s * dy, target[1] + s * dx + c * dy, pose[2] + turn])


@dataclass(frozen=True)
class ClosedLoop:
    """One run without sensors.

    Attributes:
        model: the source of pose.
        t: time since the sensors were cut, s.
        measured: what a lidar in a separate program saw, x, y, psi.
        believed: what was steered by.
        error: distance of both, m.
        deviation: of the car from the track, to the left, m.
        at_exit: row at which the car passes the end of the last arc; the last one if it does not.
    """

    model: str
    t: Float[np.ndarray, " N"]
    measured: Float[np.ndarray, "N 3"]
    believed: Float[np.ndarray, "N 3"]
    error: Float[np.ndarray, " N"]
    deviation: Float[np.ndarray, " N"]
    at_exit: int


def record_run(
    car: Car, course: Course, vehicle: Vehicle, *, seed: int
) -> dict[str, Float[np.ndarray, " N"]]:
    """Let the car drive a course with its sensors cut, and give the columns of its log.

    Raises:
        InputError: MuJoCo is not installed.
    """
    rows = round(course.duration / ROW) + 1
    reckoning = DeadReckoning(vehicle, course, rows)
    geometry, limit = car.dimensions.geometry, car.dimensions.max_steering
    pursuer = Pursuer(course, geometry, limit=limit, rows=rows, localisation=reckoning)
    run = drive(car, pursuer, duration=course.duration, seed=seed)
    assert reckoning.cut is not None, "the car never came to the bend"
    first = -(-(reckoning.cut + round(car.sensor.latency / ROW) + 2) // KEPT) * KEPT
    columns = [run.t - ROW * reckoning.cut, *run.pose.T, *pursuer.believed.T]
    return {name: column[first::KEPT] for name, column in zip(COLUMNS, columns, strict=True)}


def judge(model: str, course: Course, columns: Mapping[str, Float[np.ndarray, " N"]]) -> ClosedLoop:
    """The errors of a recorded run; columns as in `COLUMNS`."""
    measured = np.stack([columns[c] for c in COLUMNS[1:4]], axis=1)
    believed = np.stack([columns[c] for c in COLUMNS[4:]], axis=1)
    beyond = np.flatnonzero(course.progress(measured) >= course.exit)
    return ClosedLoop(
        model,
        columns["t"],
        measured,
        believed,
        error=np.hypot(*(measured - believed)[:, :2].T),
        deviation=course.deviation(measured),
        at_exit=int(beyond[0]) if beyond.size else len(measured) - 1,
    )
