"""What each model says about a record: responses and motion, segment by segment."""

import enum
from collections.abc import Mapping, Sequence
from dataclasses import replace

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import ArrayLike, Float

from ..config import POSE
from ..data.record import Record
from ..data.segment import Segment
from ..effects import Signals
from ..model_file import Model, Plant
from ..models.extended_plant import ExtendedPlant, surroundings
from ..models.plant import AbstractPlant
from ..simulate import RESULTS, Commands, Start, resting_command, simulate
from ._nouns import SUCCESSFUL, has_pose

START_TIME = 0.2
"""How much of the measured response, s, tells the state at a start."""

_NEWTON_STEPS = 2  # of the search for a start where effects bend the response
_NUDGE = 1e-3  # of the command's size, for the difference in such a step


class Kind(enum.Enum):
    """The models that are compared; the value is the name that is shown."""

    VDM = "VDM"
    VDM_SI = "VDM-SI"
    EXTENDED = "extended"

    def of(self, plant: Plant) -> AbstractPlant:
        """What simulates a plant, where its dynamics are wanted."""
        return plant.model if self is Kind.EXTENDED else plant.plain


def drives(record: Record, model: Model) -> bool:
    """Whether a motion can be simulated: it takes the geometry and both commands."""
    actuators = (model.plant("v_cmd", "v"), model.plant("delta_cmd", "delta"))
    commanded = {"v_cmd", "delta_cmd"} <= set(record.channels)
    return model.vehicle is not None and commanded and any(actuators)


def responses(
    record: Record, model: Model, kind: Kind, known: Mapping[str, np.ndarray]
) -> dict[str, np.ndarray]:
    """Predicted responses of the plants, each from its own command; a command that is followed at
    once must be of the response's kind to be comparable.

    Args:
        record: the log.
        model: the plants.
        kind: how they are simulated.
        known: responses that are predicted already, and are left out; a steering hears the
            predicted speed.
    """
    found = {}
    for plant in sorted(model.plants.values(), key=lambda plant: plant.spec.output != "v"):
        spec = plant.spec
        if spec.output not in record or spec.output in known:
            continue
        if kind is not Kind.VDM:
            every = _heard(record, plant, kind, {**known, **found})
            commands = _padded(record, record[spec.input])
            starts = _starts(record, model, plant, every, kind)
            rows = [
                _run(one, u, jnp.asarray(record.dt), x0)
                for one, u, x0 in zip(every, commands, starts, strict=True)
            ]
            found[spec.output] = _joined(record, rows)
        elif record.units[spec.input] == record.units[spec.output]:
            found[spec.output] = record[spec.input]
    return found


def motion(record: Record, model: Model, kind: Kind) -> tuple[dict[str, np.ndarray], str]:
    """Speed, angle, yaw rate and pose of the reference point over every segment, and the status.

    Segments start at their measured pose; where none was measured a run starts at the origin, and
    goes on behind a gap from where it was.
    """
    vehicle = model.to_vehicle(dynamics=kind is not Kind.VDM, effects=kind is Kind.EXTENDED)
    speeds, angles = (_padded(record, record[name]) for name in ("v_cmd", "delta_cmd"))
    powertrain, steering = (
        _starts(record, model, plant, _heard(record, plant, kind, {}), kind)
        if plant and kind is not Kind.VDM
        else [None] * len(record.segments)
        for plant in (model.plant("v_cmd", "v"), model.plant("delta_cmd", "delta"))
    )
    posed, trajectories = has_pose(record.channels), []
    ends: dict[str, tuple[float, ...]] = {}  # of runs without a pose
    for i, (segment, known) in enumerate(zip(record.segments, _begun(record), strict=True)):
        pose = ends.get(segment.run, (0.0, 0.0, 0.0))
        if posed:
            pose = tuple(float(record[name][segment.start]) for name in POSE)
        if "psi" in record:
            pose = (*pose[:2], _heading(record, model, segment, kind))
        start = Start(*pose, powertrain=powertrain[i], steering=steering[i])
        commands = Commands(speeds[i], angles[i], record.dt, **known)
        trajectories.append(simulate(vehicle, commands, start))
        if not posed:
            last = len(segment) - 1
            ends[segment.run] = tuple(float(getattr(trajectories[-1], name)[last]) for name in POSE)
    failed = [t for t in trajectories if not bool(t.ok)]
    channels = {
        name: _joined(record, [getattr(t, name) for t in trajectories])
        for name in (*POSE, "v", "delta", "r")
    }
    return channels, str(RESULTS[failed[0].status]) if failed else SUCCESSFUL


def _heading(record: Record, model: Model, segment: Segment, kind: Kind) -> float:
    """Heading with which a segment begins: as measured, or, where a model knows its sensor, what
    that reads when it has come so late as it tells a steady turn, less what it adds to a heading
    that stays."""
    psi, rows = np.unwrap(record["psi"][segment.samples]), np.arange(float(record.n))
    if kind is not Kind.EXTENDED:
        return float(psi[0])
    bias, turned = (_measured(record, model, "psi", y)[-1] for y in (0.0 * rows, rows))
    return float(np.interp(rows[-1] + bias - turned, rows[: len(psi)], psi) - bias)


def sensed(
    record: Record, model: Model, channels: Mapping[str, np.ndarray]
) -> dict[str, np.ndarray]:
    """The channels with what their sensors add; a sensor of the pose is left out."""
    seen = dict(channels)
    for channel in {channel for channel, _ in model.sensors if channel in seen}:
        rows = _padded(record, seen[channel])
        seen[channel] = _joined(record, [_measured(record, model, channel, y) for y in rows])
    return seen


def _measured(record: Record, model: Model, channel: str, y: np.ndarray) -> np.ndarray:
    """What the sensor of a channel makes of evenly sampled values."""
    signals, seen = Signals.plain(len(y), record.dt), jnp.asarray(y)
    for name, effect in model.sensors:
        seen = effect.sensor(seen, signals) if name == channel else seen
    return np.asarray(seen)


def _padded(record: Record, values: np.ndarray) -> Float[np.ndarray, "segments longest"]:
    """Samples of a record segment by segment, the last one held: one shape, so that one compiled
    program serves every segment."""
    pieces = [values[segment.samples] for segment in record.segments]
    longest = max(map(len, pieces))
    return np.stack([np.pad(piece, (0, longest - len(piece)), mode="edge") for piece in pieces])


def _joined(record: Record, rows: Sequence[ArrayLike]) -> np.ndarray:
    """The samples of the segments again one after another, the padding left out."""
    return np.concatenate(
        [np.asarray(row)[: len(s)] for row, s in zip(rows, record.segments, strict=True)]
    )


def _begun(record: Record) -> list[dict[str, float]]:
    """How far its run has come where each segment begins: `since`, s, and `way`, m; and when it
    began in its `session`, s."""
    began: dict[str, float] = {}
    for segment in record.segments:
        began.setdefault(segment.run, float(record.t[segment.start]))
    way = record.travelled()
    return [
        {
            "since": float(record.t[segment.start]) - began[segment.run],
            "way": float(way[segment.start]),
            "session": record.session,
        }
        for segment in record.segments
    ]


def _heard(
    record: Record, plant: Plant, kind: Kind, known: Mapping[str, np.ndarray]
) -> list[AbstractPlant]:
    """The plant for each segment, told what goes on in it if it has effects. A powertrain hears its
    own command as the speed; others the predicted speed, else the measured or the commanded one."""
    model, spec = kind.of(plant), plant.spec
    if not isinstance(model, ExtendedPlant):
        return [model] * len(record.segments)
    channels = {**record.channels, **known}
    speeds, other = (("v_cmd",), "delta_cmd") if spec.output == "v" else (("v", "v_cmd"), "v_cmd")
    nothing = np.zeros(record.n)
    v = next((channels[name] for name in speeds if name in channels), nothing)
    rows = (_padded(record, values) for values in (v, channels.get(other, nothing)))
    return [
        model.hearing(surroundings(jnp.asarray(v), jnp.asarray(w), record.dt, **known))
        for v, w, known in zip(*rows, _begun(record), strict=True)
    ]


@eqx.filter_jit
def _run(plant: AbstractPlant, u, dt, x0):
    return plant.simulate(u, dt, x0).y


def _starts(
    record: Record, model: Model, plant: Plant, every: Sequence[AbstractPlant], kind: Kind
) -> Sequence[np.ndarray | None]:
    """State of a plant at the start of each segment: at rest under that constant command which
    brings its response closest to what was measured of the first `START_TIME`; where nothing was,
    as an angle that is told by a yaw rate is not while the vehicle stands, under the command with
    which the segment begins. None, the simulation's own start, where the plant has no rest."""
    linear = (plant.linear if kind is Kind.EXTENDED else plant.plain).to_plant()
    if not linear.rests(record.duration):
        return [None] * len(record.segments)
    rest = np.asarray(linear.rest)
    rows = max(round(START_TIME / record.dt), 2)
    nothing, output = np.zeros(record.n), plant.spec.output
    told = output in record
    channels = (
        record[plant.spec.input],
        record[output] if told else nothing,
        record.measured(output).astype(float) if told else nothing,
    )
    found = []
    for own, u, y, known in zip(every, *(_padded(record, c) for c in channels), strict=True):
        known = known[:rows] > 0.0
        if not known.any():
            found.append(rest * resting_command(u, record.dt))
            continue
        own, u, y = _first(own, len(known)), u[:rows], y[:rows][known]

        def response(c: float, own=own, u=u, known=known) -> np.ndarray:
            moved = np.asarray(_run(own, u, jnp.asarray(record.dt), c * rest))
            if kind is Kind.EXTENDED:
                moved = _measured(record, model, output, moved)
            return moved[known]

        forced = response(0.0)
        best = _toward(forced, response(1.0) - forced, y)
        if isinstance(own, ExtendedPlant):
            best = _bent(response, best, y, _NUDGE * max(float(np.ptp(u)), abs(best), 1e-9))
        found.append(rest * best)
    return found


def _first(plant: AbstractPlant, rows: int) -> AbstractPlant:
    """A plant that has heard the first rows only."""
    if not isinstance(plant, ExtendedPlant) or plant.told is None:
        return plant
    told = plant.told
    cut = {name: getattr(told, name)[:rows] for name in ("t", "v", "other", "distance")}
    return plant.hearing(replace(told, **cut))


def _toward(now: np.ndarray, free: np.ndarray, y: np.ndarray) -> float:
    """How much of `free` brings `now` closest to `y`."""
    return float(free @ (y - now)) / max(float(free @ free), 1e-30)


def _bent(response, c: float, y: np.ndarray, nudge: float) -> float:
    """A start for a response that is no straight function of it: from `c` on by Gauss-Newton steps
    as long as they help."""
    now = response(c)
    for _ in range(_NEWTON_STEPS):
        ahead = c + _toward(now, (response(c + nudge) - now) / nudge, y)
        then = response(ahead)
        if not np.sum((y - then) ** 2) < np.sum((y - now) ** 2):
            break
        c, now = ahead, then
    return c
