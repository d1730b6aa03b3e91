"""Fusion of a vehicle model with a pose sensor that comes and goes: an extended Kalman filter.

The model predicts from the commands alone, the sensor corrects. What the model gets wrong is told
to the filter by the residual of its identification: each actuator's response is off by a
first-order Gauss-Markov process (Jazwinski, Stochastic Processes and Filtering Theory, 1970, sec.
3.8) of the residual's size and memory, which is estimated on the way. An error that lasts makes a
position drift as white noise never would, so without this memory a filter is sure of itself where
it should not be.
"""

from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax import lax
from jaxtyping import Array, ArrayLike, Bool, Float

from vdmsi_jax.data.record import Record
from vdmsi_jax.model_file import Model
from vdmsi_jax.models.commands import Commands
from vdmsi_jax.models.linear_plant import LinearPlant, delayed
from vdmsi_jax.models.plant import AbstractPlant
from vdmsi_jax.models.vehicle import Vehicle
from vdmsi_jax.simulate import as_commands, as_vehicle

POSE = 3  # x, y, psi come first in the state; then the errors of speed and angle; then the plants
_ERRORS = 2
_SPAN = 3.0  # s of lags of the autocovariance that are looked at
_TIMES = (0.02, 20.0)  # s, between which a time constant is sought


class GaussMarkov(eqx.Module):
    """A stationary random process with the covariance `std² exp(-|lag| / time_constant)`.

    Attributes:
        std: standard deviation, unit of the response.
        time_constant: of its memory, s.
    """

    std: Float[Array, "*batch"] = eqx.field(converter=lambda x: jnp.asarray(x, float))
    time_constant: Float[Array, "*batch"] = eqx.field(converter=lambda x: jnp.asarray(x, float))

    @staticmethod
    def of_residual(residual: Float[ArrayLike, " N"], dt: float) -> tuple["GaussMarkov", float]:
        """The error of a model from its residual, measured response less simulated one.

        The residual is such a process and the sensor's white noise on top. Its autocovariance is
        fitted by least squares from the first lag on, where the white part is gone; a mean is not
        taken out, since an error that never changes is one too.

        Args:
            residual: of a log without gaps, at best one that no fit has seen; NaN where nothing
                was measured, as `Fit.residual` has it.
            dt: sample period, s.

        Returns:
            The process, and the standard deviation of the white part.

        Raises:
            ValueError: less than four values are known, or one is infinite.
        """
        e = np.asarray(residual, float)
        known = ~np.isnan(e)
        if known.sum() < 4 or np.isinf(e).any():
            raise ValueError("a residual needs four known values or more, all of them finite")
        e = np.where(known, e, 0.0)
        lags = np.arange(1, min(round(_SPAN / dt), e.size // 3) + 1)
        pairs = np.array([np.sum(known[k:] & known[:-k]) for k in lags])
        products = np.array([e[k:] @ e[:-k] for k in lags])
        covariance = products / np.maximum(pairs, 1) * (e.size - lags) / e.size
        times = np.geomspace(*_TIMES, 60)
        shapes = np.exp(-lags * dt / times[:, None])
        sizes = np.maximum(shapes @ covariance / np.sum(shapes**2, axis=1), 0.0)
        misfit = np.sum((covariance - sizes[:, None] * shapes) ** 2, axis=1)
        best = int(np.argmin(misfit))
        white = max(float(e @ e) / known.sum() - sizes[best], 0.0)
        return GaussMarkov(np.sqrt(sizes[best]), times[best]), float(np.sqrt(white))


def _process(given: Any) -> GaussMarkov:
    if isinstance(given, tuple):
        problem = "a tuple is no process, and fuse asks for its std and time_constant"
        raise TypeError(f"{problem}; give the process alone, of_residual(...)[0]")
    return given


class ModelError(eqx.Module):
    """What a vehicle model gets wrong in the responses of its two actuators.

    Attributes:
        speed: of the powertrain's response, m/s.
        angle: of the steering's response, rad.

    Raises:
        TypeError: all that `GaussMarkov.of_residual` returns was given for a process.
    """

    speed: GaussMarkov = eqx.field(converter=_process)
    angle: GaussMarkov = eqx.field(converter=_process)


class PoseSensor(eqx.Module):
    """A sensor of x, y and psi with white noise.

    Attributes:
        position_std: of x and of y, m.
        heading_std: of psi, rad.
    """

    position_std: Float[Array, ""] = eqx.field(converter=lambda x: jnp.asarray(x, float))
    heading_std: Float[Array, ""] = eqx.field(converter=lambda x: jnp.asarray(x, float))

    @property
    def covariance(self) -> Float[Array, "3 3"]:
        """Of one measurement, m² and rad²."""
        std = jnp.stack([self.position_std, self.position_std, self.heading_std])
        return jnp.diag(std**2)


class Fused(NamedTuple):
    """What a filter knew at each row, from the rows up to it.

    Attributes:
        poses: (N, 3) x, y (m), psi (rad).
        covariance: (N, 3, 3) of the poses.
        errors: (N, 2) by how much the responses of powertrain (m/s) and steering (rad) are thought
            to be off.
    """

    poses: Float[Array, "N 3"]
    covariance: Float[Array, "N 3 3"]
    errors: Float[Array, "N 2"]

    def nees(self, truth: Float[ArrayLike, "N 3"]) -> Float[Array, " N"]:
        """Normalised estimation error squared of the poses: of a consistent filter chi-square
        distributed with 3 degrees of freedom (Bar-Shalom, Li and Kirubarajan, Estimation with
        Applications to Tracking and Navigation, 2001, sec. 5.4)."""
        error = jnp.asarray(truth, float) - self.poses
        error = error.at[:, 2].set(_wrapped(error[:, 2]))
        solved = jnp.linalg.solve(self.covariance, error[..., None])[..., 0]
        return jnp.sum(error * solved, axis=-1)


def fuse(
    vehicle: Vehicle | Model,
    commands: Commands | Record,
    measured: Float[ArrayLike, "N 3"],
    seen: Bool[ArrayLike, " N"],
    *,
    error: ModelError,
    sensor: PoseSensor,
) -> Fused:
    """Estimate the pose of a vehicle from its commands and a pose sensor that is not always there.

    The filter starts at the first row from its measurement, the actuators at rest under their first
    commands, and goes on through rows that were not seen with nothing but the commands. It runs
    under `jax.vmap` over drives.

    Args:
        vehicle: VDM or VDM-SI; effects of body and road are taken, but not their memory. The
            bicycle takes the powertrain's response as its speed, whatever `speed_input` says.
            A model is the vehicle that it describes.
        commands: held between the rows; a record without gaps gives its own.
        measured: x, y (m) and psi (rad, wrapped or not) at the rows; the numbers of rows that were
            not seen are not read.
        seen: which rows the sensor saw. The first must be one.
        error: what the model gets wrong.
        sensor: the sensor's noise.

    Raises:
        ValueError: an actuator is not linear, or an effect remembers the way.
        RuntimeError: the first row was not seen.
        TypeError, InputError: of vehicle and commands, as in `simulate`.
    """
    vehicle, commands = as_vehicle(vehicle), as_commands(commands)
    return _fuse(vehicle, commands, measured, seen, error, sensor)


@eqx.filter_jit
def _fuse(
    vehicle: Vehicle,
    commands: Commands,
    measured: Float[ArrayLike, "N 3"],
    seen: Bool[ArrayLike, " N"],
    error: ModelError,
    sensor: PoseSensor,
) -> Fused:
    if vehicle.acts_at("relaxed"):
        raise ValueError("a filter takes no effect that remembers the way; leave it out")
    measured, seen = jnp.asarray(measured, float), jnp.asarray(seen, bool)
    measured = eqx.error_if(measured, ~seen[0], "the sensor has to see the first row: begin there")
    measured = jnp.where(seen[:, None], measured, 0.0)
    dt, span = commands.dt, commands.v_cmd.shape[0] * commands.dt
    plants = [_linear(vehicle.powertrain, "powertrain"), _linear(vehicle.steering, "steering")]
    inputs = [
        _held(plant, u, dt)
        for plant, u in zip(plants, (commands.v_cmd, commands.delta_cmd), strict=True)
    ]
    processes = (error.speed, error.angle)
    keeps = jnp.stack([jnp.exp(-dt / process.time_constant) for process in processes])
    variances = jnp.stack([process.std for process in processes]) ** 2
    states = [
        plant.initial_state(u[0], span)
        for plant, u in zip(plants, (commands.v_cmd, commands.delta_cmd), strict=True)
    ]
    mean = jnp.concatenate([measured[0], jnp.zeros(_ERRORS), *states])
    none = jnp.zeros((mean.shape[0],) * 2)
    P = none.at[:POSE, :POSE].set(sensor.covariance)
    P = P.at[POSE : POSE + _ERRORS, POSE : POSE + _ERRORS].set(jnp.diag(variances))
    at = jnp.arange(POSE, POSE + _ERRORS)
    Q = none.at[at, at].set(variances * (1.0 - keeps**2))
    first = plants[0].rest.shape[0]

    def moved(mean: Array, held: tuple) -> Array:
        pose, errors = mean[:POSE], mean[POSE : POSE + _ERRORS]
        own = (mean[POSE + _ERRORS :][:first], mean[POSE + _ERRORS + first :])
        later, means = [], []
        for plant, x, u, off in zip(plants, own, held, errors, strict=True):
            then, level = _advanced(plant, x, u, dt)
            later.append(then)
            means.append(level + off)
        v, beta, curvature = vehicle.over_ground(*means)
        half = 0.5 * dt * v * curvature
        course = pose[2] + half + beta
        gone = jnp.stack([dt * v * jnp.cos(course), dt * v * jnp.sin(course), 2.0 * half])
        return jnp.concatenate([pose + gone, keeps * errors, *later])

    def step(carry: tuple[Array, Array], row: tuple) -> tuple[tuple[Array, Array], Fused]:
        mean, P = carry
        z, counts, held = row
        innovation = z - mean[:POSE]
        innovation = innovation.at[2].set(_wrapped(innovation[2]))
        R = sensor.covariance
        gain = jnp.linalg.solve(P[:POSE, :POSE] + R, P[:POSE]).T * counts
        mean = mean + gain @ innovation
        # Joseph's form, which stays symmetric and positive
        keep = jnp.eye(mean.shape[0]).at[:, :POSE].add(-gain)
        P = keep @ P @ keep.T + gain @ R @ gain.T
        told = Fused(mean[:POSE], P[:POSE, :POSE], mean[POSE : POSE + _ERRORS])
        F = jax.jacfwd(moved)(mean, held)
        return (moved(mean, held), F @ P @ F.T + Q), told

    corrects = seen.at[0].set(False)  # the start has taken it
    return lax.scan(step, (mean, P), (measured, corrects, tuple(inputs)))[1]


def _linear(plant: AbstractPlant, name: str) -> LinearPlant:
    try:
        return plant.to_plant()
    except ValueError as why:
        mend = "give a transfer function, or None for a command that is followed at once"
        raise ValueError(f"the {name} is not linear, and a filter needs that; {mend}") from why


class _Input(NamedTuple):
    """What acts on a plant in each sample: a command, and the one that the delay lets in for the
    last `rest` seconds of it."""

    early: Array
    late: Array
    rest: Array


def _held(plant: LinearPlant, u: Array, dt: Array) -> _Input:
    early, late, rest = delayed(u, jnp.zeros(()) if plant.delay is None else plant.delay, dt)
    return _Input(early, late, jnp.full(u.shape, rest))


def _advanced(plant: LinearPlant, x: Array, u: _Input, dt: Array) -> tuple[Array, Array]:
    """The state one sample later and the mean response on the way, by the trapezoidal rule in each
    part of the sample."""
    system, total = plant.system, jnp.zeros(())
    parts = ((dt, u.early),)
    if plant.delay is not None:
        parts = ((dt - u.rest, u.early), (u.rest, u.late))
    for span, command in parts:
        Ad, Bd = system.discretise(span)
        then = Ad @ x + Bd * command
        total = total + span * (0.5 * system.C @ (x + then) + system.D * command)
        x = then
    return x, plant.shift(total / dt)


def _wrapped(angle: Float[Array, "*n"]) -> Float[Array, "*n"]:
    return jnp.arctan2(jnp.sin(angle), jnp.cos(angle))
