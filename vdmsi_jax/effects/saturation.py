"""Saturation: the command, or the response, has an end."""

from typing import ClassVar, Literal

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from vdmsi_jax.effects.base import AbstractEffect, Effort, Scales, Signals, moved, mover
from vdmsi_jax.parameters import parameter

_ROUNDEST = 0.5
_ROUNDEST_LATE = 0.3  # rounder ones with a lag of seconds pose for a gain that remembers
_SHARES = (0.97, 0.9, 0.75, 0.55, 0.35, 0.2)  # of the range, at which limits are tried


class Saturation(AbstractEffect):
    """Limits on the command, or on the response behind the dynamics (a stop).

    Held as inverse limits, since a limit that is off is infinite: `Saturation.of(lower=-2.0,
    upper=2.0)` is one at 2.

    Attributes:
        at: which signal is limited.
    """

    cause: ClassVar[str] = "saturation"
    shown_by: ClassVar[str] = "large commands, held"

    upper: Float[Array, ""] = parameter(
        "1/command", "inverse of the upper limit", lower=0.0, shown="inverse"
    )
    lower: Float[Array, ""] = parameter(
        "1/command", "inverse of the lower limit's size", lower=0.0, shown="inverse"
    )
    at: Literal["command", "response"] = eqx.field(static=True, default="command")

    @property
    def ports(self) -> frozenset[str]:
        return frozenset({"command" if self.at == "command" else "measured"})

    def probes(self, scales: Scales) -> list[tuple[float, ...]]:
        if self.at == "command":
            high, low = scales.high, -scales.low
        else:
            high, low = scales.y_high, -scales.y_low
        up = [1.0 / (k * high) if high > 0 else 0.0 for k in _SHARES]
        down = [1.0 / (k * low) if low > 0 else 0.0 for k in _SHARES]
        both = list(zip(up, down, strict=True)) if high > 0 and low > 0 else []
        one = [(a, 0.0) for a in up if a > 0] + [(0.0, b) for b in down if b > 0]
        return both + one

    def _limited(self, u: Array) -> Array:
        return u / jnp.maximum(1.0, jnp.maximum(u * self.upper, -u * self.lower))

    def command(self, u: Float[Array, " N"], signals: Signals) -> Float[Array, " N"]:
        return self._limited(u)

    def measured(self, y: Float[Array, " N"], signals: Signals) -> Float[Array, " N"]:
        return self._limited(y)


class AbstractRoundLimits(AbstractEffect):
    """Limits with a round corner, as a magnetic circuit's or a smooth governor's: `u / (1 + |u /
    limit|^(1/corner))^corner`."""

    cause: ClassVar[str] = "saturation"
    shown_by: ClassVar[str] = "large commands, held"

    upper: Float[Array, ""] = parameter(
        "1/command", "inverse of the upper limit", lower=0.0, shown="inverse"
    )
    lower: Float[Array, ""] = parameter(
        "1/command", "inverse of the lower limit's size", lower=0.0, shown="inverse"
    )
    corner: Float[Array, ""] = parameter("1", "how round it is", lower=0.0, upper=_ROUNDEST)

    def _limited(self, u: Float[Array, "*n"]) -> Float[Array, "*n"]:
        size = jnp.maximum(u * self.upper, -u * self.lower)
        near = jnp.maximum(jnp.minimum(size, 1.0 / jnp.maximum(size, 1e-12)), 1e-12)
        corner = jnp.where(self.corner > 1e-3, self.corner, 1.0)
        rounding = jnp.exp(corner * jnp.log1p(jnp.exp(jnp.log(near) / corner)))
        on = (self.corner > 1e-3) & (size > 1e-9)
        return u / (jnp.maximum(1.0, size) * jnp.where(on, rounding, 1.0))


class RoundSaturation(AbstractRoundLimits):
    """Limits on the command that are approached by a round corner.

    Attributes:
        at: what is limited.
    """

    at: Literal["corner"] = eqx.field(static=True, default="corner")

    def probes(self, scales: Scales) -> list[tuple[float, ...]]:
        limits = Saturation(at="command").probes(scales)
        return [(*limit, corner) for limit in limits[::2] for corner in (0.12, 0.35)]

    def command(self, u: Float[Array, " N"], signals: Signals) -> Float[Array, " N"]:
        return self._limited(u)


class LateSaturation(AbstractRoundLimits):
    """Limits behind the first lag of an actuator, as of a pump that cavitates behind its rotor,
    with a sharp corner or a round one. The dynamics are as a whole those of the plant; what the
    limits cut is missing in the command, told ahead of the lag.

    Attributes:
        at: what is limited.
    """

    refines: ClassVar[tuple[str, ...]] = ("saturation", "gain_nonlinearity")

    corner: Float[Array, ""] = parameter("1", "how round it is", lower=0.0, upper=_ROUNDEST_LATE)
    before: Float[Array, ""] = parameter("s", "time constant of what comes before", lower=0.0)
    at: Literal["late"] = eqx.field(static=True, default="late")

    def probes(self, scales: Scales) -> list[tuple[float, ...]]:
        limits = Saturation(at="command").probes(scales)[::2]
        lags = [k * scales.time_constant for k in (0.1, 0.4)]
        return [(*limit, 0.12, lag) for limit in limits for lag in lags]

    def held(self, u: Float[Array, " M"], signals: Signals) -> Float[Array, " M"]:
        span, first = self.before / signals.h, signals.earlier(u)
        late = moved(u, span, first)
        return u - mover(late - self._limited(late), span, first - self._limited(first))


class EndStop(AbstractEffect):
    """Stops that hold the moving part itself, as those of a rack or the rim of a tank: it leaves
    them as soon as it is driven back, where a response that is merely cut comes back late.

    The force is that which lets the response come no nearer than half way to the stop within the
    sub-step, and half way back from behind it: an inelastic contact by time stepping, which does
    not chatter.

    Attributes:
        at: what is limited.

    Source: Moreau, Unilateral contact and dry friction (1988); Acary and Brogliato (2008), ch. 5.
    """

    cause: ClassVar[str] = "saturation"
    shown_by: ClassVar[str] = "large commands, held"

    upper: Float[Array, ""] = parameter(
        "1/response", "inverse of the upper limit", lower=0.0, shown="inverse"
    )
    lower: Float[Array, ""] = parameter(
        "1/response", "inverse of the lower limit's size", lower=0.0, shown="inverse"
    )
    at: Literal["stop"] = eqx.field(static=True, default="stop")

    def probes(self, scales: Scales) -> list[tuple[float, ...]]:
        return Saturation(at="response").probes(scales)[1::3]

    def effort(self, at: Effort) -> Float[Array, ""]:
        then = at.y + 2.0 * at.h * at.rate

        def beyond(limit: Array, y: Array) -> Array:
            over = limit * y - 1.0
            return jnp.where(over > 0.0, over / jnp.where(over > 0.0, limit, 1.0), 0.0)

        return (beyond(self.upper, then) - beyond(self.lower, -then)) / (2.0 * at.h * at.gain)
