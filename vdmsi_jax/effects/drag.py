"""Drag: air and rolling resistance that the speed control does not take away."""

from typing import ClassVar

import jax.numpy as jnp
from jaxtyping import Array, Float

from vdmsi_jax.effects.base import AbstractEffect, Effort, Scales
from vdmsi_jax.parameters import parameter


class Drag(AbstractEffect):
    """The deceleration `quadratic v |v| + rolling sign(v)`, as the command that is spent on it."""

    cause: ClassVar[str] = "drag"
    shown_by: ClassVar[str] = "a ladder of speeds"

    quadratic: Float[Array, ""] = parameter("1/m", "of the squared speed", lower=0.0)
    rolling: Float[Array, ""] = parameter("m/s^2", "deceleration by rolling resistance", lower=0.0)

    def probes(self, scales: Scales) -> list[tuple[float, ...]]:
        size = max(abs(scales.y_low), abs(scales.y_high), 1e-12)
        spent = [k * size / scales.time_constant for k in (0.03, 0.2)]
        return [(a / size**2, 0.0) for a in spent] + [(0.0, a) for a in spent]

    def effort(self, at: Effort) -> Float[Array, ""]:
        rolls = jnp.clip(at.y / 0.05, -1.0, 1.0)  # rolling resistance fades out below 5 cm/s
        return at.slowness * (self.quadratic * at.y * abs(at.y) + self.rolling * rolls)
