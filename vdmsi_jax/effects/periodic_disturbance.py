"""Periodic disturbance: something turns or swings along."""

from typing import ClassVar

import jax.numpy as jnp
from jaxtyping import Array, Float

from vdmsi_jax.effects.base import AbstractEffect, Scales, Signals
from vdmsi_jax.parameters import parameter


class PeriodicDisturbance(AbstractEffect):
    """A sinusoid of the run's time added to the response, as its sine and cosine parts."""

    cause: ClassVar[str] = "periodic_disturbance"
    shown_by: ClassVar[str] = "long steady stretches"
    weight: ClassVar[float] = 5.0

    frequency: Float[Array, ""] = parameter("Hz", "how often", off=1.0, lower=0.0)
    sine: Float[Array, ""] = parameter("response", "amplitude of the sine")
    cosine: Float[Array, ""] = parameter("response", "amplitude of the cosine")

    def probes(self, scales: Scales) -> list[tuple[float, ...]]:
        # a diagnosis looks in the spectrum of the residual, which is finer than any list
        size = 0.05 * scales.response
        return [(f / scales.time_constant, size, 0.0) for f in (0.05, 0.2)]

    def measured(self, y: Float[Array, " N"], signals: Signals) -> Float[Array, " N"]:
        angle = 2.0 * jnp.pi * self.frequency * signals.t
        return y + (self.sine * jnp.sin(angle) + self.cosine * jnp.cos(angle))
