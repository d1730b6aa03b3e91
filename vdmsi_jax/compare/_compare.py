"""Simulating a record by each model, and scoring all of them."""

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from ..config import POSE
from ..data.record import Record, Segment
from ..errors import InputError, nearest
from ..identify.acceleration import measures_acceleration, speed_response
from ..identify.result import Fit, OrderGrid, model_of
from ..metrics import (
    Alignment,
    fit,
    heading_error,
    mse,
    relative_pose_error,
    spread,
    translation_error,
)
from ..model_file import Model, Plant
from ..programs import make_room
from ._nouns import (
    SUCCESSFUL,
    Comparison,
    PoseErrors,
    Prediction,
    RelativeErrors,
    Score,
    has_pose,
)
from ._predict import Kind, drives, motion, responses, sensed


def compare(record: Record, model: Model, *, window: float = 20.0) -> Comparison:
    """Simulate a record by VDM, by VDM-SI and by the extended model and score all against it.

    VDM takes every command as followed at once (the speed, too, is the commanded one); VDM-SI puts
    the identified plants between; a model with effects is simulated with them, too, under the name
    `extended`, and what its sensors add is in the responses that are predicted (a delay of the pose
    is not). All start from the first measured pose of each segment, and a plant starts so that it
    meets the first 0.2 s of its measured response. Whatever the log lacks is left out: without a
    pose the path starts at the origin and has no errors, commands alone are driven and compared
    with nothing, and a single actuator is compared as well as a vehicle.

    Args:
        record: a log with the commands of the plants.
        model: what `load_model` read or `identified` made.
        window: length of the windows that are anchored anew, s. What is left behind the last whole
            one of a segment is a window of its own if it is at least half as long, and else a part
            of that one.

    Raises:
        InputError: it is no model, no plant of it has its command in the record, or the window has
            no length.
    """
    if not isinstance(record, Record):
        mend = "give one record; call compare for each of several"
        raise InputError("record", "", f"{type(record).__name__} is no record", mend)
    if not isinstance(model, Model):
        mend = "give a model, as load_model reads and identified makes it"
        raise InputError("model", "", f"{type(model).__name__} is no model", mend)
    if not window > 0.0:
        mend = "give seconds, more than zero"
        raise InputError("window", "", f"{window} is no duration", mend)
    make_room()
    plants = {name: plant for name, plant in model.plants.items() if plant.spec.input in record}
    if not model.plants:
        mend = "give one that was made of logs whose commands change"
        raise InputError("model", "plants", "it has no actuator to simulate", mend)
    if not plants:
        asked = ", ".join(sorted({plant.spec.input for plant in model.plants.values()}))
        problem = f"has none of the model's commands ({asked})"
        raise InputError(record.source, "channels", problem, "name them in [columns]")
    present = replace(model, plants=plants, vehicle=record.vehicle or model.vehicle)
    predictions, moved, kind = {}, {}, Kind.VDM
    for kind in Kind if present.extended else (Kind.VDM, Kind.VDM_SI):
        channels, status = {}, SUCCESSFUL
        if drives(record, present):
            moved, status = motion(record, present, kind)
            channels = dict(moved)
        channels |= responses(record, present, kind, channels)
        if kind is Kind.EXTENDED:
            channels = sensed(record, present, channels)
        predictions[kind.value] = _score(kind.value, status, record, channels, window)
    if not (drives(record, present) and {"v", "delta", *POSE} <= set(record.channels)):
        return Comparison(record, predictions, window)

    def driven(name: str, kind: Kind, v: np.ndarray, delta: np.ndarray) -> Prediction:
        """The bicycle alone, with these responses in place of the actuators'."""
        moving = {"v_cmd": _midway(record, v), "delta_cmd": _midway(record, delta)}
        told = replace(record, channels={**record.channels, **moving})
        channels, status = motion(told, replace(present, plants={}), kind)
        return _score(name, status, record, channels, window)

    v, delta = record["v"], record["delta"]
    return Comparison(
        record,
        predictions,
        window,
        floor=driven("measured responses", kind, v, delta),
        with_measured={
            "v": driven("measured v", kind, v, moved["delta"]),
            "delta": driven("measured delta", kind, moved["v"], delta),
        }
        if predictions[kind.value].ok
        else {},
    )


def _midway(record: Record, response: np.ndarray) -> np.ndarray:
    """What to hold from each sample to the next in place of a response that moves on between."""
    ahead = np.append(response[1:], response[-1])
    ends = [segment.stop - 1 for segment in record.segments]
    ahead[ends] = response[ends]
    return 0.5 * (response + ahead)


def identified(
    grids: Mapping[str, OrderGrid | Fit], orders: Mapping[str, str] | None = None
) -> Model:
    """The models of an identification, ready to be simulated or saved. A powertrain that was
    identified by its acceleration becomes the one whose speed makes it.

    Args:
        grids: by the plants' names; of a plant, a fit stands for itself, without a vehicle.
        orders: for some plants, another order than the chosen one, such as `{"steering": "P1Z0"}`.

    Raises:
        InputError: a plant goes by another name or has no model of that order, or an order is given
            for none of them.
        KeyError: the grid has no such order.
    """
    orders, plants = orders or {}, {}
    for name in orders.keys() - grids.keys():
        raise InputError("orders", name, "no such plant was identified", nearest(name, grids))
    for name, grid in grids.items():
        fit = grid if isinstance(grid, Fit) else grid[orders.get(name, grid.chosen)]
        if name != fit.plant.name:
            problem, mend = f"is the plant {fit.plant.name}", f"give it as {fit.plant.name!r}"
            raise InputError("grids", name, problem, mend)
        plants[name] = _plant(fit)
    vehicles = [grid.record.vehicle for grid in grids.values() if isinstance(grid, OrderGrid)]
    return Model(plants, vehicles[0] if vehicles else None)


def _plant(fit: Fit) -> Plant:
    """What is simulated: of an identified acceleration, the speed that makes it."""
    model = model_of(fit)
    if measures_acceleration(fit.plant):
        return Plant(replace(fit.plant, output="v"), speed_response(fit).model)
    return Plant(fit.plant, model)


def _score(
    name: str, status: str, record: Record, channels: Mapping[str, np.ndarray], window: float
) -> Prediction:
    """Set what was predicted against what was measured; filled-in samples do not count."""
    scores, posed = {}, has_pose(channels.keys() & set(record.channels))
    moved = has_pose(channels.keys())  # else `y` is a response of a plant of its own
    # a pose has errors, and half of one no start
    unscored = POSE if posed else ("x", "y") if moved else ()
    for channel in channels:
        if channel in record and channel not in unscored:
            seen = record.measured(channel)
            y, y_hat = record[channel][seen], channels[channel][seen]
            scores[channel] = Score(float(fit(y, y_hat)), float(mse(y, y_hat)))
    if not posed or status != SUCCESSFUL:
        return Prediction(name, status, channels, scores)
    predicted = np.stack([channels[c] for c in POSE], axis=1)
    measured = np.stack([record[c] for c in POSE], axis=1)
    samples = max(round(min(window / record.dt, record.n)), 1)
    anchors = np.concatenate([s.start + _window_starts(len(s), samples) for s in record.segments])
    return Prediction(
        name,
        status,
        channels,
        scores,
        whole=_errors(measured, predicted),
        windows=_errors(measured, _anchored(measured, predicted, anchors)),
        aligned=_aligned(measured, predicted, record.segments),
        relative=_relative(measured, predicted, record.segments),
    )


def _window_starts(rows: int, samples: int) -> np.ndarray:
    """First row of the window of each of a segment's rows: windows of so many samples, of which the
    last takes in what is shorter than half of one."""
    last = max((2 * rows + samples) // (2 * samples) - 1, 0)
    return np.minimum(np.arange(rows) // samples, last) * samples


def _aligned(
    measured: np.ndarray, predicted: np.ndarray, segments: Sequence[Segment]
) -> dict[str, float]:
    """Errors after the best rigid motion of each segment onto its measured path."""
    apart = [
        np.asarray(translation_error(measured[s.samples], predicted[s.samples], Alignment.SE2))
        for s in segments
    ]
    return spread(np.concatenate(apart))


def _relative(
    measured: np.ndarray, predicted: np.ndarray, segments: Sequence[Segment]
) -> RelativeErrors | None:
    """Errors over stretches of about a tenth of the longest segment's way, rounded down to 1, 2 or
    5 times a power of ten; None for a vehicle that stands."""
    ways = [float(np.hypot(*np.diff(measured[s.samples, :2], axis=0).T).sum()) for s in segments]
    way = max(ways)
    if not way > 0.0:
        return None
    power = 10.0 ** np.floor(np.log10(0.1 * way))
    distance = float(power * max(d for d in (1, 2, 5) if d * power <= 0.1 * way * (1 + 1e-9)))
    errors = [
        relative_pose_error(measured[s.samples], predicted[s.samples], distance=distance)
        for s, own in zip(segments, ways, strict=True)
        if own >= distance
    ]
    translation, heading = (np.concatenate(parts) for parts in zip(*errors, strict=True))
    return RelativeErrors(distance, spread(translation), spread(heading))


def _anchored(measured: np.ndarray, predicted: np.ndarray, anchors: np.ndarray) -> np.ndarray:
    """The predicted motion since each sample's anchor, begun at the pose measured there, (N, 3)."""
    turn = (measured - predicted)[anchors, 2]
    c, s = np.cos(turn), np.sin(turn)
    dx, dy = (predicted - predicted[anchors])[:, :2].T
    moved = np.stack([c * dx - s * dy, s * dx + c * dy], axis=1) + measured[anchors, :2]
    return np.column_stack([moved, predicted[:, 2] + turn])


def _errors(measured: np.ndarray, predicted: np.ndarray) -> PoseErrors:
    return PoseErrors(
        np.asarray(translation_error(measured, predicted, Alignment.NONE)),
        np.asarray(heading_error(measured, predicted, Alignment.NONE)),
    )
