"""Dead zone: small commands do nothing."""

from typing import ClassVar, Literal

import equinox as eqx
from jaxtyping import Array, Float

from vdmsi_jax.effects.base import AbstractEffect, Scales, Signals, moved, mover, within
from vdmsi_jax.parameters import parameter


class DeadZone(AbstractEffect):
    """`u - clip(u, -w, w)`: nothing within `half_width` of zero, the excess beyond it.

    Attributes:
        at: what has the zone.
    """

    cause: ClassVar[str] = "dead_zone"
    shown_by: ClassVar[str] = "small commands around zero"

    half_width: Float[Array, ""] = parameter(
        "command", "commands up to this size do nothing", lower=0.0
    )
    at: Literal["command"] = eqx.field(static=True, default="command")

    def probes(self, scales: Scales) -> list[tuple[float, ...]]:
        largest = max(abs(scales.low), abs(scales.high))
        return [(k * largest,) for k in (0.02, 0.06, 0.15, 0.3)]

    def command(self, u: Float[Array, " N"], signals: Signals) -> Float[Array, " N"]:
        return u - within(u, self.half_width)


class LateDeadZone(AbstractEffect):
    """A dead zone behind the first lag of an actuator, as the overlap of a valve whose spool
    follows the command late. The dynamics are as a whole those of the plant; what the zone keeps
    back is missing in the command, told ahead of the lag.

    Attributes:
        at: what has the zone.

    Source: Merritt, Hydraulic Control Systems (1967), ch. 5, overlapped valves.
    """

    cause: ClassVar[str] = "dead_zone"
    shown_by: ClassVar[str] = "small commands around zero"

    half_width: Float[Array, ""] = parameter(
        "command", "commands up to this size do nothing", lower=0.0
    )
    before: Float[Array, ""] = parameter("s", "time constant of what moves it", lower=0.0)
    at: Literal["spool"] = eqx.field(static=True, default="spool")

    def probes(self, scales: Scales) -> list[tuple[float, ...]]:
        largest = max(abs(scales.low), abs(scales.high))
        lags = [k * scales.time_constant for k in (0.1, 0.4)]
        return [(k * largest, lag) for k in (0.06, 0.15, 0.3) for lag in lags]

    def held(self, u: Float[Array, " M"], signals: Signals) -> Float[Array, " M"]:
        span, first = self.before / signals.h, signals.earlier(u)
        kept = within(moved(u, span, first), self.half_width)
        return u - mover(kept, span, within(first, self.half_width))
