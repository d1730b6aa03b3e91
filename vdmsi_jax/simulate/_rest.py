"""A start at rest under commands that are noisy."""

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from vdmsi_jax.models.commands import Commands
from vdmsi_jax.models.extended_plant import ExtendedPlant
from vdmsi_jax.models.linear_plant import LinearPlant
from vdmsi_jax.models.plant import AbstractPlant
from vdmsi_jax.models.transfer_function import TransferFunction
from vdmsi_jax.models.vehicle import Vehicle
from vdmsi_jax.simulate._nouns import Start

_LONGEST = 1.0  # s, that a command is looked at
_FEWEST = 8  # samples that tell rest from motion
_TREND = 0.25  # of the variance, that a line may explain: of a ramp it is all, of a step up to 3/4
_CROSSINGS = 6  # of the mean, that scatter makes and no step, ramp or turn does


def resting_command(u: Float[np.ndarray, " N"], dt: float) -> float:
    """Under which a plant has rested before the first row: the mean of as many of the first samples
    as scatter about one value, else the first of them. What plays or sticks keeps what it begins
    with, and a single sample, where a controller makes it of what sensors see, is off by all of
    their noise.

    Args:
        u: commands at the rows.
        dt: sample period, s.
    """
    many = min(len(u), round(_LONGEST / dt))
    while many >= _FEWEST:
        if _rests(u[:many]):
            return float(np.mean(u[:many]))
        many //= 2
    return float(u[0])


def at_rest(
    vehicle: Vehicle, commands: Commands, *, x: float = 0.0, y: float = 0.0, psi: float = 0.0
) -> Start:
    """The start of a vehicle that stands, its actuators at rest under `resting_command`.

    Args:
        vehicle: plants that are no transfer functions have their own start at rest.
        commands: of one drive.
        x, y, psi: pose, m and rad.
    """

    def state(plant: AbstractPlant, u: Array) -> Array | None:
        linear = plant.plant if isinstance(plant, ExtendedPlant) else plant
        if not isinstance(linear, (TransferFunction, LinearPlant)):
            return None
        command = resting_command(np.asarray(u), float(commands.dt))
        duration = u.shape[0] * jnp.asarray(commands.dt)
        return linear.to_plant().initial_state(jnp.asarray(command), duration)

    powertrain = state(vehicle.powertrain, commands.v_cmd)
    steering = state(vehicle.steering, commands.delta_cmd)
    return Start(x, y, psi, powertrain=powertrain, steering=steering)


def _rests(u: Float[np.ndarray, " n"]) -> bool:
    """Whether samples scatter about one value, without a trend; those that are all the same have
    nothing to average."""
    t, off = np.arange(len(u)) - 0.5 * (len(u) - 1), u - np.mean(u)
    trend = float(t @ off) ** 2 / float(t @ t)
    crossings = np.count_nonzero(np.diff(off > 0.0))
    return bool(crossings >= _CROSSINGS and trend <= _TREND * float(off @ off))
