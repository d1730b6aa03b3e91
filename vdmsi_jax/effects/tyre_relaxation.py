"""Tyre relaxation: the tyres need a way to build up their slip."""

from typing import ClassVar

import jax.numpy as jnp
from jaxtyping import Array, ArrayLike, Float

from vdmsi_jax.effects.base import AbstractEffect, Scales, lag
from vdmsi_jax.parameters import parameter

_LEAST = 1e-9  # m, of way between two instants, so that there is one where a vehicle stands


class TyreRelaxation(AbstractEffect):
    """The curvature follows over `length` metres of way.

    Source: Pacejka, Tire and Vehicle Dynamics (2012), section 1.3 and ch. 7.
    """

    cause: ClassVar[str] = "tyre_relaxation"
    shown_by: ClassVar[str] = "a steering chirp of 0.1 to 6 Hz at two speeds"

    length: Float[Array, ""] = parameter("m", "way over which the curvature follows", lower=0.0)

    def probes(self, scales: Scales) -> list[tuple[float, ...]]:
        return [(0.3,), (1.0,)]

    def relaxed(
        self, kappa: Float[Array, " M"], v: Float[Array, " M"], h: Float[ArrayLike, "..."]
    ) -> Float[Array, " M"]:
        return lag(kappa, self.length / (jnp.abs(v) * h + _LEAST))
