"""Units that a log does not declare, told by how the vehicle moves: speeds in km/h, angles in
degrees, positions in mm or cm.

A speed is compared with the way of the pose, heading and yaw rate with each other or with the
course of the pose, a steering angle with the one that would turn the vehicle so. What a
configuration gives a unit for is taken at its word.
"""

from collections.abc import Callable, Iterator, Mapping

import numpy as np
from jaxtyping import Float

from ..config import Config, VehicleGeometry
from ..errors import InputError
from ..units import UNITS, si_symbol
from .derive import Channels, steering_from_yaw_rate

_CHORD = 0.5  # s, over which speeds and courses are taken
_TURN = 4  # chords, over which turns are compared
_FEWEST = 10  # comparisons
_MOVING = 0.25  # of a high speed, below which noise drowns course and steering angle
_ALIKE = 0.85  # correlation of two channels that tell of one motion
_NEAR = {"km/h": 0.08, "mm": 0.2, "cm": 0.2, "deg": 0.2, "deg/s": 0.2}
"""How far from a unit's a ratio may be. Speeds of measured logs are off their poses by up to 7.5 %;
angles may be further off, as tyres slip and chords cut bends, and no gain is near 57.3."""

_Chords = Float[np.ndarray, " _"]


def refuse_undeclared(
    channels: Channels, config: Config, columns: Mapping[str, str], source: str
) -> None:
    """Refuse a vehicle's log with a speed in km/h, an angle in degrees, or a position in mm or cm
    that is not declared.

    Args:
        channels: of the log.
        config: its vehicle, without which nothing is compared, and its units.
        columns: channel -> column of the file, of those that were logged.
        source: the log, for errors.

    Raises:
        InputError: a channel is as many times what the motion tells as such a unit makes.
    """
    logged = (columns.keys() & channels.values.keys()) - config.derive.keys()
    motion = _Motion(channels)
    if config.vehicle is None or not motion.edges:
        return
    for name, unit, what, seen, told in _comparisons(motion, logged, config.vehicle):
        ratio = _ratio(seen, told)
        own = UNITS[unit]
        if name not in config.units and abs(ratio * own.to_si - 1.0) < _NEAR[unit]:
            problem = f"{name} is {ratio:.3g} times {what}, as if it were in {unit}"
            both = f' and y = "{unit}"' if name == "x" else ""
            si = si_symbol(own.quantity)
            mend = f'declare its unit, [units] {name} = "{unit}"{both} or "{si}"'
            raise InputError(source, f"column {columns[name]!r}", problem, mend)


class _Motion:
    """What the channels of a log tell of its motion, over chords of the path."""

    def __init__(self, channels: Channels):
        self.values, self.dt = channels.values, channels.dt
        self.width = max(1, round(_CHORD / channels.dt))
        edges = [np.arange(p.start, p.stop, self.width) for p in channels.pieces]
        self.edges = [at for at in edges if at.size > _TURN + 1]

    def each(self, of: Callable[[np.ndarray], np.ndarray]) -> _Chords:
        """Something of the edges of the chords of each piece, joined."""
        return np.concatenate([of(at) for at in self.edges])

    def mean(self, name: str) -> _Chords:
        """Mean of a channel over each chord."""
        x = self.values[name]
        return self.each(lambda at: np.add.reduceat(x[: at[-1]], at[:-1]) / self.width)

    def turning(self) -> _Chords:
        """Yaw rate over each chord, of `r` or else of `psi`."""
        if "r" in self.values:
            return self.mean("r")
        return self.each(lambda at: np.diff(self.values["psi"][at])) / (self.width * self.dt)

    def turned(self, heading: Float[np.ndarray, " N"]) -> _Chords:
        """By how much a heading turns from the middle of a chord to that of a later one."""
        return self.each(lambda at: _later(heading[at[:-1] + self.width // 2]))

    def ways(self) -> tuple[_Chords, _Chords, _Chords]:
        """Speed over each chord, turns of the course, modulo a half turn, and the lowest speed in
        each of them."""
        x, y = self.values["x"], self.values["y"]

        def speed(at: np.ndarray) -> np.ndarray:
            return np.hypot(np.diff(x[at]), np.diff(y[at])) / (self.width * self.dt)

        def turn(at: np.ndarray) -> np.ndarray:
            course = np.arctan2(np.diff(y[at]), np.diff(x[at]))
            return _later(np.unwrap(course, period=np.pi))

        def lowest(at: np.ndarray) -> np.ndarray:
            return np.lib.stride_tricks.sliding_window_view(speed(at), _TURN + 1).min(axis=1)

        return self.each(speed), self.each(turn), self.each(lowest)


_Comparison = tuple[str, str, str, _Chords, _Chords]


def _comparisons(
    motion: _Motion, logged: set[str], vehicle: VehicleGeometry
) -> Iterator[_Comparison]:
    """Channel, unit in which it may be, what it is compared with, and both over the chords; those
    first that the later ones build on."""
    ways = motion.ways() if {"x", "y"} <= logged else None
    if ways is not None:
        for name in ("v", "v_cmd"):
            if name in logged and (name == "v" or _follows(motion.mean(name), ways[0])):
                speed = np.abs(motion.mean(name))
                yield name, "km/h", "the speed of x and y", speed, ways[0]
                for unit in ("mm", "cm"):
                    yield "x", unit, f"what {name} tells", ways[0], speed
    turns = {}
    if "psi" in logged:
        turns["psi"] = motion.turned(motion.values["psi"])
    if "r" in logged:
        turns["r"] = motion.turned(np.cumsum(motion.values["r"]) * motion.dt)
    if len(turns) == 2:
        yield "psi", "deg", "the turns that r makes", turns["psi"], turns["r"]
        yield "r", "deg/s", "the rate at which psi turns", turns["r"], turns["psi"]
    if ways is not None:
        moving = ways[2] > _MOVING * np.quantile(ways[0], 0.95)
        for name, unit in (("psi", "deg"), ("r", "deg/s")):
            if name in turns:
                told = ways[1][moving]
                yield name, unit, "what the path of x and y turns", turns[name][moving], told
    if turns and "v" in motion.values:
        v = motion.mean("v")
        slowest = max(float(_MOVING * np.quantile(np.abs(v), 0.95)), 1e-6)
        angle, known = steering_from_yaw_rate(motion.turning(), v, vehicle, slowest)
        for name in ("delta", "delta_cmd"):
            if name in logged:
                what = "the angle that turns the vehicle so"
                yield name, "deg", what, np.abs(motion.mean(name)[known]), np.abs(angle[known])


def _later(heading: np.ndarray) -> np.ndarray:
    return heading[_TURN:] - heading[:-_TURN]


def _follows(command: _Chords, speed: _Chords) -> bool:
    """Whether a speed changes as its command does: one that is stuck below it may be any part."""
    return bool(np.isfinite(_ratio(np.abs(command) - np.abs(command).mean(), speed - speed.mean())))


def _ratio(seen: _Chords, told: _Chords) -> float:
    """How many times as large one is as the other; NaN where they are not alike."""
    if seen.size < _FEWEST:
        return np.nan
    size, other = float(np.linalg.norm(seen)), float(np.linalg.norm(told))
    return size / other if abs(seen @ told) > _ALIKE * size * other else np.nan
