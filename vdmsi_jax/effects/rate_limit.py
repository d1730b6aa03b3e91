"""Rate limit: the response, or the command, or the drive of a servo, moves no faster."""

from typing import ClassVar, Literal

import equinox as eqx
import jax.numpy as jnp
from jax import lax
from jaxtyping import Array, Float

from vdmsi_jax.effects.base import AbstractEffect, Effort, Scales, Signals
from vdmsi_jax.parameters import parameter

_LEAST = 0.1  # of the plant's time constants, that a drive lags behind at least


class RateLimit(AbstractEffect):
    """A largest rate upward and downward: of the response, where the actuator has no more power,
    of the command, where electronics ramp it, or of what a position loop asks of its drive (a
    valve's flow, a motor's speed): the command counts no further ahead of the response than what
    the response follows at that rate once it moves so, and what lies behind the drive still lags.

    Held as inverse rates, since one that is off is infinite: `RateLimit.of(rising=0.5,
    falling=0.5)` is one of 0.5 per second.

    Attributes:
        at: which signal's rate is limited.
    """

    cause: ClassVar[str] = "rate_limit"
    shown_by: ClassVar[str] = "large steps"

    rising: Float[Array, ""] = parameter(
        "1/(response/s)", "inverse of the largest rate upward", lower=0.0, shown="inverse"
    )
    falling: Float[Array, ""] = parameter(
        "1/(response/s)", "inverse of the largest rate downward", lower=0.0, shown="inverse"
    )
    at: Literal["response", "command", "drive"] = eqx.field(static=True, default="response")

    @property
    def ports(self) -> frozenset[str]:
        return frozenset({"held" if self.at == "command" else "effort"})

    def probes(self, scales: Scales) -> list[tuple[float, ...]]:
        rate, shares = scales.rate, (1.5, 0.9, 0.6, 0.35)
        if self.at == "command":  # the command of a hull is the angle of its rudder
            rate *= scales.command / max(scales.response, 1e-12)
            shares += (4.0, 12.0)  # steps are ramped faster than what follows them moves
        slow = [1.0 / (k * max(rate, 1e-12)) for k in shares]
        if self.at == "drive":
            return [(k, k) for k in slow]
        return [(k, k) for k in slow] + [(slow[1], 0.0), (0.0, slow[1])]

    def effort(self, at: Effort) -> Float[Array, ""]:
        rate, unit = at.rate, 1.0 / at.gain
        if self.at == "drive":
            # how far ahead the command is per rate; the response moves on within the sub-step
            ahead = jnp.maximum(jnp.abs(at.lag), _LEAST * jnp.abs(at.slowness))
            unit = jnp.maximum(ahead + 0.5 * at.h / jnp.abs(at.level), 1e-9)
            rate = (at.u - at.still) / unit
        limit = jnp.maximum(1.0, jnp.maximum(rate * self.rising, -rate * self.falling))
        return (rate - rate / limit) * unit

    def held(self, u: Float[Array, " M"], signals: Signals) -> Float[Array, " M"]:

        def follow(before: Array, u: Array) -> tuple[Array, Array]:
            step = u - before
            rate = step / signals.h
            limit = jnp.maximum(1.0, jnp.maximum(rate * self.rising, -rate * self.falling))
            now = jnp.where(limit > 1.0, before + step / limit, u)
            return now, now

        return lax.scan(follow, signals.earlier(u), u)[1]
