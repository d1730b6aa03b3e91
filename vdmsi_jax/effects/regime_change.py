"""Regime change: from a moment on, the plant has another gain, and may be slower."""

from typing import ClassVar

import jax.numpy as jnp
from jaxtyping import Array, Float

from vdmsi_jax.effects.base import AbstractEffect, Scales, Signals, lag
from vdmsi_jax.parameters import parameter


class RegimeChange(AbstractEffect):
    """The gain jumps at `time` of the run, and a lag comes with it: what loses strength inside a
    loop (power assistance, a supply) gets slower, too, and innovations see the fast part first. The
    jump is spread over one row, so that its moment has a derivative."""

    cause: ClassVar[str] = "regime_change"
    weight: ClassVar[float] = 5.0

    time: Float[Array, ""] = parameter("s", "when, from the start of the run")
    gain: Float[Array, ""] = parameter("1", "gain after over gain before, minus 1", lower=-1.0)
    slowing: Float[Array, ""] = parameter("s", "time constant that is added", lower=0.0)

    def probes(self, scales: Scales) -> list[tuple[float, ...]]:
        return [
            (share * scales.duration, size, 0.0)
            for share in (0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9)
            for size in (-0.15, 0.15)
        ]

    def command(self, u: Float[Array, " N"], signals: Signals) -> Float[Array, " N"]:
        row = signals.h * signals.substeps
        after = jnp.clip((signals.t - self.time) / row + 0.5, 0.0, 1.0)
        return lag(u + self.gain * after * u, after * self.slowing / row)
