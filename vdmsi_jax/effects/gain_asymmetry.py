"""Gain asymmetry: one direction answers more than the other."""

from typing import ClassVar, Literal

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from vdmsi_jax.effects.base import AbstractEffect, Effort, Scales, Signals
from vdmsi_jax.parameters import parameter


class GainAsymmetry(AbstractEffect):
    """Another gain for positive commands than for negative ones, or for pushing (a command above
    the one that would hold the response) than for braking, or for responses to the positive side,
    where a spring of another stiffness pulls them back.

    Attributes:
        by: the sign of what decides the gain.
    """

    cause: ClassVar[str] = "gain_asymmetry"
    shown_by: ClassVar[str] = "steps in both directions"

    ratio: Float[Array, ""] = parameter("1", "positive over negative gain, minus 1", lower=-0.95)
    by: Literal["command", "effort", "stiffness"] = eqx.field(static=True, default="command")

    @property
    def ports(self) -> frozenset[str]:
        return frozenset({"command" if self.by == "command" else "effort"})

    def probes(self, scales: Scales) -> list[tuple[float, ...]]:
        return [(k,) for k in (-0.4, -0.1, 0.1, 0.5)]

    def command(self, u: Float[Array, " N"], signals: Signals) -> Float[Array, " N"]:
        return jnp.where(u > 0.0, u + self.ratio * u, u)

    def effort(self, at: Effort) -> Float[Array, ""]:
        if self.by == "stiffness":
            return at.more_pull(jnp.where(at.y > 0.0, 1.0 / (1.0 + self.ratio), 1.0))
        push = at.u - at.still
        return jnp.where(push > 0.0, -self.ratio * push, 0.0)
