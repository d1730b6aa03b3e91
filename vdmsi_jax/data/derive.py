"""Channels that follow from others: the formulas of the named rules, and how a configuration calls
them.

All geometry is that of the kinematic bicycle with a rear axle that does not slip. The reference
point lies `d` ahead of the rear axle (`VehicleGeometry.rear_to_reference`): its course makes the
angle β = atan(d tan δ / L) with the body, and the vehicle yaws with r = v cos β tan δ / L, where L
is the wheelbase and v the speed of the reference point along its course. For d = l_r that is eq.
(1) of the paper, for d = 0 the rear axle's r = v tan δ / L.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from jaxtyping import Bool, Float

from ..config import CANONICAL, POSE, Derivation, VehicleGeometry, allowed_quantities
from ..errors import InputError, nearest
from ..units import si_symbol, unit
from .expressions import parse
from .heading import BY_STEERING, heading_of_path
from .mend import moment

_LARGEST_SINE = 0.95  # of the course angle, beyond which noise and not geometry speaks


def sharpest_curvature(vehicle: VehicleGeometry) -> float:
    """The largest curvature, 1/m, of a path that the reference point can follow; infinite for a
    point on the rear axle."""
    ahead = abs(vehicle.rear_to_reference)
    return _LARGEST_SINE / ahead if ahead > 0.0 else np.inf


def steering_from_curvature(
    curvature: Float[np.ndarray, " N"], vehicle: VehicleGeometry
) -> Float[np.ndarray, " N"]:
    """Road-wheel angle that drives the reference point along a path of this curvature.

    Args:
        curvature: (N,) 1/m, positive to the left.
        vehicle: geometry; the curvature is that of its reference point's path.

    Returns:
        (N,) rad. From sin β = d κ it is tan δ = L κ / cos β; curvatures that the point cannot
        follow are cut to the sharpest that it can.
    """
    sharpest = sharpest_curvature(vehicle)
    curvature = np.clip(curvature, -sharpest, sharpest)
    sine = vehicle.rear_to_reference * curvature
    return np.arctan(vehicle.wheelbase * curvature / np.sqrt(1.0 - sine**2))


def steering_from_yaw_rate(
    yaw_rate: Float[np.ndarray, " N"],
    speed: Float[np.ndarray, " N"],
    vehicle: VehicleGeometry,
    min_speed: float,
) -> tuple[Float[np.ndarray, " N"], Bool[np.ndarray, " N"]]:
    """Road-wheel angle at which the kinematic bicycle would yaw as measured.

    It takes side slip for steering: what understeer does is in it.

    Args:
        yaw_rate: (N,) rad/s, positive to the left.
        speed: (N,) m/s of the reference point along its course, negative backwards.
        vehicle: geometry.
        min_speed: m/s, below which the angle is not told.

    Returns:
        The angle (N,) rad, and a mask (N,) of where it can be told. tan δ = L r / v_rear with the
        speed of the rear axle v_rear = v cos β and sin β = d r / v.
    """
    lateral = vehicle.rear_to_reference * yaw_rate
    known = (np.abs(speed) >= min_speed) & (np.abs(lateral) <= _LARGEST_SINE * np.abs(speed))
    rear = np.sign(speed) * np.sqrt(np.where(known, speed**2 - lateral**2, 1.0))
    return np.where(
        known, np.arctan(vehicle.wheelbase * yaw_rate / np.where(known, rear, 1.0)), 0.0
    ), known


def yaw_rate_from_steering(
    speed: Float[np.ndarray, " N"], steering: Float[np.ndarray, " N"], vehicle: VehicleGeometry
) -> Float[np.ndarray, " N"]:
    """Yaw rate of the kinematic bicycle, r = v cos β tan δ / L.

    Args:
        speed: (N,) m/s of the reference point along its course.
        steering: (N,) rad, road-wheel angle.
        vehicle: geometry.

    Returns:
        (N,) rad/s, positive to the left.
    """
    turn = np.tan(steering) / vehicle.wheelbase
    return speed * turn / np.sqrt(1.0 + (vehicle.rear_to_reference * turn) ** 2)


def differentiate(
    values: Float[np.ndarray, " N"], dt: float, samples: int
) -> Float[np.ndarray, " N"]:
    """Time derivative of a measurement: the slope of the parabola that fits the samples around each
    one best.

    It does not shift in time. Source: Savitzky and Golay (1964); at the ends the parabola of the
    first or last window is used.

    Args:
        values: (N,) evenly spaced samples of one segment.
        dt: sample period, s.
        samples: length of the window, odd; cut to what is there.
    """
    half = min(samples, values.size - 1 + values.size % 2) // 2
    if half < 1:
        return np.gradient(values, dt) if values.size > 1 else np.zeros_like(values)
    offset = np.arange(-half, half + 1)
    slope = np.empty_like(values)
    slope[half : values.size - half] = (
        np.convolve(values, -offset / np.sum(offset**2), "valid") / dt
    )
    for start, target in (
        (0, np.arange(half)),
        (values.size - offset.size, values.size - 1 - np.arange(half)),
    ):
        parabola = np.polyfit(offset, values[start : start + offset.size], 2)
        slope[target] = np.polyval(np.polyder(parabola), target - start - half) / dt
    return slope


@dataclass
class Channels:
    """The channels of a record in the making, to which rules add.

    Attributes:
        values: name -> (N,) in SI.
        filled: name -> (N,) mask of the samples that are not measured.
        units: name -> SI unit.
        pieces: the evenly sampled stretches.
        dt: sample period, s.
        t: (N,) s.
        told: sentences about what was filled in.
    """

    values: dict[str, np.ndarray]
    filled: dict[str, np.ndarray]
    units: dict[str, str]
    pieces: Sequence[slice]
    dt: float
    t: np.ndarray
    told: list[str] = field(default_factory=list)


@dataclass(frozen=True)
class _Rule:
    """A named rule: which channels it needs, what it measures, and its formula.

    The formula maps channels, derivation and vehicle to the values and, if some cannot be told, a
    mask of those that can. One that differentiates looks to one side only at the ends of a stretch:
    what it tells there is many times as noisy, and does not count as measured. What is reckoned
    from a channel of which it says nothing new counts nowhere.
    """

    quantity: str
    needs: Callable[[Derivation], tuple[str, ...]]
    formula: Callable[..., tuple[np.ndarray, np.ndarray | None]]
    needs_vehicle: bool = False
    differentiates: bool = False
    reckoned: bool = False


def _window(channels: Channels, how: Derivation) -> int:
    return 5 if how.window is None else 2 * max(1, round(how.window / channels.dt / 2.0)) + 1


def _slope(channels: Channels, name: str, how: Derivation) -> np.ndarray:
    samples = _window(channels, how)
    parts = [
        differentiate(channels.values[name][piece], channels.dt, samples)
        for piece in channels.pieces
    ]
    return np.concatenate(parts)


def _speed_from_pose(
    channels: Channels, how: Derivation, vehicle: VehicleGeometry | None
) -> tuple[np.ndarray, None]:
    """Speed of the reference point. Of a vehicle the way aside is that of a wheel that does not
    slip, since the noise of a measured one would always add."""
    vx, vy, psi = _slope(channels, "x", how), _slope(channels, "y", how), channels.values["psi"]
    ahead = vx * np.cos(psi) + vy * np.sin(psi)
    turning = _slope(channels, "psi", how)
    kept = _kept_of_circle(turning, channels.dt, _window(channels, how))
    aside = vy * np.cos(psi) - vx * np.sin(psi)
    if vehicle is not None:
        aside = kept * vehicle.rear_to_reference * turning
    return np.copysign(np.hypot(ahead, aside), ahead) / kept, None


def _heading_from_path(
    channels: Channels, how: Derivation, vehicle: VehicleGeometry | None
) -> tuple[np.ndarray, None]:
    ahead = 0.0 if vehicle is None else vehicle.rear_to_reference
    x, y, r, v = (channels.values[c] for c in ("x", "y", how.yaw_rate, how.speed))
    parts = [
        heading_of_path(x[piece], y[piece], r[piece], v[piece], channels.dt, ahead)
        for piece in channels.pieces
    ]
    return np.concatenate(parts), None


def _heading_by_steering(
    channels: Channels, how: Derivation, vehicle: VehicleGeometry
) -> tuple[np.ndarray, None]:
    x, y, v, delta = (channels.values[c] for c in ("x", "y", how.speed, how.steering))
    r, ahead = yaw_rate_from_steering(v, delta, vehicle), vehicle.rear_to_reference
    parts = [
        heading_of_path(x[p], y[p], r[p], v[p], channels.dt, ahead, BY_STEERING)
        for p in channels.pieces
    ]
    return np.concatenate(parts), None


def _kept_of_circle(r: np.ndarray, dt: float, samples: int) -> np.ndarray:
    """What the parabola over so many samples leaves of the speed on a circle at a yaw rate of `r`:
    it cuts the bend short. At least a half, where it bends more than any vehicle does."""
    k = np.arange(1, samples // 2 + 1)
    turned = np.abs(r[:, None]) * dt * k
    kept = np.sum(k**2 * np.sinc(turned / np.pi), axis=1) / np.sum(k**2)
    return np.maximum(kept, 0.5)


_RULES: Mapping[str, _Rule] = {
    "steering_from_yaw_rate": _Rule(
        "angle",
        lambda how: (how.yaw_rate, how.speed),
        lambda c, how, vehicle: steering_from_yaw_rate(
            c.values[how.yaw_rate], c.values[how.speed], vehicle, how.min_speed
        ),
        needs_vehicle=True,
    ),
    "yaw_rate_from_steering": _Rule(
        "angular rate",
        lambda how: (how.speed, how.steering),
        lambda c, how, vehicle: (
            yaw_rate_from_steering(c.values[how.speed], c.values[how.steering], vehicle),
            None,
        ),
        needs_vehicle=True,
    ),
    "yaw_rate_from_heading": _Rule(
        "angular rate",
        lambda _: ("psi",),
        lambda c, how, _: (_slope(c, "psi", how), None),
        differentiates=True,
    ),
    "speed_from_pose": _Rule(
        "speed", lambda _: ("x", "y", "psi"), _speed_from_pose, differentiates=True
    ),
    "heading_from_path": _Rule(
        "angle",
        lambda how: ("x", "y", how.yaw_rate, how.speed),
        _heading_from_path,
        reckoned=True,
    ),
    "heading_from_path_and_steering": _Rule(
        "angle",
        lambda how: ("x", "y", how.speed, how.steering),
        _heading_by_steering,
        needs_vehicle=True,
        reckoned=True,
    ),
    "acceleration_from_speed": _Rule(
        "acceleration",
        lambda how: (how.speed,),
        lambda c, how, _: (_slope(c, how.speed, how), None),
        differentiates=True,
    ),
}


def derive(
    channels: Channels,
    derivations: Mapping[str, Derivation],
    vehicle: VehicleGeometry | None,
    *,
    source: str,
    log: str,
) -> None:
    """Add the channels that `[derive]` asks for, in its order, to `channels`.

    Args:
        channels: what there is; added to in place.
        derivations: name -> how.
        vehicle: geometry, for the rules that need it.
        source: the configuration, for errors about it.
        log: the log, for errors about its numbers.

    Raises:
        InputError: a channel that is needed is not there, the vehicle is not described, a unit is
            unknown, or a result is not finite.
    """
    for name, how in derivations.items():
        place = f"[derive] {name}"
        if how.expression is not None:
            expression = parse(how.expression, source=source, place=place)
            needs, known, ends, reckoned = expression.names, None, 0, False
            of = unit(how.unit or "1", source=source, place=f"{place} unit")
            _demand(needs, channels, source, place)
            values = of.to_si * np.broadcast_to(expression(channels.values), channels.t.shape)
            quantity = of.quantity
        else:
            rule = _RULES[how.rule or ""]
            needs, quantity = rule.needs(how), rule.quantity
            wanted = () if name in POSE else allowed_quantities(name, CANONICAL)
            if wanted and quantity not in wanted:
                problem = f"{how.rule} makes {quantity}, and {name} is {wanted[0]}"
                raise InputError(source, place, problem, "derive another channel by it")
            ends = _window(channels, how) // 2 if rule.differentiates else 0
            reckoned = rule.reckoned
            _demand(needs, channels, source, place)
            if rule.needs_vehicle and vehicle is None:
                mend = "give [vehicle] l_f and l_r"
                raise InputError(source, place, f"{how.rule} needs the wheelbase", mend)
            values, known = rule.formula(channels, how, vehicle)  # pyright: ignore[reportArgumentType]
        if not np.isfinite(values).all():
            bad = np.flatnonzero(~np.isfinite(values))
            first = moment(channels.t, int(bad[0]))
            problem = f"{name} is not finite in {bad.size} samples, the first {first}"
            raise InputError(
                log, place, problem, "guard the expression, such as a / maximum(b, 0.1)"
            )
        mask = np.full(values.shape, reckoned)
        for need in needs:
            mask |= channels.filled.get(need, mask)
        for piece in channels.pieces if ends else ():
            mask[piece][:ends] = mask[piece][-ends:] = True
        if known is not None and not known.all():
            values = _fill(values, known, channels, log, place, how)
            mask |= ~known
            channels.told.append(
                f"interpolated {name} in {np.count_nonzero(~known)} of {known.size} samples in "
                f"which it cannot be told (slower than {how.min_speed:g} m/s, or turning almost on "
                f"the spot), and marked them as not measured"
            )
        if name in channels.values:
            channels.told.append(f"derived {name} in place of its column in the log")
        channels.values[name], channels.units[name] = np.array(values), si_symbol(quantity)
        channels.filled.pop(name, None)
        if mask.any():
            channels.filled[name] = mask


def _demand(needs: Sequence[str], channels: Channels, source: str, place: str) -> None:
    for need in needs:
        if need not in channels.values:
            problem = f"needs the channel {need!r}, which is not there"
            raise InputError(source, place, problem, nearest(need, channels.values))


def _fill(
    values: np.ndarray, known: np.ndarray, channels: Channels, log: str, place: str, how: Derivation
) -> np.ndarray:
    """Interpolate over the samples that are not known, segment by segment; zero where a segment has
    none."""
    if not known.any():
        problem = f"the speed never reaches min_speed = {how.min_speed:g} m/s"
        raise InputError(log, place, problem, "lower min_speed, or check the unit of the speed")
    values = values.copy()
    for piece in channels.pieces:
        index = np.arange(piece.start, piece.stop)
        good = index[known[piece]]
        values[piece] = np.interp(index, good, values[good]) if good.size else 0.0
    return values
