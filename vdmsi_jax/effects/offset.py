"""Offset: the response is shifted."""

from typing import ClassVar, Literal

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from vdmsi_jax.effects.base import AbstractEffect, Scales, Signals
from vdmsi_jax.parameters import parameter


class Offset(AbstractEffect):
    """A constant added to the actuator's response.

    Attributes:
        by: how it is told: as it stands, or `travel`, by the direction in which the vehicle moves,
            since wheels that run to one side forward are pulled to the other in reverse.
    """

    cause: ClassVar[str] = "offset"
    shown_by: ClassVar[str] = "commands of zero"

    bias: Float[Array, ""] = parameter("response", "added to the response")

    by: Literal["itself", "travel"] = eqx.field(static=True, default="itself")

    def probes(self, scales: Scales) -> list[tuple[float, ...]]:
        return [(k * scales.response,) for k in (-0.05, 0.05)]

    def measured(self, y: Float[Array, " N"], signals: Signals) -> Float[Array, " N"]:
        return y + (self.bias * jnp.sign(signals.v) if self.by == "travel" else self.bias)

    def rested(self, y: Float[Array, ""]) -> Float[Array, ""]:
        return y - self.bias if self.by == "itself" else y
