"""Quantisation: the command acts in steps."""

from typing import ClassVar

import jax.numpy as jnp
from jaxtyping import Array, Float

from vdmsi_jax.effects.base import AbstractEffect, Scales, Signals
from vdmsi_jax.parameters import parameter


class Quantization(AbstractEffect):
    """The command is rounded to the nearest multiple of `step` before it acts."""

    cause: ClassVar[str] = "quantization"
    weight: ClassVar[float] = 4.0

    step: Float[Array, ""] = parameter("command", "size of a step", lower=0.0)

    def probes(self, scales: Scales) -> list[tuple[float, ...]]:
        fine = max(scales.noise, 1e-3 * scales.command)
        count = 60
        return [(fine * (0.5 * scales.command / fine) ** (k / count),) for k in range(count)]

    def command(self, u: Float[Array, " N"], signals: Signals) -> Float[Array, " N"]:
        step = jnp.where(self.step > 0.0, self.step, 1.0)
        return jnp.where(self.step > 0.0, jnp.round(u / step) * self.step, u)
