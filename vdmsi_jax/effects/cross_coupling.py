"""Cross-coupling: one actuator disturbs the other."""

from typing import ClassVar, Literal

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from vdmsi_jax.effects.base import AbstractEffect, Scales, Signals, lag
from vdmsi_jax.parameters import parameter

_SMOOTH = 0.2  # s, over which a speed is averaged to tell its slope


class CrossCoupling(AbstractEffect):
    """Something of the other actuator is added to the command.

    Attributes:
        by: what acts: the other command (`signed`), its size (`size`), its square (`square`), in a
            share of the own command its size (`slowed`), its square by that of the own command, as
            tyres brake that turn a vehicle (`cornering`), the `speed`, or the `acceleration`, which
            is the slope of the speed over a fifth of a second to both sides.
    """

    cause: ClassVar[str] = "cross_coupling"
    shown_by: ClassVar[str] = "one command held while the other moves"

    strength: Float[Array, ""] = parameter("command per unit of the other", "of the coupling")
    by: Literal["signed", "size", "square", "slowed", "cornering", "speed", "acceleration"] = (
        eqx.field(static=True, default="signed")
    )

    def probes(self, scales: Scales) -> list[tuple[float, ...]]:
        speed = max(scales.speed, 0.1)
        size = {
            "slowed": 1.0,
            "cornering": 1.0 / max(abs(scales.low), abs(scales.high), 1e-9),
            "speed": scales.command / speed,
            "acceleration": scales.command * scales.duration / (20.0 * speed),
        }.get(self.by, scales.command)
        return [(k * size,) for k in (-0.5, -0.05, 0.05, 0.5)]

    def command(self, u: Float[Array, " N"], signals: Signals) -> Float[Array, " N"]:
        acting = {
            "signed": signals.other,
            "size": abs(signals.other),
            "square": signals.other**2,
            "slowed": abs(signals.other) * u,
            "cornering": signals.other**2 * abs(u) * u,
            "speed": signals.v,
            "acceleration": _slope(signals),
        }[self.by]
        return u + self.strength * acting


def _slope(signals: Signals) -> Float[Array, " N"]:
    """Acceleration: the speed that is to come less the one that was, both by exponential means."""
    spans = jnp.full_like(signals.v, _SMOOTH / (signals.h * signals.substeps))
    before = lag(signals.v, spans)
    after = lag(signals.v[::-1], spans)[::-1]
    return (after - before) / (2.0 * _SMOOTH)
