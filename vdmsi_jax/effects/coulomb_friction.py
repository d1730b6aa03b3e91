"""Coulomb friction: dry friction that the drive must overcome before anything moves."""

from typing import ClassVar, Literal

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from vdmsi_jax.effects.base import AbstractEffect, Effort, Scales, within
from vdmsi_jax.parameters import parameter


class CoulombFriction(AbstractEffect):
    """Friction of a constant level against the motion, more while it stands still.

    The force is that which stops the response at the end of the sub-step, no larger than its
    level: time stepping with an implicit, set-valued sign, in which sticking is exact.

    Attributes:
        against: what it opposes: the rate of the response, where the response is a position, or the
            response itself, where that is a speed.
        rest: response below which a speed counts as none, its unit.

    Source: Moreau, Unilateral contact and dry friction (1988); Acary and Brogliato (2008), ch. 9.
    """

    cause: ClassVar[str] = "coulomb_friction"

    level: Float[Array, ""] = parameter(
        "command", "friction as the command that overcomes it", lower=0.0
    )
    breakaway: Float[Array, ""] = parameter(
        "command", "how much more holds it while it stands", lower=0.0
    )

    against: Literal["rate", "response"] = eqx.field(static=True, default="rate")
    rest: Float[Array, ""] = eqx.field(converter=jnp.asarray, default=0.05)

    def scaled(self, scales: Scales) -> "CoulombFriction":
        rest = 0.01 * max(abs(scales.y_low), abs(scales.y_high), 1e-9)
        return CoulombFriction(self.level, self.breakaway, self.against, rest)

    def probes(self, scales: Scales) -> list[tuple[float, ...]]:
        sizes = [k * scales.command for k in (0.01, 0.03, 0.08, 0.2)]
        return [(size, 0.0) for size in sizes] + [(size, 0.5 * size) for size in sizes[1:3]]

    def effort(self, at: Effort) -> Float[Array, ""]:
        if self.against == "response":
            standing = jnp.where(jnp.abs(at.y) < self.rest, self.breakaway, 0.0)
            return (self.level + standing) * jnp.clip(at.y / self.rest, -1.0, 1.0)
        level = self.level + self.breakaway * at.stuck
        return within(at.rate / at.gain, level)
