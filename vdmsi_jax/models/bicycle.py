"""The kinematic bicycle at the centre of gravity, eq. (1) and (6) of the paper."""

from typing import NamedTuple

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, ArrayLike, Float

from ..config import VehicleGeometry
from ..parameters import floats


class BicycleState(NamedTuple):
    """State of eq. (1), or its time derivative.

    Attributes:
        x, y: centre of gravity, m.
        psi: heading of the body, counter-clockwise, rad.
        v: speed of the centre of gravity along its course, m/s.
    """

    x: Float[Array, "*batch"]
    y: Float[Array, "*batch"]
    psi: Float[Array, "*batch"]
    v: Float[Array, "*batch"]


class Bicycle(eqx.Module):
    """Two wheels that do not slip, seen from the centre of gravity (Kong et al. 2015).

    Every method works on one instant or, elementwise, on many.

    Attributes:
        l_f: distance from the centre of gravity to the front axle, m.
        l_r: distance from the centre of gravity to the rear axle, m; 0 puts the reference point on
            the rear axle.
    """

    l_f: Float[Array, ""] = eqx.field(converter=floats)
    l_r: Float[Array, ""] = eqx.field(converter=floats)

    @classmethod
    def at_reference(cls, vehicle: VehicleGeometry) -> "Bicycle":
        """The one whose reference point is the vehicle's, wherever its centre of gravity lies."""
        behind = vehicle.rear_to_reference
        return cls(vehicle.wheelbase - behind, behind)

    @property
    def wheelbase(self) -> Float[Array, ""]:
        """Distance between the axles, m."""
        return self.l_f + self.l_r

    def slip_angle(self, delta: Float[ArrayLike, "*batch"]) -> Float[Array, "*batch"]:
        """Angle from the body's heading to its course, rad, at the road-wheel angle `delta`."""
        return jnp.arctan(self.l_r / self.wheelbase * jnp.tan(delta))

    def course(
        self, delta: Float[ArrayLike, "*batch"]
    ) -> tuple[Float[Array, "*batch"], Float[Array, "*batch"], Float[Array, "*batch"]]:
        """Cosine and sine of the slip angle, and the curvature of the path in 1/m.

        The curvature is the paper's `sin(beta) / l_r`, written as `cos(beta) tan(delta) / (l_f +
        l_r)` so that it holds on the rear axle too, and without a trigonometric function of an
        inverse one.
        """
        tangent = jnp.tan(delta)
        slope = self.l_r / self.wheelbase * tangent
        cosine = 1.0 / jnp.sqrt(1.0 + slope * slope)
        return cosine, slope * cosine, cosine * tangent / self.wheelbase

    def steering_angle(self, curvature: Float[ArrayLike, "*batch"]) -> Float[Array, "*batch"]:
        """Road-wheel angle, rad, at which the path has `curvature` (1/m): the inverse of `course`.

        NaN where the centre of gravity cannot turn so sharply (`l_r |curvature| >= 1`).
        """
        turning = self.l_r * curvature
        return jnp.arctan(self.wheelbase * curvature / jnp.sqrt(1.0 - turning * turning))

    def yaw_rate(
        self, v: Float[ArrayLike, "*batch"], delta: Float[ArrayLike, "*batch"]
    ) -> Float[Array, "*batch"]:
        """Rate of the heading, rad/s."""
        return jnp.asarray(v) * self.course(delta)[2]

    def derivatives(
        self, state: BicycleState, a: Float[ArrayLike, "*batch"], delta: Float[ArrayLike, "*batch"]
    ) -> BicycleState:
        """Eq. (1): the derivative of `state` under acceleration `a` (m/s²) and `delta` (rad)."""
        beta = self.slip_angle(delta)
        return BicycleState(
            x=state.v * jnp.cos(state.psi + beta),
            y=state.v * jnp.sin(state.psi + beta),
            psi=self.yaw_rate(state.v, delta),
            v=jnp.asarray(a),
        )
