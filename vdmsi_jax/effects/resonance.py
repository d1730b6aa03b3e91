"""Resonance: a lightly damped mode between the command and the response."""

from typing import ClassVar

import jax.numpy as jnp
from jax import lax
from jaxtyping import Array, Float

from vdmsi_jax.effects.base import AbstractEffect, Scales, Signals
from vdmsi_jax.parameters import parameter


class Resonance(AbstractEffect):
    """A `share` of the command goes through `w² / (s² + 2 d w s + w²)`, exactly for held
    commands, and a part `lead` of that one's rate by `w` is added: with it the mode has any two
    zeros, as that of a motor that swings against its load."""

    cause: ClassVar[str] = "resonance"
    shown_by: ClassVar[str] = "a chirp of 0.1 to 6 Hz"
    weight: ClassVar[float] = 2.0  # as a plant of two poles and zeros more would cost

    frequency: Float[Array, ""] = parameter("Hz", "of the undamped mode", off=1.0, lower=0.0)
    damping: Float[Array, ""] = parameter("1", "damping ratio", off=0.1, lower=0.005, upper=0.25)
    share: Float[Array, ""] = parameter("1", "weight of the mode", lower=-8.0, upper=1.0)
    lead: Float[Array, ""] = parameter(
        "1", "of the rate of the mode, by its frequency", lower=-8.0, upper=8.0
    )

    def probes(self, scales: Scales) -> list[tuple[float, ...]]:
        slow = max(2.0 / scales.duration, 0.05 / scales.time_constant)
        fast = min(0.4 / scales.dt, 10.0 / scales.time_constant)
        ladder = [slow * (fast / slow) ** (k / 9) for k in range(10)] if fast > slow else [slow]
        return [(frequency, 0.1, share, 0.0) for frequency in ladder for share in (0.5, -0.2)]

    def held(self, u: Float[Array, " M"], signals: Signals) -> Float[Array, " M"]:
        w = 2.0 * jnp.pi * self.frequency
        root = jnp.sqrt(1.0 - self.damping**2)
        angle, decay = w * root * signals.h, jnp.exp(-self.damping * w * signals.h)
        cosine, sine = decay * jnp.cos(angle), decay * jnp.sin(angle) / root
        stay = cosine + self.damping * sine

        def swing(state: tuple[Array, Array], u: Array) -> tuple[tuple[Array, Array], Array]:
            q, dq = state  # position, and velocity over w
            away = q - u
            now = (u + stay * away + sine * dq, -sine * away + (cosine - self.damping * sine) * dq)
            return now, 0.5 * (self.share * (q + now[0]) + self.lead * (dq + now[1]))

        first = signals.earlier(u)
        mode = lax.scan(swing, (first, jnp.zeros_like(first)), u)[1]
        return (1.0 - self.share) * u + mode
