"""Quantisation: the command acts in steps."""

from typing import ClassVar, Literal

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from vdmsi_jax.effects.base import AbstractEffect, Scales, Signals
from vdmsi_jax.parameters import parameter


class Quantization(AbstractEffect):
    """The command is rounded to a multiple of `step` before it acts.

    Attributes:
        by: rounding to the nearest, down, or toward zero, as a cast to an integer does.
    """

    cause: ClassVar[str] = "quantization"
    shown_by: ClassVar[str] = "slow ramps"
    weight: ClassVar[float] = 4.0

    step: Float[Array, ""] = parameter("command", "size of a step", lower=0.0)

    by: Literal["nearest", "floor", "truncation"] = eqx.field(static=True, default="nearest")

    def probes(self, scales: Scales) -> list[tuple[float, ...]]:
        fine = max(scales.noise, 1e-3 * scales.command)
        count = 60
        return [(fine * (0.5 * scales.command / fine) ** (k / count),) for k in range(count)]

    def command(self, u: Float[Array, " N"], signals: Signals) -> Float[Array, " N"]:
        step = jnp.where(self.step > 0.0, self.step, 1.0)
        rounding = {"nearest": jnp.round, "floor": jnp.floor, "truncation": jnp.trunc}[self.by]
        return jnp.where(self.step > 0.0, rounding(u / step) * self.step, u)
