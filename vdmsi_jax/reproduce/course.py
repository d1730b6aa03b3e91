"""The paper's two courses, and who steers the car along them."""

import math
from collections.abc import Callable
from dataclasses import dataclass

import equinox as eqx
import numpy as np
from jaxtyping import Float

from ..config import VehicleGeometry
from ..control import PurePursuit
from ..scenarios import PAPER_SPEED, Track, bend, s_curve
from ..testbed import ROW, Sighting

RAMP = 1.0
"""Acceleration with which the speed command rises from rest, m/s²: a planner's, far below what the
drive can do."""

EVERY = 2
"""Rows between two looks of whoever steers: 50 a second."""

_SPACING = 0.25  # m, between the points of a path


@dataclass(frozen=True)
class Course:
    """A track with its name, and where on it the bend lies.

    Attributes:
        name: `bend` or `s_curve`.
        title: for readers.
        track: the designed path of the centre of gravity.
    """

    name: str
    title: str
    track: Track

    @property
    def entrance(self) -> float:
        """Distance along the track at which the first arc begins, m."""
        return self.track.lengths[0]

    @property
    def exit(self) -> float:
        """Distance along the track at which the last arc ends, m."""
        return self.track.length - self.track.lengths[-1]

    @property
    def duration(self) -> float:
        """Time for the whole track from rest, s."""
        return math.ceil(self.track.length / PAPER_SPEED + 0.5 * PAPER_SPEED / RAMP)

    def path(self) -> Float[np.ndarray, "M 2"]:
        """Points along the track, m."""
        points = math.ceil(self.track.length / _SPACING) + 1
        return self.track.at(np.linspace(0.0, self.track.length, points))[:, :2]

    def pursuit(self, geometry: VehicleGeometry, limit: float) -> PurePursuit:
        """Pure pursuit of the track by a vehicle that steers up to `limit` (rad)."""
        return PurePursuit(self.path(), geometry.wheelbase, geometry.l_r, limit=limit)

    def progress(self, poses: Float[np.ndarray, "N 3"]) -> Float[np.ndarray, " N"]:
        """Distance along the track at each pose, m."""
        control = PurePursuit(self.path(), 1.0)
        return np.asarray(_along(control, poses[:, :2])[0])

    def deviation(self, poses: Float[np.ndarray, "N 3"]) -> Float[np.ndarray, " N"]:
        """How far each pose lies to the left of the track, m."""
        control = PurePursuit(self.path(), 1.0)
        return np.asarray(_along(control, poses[:, :2])[1])


@eqx.filter_jit
def _along(control: PurePursuit, points):
    return eqx.filter_vmap(control.progress)(points)


COURSES = (
    Course("bend", "90° bend, 20 m radius", bend()),
    Course("s_curve", "S-curve, 15 m radius", s_curve()),
)
"""Figure 6: a 90° bend of 20 m radius and an S-curve of 15 m radius, between straights of 20 m."""


def ramped(k: int) -> float:
    """Speed command of row `k`: from rest to 15 km/h, m/s."""
    return min(RAMP * ROW * k, PAPER_SPEED)


def stepped(k: int) -> float:
    """Speed command of row `k` that asks for 15 km/h at once, after a second at rest, m/s."""
    return PAPER_SPEED if k * ROW >= 1.0 else 0.0


Localisation = Callable[[int, Sighting, Float[np.ndarray, "N 2"]], Float[np.ndarray, "3"]]
"""From the row, the last sighting and the commands so far to the pose that is steered by."""


def by_sensor(_: int, seen: Sighting, __: Float[np.ndarray, "N 2"]) -> Float[np.ndarray, "3"]:
    """Steer by the last sighting, old as it is."""
    return seen.pose


class Pursuer:
    """A driver that follows a course by pure pursuit, at the pose that a localisation tells.

    **Arguments:**

    - `course`: where to go.
    - `geometry`: of the car.
    - `limit`: greatest steering command, rad.
    - `speed`: the speed command of each row.
    - `localisation`: what is steered by.
    - `rows`: of the whole drive.

    `believed` (N, 3) are the poses that it steered by.
    """

    def __init__(
        self,
        course: Course,
        geometry: VehicleGeometry,
        *,
        limit: float,
        rows: int,
        speed: Callable[[int], float] = ramped,
        localisation: Localisation = by_sensor,
    ):
        self.control = eqx.filter_jit(course.pursuit(geometry, limit))
        self.speed, self.localisation = speed, localisation
        self.commands = np.zeros((rows, 2))
        self.believed = np.zeros((rows, 3))

    def __call__(self, k: int, seen: Sighting) -> tuple[float, float]:
        """Both commands of row `k`."""
        v_cmd = self.speed(k)
        if k % EVERY:
            self.believed[k], delta_cmd = self.believed[k - 1], self.commands[k - 1, 1]
        else:
            self.believed[k] = self.localisation(k, seen, self.commands[:k])
            delta_cmd = float(self.control(self.believed[k], np.asarray(v_cmd)))
        self.commands[k] = v_cmd, delta_cmd
        return v_cmd, float(delta_cmd)
