"""Offset of the vehicle: something turns it while it moves, whatever the wheels do."""

from typing import ClassVar, Literal

import equinox as eqx
from jaxtyping import Array, Float

from vdmsi_jax.effects.base import AbstractEffect, Scales
from vdmsi_jax.parameters import parameter

_CREEPS = 0.05  # m/s, about which what stands begins to turn


class YawOffset(AbstractEffect):
    """A constant added to the yaw rate of a vehicle that moves, as by a drive that pulls more on
    one side; unlike wheels that stand askew, it turns no more at a higher speed."""

    cause: ClassVar[str] = "offset"
    shown_by: ClassVar[str] = "driving straight, with a pose"
    weight: ClassVar[float] = 1.1  # a gyroscope's bias is likelier where nothing tells them apart

    bias: Float[Array, ""] = parameter("rad/s", "added to the yaw rate")
    by: Literal["turning"] = eqx.field(static=True, default="turning")

    def probes(self, scales: Scales) -> list[tuple[float, ...]]:
        return [(-0.01,), (0.01,)]

    def curvature(self, kappa: Float[Array, " M"], v: Float[Array, " M"]) -> Float[Array, " M"]:
        return kappa + self.bias * v / (v**2 + _CREEPS**2)
