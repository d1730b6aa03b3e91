"""Coulomb friction: dry friction that the drive must overcome before anything moves."""

from dataclasses import replace
from typing import ClassVar, Literal

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from vdmsi_jax.effects.base import AbstractEffect, Effort, Scales, within
from vdmsi_jax.parameters import parameter


class CoulombFriction(AbstractEffect):
    """Friction of a constant level against the motion, more while it stands still; that wears off
    at once, or the faster it moves (Stribeck).

    The force is that which stops the response at the end of the sub-step, no larger than its
    level: time stepping with an implicit, set-valued sign, in which sticking is exact.

    Attributes:
        against: what it opposes: the rate of the response, where the response is a position, or the
            response itself, where that is a speed.
        rest: response below which a speed counts as none, its unit.
        most: the largest speed, its unit.

    Source: Moreau, Unilateral contact and dry friction (1988); Acary and Brogliato (2008), ch. 9;
    Hess and Soom, Friction at a lubricated line contact operating at oscillating sliding velocities
    (1990), for the way in which it wears off.
    """

    cause: ClassVar[str] = "coulomb_friction"
    shown_by: ClassVar[str] = "slow reversals, and coasting down"
    weight: ClassVar[float] = 2.0  # without breakaway the last parameter tells nothing

    level: Float[Array, ""] = parameter(
        "command", "friction as the command that overcomes it", lower=0.0
    )
    breakaway: Float[Array, ""] = parameter(
        "command", "how much more holds it while it stands", lower=0.0
    )
    stribeck: Float[Array, ""] = parameter(
        "1", "share of the largest speed at which half of that has worn off", lower=0.0, upper=0.3
    )

    against: Literal["rate", "response"] = eqx.field(static=True, default="rate")
    rest: Float[Array, ""] = eqx.field(converter=jnp.asarray, default=0.05)
    most: Float[Array, ""] = eqx.field(converter=jnp.asarray, default=1.0)

    def scaled(self, scales: Scales) -> "CoulombFriction":
        largest = max(abs(scales.y_low), abs(scales.y_high), 1e-9)
        most = largest if self.against == "response" else max(scales.rate, 1e-9)
        return replace(self, rest=0.01 * largest, most=most)

    def probes(self, scales: Scales) -> list[tuple[float, ...]]:
        sizes = [k * scales.command for k in (0.01, 0.03, 0.08, 0.2)]
        held = [(size, 0.5 * size, worn) for size in sizes[1:3] for worn in (0.02, 0.1)]
        return [(size, 0.0, 0.0) for size in sizes] + held

    def effort(self, at: Effort) -> Float[Array, ""]:
        if self.against == "response":
            beyond = jnp.maximum(jnp.abs(at.y) - self.rest, 0.0)
            level = self.level + self.breakaway * self._left(beyond)
            return level * jnp.clip(at.y / self.rest, -1.0, 1.0)
        left = jnp.maximum(at.stuck, self._left(jnp.abs(at.rate)))
        return within(at.rate / at.gain, self.level + self.breakaway * left)

    def _left(self, speed: Float[Array, ""]) -> Float[Array, ""]:
        """Share of the breakaway that is left at a speed."""
        wears = self.stribeck > 0.0
        half = jnp.where(wears, self.stribeck * self.most, 1.0)
        at_once = jnp.where(speed > 0.0, 0.0, 1.0)
        return jnp.where(wears, 1.0 / (1.0 + (speed / half) ** 2), at_once)
