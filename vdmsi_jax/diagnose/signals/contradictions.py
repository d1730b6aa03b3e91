"""What the channels of a log say against each other, which no cause is: a sign that is another than
the convention's, a yaw rate that is no rate of the heading, a command and a response that stand for
each other."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ...config import PlantSpec
from ...data.record import Record
from ...first_look import first_look
from ...models.bicycle import Bicycle
from .windows import moving_mean

_OVER = 0.5  # s, over which turns are averaged
_AGAINST = -0.7  # correlation from which on a channel runs against what makes it
_SCALE = 0.06  # by which the yaw rate differs from the rate of the heading, beyond noise of both
_TURN = 1.0  # s, over which both turn
_FILLED, _FEWEST = 0.2, 20  # of such a second, that may be filled in; and seconds that are asked
_LATE = 1.0  # s, by which a response is late at the most
_BACKWARD, _FORWARD = 0.1, 3.0  # of a spread's square, that a lag of the response leaves of the
# command at the most, and how many times more a lag of the command leaves of the response


@dataclass(frozen=True)
class Contradiction:
    """What cannot be.

    Attributes:
        channel: that says so.
        by: the channels against which it does.
        leave: channels that tell nothing as they are.
        said: what it is, and the mend.
    """

    channel: str
    by: tuple[str, ...]
    leave: tuple[str, ...]
    said: str


def contradictions(records: Sequence[Record], plants: Sequence[PlantSpec]) -> list[Contradiction]:
    """What the logs of one vehicle say against themselves.

    Args:
        records: of one vehicle, or of none.
        plants: whose commands and responses are looked at where they are a vehicle's.
    """
    actuators = [p for p in plants if p.role != "plant"]
    signs = _turned_round(records)
    scale = [] if signs else _scaled(records)
    return [*signs, *scale, *(c for p in actuators for c in _swapped(records, p))]


def _turned_round(records: Sequence[Record]) -> list[Contradiction]:
    """Channels whose sign is another than the convention's: x ahead, y to the left, angles and yaw
    rates positive to the left. Where both yaw rate and heading are, the angle is."""
    vehicle = records[0].vehicle
    if vehicle is None or not all("v" in r and "delta" in r for r in records):
        return []
    bicycle = Bicycle.at_reference(vehicle)
    made = [np.asarray(bicycle.yaw_rate(r["v"], r["delta"])) for r in records]
    alike = {}
    for name in ("r", "psi"):
        if not all(name in record for record in records):
            continue
        pairs = [
            [
                moving_mean(x[None], _OVER, record.dt)[0][record.measured(name)[s.samples]]
                for x in (rate[s.samples], _turning(record[name][s.samples], name, record.dt))
            ]
            for rate, record in zip(made, records, strict=True)
            for s in record.segments
        ]
        one, other = (np.concatenate(parts) for parts in zip(*pairs, strict=True))
        if not one.size:
            continue
        spread = max(float(np.std(one) * np.std(other)), 1e-300)
        alike[name] = float(np.mean((one - one.mean()) * (other - other.mean()))) / spread
    against = [name for name, value in alike.items() if value < _AGAINST]
    if len(against) == 2:
        signs = " and ".join(f"[sign] {c} = -1" for c in ("delta_cmd", "delta"))
        numbers = " and ".join(f"{alike[name]:.2f}" for name in against)
        said = f"v and delta turn against r and psi (correlation {numbers}): {signs} would turn "
        return [Contradiction("delta", ("r", "psi"), ("r", "x", "y", "psi"), f"{said}them round.")]
    return [
        Contradiction(
            name,
            ("v", "delta"),
            ("r",) if name == "r" else ("x", "y", "psi"),
            f"{name} turns against what v and delta make (correlation {alike[name]:.2f}): "
            f"[sign] {name} = -1 would turn it round.",
        )
        for name in against
    ]


def _scaled(records: Sequence[Record]) -> list[Contradiction]:
    """Whether the yaw rate is the rate of the heading times a factor, as that of a gyroscope whose
    scale is off. Noise of the one and of the other bias the factor to either side, which bounds it.

    Source: Fuller, Measurement Error Models (1987), section 1.1.2.
    """
    if not all("r" in record and "psi" in record for record in records):
        return []
    r, psi, made = _turned(records)
    shared = float(r @ psi)
    if shared <= 0.0 or r.size < _FEWEST:
        return []
    low, high = shared / float(psi @ psi), float(r @ r) / shared
    if low < 1.0 + _SCALE and high > 1.0 - _SCALE:
        return []
    said = f"r is {np.sqrt(low * high):.2f} times the rate at which psi turns: "
    if made.size == r.size:  # which of the two goes with v and delta
        off = [abs(float(np.log(max(x @ made, 1e-300) / (made @ made)))) for x in (r, psi)]
        if off[0] < off[1]:
            why = "r goes with v and delta, and the pose was left aside."
            return [Contradiction("psi", ("r",), ("x", "y", "psi"), said + why)]
    why = "the scale or the unit of r is off, and r was left aside."
    return [Contradiction("r", ("psi",), ("r",), said + why)]


def _turned(records: Sequence[Record]) -> list[np.ndarray]:
    """How far the yaw rate, the heading and, where they are there, speed and angle turn over each
    second in which little was filled, rad, less the mean of each stretch without a gap: a rate may
    have a bias."""
    turns: list[list[np.ndarray]] = [[], [], []]
    for record in records:
        every = slice(None, None, max(1, round(_TURN / record.dt)))
        made, filled = None, ~(record.measured("r") & record.measured("psi"))
        if record.vehicle is not None and "v" in record and "delta" in record:
            filled |= ~(record.measured("v") & record.measured("delta"))
            bicycle = Bicycle.at_reference(record.vehicle)
            made = np.asarray(bicycle.yaw_rate(record["v"], record["delta"]))
        for part in (s.samples for s in record.segments):
            angles = [np.cumsum(record["r"][part]) * record.dt, np.unwrap(record["psi"][part])]
            angles += [] if made is None else [np.cumsum(made[part]) * record.dt]
            whole = np.diff(np.cumsum(filled[part])[every]) <= _FILLED * _TURN / record.dt
            for kept, angle in zip(turns, angles, strict=False):
                turn = np.diff(angle[every])[whole]
                kept.append(turn - turn.mean() if turn.size else turn)
    return [np.concatenate(own) if own else np.zeros(0) for own in turns]


def _turning(values: np.ndarray, name: str, dt: float) -> np.ndarray:
    """Rate of turn, rad/s."""
    return values if name == "r" else np.gradient(np.unwrap(values), dt)


def _swapped(records: Sequence[Record], plant: PlantSpec) -> list[Contradiction]:
    """Whether a command follows its response as a response follows a command."""
    if not all(plant.input in r and plant.output in r for r in records):
        return []
    parts = [(r, s.samples) for r in records for s in r.segments]
    u, y = ([r[c][part] for r, part in parts] for c in plant.channels)
    seen = [r.measured(plant.output)[part] for r, part in parts]
    late = max(round(_LATE / records[0].dt), 1)
    forward, backward = (1.0 - first_look(a, b, seen, late).explained for a, b in ((u, y), (y, u)))
    noise = np.mean([r.noise_std(plant.output) ** 2 for r in records]) / np.var(np.concatenate(y))
    if backward > _BACKWARD or forward - noise < _FORWARD * backward:  # no command tells noise
        return []
    said = (
        f"{plant.input} follows {plant.output} as a response follows a command (a lag leaves "
        f"{100.0 * backward:.1f} % of it, and {100.0 * forward:.1f} % the other way): "
        "are the two exchanged in [columns]?"
    )
    return [Contradiction(plant.output, (plant.input,), (), said)]
