"""Backlash: play before the actuator, or between it and what it moves."""

from typing import ClassVar, Literal

import equinox as eqx
import jax.numpy as jnp
from jax import lax
from jaxtyping import Array, Float

from vdmsi_jax.effects.base import AbstractEffect, Scales, Signals
from vdmsi_jax.parameters import parameter


class Backlash(AbstractEffect):
    """The play operator on the response, or on the command (in its unit): it rests until its input
    has crossed the gap.

    Attributes:
        at: which signal plays.

    Source: Brokate and Sprekels, Hysteresis and Phase Transitions (1996), ch. 2.
    """

    cause: ClassVar[str] = "backlash"

    gap: Float[Array, ""] = parameter("response", "full width of the play", lower=0.0)
    at: Literal["command", "response"] = eqx.field(static=True, default="response")

    @property
    def remembers(self) -> bool:
        """A held command plays at the rows alone."""
        return self.at == "response"

    def probes(self, scales: Scales) -> list[tuple[float, ...]]:
        size = scales.command if self.at == "command" else scales.response
        return [(k * size,) for k in (0.01, 0.03, 0.08, 0.2)]

    def command(self, u: Float[Array, " N"], signals: Signals) -> Float[Array, " N"]:
        return _played(u, self.gap) if self.at == "command" else u

    def output(self, y: Float[Array, " M"], signals: Signals) -> Float[Array, " M"]:
        return _played(y, self.gap) if self.at == "response" else y


def _played(y: Float[Array, " M"], gap: Float[Array, ""]) -> Float[Array, " M"]:
    half = 0.5 * gap

    def follow(rest: Array, y: Array) -> tuple[Array, Array]:
        # each side by itself: without play both bounds coincide, and have no derivative there
        stays = jnp.where(half > 0.0, rest, y)
        down = jnp.where(y < rest, jnp.minimum(rest, y + half), stays)
        rest = jnp.where(y > rest, jnp.maximum(rest, y - half), down)
        return rest, rest

    return lax.scan(follow, y[0], y)[1]
