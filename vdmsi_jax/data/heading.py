"""The heading of a vehicle whose position and yaw rate are logged, and whose heading is not."""

import numpy as np
from jaxtyping import Float

_ALONG = 20.0  # s, over which the path tells its course: long enough for a receiver of half a metre
BY_STEERING = 4.0
"""The same where wheels tell the yaw rate, which a vehicle that slips does not follow, s."""

_SLOW = 0.05  # of the usual speed, or of the longest way in that time, below which a path tells no
# course: a vehicle that stands goes the way of the noise
_AT_ONCE = 0.5  # s, over which a speed is forward or backward
_LARGEST_SINE = 0.95  # of the course angle


def heading_of_path(
    x: Float[np.ndarray, " N"],
    y: Float[np.ndarray, " N"],
    yaw_rate: Float[np.ndarray, " N"],
    speed: Float[np.ndarray, " N"],
    dt: float,
    ahead: float = 0.0,
    along: float = _ALONG,
) -> Float[np.ndarray, " N"]:
    """The summed yaw rate, turned so that it goes the way of the path.

    From moment to moment it is the yaw rate alone; over 20 s it follows the course of the path, so
    that neither a bias of the yaw rate nor its scale adds up, and the noise of a position hardly
    counts. It is no measurement of its own: what the yaw rate says wrongly, it says as well.

    Args:
        x, y: (N,) m, position of the reference point, evenly sampled and without a gap.
        yaw_rate: (N,) rad/s, positive to the left.
        speed: (N,) m/s of the reference point along its course, negative backwards.
        dt: sample period, s.
        ahead: how far the reference point is ahead of the rear axle, m: its course makes the angle
            asin(ahead r / v) with the body where the rear does not slip.
        along: over which the path tells its course, s.

    Returns:
        (N,) rad, counter-clockwise, not wrapped.
    """
    n = len(x)
    turned = np.concatenate([[0.0], np.cumsum(_between(yaw_rate) * dt)])
    v, t = _between(speed), dt * np.arange(n)
    sine = ahead * _between(yaw_rate) / np.where(v == 0.0, np.inf, v)
    slip = np.arcsin(np.clip(sine, -_LARGEST_SINE, _LARGEST_SINE))
    steady = _around(v, max(1, round(0.5 * _AT_ONCE / dt)))[:-1]
    moves = np.abs(steady) > _SLOW * np.quantile(np.abs(steady), 0.95) if n > 1 else steady
    way = np.diff(x + 1j * y) * np.where(moves, np.sign(steady), 0.0) * np.exp(-1j * slip)
    half = max(1, round(0.5 * along / dt))
    gone = _around(np.abs(v) * dt, half)
    tells = gone > _SLOW * gone.max()
    if not tells.any():
        return turned
    for _ in range(2):  # a bias turns what stands at one side of its window only, and is taken out
        course = _around(way * np.exp(-1j * _between(turned)), half)
        off = np.unwrap(np.angle(course[tells]))
        slope = np.polyfit(t[tells], off, 1)[0] if np.ptp(t[tells]) > 0.5 * along else 0.0
        turned = turned + slope * t
    return turned + np.interp(t, t[tells], off - slope * t[tells])


def _between(values: Float[np.ndarray, " N"]) -> np.ndarray:
    """Between the samples."""
    return 0.5 * (values[1:] + values[:-1])


def _around(steps: np.ndarray, half: int) -> np.ndarray:
    """Sum of so many steps before each sample and as many behind it, of those that there are."""
    sums = np.concatenate([[0.0], np.cumsum(steps)])
    at, n = np.arange(len(sums)), len(sums) - 1
    return sums[np.minimum(at + half, n)] - sums[np.maximum(at - half, 0)]
