"""Cross-coupling: one actuator disturbs the other."""

from typing import ClassVar, Literal

import equinox as eqx
from jaxtyping import Array, Float

from vdmsi_jax.effects.base import AbstractEffect, Scales, Signals
from vdmsi_jax.parameters import parameter


class CrossCoupling(AbstractEffect):
    """Something of the other actuator is added to the command.

    Attributes:
        by: what acts: the other command (`signed`), its size (`size`), its square (`square`), or,
            in a share of the own command, its size (`slowed`).
    """

    cause: ClassVar[str] = "cross_coupling"

    strength: Float[Array, ""] = parameter("command per unit of the other", "of the coupling")
    by: Literal["signed", "size", "square", "slowed", "speed"] = eqx.field(
        static=True, default="signed"
    )

    def probes(self, scales: Scales) -> list[tuple[float, ...]]:
        typical = {"speed": max(scales.speed, 0.1)}.get(self.by, 1.0)
        whole = 1.0 if self.by == "slowed" else scales.command
        return [(k * whole / typical,) for k in (-0.5, -0.05, 0.05, 0.5)]

    def command(self, u: Float[Array, " N"], signals: Signals) -> Float[Array, " N"]:
        acting = {
            "signed": signals.other,
            "size": abs(signals.other),
            "square": signals.other**2,
            "slowed": abs(signals.other) * u,
            "speed": signals.v,
        }[self.by]
        return u + self.strength * acting
