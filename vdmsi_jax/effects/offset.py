"""Offset: the response is shifted."""

from typing import ClassVar

from jaxtyping import Array, Float

from vdmsi_jax.effects.base import AbstractEffect, Scales, Signals
from vdmsi_jax.parameters import parameter


class Offset(AbstractEffect):
    """A constant added to the actuator's response."""

    cause: ClassVar[str] = "offset"

    bias: Float[Array, ""] = parameter("response", "added to the response")

    def probes(self, scales: Scales) -> list[tuple[float, ...]]:
        return [(k * scales.response,) for k in (-0.05, 0.05)]

    def measured(self, y: Float[Array, " N"], signals: Signals) -> Float[Array, " N"]:
        return y + self.bias
