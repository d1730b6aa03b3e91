"""The measured steering angle, and what stands in for it where it was not logged."""

import jax.numpy as jnp
import numpy as np

from ...models.bicycle import Bicycle
from .runs import Runs

_SLOWEST_STEERED = 0.3  # m/s, below which a yaw rate tells no steering angle of what goes faster
_SLOWER_STEERED = 0.5  # of the usual speed, likewise: a lag of either tells when a vehicle sets off
_FASTEST = 0.95  # quantile of the speed, half of which is fast enough for what is slow
_HEADED, _HEADINGS = 4.0, 6  # s, over which headings are compared, and how often at least
_SURELY = 5.0  # standard errors, from which the yaw rate has a bias


def steering_angle(runs: Runs) -> tuple[np.ndarray, np.ndarray] | None:
    """Measured road-wheel angle and where it is known; where it was not measured, from speed and
    yaw rate, less its bias; None where neither was."""
    logged, vehicle = all("delta" in r for r in runs.records), runs.records[0].vehicle
    bias = yaw_rate_bias(runs) if not logged or derived(runs) else 0.0
    if logged and bias == 0.0:
        return runs.channel("delta"), runs.seen("delta")
    if vehicle is None or not all("r" in r and "v" in r for r in runs.records):
        return None
    v, r = runs.channel("v"), runs.channel("r") - bias
    seen = runs.seen("r") & runs.seen("v")
    if logged:
        known = runs.seen("delta") & seen
    else:
        speeds = np.abs(v[seen]) if seen.any() else np.zeros(1)
        usual, fast = _SLOWER_STEERED * np.quantile(speeds, [0.5, _FASTEST])
        known = (np.abs(v) > max(min(_SLOWEST_STEERED, fast), usual)) & seen
    bicycle = Bicycle.at_reference(vehicle)
    curvature = np.where(known, r / np.where(known, v, 1.0), 0.0)
    limit = 0.99 / max(abs(vehicle.rear_to_reference), 1e-6)
    angle = np.asarray(bicycle.steering_angle(jnp.asarray(np.clip(curvature, -limit, limit))))
    return angle, known & (np.abs(curvature) < limit)


def yaw_rate_bias(runs: Runs) -> float:
    """What the yaw rate says more than the heading turns, rad/s, of what is fitted; zero where that
    is not sure, or one of them was not logged."""
    if not all("r" in record and "psi" in record for record in runs.records):
        return 0.0
    r, psi = runs.channel("r"), np.unwrap(runs.channel("psi"), axis=1)
    seen = runs.seen("r") & runs.seen("psi") & ~runs.held()
    rows = max(round(_HEADED / runs.dt), 2)
    turned = runs.dt * np.cumsum(0.5 * (r[:, 1:] + r[:, :-1]), axis=1)
    excess = []
    for own, angle, use in zip(turned, psi, seen, strict=True):
        for a in range(0, len(own) - rows, rows):
            b = a + rows
            if use[a : b + 2].all():
                excess.append((own[b] - own[a] - angle[b + 1] + angle[a + 1]) / (rows * runs.dt))
    if len(excess) < _HEADINGS:
        return 0.0
    middle = float(np.median(excess))
    spread = 1.4826 * float(np.median(np.abs(np.array(excess) - middle)))
    sure = abs(middle) > _SURELY * 1.2533 * spread / np.sqrt(len(excess))
    return middle if sure else 0.0


def derived(runs: Runs) -> bool:
    """Whether the steering angle is made of the yaw rate, which then tells nothing of its own: it
    was not logged, or is just what the two make of each other."""
    vehicle = runs.records[0].vehicle
    if vehicle is None:
        return False
    if not all("delta" in record for record in runs.records):
        return True
    v, r, delta = (runs.channel(name) for name in ("v", "r", "delta"))
    known = runs.seen("delta") & runs.seen("r")
    error = np.abs(np.asarray(Bicycle.at_reference(vehicle).yaw_rate(v, delta)) - r)[known]
    return bool(error.size and np.median(error) < 1e-6 * max(float(np.std(r[known])), 1e-12))
