"""Rate limit: the response, or the command, moves no faster."""

from typing import ClassVar, Literal

import equinox as eqx
import jax.numpy as jnp
from jax import lax
from jaxtyping import Array, Float

from vdmsi_jax.effects.base import AbstractEffect, Effort, Scales, Signals
from vdmsi_jax.parameters import parameter


class RateLimit(AbstractEffect):
    """A largest rate upward and downward: of the response, where the actuator has no more power,
    or of the command, where electronics ramp it.

    Attributes:
        at: which signal's rate is limited.
    """

    cause: ClassVar[str] = "rate_limit"

    rising: Float[Array, ""] = parameter(
        "1/(response/s)", "inverse of the largest rate upward", lower=0.0, shown="inverse"
    )
    falling: Float[Array, ""] = parameter(
        "1/(response/s)", "inverse of the largest rate downward", lower=0.0, shown="inverse"
    )
    at: Literal["response", "command"] = eqx.field(static=True, default="response")

    def probes(self, scales: Scales) -> list[tuple[float, ...]]:
        rate, shares = scales.rate, (1.5, 0.9, 0.6, 0.35)
        if self.at == "command":  # the command of a hull is the angle of its rudder
            rate *= scales.command / max(scales.response, 1e-12)
            shares += (4.0, 12.0)  # steps are ramped faster than what follows them moves
        slow = [1.0 / (k * max(rate, 1e-12)) for k in shares]
        return [(k, k) for k in slow] + [(slow[1], 0.0), (0.0, slow[1])]

    def effort(self, at: Effort) -> Float[Array, ""]:
        if self.at != "response":
            return jnp.zeros_like(at.u)
        limit = jnp.maximum(1.0, jnp.maximum(at.rate * self.rising, -at.rate * self.falling))
        return (at.rate - at.rate / limit) / at.gain

    def held(self, u: Float[Array, " M"], signals: Signals) -> Float[Array, " M"]:
        if self.at != "command":
            return u

        def follow(before: Array, u: Array) -> tuple[Array, Array]:
            step = u - before
            rate = step / signals.h
            limit = jnp.maximum(1.0, jnp.maximum(rate * self.rising, -rate * self.falling))
            now = jnp.where(limit > 1.0, before + step / limit, u)
            return now, now

        return lax.scan(follow, u[0] if signals.before is None else signals.before, u)[1]
