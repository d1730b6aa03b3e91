"""Dead zone: small commands do nothing."""

from typing import ClassVar

from jaxtyping import Array, Float

from vdmsi_jax.effects.base import AbstractEffect, Scales, Signals, within
from vdmsi_jax.parameters import parameter


class DeadZone(AbstractEffect):
    """`u - clip(u, -w, w)`: nothing within `half_width` of zero, the excess beyond it."""

    cause: ClassVar[str] = "dead_zone"

    half_width: Float[Array, ""] = parameter(
        "command", "commands up to this size do nothing", lower=0.0
    )

    def probes(self, scales: Scales) -> list[tuple[float, ...]]:
        largest = max(abs(scales.low), abs(scales.high))
        return [(k * largest,) for k in (0.02, 0.06, 0.15, 0.3)]

    def command(self, u: Float[Array, " N"], signals: Signals) -> Float[Array, " N"]:
        return u - within(u, self.half_width)
