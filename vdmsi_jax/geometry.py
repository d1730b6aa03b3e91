"""Where a vehicle's axles are, and which of its points a log means."""

import math
from dataclasses import dataclass
from typing import Literal

from .errors import InputError, refuse_unknown_words, require

_SHORTEST, _LONGEST = 1e-3, 100.0  # m, of a wheelbase


@dataclass(frozen=True)
class VehicleGeometry:
    """Where the axles are, and which point of the vehicle the log means by its speed and pose.

    Attributes:
        l_f: how far the steered axle is ahead of the centre of gravity, m.
        l_r: how far the other axle is behind it, m. Both are negative for a vehicle that steers at
            the rear, as a forklift.
        reference_point: the point whose speed and pose are logged. Logs of real vehicles often mean
            the rear axle, and reading those as the centre of gravity makes side slip where there is
            none. With a lever arm it is the sensor, unless it is the rear axle, which is refused.
        lever_arm: how far the sensor sits ahead of the centre of gravity, m (negative behind it).
    """

    l_f: float
    l_r: float
    reference_point: Literal[
        "cog", "rear_axle", "sensor", "centre_of_gravity", "center_of_gravity"
    ] = "cog"
    lever_arm: float | None = None

    def __post_init__(self):
        refuse_unknown_words(self)
        for name in ("l_f", "l_r"):
            value = getattr(self, name)
            require(math.isfinite(value), self, name, f"{value} is no distance", "give metres")
        problem = f"{self.l_f} and l_r = {self.l_r} lie on the same side"
        mend = "give metres, zero or more; both negative where the steered axle is behind"
        require(self.l_f * self.l_r >= 0.0, self, "l_f", problem, mend)
        problem = f"l_f + l_r = {self.wheelbase:g} m is no wheelbase"
        fine = _SHORTEST <= abs(self.wheelbase) <= _LONGEST
        require(fine, self, "l_f", problem, "give the distances in metres")
        point = "cog" if self.reference_point.endswith("gravity") else self.reference_point
        point = "sensor" if point == "cog" and self.lever_arm is not None else point
        object.__setattr__(self, "reference_point", point)  # one name for each from here on
        fine = (point == "sensor") == (self.lever_arm is not None)
        problem = f"does not go with reference_point = {self.reference_point!r}"
        mend = 'give it (m ahead of the centre of gravity) with "sensor", and only then'
        require(fine, self, "lever_arm", problem, mend)
        problem = f"{self.lever_arm} is no distance"
        require(math.isfinite(self.lever_arm or 0.0), self, "lever_arm", problem, "give metres")

    @property
    def wheelbase(self) -> float:
        """Distance between the axles l_f + l_r, m."""
        return self.l_f + self.l_r

    @property
    def rear_to_reference(self) -> float:
        """How far the reference point lies ahead of the rear axle, m (zero for the rear axle
        itself)."""
        if self.reference_point == "rear_axle":
            return 0.0
        return self.l_r + (self.lever_arm or 0.0)


def refuse_no_geometry(vehicle: object, source: str) -> None:
    """Refuse as a vehicle of `source` what is neither a geometry nor None.

    Raises:
        InputError: it is something else, such as a dictionary.
    """
    if not isinstance(vehicle, VehicleGeometry | None):
        mend = "give VehicleGeometry(l_f, l_r), or load_config(file).vehicle"
        raise InputError(source, "vehicle", f"{vehicle!r} is no geometry", mend)
