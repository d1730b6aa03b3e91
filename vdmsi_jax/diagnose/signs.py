"""Do the yaw rate and the heading turn as speed and steering angle make a vehicle turn?"""

from collections.abc import Sequence

import numpy as np

from ..data.record import Record
from ..models.bicycle import Bicycle
from .windows import moving_mean

_OVER = 0.5  # s, over which both are averaged
_AGAINST = -0.7  # correlation from which on a channel runs against what makes it


def turned_round(records: Sequence[Record]) -> list[str]:
    """A sentence for each channel whose sign is another than the convention's (x ahead, y to the
    left, angles and yaw rates positive to the left), which no cause is.

    Args:
        records: of one vehicle.
    """
    vehicle = records[0].vehicle
    if vehicle is None or not all("v" in r and "delta" in r for r in records):
        return []
    bicycle = Bicycle.at_reference(vehicle)
    made = [np.asarray(bicycle.yaw_rate(r["v"], r["delta"])) for r in records]
    told = []
    for name in ("r", "psi"):
        if not all(name in record for record in records):
            continue
        pairs = [
            [
                moving_mean(x[None], _OVER, record.dt)[0]
                for x in (rate[s.samples], _turning(record[name][s.samples], name, record.dt))
            ]
            for rate, record in zip(made, records, strict=True)
            for s in record.segments
        ]
        one, other = (np.concatenate(parts) for parts in zip(*pairs, strict=True))
        spread = float(np.std(one) * np.std(other))
        alike = float(np.mean((one - one.mean()) * (other - other.mean()))) / max(spread, 1e-300)
        if alike < _AGAINST:
            told.append(
                f"{name} turns against what v and delta make (correlation {alike:.2f}): "
                f"[sign] {name} = -1 would turn it round."
            )
    return told


def _turning(values: np.ndarray, name: str, dt: float) -> np.ndarray:
    """Rate of turn, rad/s."""
    return values if name == "r" else np.gradient(np.unwrap(values), dt)
