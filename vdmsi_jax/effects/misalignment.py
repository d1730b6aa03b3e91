"""Offset of the vehicle: the wheels stand otherwise than the steering sensor says."""

from typing import ClassVar, Literal

import equinox as eqx
from jaxtyping import Array, Float

from vdmsi_jax.effects.base import AbstractEffect, Scales
from vdmsi_jax.parameters import parameter


class Misalignment(AbstractEffect):
    """A constant added to the road-wheel angle behind its sensor."""

    cause: ClassVar[str] = "offset"
    shown_by: ClassVar[str] = "driving straight, with a pose"

    bias: Float[Array, ""] = parameter("rad", "added to the road-wheel angle")
    by: Literal["angle"] = eqx.field(static=True, default="angle")

    def probes(self, scales: Scales) -> list[tuple[float, ...]]:
        return [(-0.005,), (0.005,)]

    def angle(self, delta: Float[Array, " M"]) -> Float[Array, " M"]:
        return delta + self.bias
