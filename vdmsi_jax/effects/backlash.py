"""Backlash: play before the actuator, or between it and what it moves."""

from typing import ClassVar, Literal

import equinox as eqx
import jax.numpy as jnp
from jax import lax
from jaxtyping import Array, ArrayLike, Float

from vdmsi_jax.effects.base import AbstractEffect, Scales, Signals, before_lag, lag
from vdmsi_jax.parameters import parameter


class Backlash(AbstractEffect):
    """The play operator on the response, or on the command (in its unit): it rests until its input
    has crossed the gap.

    Attributes:
        at: which signal plays.

    Source: Brokate and Sprekels, Hysteresis and Phase Transitions (1996), ch. 2.
    """

    cause: ClassVar[str] = "backlash"
    shown_by: ClassVar[str] = "reversals at several amplitudes"

    gap: Float[Array, ""] = parameter("response", "full width of the play", lower=0.0)
    at: Literal["command", "response"] = eqx.field(static=True, default="response")

    @property
    def ports(self) -> frozenset[str]:
        """A held command plays at the rows alone."""
        return frozenset({"command" if self.at == "command" else "output"})

    @property
    def hides_small(self) -> bool:
        """A play of the command stops what is smaller than its gap."""
        return self.at == "command"

    def probes(self, scales: Scales) -> list[tuple[float, ...]]:
        size = scales.command if self.at == "command" else scales.response
        return [(k * size,) for k in (0.01, 0.03, 0.08, 0.2)]

    def command(self, u: Float[Array, " N"], signals: Signals) -> Float[Array, " N"]:
        return _played(u, self.gap)

    def output(self, y: Float[Array, " M"], signals: Signals) -> Float[Array, " M"]:
        return _played(y, self.gap)


class LoadedBacklash(AbstractEffect):
    """Play of what a load pulls back to zero, as tyres pull road wheels straight: within the gap
    the response does not rest but creeps back, damped, until it leans on the gap's inner side.
    Pulled back at once, it has a dead zone.

    Attributes:
        at: what plays.

    Source: Nordin and Gutman, Controlling mechanical systems with backlash (2002), the model with a
    damped shaft, whose load is a spring here.
    """

    cause: ClassVar[str] = "backlash"
    shown_by: ClassVar[str] = "reversals at several amplitudes"

    gap: Float[Array, ""] = parameter("response", "full width of the play", lower=0.0)
    centring: Float[Array, ""] = parameter("1/s", "pace of the return to zero", lower=0.0)
    at: Literal["load"] = eqx.field(static=True, default="load")

    def probes(self, scales: Scales) -> list[tuple[float, ...]]:
        paces = (0.1 / scales.time_constant, 1.0 / scales.time_constant)
        return [(k * scales.response, c) for k in (0.03, 0.08, 0.2) for c in paces]

    def output(self, y: Float[Array, " M"], signals: Signals) -> Float[Array, " M"]:
        return _played(y, self.gap, jnp.exp(-self.centring * signals.h))


class CoastingBacklash(AbstractEffect):
    """Play of a load with inertia and little friction, as of wheels on a loose tie rod: where what
    drives it slows down, it coasts on through the gap, ever slower, and may come to rest at the
    side ahead. What hits a side takes its speed (an inelastic contact).

    Attributes:
        at: what plays.

    Source: Nordin and Gutman, Controlling mechanical systems with backlash (2002), the model with
    inertia, whose load a damper brakes.
    """

    cause: ClassVar[str] = "backlash"
    shown_by: ClassVar[str] = "reversals at several amplitudes"

    gap: Float[Array, ""] = parameter("response", "full width of the play", lower=0.0)
    coasting: Float[Array, ""] = parameter("s", "time in which the load comes to rest", lower=0.0)
    at: Literal["inertia"] = eqx.field(static=True, default="inertia")

    def probes(self, scales: Scales) -> list[tuple[float, ...]]:
        # where it comes to rest jumps with both, so that no fit gets far
        times = [k * scales.time_constant for k in (0.35, 0.7, 1.2, 2.0)]
        return [(k * scales.response, t) for k in (0.03, 0.05, 0.08, 0.12, 0.2) for t in times]

    def output(self, y: Float[Array, " M"], signals: Signals) -> Float[Array, " M"]:
        half, on = 0.5 * self.gap, self.coasting > 0.0
        kept = jnp.where(on, jnp.exp(-signals.h / jnp.where(on, self.coasting, 1.0)), 0.0)

        def follow(load: tuple[Array, ...], y: Array) -> tuple[tuple[Array, ...], Array]:
            rest, step, before = load
            free = rest + kept * step
            inside = jnp.where(half > 0.0, free, y)
            low = jnp.where(y > free, jnp.maximum(free, y - half), inside)
            new = jnp.where(y < free, jnp.minimum(free, y + half), low)
            return (new, jnp.where(new == free, kept * step, y - before), y), new

        return lax.scan(follow, (y[0], jnp.zeros_like(y[0]), y[0]), y)[1]


class FollowedBacklash(AbstractEffect):
    """Play before the last lag of an actuator: what it moves follows late, as a mirror behind its
    gear or wheels on a compliant rod. The dynamics are as a whole those of the plant; what the play
    keeps of the motion ahead of the lag is missing behind it.

    Attributes:
        at: what plays.

    Source: Brokate and Sprekels, Hysteresis and Phase Transitions (1996), ch. 2, between two linear
    parts (a Wiener-Hammerstein system).
    """

    cause: ClassVar[str] = "backlash"
    shown_by: ClassVar[str] = "reversals at several amplitudes"

    gap: Float[Array, ""] = parameter("response", "full width of the play", lower=0.0)
    behind: Float[Array, ""] = parameter("s", "time constant of what follows", lower=0.0)
    at: Literal["between"] = eqx.field(static=True, default="between")

    def probes(self, scales: Scales) -> list[tuple[float, ...]]:
        lags = [k * scales.time_constant for k in (0.15, 0.5)]
        return [(k * scales.response, lag) for k in (0.03, 0.08, 0.2) for lag in lags]

    def output(self, y: Float[Array, " M"], signals: Signals) -> Float[Array, " M"]:
        ahead = before_lag(y, self.behind / signals.h)
        missing = ahead - _played(ahead, self.gap)
        return y - lag(missing, jnp.full_like(y, self.behind / signals.h))


def _played(
    y: Float[Array, " M"], gap: Float[Array, ""], kept: Float[ArrayLike, ""] = 1.0
) -> Float[Array, " M"]:
    """What follows `y` with play; within the gap it keeps a share of where it was."""
    half = 0.5 * gap

    def follow(rest: Array, y: Array) -> tuple[Array, Array]:
        # each side by itself: without play both bounds coincide, and have no derivative there
        rest = rest * kept
        stays = jnp.where(half > 0.0, rest, y)
        down = jnp.where(y < rest, jnp.minimum(rest, y + half), stays)
        rest = jnp.where(y > rest, jnp.maximum(rest, y - half), down)
        return rest, rest

    return lax.scan(follow, y[0], y)[1]
