"""The pose as a chain of circular arcs: exact where the wheel is still between the rows."""

import jax.numpy as jnp
from jaxtyping import Array

from vdmsi_jax.models.commands import Commands
from vdmsi_jax.models.following import FollowedAtOnce
from vdmsi_jax.models.vehicle import Vehicle
from vdmsi_jax.simulate._nouns import (
    AbstractMethod,
    Start,
    Trajectory,
    respond,
    trajectory,
)
from vdmsi_jax.simulate._quadrature import accumulate


def no_arcs(vehicle: Vehicle) -> str | None:
    """Why the vehicle does not move on arcs between the rows; `None` if it does."""
    if not isinstance(vehicle.steering, FollowedAtOnce):
        return "Arcs needs a steering that is FollowedAtOnce"
    if vehicle.acts_at("relaxed"):
        return "Arcs takes no effect that remembers the way"
    still = isinstance(vehicle.powertrain, FollowedAtOnce)
    if vehicle.acts_at("speed", "curvature") and not still:
        return "Arcs takes effects on speed or curvature only where the speed is FollowedAtOnce"
    return None


class Arcs(AbstractMethod):
    """Closed form for a steering that is followed at once, as in the plain VDM.

    The wheel then stands still between the rows, the path is an arc, and only the distance along it
    counts, which every powertrain knows exactly, kinks and jumps included. Effects of the vehicle
    are taken where they leave that so.
    """

    def __call__(self, vehicle: Vehicle, commands: Commands, start: Start) -> Trajectory:
        """The trajectory; arguments as in `simulate`.

        Raises:
            ValueError: the steering has dynamics, or an effect bends the arcs.
        """
        reason = no_arcs(vehicle)
        if reason is not None:
            raise ValueError(f"{reason}; use Quadrature()")
        responses = respond(vehicle, commands, start)
        v, beta, curvature = vehicle.over_ground(responses.v[:-1], responses.delta[:-1])
        if vehicle.acts_at("speed"):
            distance = v * commands.dt
        else:
            distance = (responses.powertrain.travelled() + responses.surplus * commands.dt)[:-1]
        half_turn = 0.5 * distance * curvature
        psi = accumulate(2.0 * half_turn, start.psi)
        chord = distance * _sinc(half_turn)
        course = psi[:-1] + beta + half_turn
        x = accumulate(chord * jnp.cos(course), start.x)
        y = accumulate(chord * jnp.sin(course), start.y)
        return trajectory(vehicle, commands, responses, x, y, psi)


def _sinc(q: Array) -> Array:
    """`sin(q) / q`, by its series near 0 where the quotient has no derivative."""
    small = jnp.abs(q) < 1e-2
    apart = jnp.where(small, 1.0, q)
    squared = jnp.where(small, q * q, 0.0)
    series = 1.0 - squared / 6.0 * (1.0 - squared / 20.0 * (1.0 - squared / 42.0))
    return jnp.where(small, series, jnp.sin(apart) / apart)
