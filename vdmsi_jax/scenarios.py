"""Commands to excite actuators with, and the paper's test tracks.

Signals are NumPy arrays of one channel; what returns `Commands` drives a vehicle. Random ones take
a seed, so that a scenario is the same wherever it is made.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from vdmsi_jax.models.bicycle import Bicycle
from vdmsi_jax.models.commands import Commands

PAPER_DT = 0.01  # s, figure 3
PAPER_DURATION = 30.0  # s, figure 3
PAPER_SPEED = 15.0 / 3.6  # m/s, section 5.2

# Maximal-length feedback taps of a Fibonacci shift register, by its number of bits.
_PRBS_TAPS = {5: (5, 3), 6: (6, 5), 7: (7, 6), 9: (9, 5), 10: (10, 7), 11: (11, 9), 15: (15, 14)}


def held_levels(
    levels: Sequence[float], *, dwell: float, duration: float, dt: float
) -> Float[np.ndarray, " N"]:
    """Multi-step: each level for `dwell` seconds, over and over, for `duration` seconds (both ends
    included)."""
    t = _times(duration, dt)
    which = np.floor(t / dwell + 1e-9).astype(int) % len(levels)
    return np.asarray(levels, float)[which]


def random_steps(
    levels: Sequence[float],
    *,
    dwell: tuple[float, float],
    duration: float,
    dt: float,
    seed: int,
) -> Float[np.ndarray, " N"]:
    """Steps between `levels`, never to the same one, each held for a random time in `dwell` s."""
    rng = np.random.default_rng(seed)
    t = _times(duration, dt)
    signal = np.empty_like(t)
    level, begin = 0, 0
    while begin < t.size:
        end = begin + max(1, round(rng.uniform(*dwell) / dt))
        signal[begin:end] = levels[level]
        level = (level + int(rng.integers(1, len(levels)))) % len(levels)
        begin = end
    return signal


def prbs(*, bits: int, clock: int, amplitude: float) -> Float[np.ndarray, " N"]:
    """One period of a maximal-length pseudo-random binary sequence, `±amplitude`.

    Args:
        bits: length of the shift register; the period is `(2**bits - 1) * clock` samples.
        clock: samples for which each value is held.

    Raises:
        ValueError: no feedback taps are known for `bits`.
    """
    if bits not in _PRBS_TAPS:
        raise ValueError(f"no PRBS of {bits} bits; give one of {sorted(_PRBS_TAPS)}")
    taps = [tap - 1 for tap in _PRBS_TAPS[bits]]
    register = [1] * bits
    values = np.empty(2**bits - 1)
    for k in range(values.size):
        values[k] = 2.0 * register[-1] - 1.0
        register = [register[taps[0]] ^ register[taps[1]], *register[:-1]]
    return amplitude * np.repeat(values, clock)


def chirp(
    *, low: float, high: float, amplitude: float, duration: float, dt: float
) -> Float[np.ndarray, " N"]:
    """Sine whose frequency rises from `low` to `high` (Hz) evenly on a logarithmic scale."""
    t = _times(duration, dt)
    growth = math.log(high / low) / duration
    return amplitude * np.sin(2.0 * math.pi * low * np.expm1(growth * t) / growth)


def paper_powertrain_steps(seed: int = 0) -> Commands:
    """Figure 3a: 30 s of velocity steps of 1 m/s at 100 Hz, the steering straight.

    The figure gives amplitude, length and rate, but no times of the steps: they are random here.
    """
    v = random_steps([0.0, 1.0], dwell=(1.0, 3.0), duration=PAPER_DURATION, dt=PAPER_DT, seed=seed)
    return Commands(v, np.zeros_like(v), PAPER_DT)


def paper_steering_steps(seed: int = 0) -> Commands:
    """Figure 3b: 30 s of steering steps of 0.52 rad at 100 Hz, the speed held at 1 m/s."""
    levels = [0.0, 0.52, -0.52]
    delta = random_steps(levels, dwell=(1.0, 3.0), duration=PAPER_DURATION, dt=PAPER_DT, seed=seed)
    return Commands(np.ones_like(delta), delta, PAPER_DT)


@dataclass(frozen=True)
class Track:
    """A designed path of the centre of gravity: straights and arcs, from the origin along x.

    Attributes:
        lengths: of the parts, m.
        curvatures: of the parts, 1/m, positive to the left.
    """

    lengths: tuple[float, ...]
    curvatures: tuple[float, ...]

    @property
    def length(self) -> float:
        """Of the whole, m."""
        return math.fsum(self.lengths)

    def curvature(self, s: Float[np.ndarray, " N"]) -> Float[np.ndarray, " N"]:
        """At the distances `s` (m); that of the last part beyond the end."""
        return np.asarray(self.curvatures)[self._part(s)]

    def at(self, s: Float[np.ndarray, " N"]) -> Float[np.ndarray, "N 3"]:
        """x, y (m) and course (rad) at the distances `s` (m)."""
        ends = np.zeros((len(self.lengths) + 1, 3))
        for i, (length, curvature) in enumerate(zip(self.lengths, self.curvatures, strict=True)):
            ends[i + 1] = _along(ends[i], np.array(length), np.array(curvature))
        part = self._part(s)
        begins = np.concatenate([[0.0], np.cumsum(self.lengths)])
        return _along(ends[part], s - begins[part], np.asarray(self.curvatures)[part])

    def commands(self, bicycle: Bicycle, *, speed: float, dt: float = PAPER_DT) -> Commands:
        """What an ideal vehicle would be told to drive along the track at a constant speed (m/s).

        The angle of a row is that of the curvature in the middle of its sample.
        """
        rows = math.ceil(self.length / (speed * dt))
        curvature = self.curvature(speed * dt * (np.arange(rows) + 0.5))
        return Commands(np.full(rows, speed), bicycle.steering_angle(jnp.asarray(curvature)), dt)

    def _part(self, s: np.ndarray) -> np.ndarray:
        inner = np.cumsum(self.lengths)[:-1]
        return np.searchsorted(inner, s, side="right")


def bend(*, radius: float = 20.0, angle: float = math.pi / 2, straight: float = 20.0) -> Track:
    """The paper's first track: a bend (90° of 20 m) to the left between two straights (m), which
    `bend().commands(bicycle, speed=PAPER_SPEED)` drives along."""
    return Track((straight, radius * angle, straight), (0.0, 1.0 / radius, 0.0))


def s_curve(*, radius: float = 15.0, angle: float = math.pi / 2, straight: float = 20.0) -> Track:
    """The paper's second track: a left and a right arc (15 m) between two straights (m)."""
    arc, curvature = radius * angle, 1.0 / radius
    return Track((straight, arc, arc, straight), (0.0, curvature, -curvature, 0.0))


def _times(duration: float, dt: float) -> np.ndarray:
    return dt * np.arange(round(duration / dt) + 1)


def _along(pose: np.ndarray, s: np.ndarray, curvature: np.ndarray) -> np.ndarray:
    """Pose (..., 3) after the distance `s` (...) on an arc."""
    half = 0.5 * curvature * s
    chord = s * np.sinc(half / math.pi)
    course = pose[..., 2] + half
    gone = np.stack([chord * np.cos(course), chord * np.sin(course), 2.0 * half], axis=-1)
    return pose + gone
