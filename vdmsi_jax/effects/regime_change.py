"""Regime change: from a moment on, the plant has another gain, and may be slower."""

from typing import ClassVar, Literal

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from vdmsi_jax.effects.base import AbstractEffect, Scales, Signals, lag
from vdmsi_jax.parameters import parameter


class RegimeChange(AbstractEffect):
    """The gain jumps at a moment, and a lag comes with it: what loses strength inside a
    loop (power assistance, a supply) gets slower, too, and innovations see the fast part first. A
    change that takes its time (a voltage that sinks, a leak that opens) is a ramp about the moment;
    a jump is spread over one row, so that its moment has a derivative.

    Attributes:
        over: whether that is a moment of every run, or one of the session that the runs are parts
            of, after which all is changed.
    """

    cause: ClassVar[str] = "regime_change"
    shown_by: ClassVar[str] = "the same manoeuvre throughout"
    weight: ClassVar[float] = 5.0

    time: Float[Array, ""] = parameter("s", "when, from the start of the run or session")
    gain: Float[Array, ""] = parameter("1", "gain after over gain before, minus 1", lower=-1.0)
    slowing: Float[Array, ""] = parameter("s", "time constant that is added", lower=0.0)
    ramp: Float[Array, ""] = parameter("s", "how long the gain takes to change", lower=0.0)

    over: Literal["run", "session"] = eqx.field(static=True, default="run")

    def probes(self, scales: Scales) -> list[tuple[float, ...]]:
        length = scales.clock(self.over)
        slow = min(4.0 * scales.time_constant, 0.05 * length)
        jumps, ramps = (0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9), (0.25, 0.5, 0.75)
        times = [*((share, 0.0) for share in jumps), *((share, slow) for share in ramps)]
        return [(s * length, size, 0.0, ramp) for s, ramp in times for size in (-0.15, 0.15)]

    def command(self, u: Float[Array, " N"], signals: Signals) -> Float[Array, " N"]:
        row = signals.h * signals.substeps
        t = signals.clock(self.over)
        after = jnp.clip((t - self.time) / (row + self.ramp) + 0.5, 0.0, 1.0)
        return lag(u + self.gain * after * u, after * self.slowing / row)
