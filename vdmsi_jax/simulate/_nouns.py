"""What goes into a simulation and what comes out of it."""

import abc
from typing import Any

import diffrax
import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from vdmsi_jax.models.commands import Commands
from vdmsi_jax.models.plant import AbstractTrace
from vdmsi_jax.models.vehicle import SpeedInput, Vehicle


class RESULTS(diffrax.RESULTS):  # type: ignore[misc]  # an enumeration of equinox is extended so
    """How a simulation ended; the member is the message."""

    nonfinite_trajectory = (
        "The trajectory is not finite: a command, a parameter or the start is not, or a plant is "
        "unstable and has overflowed. Check the poles and the commands."
    )


def _array_or_none(value: Any) -> Array | None:
    return None if value is None else jnp.asarray(value, float)


class Start(eqx.Module):
    """State of a vehicle at the first row.

    Attributes:
        x, y, psi: pose of the centre of gravity, m and rad.
        v: speed, m/s, for `SpeedInput.ACCELERATION`; `None` for that of the powertrain's response.
        powertrain: state of the powertrain at the first row; `None` for a start at rest under the
            first command. (Of `RateLimited` it is the speed; give it where a run starts rolling.)
        steering: likewise.
    """

    x: Float[Array, "*batch"] = eqx.field(converter=jnp.asarray, default=0.0)
    y: Float[Array, "*batch"] = eqx.field(converter=jnp.asarray, default=0.0)
    psi: Float[Array, "*batch"] = eqx.field(converter=jnp.asarray, default=0.0)
    v: Float[Array, "*batch"] | None = eqx.field(converter=_array_or_none, default=None)
    powertrain: Float[Array, "..."] | None = eqx.field(converter=_array_or_none, default=None)
    steering: Float[Array, "..."] | None = eqx.field(converter=_array_or_none, default=None)


class Trajectory(eqx.Module):
    """The motion of the centre of gravity at the rows, each with its own command already applied.

    Attributes:
        t: time, s.
        x, y: position, m.
        psi: heading of the body, rad, not wrapped.
        v: speed, m/s.
        delta: road-wheel angle, rad.
        r: yaw rate, rad/s.
        a: acceleration between the jumps of the speed, m/s².
        status: how the simulation ended; `RESULTS.successful`, or why the arrays are no motion.
    """

    t: Float[Array, "*batch N"]
    x: Float[Array, "*batch N"]
    y: Float[Array, "*batch N"]
    psi: Float[Array, "*batch N"]
    v: Float[Array, "*batch N"]
    delta: Float[Array, "*batch N"]
    r: Float[Array, "*batch N"]
    a: Float[Array, "*batch N"]
    status: Any

    @property
    def poses(self) -> Float[Array, "*batch N 3"]:
        """x, y and psi, as the metrics take them."""
        return jnp.stack([self.x, self.y, self.psi], axis=-1)

    @property
    def ok(self) -> Array:
        """Whether the simulation succeeded, elementwise in a batch."""
        return self.status == RESULTS.successful


class AbstractMethod(eqx.Module):
    """A way to integrate the bicycle's equations."""

    @abc.abstractmethod
    def __call__(self, vehicle: Vehicle, commands: Commands, start: Start) -> Trajectory:
        """The trajectory of one vehicle under one record of commands."""


class Responses(eqx.Module):
    """Both actuators' motion over a record, and the speed that the bicycle makes of it."""

    powertrain: AbstractTrace
    steering: AbstractTrace
    surplus: Float[Array, ""]  # of the vehicle's speed over the powertrain's response, m/s
    v: Float[Array, " N"]
    a: Float[Array, " N"]
    delta: Float[Array, " N"]


def respond(vehicle: Vehicle, commands: Commands, start: Start) -> Responses:
    """Run the actuators alone: where speed and angle depend on no pose they are known
    beforehand."""
    powertrain = vehicle.powertrain.trace(commands.v_cmd, commands.dt, start.powertrain)
    steering = vehicle.steering.trace(commands.delta_cmd, commands.dt, start.steering)
    speed, angle = powertrain.rows(), steering.rows()
    # the derivative and its jumps, integrated from v: the response, moved to start there
    surplus = jnp.zeros_like(speed.y[0])
    if start.v is not None and vehicle.speed_input is SpeedInput.ACCELERATION:
        surplus = start.v - speed.y[0]
    return Responses(powertrain, steering, surplus, speed.y + surplus, speed.dy, angle.y)


def trajectory(
    vehicle: Vehicle,
    commands: Commands,
    responses: Responses,
    x: Float[Array, " N"],
    y: Float[Array, " N"],
    psi: Float[Array, " N"],
) -> Trajectory:
    """Put a trajectory together from the actuators' responses and the integrated pose."""
    t = commands.t0 + commands.dt * jnp.arange(x.shape[0])
    v, delta = responses.v, responses.delta
    r = vehicle.bicycle.yaw_rate(v, delta)
    channels = (x, y, psi, v, delta, r, responses.a)
    return Trajectory(t, *channels, status=finite_or(RESULTS.successful, channels))


def finite_or(status: Any, channels: tuple[Array, ...]) -> Any:
    """`status`, or `RESULTS.nonfinite_trajectory` where that was a success and a channel is not
    finite."""
    finite = jnp.all(jnp.stack([jnp.all(jnp.isfinite(channel)) for channel in channels]))
    return RESULTS.where(
        (status == RESULTS.successful) & ~finite, RESULTS.nonfinite_trajectory, status
    )
