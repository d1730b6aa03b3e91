"""Backlash: play between the actuator and what it moves."""

from typing import ClassVar

import jax.numpy as jnp
from jax import lax
from jaxtyping import Array, Float

from vdmsi_jax.effects.base import AbstractEffect, Scales, Signals
from vdmsi_jax.parameters import parameter


class Backlash(AbstractEffect):
    """The play operator on the response: it rests until the actuator has crossed the gap.

    Source: Brokate and Sprekels, Hysteresis and Phase Transitions (1996), ch. 2.
    """

    cause: ClassVar[str] = "backlash"

    gap: Float[Array, ""] = parameter("response", "full width of the play", lower=0.0)

    def probes(self, scales: Scales) -> list[tuple[float, ...]]:
        return [(k * scales.response,) for k in (0.01, 0.03, 0.08, 0.2)]

    def output(self, y: Float[Array, " M"], signals: Signals) -> Float[Array, " M"]:
        half = 0.5 * self.gap

        def follow(rest: Array, y: Array) -> tuple[Array, Array]:
            # each side by itself: without play both bounds coincide, and have no derivative there
            stays = jnp.where(half > 0.0, rest, y)
            down = jnp.where(y < rest, jnp.minimum(rest, y + half), stays)
            rest = jnp.where(y > rest, jnp.maximum(rest, y - half), down)
            return rest, rest

        return lax.scan(follow, y[0], y)[1]
