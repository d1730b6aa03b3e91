"""Speed-dependent gain: the steering answers less, or more, at speed."""

from typing import ClassVar, Literal

import equinox as eqx
from jaxtyping import Array, Float

from vdmsi_jax.effects.base import AbstractEffect, Scales, Signals
from vdmsi_jax.parameters import parameter


class SpeedDependentGain(AbstractEffect):
    """Gain `1 + slope v`.

    Attributes:
        at: what it multiplies: the command, or the response with its offset, where the command was
            shifted before.
    """

    cause: ClassVar[str] = "speed_dependent_gain"
    shown_by: ClassVar[str] = "the same steering at several speeds"

    slope: Float[Array, ""] = parameter("1/(m/s)", "relative change of the gain per m/s")
    at: Literal["command", "response"] = eqx.field(static=True, default="command")

    @property
    def ports(self) -> frozenset[str]:
        return frozenset({"command" if self.at == "command" else "measured"})

    def probes(self, scales: Scales) -> list[tuple[float, ...]]:
        return [(k / max(scales.speed, 0.1),) for k in (-0.3, -0.05, 0.05, 0.3)]

    def command(self, u: Float[Array, " N"], signals: Signals) -> Float[Array, " N"]:
        return u + self.slope * signals.v * u

    def measured(self, y: Float[Array, " N"], signals: Signals) -> Float[Array, " N"]:
        return y + self.slope * signals.v * y
