"""Gain drift: the plant answers more, or less, as time goes on."""

from typing import ClassVar

from jaxtyping import Array, Float

from vdmsi_jax.effects.base import AbstractEffect, Scales, Signals
from vdmsi_jax.parameters import parameter


class GainDrift(AbstractEffect):
    """The gain grows by `rate` of its first value per second, in every run anew."""

    cause: ClassVar[str] = "gain_drift"

    rate: Float[Array, ""] = parameter("1/s", "relative change of the gain per second")

    def probes(self, scales: Scales) -> list[tuple[float, ...]]:
        return [(k / scales.duration,) for k in (-0.3, -0.05, 0.05, 0.3)]

    def command(self, u: Float[Array, " N"], signals: Signals) -> Float[Array, " N"]:
        return u + self.rate * signals.t * u
