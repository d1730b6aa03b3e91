"""The vehicle: a bicycle whose speed and steering angle are the responses of two actuators, and
what body and road add to it."""

import dataclasses
import enum
from collections.abc import Sequence

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, ArrayLike, Float

from vdmsi_jax.effects.base import BODY, AbstractEffect, several
from vdmsi_jax.models.bicycle import Bicycle
from vdmsi_jax.models.following import FollowedAtOnce
from vdmsi_jax.models.linear_plant import LinearPlant
from vdmsi_jax.models.plant import AbstractPlant
from vdmsi_jax.shown import shown


class SpeedInput(enum.Enum):
    """What the bicycle takes from the powertrain's velocity response."""

    ACCELERATION = "its derivative, integrated from the speed at the start (eq. 6)"
    VELOCITY = "the response itself; a speed at the start plays no part"


def _plant(plant: AbstractPlant | None) -> AbstractPlant:
    return FollowedAtOnce() if plant is None else plant


class Vehicle(eqx.Module):
    """Commands in, motion out: VDM where the actuators follow at once, VDM-SI where they are
    identified, and the extended model where actuators, body or road have causes in them.

    A pytree: differentiate it, batch it, exchange its parts with `eqx.tree_at` (an actuator by
    None, too). VDM and VDM-SI are the same class, so that comparing them is simulating twice.

    Attributes:
        bicycle: geometry.
        powertrain: from velocity command to speed, m/s; `None` follows at once.
        steering: from steering command to road-wheel angle, rad; `None` follows at once.
        speed_input: what the bicycle takes from the powertrain. The derivative is the exact one,
            C(Ax + Bu) and the jumps of a feed-through, so that the two choices differ by nothing
            but the speed at the start.
        effects: of body and road, one or several, in the order in which they act, that of
            `vdmsi_jax.effects.VEHICLE`. They stand between the actuators' responses, which stay
            what speed and angle sensors see, and the motion.
    """

    bicycle: Bicycle
    powertrain: AbstractPlant = eqx.field(converter=_plant, default=None)
    steering: AbstractPlant = eqx.field(converter=_plant, default=None)
    speed_input: SpeedInput = eqx.field(static=True, default=SpeedInput.ACCELERATION)
    effects: tuple[AbstractEffect, ...] = eqx.field(converter=several, default=())

    def __repr__(self) -> str:
        return shown(self)

    def __check_init__(self):
        for effect in self.effects:
            if effect.ports.isdisjoint(BODY):
                problem = f"{type(effect).__name__} acts on no vehicle"
                raise ValueError(f"{problem}; give it to the ExtendedPlant of an actuator")

    def acts_at(self, *ports: str) -> bool:
        """Whether an effect acts at one of the ports."""
        return any(not effect.ports.isdisjoint(ports) for effect in self.effects)

    def over_ground(
        self, v: Float[Array, "*n"], delta: Float[Array, "*n"]
    ) -> tuple[Float[Array, "*n"], Float[Array, "*n"], Float[Array, "*n"]]:
        """Speed, angle from the heading to the course, and curvature of the path, at responses `v`
        (m/s) and `delta` (rad) of the actuators; the memory of the way (`relaxed`) left out."""
        shape, v, delta = v.shape, v.reshape(-1), delta.reshape(-1)
        for effect in self.effects:
            v, delta = effect.speed(v), effect.angle(delta)
        beta, kappa = self.bicycle.slip_angle(delta), self.bicycle.course(delta)[2]
        for effect in self.effects:
            beta, kappa = effect.course(beta), effect.curvature(kappa, v)
        return v.reshape(shape), beta.reshape(shape), kappa.reshape(shape)

    def relaxed(
        self, kappa: Float[Array, " M"], v: Float[Array, " M"], h: Float[ArrayLike, "..."]
    ) -> Float[Array, " M"]:
        """The curvature of `over_ground` with its memory of the way, at instants in the order of
        time, each `h` seconds after the one before."""
        for effect in self.effects:
            kappa = effect.relaxed(kappa, v, h)
        return kappa


def stack_vehicles(vehicles: Sequence[Vehicle]) -> Vehicle:
    """One batched vehicle out of many, whatever the orders of their plants.

    Linear plants are realised at the greatest order among them, and a missing delay or offset
    becomes zero where another vehicle has one; neither changes a response. Plants with effects are
    stacked as they are, which takes vehicles of one kind: of several hypotheses each has the
    effects of all, those not wanted off (`Backlash()`). The result goes to `simulate_many` or under
    `jax.vmap`.

    Raises:
        ValueError: there is none, `speed_input` or the kinds of effects differ, or a plant with
            effects stands beside one of another kind.
    """
    vehicles = [dataclasses.replace(vehicle) for vehicle in vehicles]  # None follows at once
    if len({vehicle.speed_input for vehicle in vehicles}) != 1:
        raise ValueError("give at least one vehicle, all with the same speed_input")
    if len({jax.tree.structure(vehicle.effects) for vehicle in vehicles}) != 1:
        raise ValueError("give vehicles with the same kinds of effects, those not wanted off")
    powertrains = _of_one_kind([vehicle.powertrain for vehicle in vehicles])
    steerings = _of_one_kind([vehicle.steering for vehicle in vehicles])
    parts = [
        Vehicle(vehicle.bicycle, powertrain, steering, vehicle.speed_input, vehicle.effects)
        for vehicle, powertrain, steering in zip(vehicles, powertrains, steerings, strict=True)
    ]
    return jax.tree.map(lambda *leaves: jnp.stack(leaves), *parts)


def _of_one_kind(plants: Sequence[AbstractPlant]) -> Sequence[AbstractPlant]:
    try:
        return _at_common_order(plants)
    except ValueError as why:
        shapes = {str(jax.tree.map(jnp.shape, plant)) for plant in plants}
        if len({jax.tree.structure(plant) for plant in plants}) == len(shapes) == 1:
            return plants
        problem = "a plant with effects stands beside one with others, or of another order"
        mend = (
            "give plants of one kind: an ExtendedPlant in each, their orders alike, and all "
            "effects in each, those not wanted off, as Backlash() is"
        )
        raise ValueError(f"{problem}; {mend}") from why


def _at_common_order(plants: Sequence[AbstractPlant]) -> list[LinearPlant]:
    order = max(plant.to_plant().rest.shape[0] for plant in plants)
    linear = [plant.to_plant(order) for plant in plants]
    for name in ("delay", "offset"):
        if any(getattr(plant, name) is not None for plant in linear):
            linear = [_with_zero(plant, name) for plant in linear]
    return linear


def _with_zero(plant: LinearPlant, name: str) -> LinearPlant:
    if getattr(plant, name) is not None:
        return plant
    zero = jnp.zeros_like(plant.slowest)
    return eqx.tree_at(lambda p: getattr(p, name), plant, zero, is_leaf=lambda leaf: leaf is None)
