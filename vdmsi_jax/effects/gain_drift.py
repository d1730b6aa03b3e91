"""Gain drift: the plant answers more, or less, as time goes on."""

from typing import ClassVar, Literal

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from vdmsi_jax.effects.base import AbstractEffect, Scales, Signals
from vdmsi_jax.parameters import parameter

_SOONEST = 1.0  # 1/s, beyond which a drift is a transient


class GainDrift(AbstractEffect):
    """The gain changes by `rate` of its first value per second at first; the rate itself decays as
    `exp(-bend t)`, as in what warms up, or grows where `bend` is negative.

    Attributes:
        over: whether in every run anew, or on from run to run of a session.
    """

    cause: ClassVar[str] = "gain_drift"
    shown_by: ClassVar[str] = "the same manoeuvre early and late"

    rate: Float[Array, ""] = parameter("1/s", "relative change of the gain per second")
    bend: Float[Array, ""] = parameter("1/s", "decay of that change", lower=-0.05, upper=_SOONEST)

    over: Literal["run", "session"] = eqx.field(static=True, default="run")

    def probes(self, scales: Scales) -> list[tuple[float, ...]]:
        shares = (-0.3, -0.05, 0.05, 0.3)
        length = scales.clock(self.over)
        straight = [(k / max(length, scales.dt), 0.0) for k in shares]
        soon = min(3.0 / max(length, scales.dt), _SOONEST)
        return straight + [(k * soon, soon) for k in shares]

    def command(self, u: Float[Array, " N"], signals: Signals) -> Float[Array, " N"]:
        t = signals.clock(self.over)
        x = self.bend * t
        small = jnp.abs(x) < 1e-4
        safe = jnp.where(small, 1.0, x)
        spent = jnp.where(small, 1.0 - 0.5 * x, -jnp.expm1(-safe) / safe)
        return u + self.rate * t * spent * u
