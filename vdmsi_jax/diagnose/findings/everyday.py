"""What every vehicle, plant or bus has so much of that it is no finding."""

from collections.abc import Callable

import numpy as np

from ..actuator.swing import FEWEST
from ..answer.result import Finding, Gain
from ..signals.runs import Runs

_SLIGHT, _SLIGHT_POINTS = 60.0, 0.3  # twice the log-likelihood and FIT, below which both a cause of
# the body, the road or a sensor is what no vehicle is without
_DOUBTFUL = 0.05  # share of a cause that makes the path no better, below which it is minor
_BUS, _LATE = 0.02, 2.5  # s and points of FIT, below which both a delay is every bus's
_SAME = 0.01  # of a yaw rate, a wheelbase or a wheel, that no body is known better by
_DRAGGED, _DRAG = 0.5, 0.25  # points of FIT and share, below which both a speed that falls in bends
# and leaves the path as it was is every vehicle's: of a physics engine's cars up to 0.28 and 0.15
_TURNS = 0.1  # s, below which a body's lag by its inertia is every vehicle's
_TELLS = 0.5  # share, from which on a tyre's relaxation is one however short
_BLURRED = 0.2  # of a swing, that the frequency may be off over the longest run: wind had 0.29
_DAMPED = 0.24  # ratio, from which a mode is rather two poles that the plant lacks
_LIGHT, _ADDS = 0.15, 0.3  # ratio, and share of the baseline's error, that a mode with more damping
# must take by itself


def is_everyday(found: Finding, runs: Runs, part: float) -> bool:
    """Whether it is less than a body's or a plant's own, by the rule of its cause; or, of a body or
    a sensor, slight; or a small gain in one channel that is none on the road.

    Args:
        found: a cause that is sure.
        runs: that were looked at.
        part: share that it takes of what its channel errs by with no cause.
    """
    own = _OWN.get(found.cause)
    if own is not None and own(found, runs, part):
        return True
    if found.where in ("vehicle", "sensor"):
        if found.statistic < _SLIGHT and _points(found) < _SLIGHT_POINTS:
            return True
    g = found.gain
    worse = g.ate_before is not None and g.ate_after is not None and g.ate_after > g.ate_before
    return worse and max(found.share, g.typical) < _DOUBTFUL


def _size(found: Finding) -> float:
    """Its first parameter."""
    return next(iter(found.parameters.values())).value


def _points(found: Finding) -> float:
    return found.gain.after - found.gain.before


def _late_sensor(found: Finding, runs: Runs, part: float) -> bool:
    """By less than half a sample."""
    return abs(_size(found)) < 0.5 * runs.dt


def _short_tyres(found: Finding, runs: Runs, part: float) -> bool:
    """That relax within less than a row, and tell little: what every vehicle has tells a part."""
    short = _size(found) < runs.dt * float(np.mean(np.abs(runs.channel("v"))))
    return short and found.share < _TELLS


def _other_body(found: Finding, runs: Runs, part: float) -> bool:
    """That turns nearly as another."""
    same = abs(_size(found)) * float(np.mean(runs.channel("v") ** 2)) < _SAME
    return same and _points(found) < _SLIGHT_POINTS


def _other_wheels(found: Finding, runs: Runs, part: float) -> bool:
    """Of a size or a base that is known to this."""
    return abs(_size(found)) < _SAME and _points(found) < _SLIGHT_POINTS


def _slow_in_bends(found: Finding, runs: Runs, part: float) -> bool:
    """By a little, which does not show on the road."""
    if found.where != "powertrain":
        return False
    return found.share < _DRAG and _points(found) < _DRAGGED and not _shorter(found.gain)


def _slow_to_turn(found: Finding, runs: Runs, part: float) -> bool:
    """By what its tyres are."""
    return _size(found) * float(np.mean(np.abs(runs.channel("v")))) < _TURNS


def _bus(found: Finding, runs: Runs, part: float) -> bool:
    """Early, or late by what every bus takes."""
    return _size(found) < 0.0 or (_size(found) < _BUS and _points(found) < _LATE)


def _wanderer(found: Finding, runs: Runs, part: float) -> bool:
    """At no frequency of its own."""
    return found.parameters["frequency"].std * runs.longest > _BLURRED


def _poles(found: Finding, runs: Runs, part: float) -> bool:
    """That poles of the baseline tell as well, or what hardly swings, or between the samples."""
    damping, frequency = (found.parameters[k].value for k in ("damping", "frequency"))
    if damping > _DAMPED or (damping > _LIGHT and part < _ADDS):
        return True
    return frequency * runs.longest < FEWEST or frequency * runs.dt > 0.5


def _shorter(gain: Gain) -> bool:
    """Whether the error of the path is clearly less."""
    if gain.ate_before is None or gain.ate_after is None:
        return False
    return gain.ate_after < (1.0 - _DOUBTFUL) * gain.ate_before


_OWN: dict[str, Callable[[Finding, Runs, float], bool]] = {
    "sensor_delay": _late_sensor,
    "sensor_lag": _late_sensor,
    "tyre_relaxation": _short_tyres,
    "understeer": _other_body,
    "geometry_scale": _other_wheels,
    "speed_scale": _other_wheels,
    "cross_coupling": _slow_in_bends,
    "yaw_inertia": _slow_to_turn,
    "transport_delay": _bus,
    "periodic_disturbance": _wanderer,
    "resonance": _poles,
}
"""What each cause is too little of, or too much like, to be one."""
