"""Drawn vehicles in a closed loop: pure pursuit on a track, with the pose of a sensor up to the
entrance of the bend and that of a model from there on."""

import math
from typing import NamedTuple

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jax import lax
from jaxtyping import Array, ArrayLike, Float, Int

from vdmsi_jax.control import PurePursuit
from vdmsi_jax.models.bicycle import Bicycle
from vdmsi_jax.reproduce.drawn import L_F, L_R, Drawn
from vdmsi_jax.scenarios import PAPER_DT, PAPER_SPEED, Track

RAMP = 1.0
"""Acceleration with which the speed command rises from rest, m/s²."""

_EVERY = 5  # samples between two looks of the controller: 20 a second
_HEARD = 32  # samples of commands that a delay may reach back


class Pursued(NamedTuple):
    """A drive in a closed loop.

    Attributes:
        delta_cmd: (N,) what the controller asked for, rad.
        truth: (N, 3) x, y (m), psi (rad) of the vehicle.
        believed: (N, 3) the pose that the controller was given.
    """

    delta_cmd: Float[Array, "*K N"]
    truth: Float[Array, "*K N 3"]
    believed: Float[Array, "*K N 3"]


def path_of(track: Track, points: int) -> Float[np.ndarray, "points 2"]:
    """So many points along a track, m."""
    return track.at(np.linspace(0.0, track.length, points))[:, :2]


def duration(track: Track) -> int:
    """Samples for the whole track from rest."""
    return math.ceil(track.length / PAPER_SPEED + 0.5 * PAPER_SPEED / RAMP) * round(1.0 / PAPER_DT)


def speed_command(rows: int) -> Float[np.ndarray, " rows"]:
    """From rest to the paper's 15 km/h, m/s, every 10 ms."""
    return np.minimum(RAMP * PAPER_DT * np.arange(rows), PAPER_SPEED)


def reached(distance: float) -> int:
    """Row at which the speed command has gone so far, m, beyond its ramp."""
    return round((distance / PAPER_SPEED + 0.5 * PAPER_SPEED / RAMP) / PAPER_DT)


def pursue(
    drawn: Drawn,
    model: Drawn,
    path: Float[Array, "M 2"],
    v_cmd: Float[Array, " N"],
    cut: Int[ArrayLike, ""],
) -> Pursued:
    """Drive one vehicle along a path.

    Args:
        drawn: the vehicle.
        model: what gives the pose from the row `cut` on, from the true pose there;
            `drawn.taken_at_word` for VDM.
        path: of the centre of gravity, from the origin along x, m.
        v_cmd: speed commands every 10 ms, m/s, a multiple of five.
        cut: row from which the sensor is gone; the number of rows for a sensor that stays.
    """
    controller = PurePursuit(path, L_F + L_R, L_R)
    speeds = jnp.stack([_speed(drawn, v_cmd), _speed(model, v_cmd)])

    def look(carry: tuple, row: tuple) -> tuple[tuple, tuple]:
        pose, own, heard = carry
        k, v = row
        own = _Moving(jnp.where(k < cut, pose.pose, own.pose), own.lag, own.play)
        command = controller(own.pose, v[0, 1])

        def move(carry: tuple, v: Array) -> tuple[tuple, tuple]:
            truth, own, heard = carry
            told = (truth.pose, own.pose)
            heard = jnp.append(heard[1:], command)
            truth = _moved(drawn, truth, heard, v[0])
            return (truth, _moved(model, own, heard, v[1]), heard), told

        carry, told = lax.scan(move, (pose, own, heard), v)
        return carry, (jnp.full(_EVERY, command), *told)

    still = _Moving(jnp.zeros(3), jnp.zeros(()), jnp.zeros(()))
    looks = (jnp.arange(0, v_cmd.shape[0], _EVERY), speeds.T.reshape(-1, _EVERY, 2))
    _, told = lax.scan(look, (still, still, jnp.zeros(_HEARD)), looks)
    command, truth, believed = told
    return Pursued(command.reshape(-1), truth.reshape(-1, 3), believed.reshape(-1, 3))


class _Moving(eqx.Module):
    """A vehicle between two samples: its pose, and the states of its steering."""

    pose: Float[Array, "3"]
    lag: Float[Array, ""]
    play: Float[Array, ""]


def _speed(drawn: Drawn, v_cmd: Array) -> Array:
    return drawn.powertrain.plant().simulate(v_cmd, PAPER_DT).y


def _moved(drawn: Drawn, was: _Moving, heard: Array, v: Array) -> _Moving:
    """One sample on, the pose by the rule of the midpoint. The ways of `ExtendedPlant`, one sample
    at a time: there is no other when the next command depends on the pose."""
    steering = drawn.steering
    bent = heard + steering.cubic * heard**3
    late = jnp.interp(_HEARD - 1 - steering.delay / PAPER_DT, jnp.arange(_HEARD), bent)
    keep = jnp.exp(-steering.pole * PAPER_DT)
    lag = keep * was.lag + (1.0 - keep) * steering.gain * late
    half = 0.5 * steering.gap
    play = jnp.clip(was.play, lag - half, lag + half)
    angle = 0.5 * (was.play + play) + steering.offset
    cosine, sine, curvature = Bicycle(L_F, L_R).course(angle)
    curvature = curvature / (1.0 + drawn.understeer * v * v)
    return _Moving(_turned(was.pose, v, cosine, sine, curvature), lag, play)


def _turned(pose: Array, v: Array, cosine: Array, sine: Array, curvature: Array) -> Array:
    way = v * PAPER_DT
    psi = pose[2] + 0.5 * way * curvature
    ahead, aside = jnp.cos(psi), jnp.sin(psi)
    dx, dy = ahead * cosine - aside * sine, aside * cosine + ahead * sine
    return pose + way * jnp.stack([dx, dy, curvature])
