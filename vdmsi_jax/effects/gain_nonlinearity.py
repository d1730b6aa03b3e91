"""Gain nonlinearity: the static characteristic is bent."""

from typing import ClassVar

from jaxtyping import Array, Float

from vdmsi_jax.effects.base import AbstractEffect, Scales, Signals
from vdmsi_jax.parameters import parameter


class GainNonlinearity(AbstractEffect):
    """`u + quadratic u |u| + cubic u³`: odd, as characteristics of actuators are; for commands of
    one sign the first term is a parabola."""

    cause: ClassVar[str] = "gain_nonlinearity"

    quadratic: Float[Array, ""] = parameter("1/command", "of u |u|")
    cubic: Float[Array, ""] = parameter("1/command^2", "of u cubed")

    def probes(self, scales: Scales) -> list[tuple[float, ...]]:
        size = max(abs(scales.low), abs(scales.high), 1e-12)
        bends = (-0.3, -0.05, 0.05, 0.3)
        return [(k / size, 0.0) for k in bends] + [(0.0, k / size**2) for k in bends]

    def command(self, u: Float[Array, " N"], signals: Signals) -> Float[Array, " N"]:
        return u + self.quadratic * u * abs(u) + self.cubic * u * u * u
