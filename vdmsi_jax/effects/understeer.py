"""Understeer: at speed the vehicle turns less than its wheels say."""

from typing import ClassVar

from jaxtyping import Array, Float

from vdmsi_jax.effects.base import AbstractEffect, Scales
from vdmsi_jax.parameters import parameter


class Understeer(AbstractEffect):
    """Curvature over `1 + K v^2`.

    Source: Rajamani, Vehicle Dynamics and Control (2012), section 3.3.
    """

    cause: ClassVar[str] = "understeer"
    shown_by: ClassVar[str] = "constant steering with a ramp of speed"

    gradient: Float[Array, ""] = parameter("s^2/m^2", "K in delta / (1 + K v^2)")

    def probes(self, scales: Scales) -> list[tuple[float, ...]]:
        return [(0.0005,), (0.003,)]

    def curvature(self, kappa: Float[Array, " M"], v: Float[Array, " M"]) -> Float[Array, " M"]:
        return kappa / (1.0 + self.gradient * v * v)
