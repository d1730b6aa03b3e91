"""Transport delay: the plant sees its command later."""

from typing import ClassVar

from jaxtyping import Array, Float

from vdmsi_jax.effects.base import AbstractEffect, Scales, Signals, late
from vdmsi_jax.parameters import parameter


class TransportDelay(AbstractEffect):
    """`u(t - delay)`, exact for held commands: each sub-step sees the mean of the late command
    over it."""

    cause: ClassVar[str] = "transport_delay"
    shown_by: ClassVar[str] = "steps of the command"

    delay: Float[Array, ""] = parameter("s", "time from the command to its effect")

    def probes(self, scales: Scales) -> list[tuple[float, ...]]:
        slow = max(scales.time_constant, scales.dt)
        return [(k * slow,) for k in (0.05, 0.15, 0.4, 0.8)] + [(k * scales.dt,) for k in (1, 3, 8)]

    def held(self, u: Float[Array, " M"], signals: Signals) -> Float[Array, " M"]:
        return late(u, self.delay / signals.h, signals.before)
