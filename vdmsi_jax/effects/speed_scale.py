"""Speed scale: the wheels are larger, or smaller, than the speed sensor thinks."""

from typing import ClassVar

from jaxtyping import Array, Float

from vdmsi_jax.effects.base import AbstractEffect, Scales
from vdmsi_jax.parameters import parameter


class SpeedScale(AbstractEffect):
    """Speed over the ground is `1 + scale` times the measured one."""

    cause: ClassVar[str] = "speed_scale"
    shown_by: ClassVar[str] = "a straight drive, with pose and speed logged together"

    scale: Float[Array, ""] = parameter("1", "true over measured speed, minus 1", lower=-0.9)

    def probes(self, scales: Scales) -> list[tuple[float, ...]]:
        return [(-0.03,), (0.03,)]

    def speed(self, v: Float[Array, " M"]) -> Float[Array, " M"]:
        return v + self.scale * v
