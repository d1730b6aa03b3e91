"""Bank: the road leans to a side, and the vehicle is pulled down it through its tyres."""

from typing import ClassVar

from jaxtyping import Array, Float

from vdmsi_jax.effects.base import AbstractEffect, Scales
from vdmsi_jax.parameters import parameter

COMPLIANCE = 0.06
"""Slip angle of an axle per g of lateral acceleration, rad: usual for road tyres (Milliken and
Milliken, Race Car Vehicle Dynamics, 1995, ch. 2). A log tells the pull, and with this the slope."""
STEEPEST = 0.08
"""Pull per slope, rad, of a vehicle that understeers by 0.008 s^2/m^2, which is much: g times that
gradient. Beyond it wheels stand askew (in the hunt and the exams banks had up to 0.041)."""


class Bank(AbstractEffect):
    """The course is turned, and the path bent, by the slip that carries the weight's side
    component."""

    cause: ClassVar[str] = "bank"
    shown_by: ClassVar[str] = "the same road in both directions"

    slope: Float[Array, ""] = parameter("1", "lateral slope, by the usual tyre's compliance")
    pull: Float[Array, ""] = parameter("rad", "steering angle that the pull is worth")

    def probes(self, scales: Scales) -> list[tuple[float, ...]]:
        return [(-0.03, -0.003), (0.03, 0.003)]

    def course(self, beta: Float[Array, " M"]) -> Float[Array, " M"]:
        return beta + COMPLIANCE * self.slope

    def angle(self, delta: Float[Array, " M"]) -> Float[Array, " M"]:
        return delta + self.pull
