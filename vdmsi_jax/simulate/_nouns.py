"""What goes into a simulation and what comes out of it."""

import abc
from typing import Any

import diffrax
import equinox as eqx
import jax
import jax.numpy as jnp
from jax.core import Tracer
from jaxtyping import Array, Float

from vdmsi_jax.models.commands import Commands
from vdmsi_jax.models.extended_plant import ExtendedPlant, surroundings
from vdmsi_jax.models.plant import AbstractPlant, AbstractTrace
from vdmsi_jax.models.vehicle import SpeedInput, Vehicle
from vdmsi_jax.parameters import floats


class RESULTS(diffrax.RESULTS):  # type: ignore[misc]  # an enumeration of equinox is extended so
    """How a simulation ended; the member is the message."""

    nonfinite_trajectory = (
        "The trajectory is not finite: a command, a parameter or the start is not, or a plant is "
        "unstable and has overflowed. Check the poles and the commands."
    )


def _array_or_none(value: Any) -> Array | None:
    return None if value is None else floats(value)


class Start(eqx.Module):
    """State of a vehicle at the first row.

    Attributes:
        x, y, psi: pose of the vehicle's point, m and rad: of its centre of gravity, or of the
            logged reference point where `Model.to_vehicle` made it.
        v: speed, m/s, for `SpeedInput.ACCELERATION`; `None` for that of the powertrain's response.
        powertrain: state of the powertrain at the first row; `None` for a start at rest under the
            first command. (Of `RateLimited` it is the speed; give it where a run starts rolling.)
        steering: likewise.
    """

    x: Float[Array, "*batch"] = eqx.field(converter=floats, default=0.0)
    y: Float[Array, "*batch"] = eqx.field(converter=floats, default=0.0)
    psi: Float[Array, "*batch"] = eqx.field(converter=floats, default=0.0)
    v: Float[Array, "*batch"] | None = eqx.field(converter=_array_or_none, default=None)
    powertrain: Float[Array, "..."] | None = eqx.field(converter=_array_or_none, default=None)
    steering: Float[Array, "..."] | None = eqx.field(converter=_array_or_none, default=None)


class Trajectory(eqx.Module):
    """The motion of the point whose pose `Start` has, at the rows, each with its own command
    already applied.

    Attributes:
        t: time, s.
        x, y: position, m.
        psi: heading of the body, rad, not wrapped.
        v: speed, m/s, the response of the powertrain; what effects of the vehicle make of it shows
            in the pose.
        delta: road-wheel angle, rad, the response of the steering, likewise.
        r: yaw rate, rad/s.
        a: acceleration between the jumps of the speed, m/s².
        status: how the simulation ended; `RESULTS.successful`, whose message is empty, or why the
            arrays are no motion. `ok` asks for it, and `print` tells it.
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

    def __repr__(self) -> str:
        if any(not eqx.is_array(x) or isinstance(x, Tracer) for x in jax.tree.leaves(self)):
            return eqx.tree_pformat(self)
        if self.ok.ndim:
            ended = f"{int(self.ok.sum())} of {self.ok.size} successful"
        else:
            ended = "successful" if self.ok else str(RESULTS[self.status])
        return f"<Trajectory of {self.x.shape[-1]} rows: {ended}>"

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
    beforehand. The powertrain hears its own command as the speed, the steering that speed which
    came of it."""

    def run(plant: AbstractPlant, u: Array, v: Array, other: Array, x0: Array | None):
        if isinstance(plant, ExtendedPlant):
            known = (commands.since, commands.session, commands.way)
            plant = plant.hearing(surroundings(v, other, commands.dt, *known))
        return plant.trace(u, commands.dt, x0)

    v_cmd, delta_cmd = commands.v_cmd, commands.delta_cmd
    powertrain = run(vehicle.powertrain, v_cmd, v_cmd, delta_cmd, start.powertrain)
    speed = powertrain.rows()
    # the derivative and its jumps, integrated from v: the response, moved to start there
    surplus = jnp.zeros_like(speed.y[0])
    if start.v is not None and vehicle.speed_input is SpeedInput.ACCELERATION:
        surplus = start.v - speed.y[0]
    v = speed.y + surplus
    steering = run(vehicle.steering, delta_cmd, v, v_cmd, start.steering)
    angle = steering.rows()
    return Responses(powertrain, steering, surplus, v, speed.dy, angle.y)


def trajectory(
    vehicle: Vehicle,
    commands: Commands,
    responses: Responses,
    x: Float[Array, " N"],
    y: Float[Array, " N"],
    psi: Float[Array, " N"],
    r: Float[Array, " N"] | None = None,
) -> Trajectory:
    """Put a trajectory together from the actuators' responses and the integrated pose; without a
    yaw rate it follows from these responses."""
    t = commands.t0 + commands.dt * jnp.arange(x.shape[0])
    v, delta = responses.v, responses.delta
    r = yaw_rate(vehicle, v, delta) if r is None else r
    channels = (x, y, psi, v, delta, r, responses.a)
    return Trajectory(t, *channels, status=finite_or(RESULTS.successful, channels))


def yaw_rate(
    vehicle: Vehicle, v: Float[Array, "*n"], delta: Float[Array, "*n"]
) -> Float[Array, "*n"]:
    """Rate of the heading, rad/s, at responses of the actuators, of a vehicle without memory."""
    if not vehicle.effects:
        return vehicle.bicycle.yaw_rate(v, delta)
    speed, _, curvature = vehicle.over_ground(v, delta)
    return speed * curvature


def finite_or(status: Any, channels: tuple[Array, ...]) -> Any:
    """`status`, or `RESULTS.nonfinite_trajectory` where that was a success and a channel is not
    finite."""
    finite = jnp.all(jnp.stack([jnp.all(jnp.isfinite(channel)) for channel in channels]))
    return RESULTS.where(
        (status == RESULTS.successful) & ~finite, RESULTS.nonfinite_trajectory, status
    )
