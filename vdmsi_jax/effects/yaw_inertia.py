"""Yaw inertia: the tyres need a moment to turn the body, the longer the faster it goes."""

from typing import ClassVar

import jax.numpy as jnp
from jaxtyping import Array, ArrayLike, Float

from vdmsi_jax.effects.base import AbstractEffect, Scales, lag
from vdmsi_jax.parameters import parameter


class YawInertia(AbstractEffect):
    """The curvature follows with a time constant in proportion to speed: about the yaw inertia over
    the tyres' cornering stiffness by their squared distances to the centre of gravity.

    Source: Rajamani, Vehicle Dynamics and Control (2012), section 2.3, by the damping of yaw.
    """

    cause: ClassVar[str] = "yaw_inertia"
    shown_by: ClassVar[str] = "a steering chirp of 0.1 to 6 Hz at two speeds"
    weight: ClassVar[float] = 2.0  # with the lags that every body has it takes some of any misfit

    lag: Float[Array, ""] = parameter("s^2/m", "time constant per speed", lower=0.0)

    def probes(self, scales: Scales) -> list[tuple[float, ...]]:
        return [(0.002,), (0.005,)]

    def relaxed(
        self, kappa: Float[Array, " M"], v: Float[Array, " M"], h: Float[ArrayLike, "..."]
    ) -> Float[Array, " M"]:
        return lag(kappa, self.lag * jnp.abs(v) / h)
