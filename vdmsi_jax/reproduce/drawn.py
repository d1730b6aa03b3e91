"""Vehicles drawn at random: actuators, and the causes that the plain models do not know."""

import dataclasses

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from vdmsi_jax.effects import AbstractEffect
from vdmsi_jax.effects.backlash import Backlash
from vdmsi_jax.effects.gain_nonlinearity import GainNonlinearity
from vdmsi_jax.effects.offset import Offset
from vdmsi_jax.effects.understeer import Understeer
from vdmsi_jax.models.bicycle import Bicycle
from vdmsi_jax.models.extended_plant import ExtendedPlant
from vdmsi_jax.models.transfer_function import TransferFunction
from vdmsi_jax.models.vehicle import SpeedInput, Vehicle

L_F, L_R = 1.75, 1.2  # m, the paper's table 1
SUBSTEPS = 1  # a sample, for the causes with memory
AT_ONCE = 1e3  # rad/s of the poles of an actuator that is all but followed at once


class Powertrain(eqx.Module):
    """From velocity command to speed: two poles and a delay.

    Attributes:
        gain: static, near 1.
        frequency: natural, rad/s.
        damping: of the pair of poles.
        delay: s.
    """

    gain: Float[Array, "*K"]
    frequency: Float[Array, "*K"]
    damping: Float[Array, "*K"]
    delay: Float[Array, "*K"]

    def plant(self) -> TransferFunction:
        """Of one vehicle."""
        square = self.frequency**2
        den = jnp.stack([jnp.ones_like(square), 2.0 * self.damping * self.frequency, square])
        return TransferFunction((self.gain * square)[None], den, delay=self.delay)


class Steering(eqx.Module):
    """From steering command to road-wheel angle: one pole and a delay, with causes in it.

    Attributes:
        gain: static.
        pole: rad/s, positive.
        delay: s.
        offset: of the angle, rad.
        cubic: of the gain's nonlinearity, 1/rad².
        gap: of the play, rad.
    """

    gain: Float[Array, "*K"]
    pole: Float[Array, "*K"]
    delay: Float[Array, "*K"]
    offset: Float[Array, "*K"]
    cubic: Float[Array, "*K"]
    gap: Float[Array, "*K"]

    def plant(self) -> ExtendedPlant:
        """Of one vehicle, with every cause, off where its parameter is zero."""
        den = jnp.stack([jnp.ones_like(self.pole), self.pole])
        linear = TransferFunction((self.gain * self.pole)[None], den, delay=self.delay)
        zero = jnp.zeros_like(self.pole)
        effects: tuple[AbstractEffect, ...] = (
            GainNonlinearity(zero, self.cubic),
            Backlash(self.gap),
            Offset(self.offset),
        )
        return ExtendedPlant(linear, effects, substeps=SUBSTEPS)

    def linear(self) -> TransferFunction:
        """Of one vehicle, without play and nonlinearity."""
        den = jnp.stack([jnp.ones_like(self.pole), self.pole])
        return TransferFunction(
            (self.gain * self.pole)[None], den, delay=self.delay, offset=self.offset
        )


class Drawn(eqx.Module):
    """Vehicles, `K` of them in the leading axis of every number.

    Attributes:
        powertrain, steering: the actuators.
        understeer: gradient, s²/m².
    """

    powertrain: Powertrain
    steering: Steering
    understeer: Float[Array, "*K"]

    def vehicle(self) -> Vehicle:
        """One vehicle, to be simulated; many under `jax.vmap`."""
        return Vehicle(
            Bicycle(L_F, L_R),
            self.powertrain.plant(),
            self.steering.plant(),
            SpeedInput.VELOCITY,
            (Understeer(self.understeer),),
        )

    @property
    def causes(self) -> Int[np.ndarray, " K"]:
        """How many causes each vehicle has that no transfer function can hold: nonlinearity, play,
        understeer."""
        parts = (self.steering.cubic, self.steering.gap, self.understeer)
        return np.sum([np.asarray(part) != 0.0 for part in parts], axis=0)

    def __getitem__(self, which) -> "Drawn":
        return jax.tree.map(lambda leaf: leaf[which], self)


@dataclasses.dataclass(frozen=True)
class Ranges:
    """Between which values vehicles are drawn, evenly; a cause is there with odds of `share`, and
    of either sign where it has one. The paper's table 2 lies within: its powertrain has 12 rad/s,
    a damping of 0.76 and a gain of 1.005, its steering a pole of 25 rad/s and a gain of 0.91.
    """

    powertrain_gain: tuple[float, float] = (0.98, 1.02)
    frequency: tuple[float, float] = (7.0, 15.0)  # rad/s
    damping: tuple[float, float] = (0.6, 1.0)
    powertrain_delay: tuple[float, float] = (0.0, 0.08)  # s
    steering_gain: tuple[float, float] = (0.85, 0.97)
    pole: tuple[float, float] = (6.0, 28.0)  # rad/s
    steering_delay: tuple[float, float] = (0.02, 0.12)  # s
    offset: tuple[float, float] = (0.003, 0.015)  # rad
    cubic: tuple[float, float] = (0.2, 0.6)  # 1/rad²
    gap: tuple[float, float] = (0.005, 0.03)  # rad
    understeer: tuple[float, float] = (0.0005, 0.003)  # s²/m²
    share: float = 0.3


def draw(count: int, *, seed: int, ranges: Ranges | None = None) -> Drawn:
    """Vehicles at random.

    Args:
        count: how many.
        seed: of the random numbers; the same seed gives the same vehicles.
        ranges: between which values.
    """
    of, rng = ranges or Ranges(), np.random.default_rng(seed)

    def evenly(between: tuple[float, float]) -> Array:
        return jnp.asarray(rng.uniform(*between, count))

    def cause(between: tuple[float, float], signed: bool) -> Array:
        sign = rng.choice([-1.0, 1.0], count) if signed else 1.0
        there = rng.uniform(size=count) < of.share
        return jnp.asarray(rng.uniform(*between, count) * sign * there)

    powertrain = Powertrain(
        gain=evenly(of.powertrain_gain),
        frequency=evenly(of.frequency),
        damping=evenly(of.damping),
        delay=evenly(of.powertrain_delay),
    )
    steering = Steering(
        gain=evenly(of.steering_gain),
        pole=evenly(of.pole),
        delay=evenly(of.steering_delay),
        offset=cause(of.offset, True),
        cubic=cause(of.cubic, True),
        gap=cause(of.gap, False),
    )
    return Drawn(powertrain, steering, cause(of.understeer, False))


PARTS = ("powertrain", "steering", "offset", "gain_nonlinearity", "backlash", "understeer")
"""What a vehicle has that VDM has not, for the error budget: the responses of both actuators (gain,
lag and delay), and the causes."""


def with_only(drawn: Drawn, on: Bool[Array, " parts"]) -> Drawn:
    """The vehicles with these of `PARTS` and without the others: an actuator that is left out is
    followed as good as at once (within 2 ms), and a cause that is left out is off."""
    powertrain, steering, offset, cubic, gap, understeer = on

    def keep(flag: Array, value: Array, otherwise: float) -> Array:
        return jnp.where(flag, value, otherwise)

    own, turn = drawn.powertrain, drawn.steering
    return Drawn(
        Powertrain(
            keep(powertrain, own.gain, 1.0),
            keep(powertrain, own.frequency, AT_ONCE),
            keep(powertrain, own.damping, 1.0),
            keep(powertrain, own.delay, 0.0),
        ),
        Steering(
            keep(steering, turn.gain, 1.0),
            keep(steering, turn.pole, AT_ONCE),
            keep(steering, turn.delay, 0.0),
            keep(offset, turn.offset, 0.0),
            keep(cubic, turn.cubic, 0.0),
            keep(gap, turn.gap, 0.0),
        ),
        keep(understeer, drawn.understeer, 0.0),
    )


def taken_at_word(count: int) -> Drawn:
    """VDM in the form of drawn vehicles: commands are followed as good as at once."""
    zero = jnp.zeros(count)
    one, fast = zero + 1.0, zero + AT_ONCE
    return Drawn(
        Powertrain(one, fast, one, zero), Steering(one, fast, zero, zero, zero, zero), zero
    )
