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


class Arcs(AbstractMethod):
    """Closed form for a steering that is followed at once, as in the plain VDM.

    The wheel then stands still between the rows, the path is an arc, and only the distance along it
    counts, which every powertrain knows exactly, kinks and jumps included.
    """

    def __call__(self, vehicle: Vehicle, commands: Commands, start: Start) -> Trajectory:
        """The trajectory; arguments as in `simulate`.

        Raises:
            ValueError: the steering has dynamics.
        """
        if not isinstance(vehicle.steering, FollowedAtOnce):
            raise ValueError("Arcs needs a steering that is FollowedAtOnce; use Quadrature()")
        responses = respond(vehicle, commands, start)
        distance = (responses.powertrain.travelled() + responses.surplus * commands.dt)[:-1]
        delta = responses.delta[:-1]
        half_turn = 0.5 * distance * vehicle.bicycle.course(delta)[2]
        psi = accumulate(2.0 * half_turn, start.psi)
        chord = distance * _sinc(half_turn)
        course = psi[:-1] + vehicle.bicycle.slip_angle(delta) + half_turn
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
