"""Simulating a record with and without the identified dynamics, and scoring both."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import equinox as eqx
import numpy as np
from jaxtyping import ArrayLike

from ..data.record import Record
from ..errors import InputError
from ..identify.result import OrderGrid
from ..metrics import (
    Alignment,
    ate,
    fit,
    heading_error,
    mse,
    relative_pose_error,
    translation_error,
)
from ..model_file import Model, Plant
from ..models.linear_plant import REST_RECORDS
from ..models.transfer_function import TransferFunction
from ..simulate import RESULTS, Commands, Start, simulate
from ._nouns import POSE, SUCCESSFUL, Comparison, PoseErrors, Prediction, RelativeErrors, Score

START_TIME = 0.2
"""How much of the measured response, s, tells the state at a start."""


def compare(record: Record, model: Model, *, window: float = 20.0) -> Comparison:
    """Simulate a record by VDM and by VDM-SI and score both against it.

    VDM takes every command as followed at once (the speed, too, is the commanded one); VDM-SI puts
    the identified plants between. Both start from the first measured pose of each segment, and a
    plant starts so that it meets the first 0.2 s of its measured response. Whatever the log lacks
    is left out: without a pose there are responses only, and a single actuator is compared as well
    as a vehicle.

    Args:
        record: a log with the commands of the plants.
        model: what `load_model` read or `identified` made.
        window: length of the windows that are anchored anew, s.

    Raises:
        InputError: no plant of the model has its command in the record.
    """
    plants = {name: plant for name, plant in model.plants.items() if plant.spec.input in record}
    if not plants:
        asked = ", ".join(sorted({plant.spec.input for plant in model.plants.values()}))
        problem = f"has none of the model's commands ({asked})"
        raise InputError(record.name, "channels", problem, "name them in [columns]")
    present = Model(plants, record.vehicle or model.vehicle)
    predictions = {}
    for name, dynamics in (("VDM", False), ("VDM-SI", True)):
        channels, status = {}, SUCCESSFUL
        if _has_path(record, present):
            channels, status = _motion(record, present, dynamics)
        others = [plant for plant in plants.values() if plant.spec.output not in channels]
        channels |= _responses(record, others, dynamics)
        predictions[name] = _score(name, status, record, channels, window)
    floor = None
    if _has_path(record, present) and {"v", "delta"} <= set(record.channels):
        told = {**record.channels, "v_cmd": record["v"], "delta_cmd": record["delta"]}
        channels, status = _motion(replace(record, channels=told), present, dynamics=False)
        floor = _score("measured responses", status, record, channels, window)
    return Comparison(record, predictions, window, floor)


def identified(grids: Mapping[str, OrderGrid], orders: Mapping[str, str] | None = None) -> Model:
    """The models of an identification, ready to be simulated or saved.

    Args:
        grids: by the plants' names.
        orders: for some plants, another order than the chosen one, such as `{"steering": "P1Z0"}`.
    """
    fits = {name: grid[(orders or {}).get(name, grid.chosen)] for name, grid in grids.items()}
    plants = {
        name: Plant(fit.plant, fit.model) for name, fit in fits.items() if fit.model is not None
    }
    vehicles = [grid.record.vehicle for grid in grids.values()]
    return Model(plants, vehicles[0] if vehicles else None)


def _has_path(record: Record, model: Model) -> bool:
    """Whether a path can be simulated and compared: geometry, both commands, and a pose."""
    actuators = (model.plant("v_cmd", "v"), model.plant("delta_cmd", "delta"))
    needed = {"v_cmd", "delta_cmd", *POSE}
    return model.vehicle is not None and needed <= set(record.channels) and any(actuators)


def _padded(record: Record, channel: str) -> np.ndarray:
    """A channel segment by segment, (segments, longest), the last sample held: one shape, so that
    one compiled program serves every segment."""
    pieces = record.pieces(channel)
    longest = max(map(len, pieces))
    return np.stack([np.pad(piece, (0, longest - len(piece)), mode="edge") for piece in pieces])


def _joined(record: Record, rows: Sequence[ArrayLike]) -> np.ndarray:
    """The samples of the segments again one after another, the padding left out."""
    return np.concatenate(
        [np.asarray(row)[: len(s)] for row, s in zip(rows, record.segments, strict=True)]
    )


@eqx.filter_jit
def _run(model: TransferFunction, u, dt, x0):
    return model.simulate(u, dt, x0).y


def _starts(record: Record, plant: Plant) -> Sequence[np.ndarray | None]:
    """State of a plant at the start of each segment: at rest under that constant command which
    brings its response closest to the first `START_TIME` of the measured one. None, the
    simulation's own start, where the response was not measured or the plant has no rest."""
    rest = np.asarray(plant.model.to_plant().rest)
    slowest = float(plant.model.to_plant().slowest)
    if plant.spec.output not in record or slowest * record.duration * REST_RECORDS <= 1.0:
        return [None] * len(record.segments)
    rows = max(round(START_TIME / record.dt), 2)
    commands, measured = (
        _padded(record, channel)[:, :rows] for channel in (plant.spec.input, plant.spec.output)
    )
    found = []
    for u, y in zip(commands, measured, strict=True):
        forced, moved = (np.asarray(_run(plant.model, u, record.dt, c * rest)) for c in (0.0, 1.0))
        free = moved - forced
        found.append(rest * (free @ (y - forced)) / max(free @ free, 1e-30))
    return found


def _responses(record: Record, plants: Sequence[Plant], dynamics: bool) -> dict[str, np.ndarray]:
    """Predicted responses of the plants, each from its own command; a command that is followed at
    once must be of the response's kind to be comparable."""
    found = {}
    for plant in plants:
        spec = plant.spec
        if spec.output not in record:
            continue
        if dynamics:
            commands, starts = _padded(record, spec.input), _starts(record, plant)
            rows = [
                _run(plant.model, u, record.dt, x0) for u, x0 in zip(commands, starts, strict=True)
            ]
            found[spec.output] = _joined(record, rows)
        elif record.units[spec.input] == record.units[spec.output]:
            found[spec.output] = record[spec.input]
    return found


def _motion(record: Record, model: Model, dynamics: bool) -> tuple[dict[str, np.ndarray], str]:
    """Speed, angle, yaw rate and pose of the reference point over every segment, and the status."""
    vehicle = model.to_vehicle(dynamics=dynamics)
    actuators = (model.plant("v_cmd", "v"), model.plant("delta_cmd", "delta"))
    nothing = [None] * len(record.segments)
    powertrain, steering = (_starts(record, p) if p and dynamics else nothing for p in actuators)
    speeds, angles = _padded(record, "v_cmd"), _padded(record, "delta_cmd")
    trajectories = []
    for i, segment in enumerate(record.segments):
        x, y, psi = (record[name][segment.start] for name in POSE)
        start = Start(x, y, psi, powertrain=powertrain[i], steering=steering[i])
        trajectories.append(simulate(vehicle, Commands(speeds[i], angles[i], record.dt), start))
    failed = [t for t in trajectories if not bool(t.ok)]
    channels = {
        name: _joined(record, [getattr(t, name) for t in trajectories])
        for name in (*POSE, "v", "delta", "r")
    }
    return channels, str(RESULTS[failed[0].status]) if failed else SUCCESSFUL


def _score(
    name: str, status: str, record: Record, channels: Mapping[str, np.ndarray], window: float
) -> Prediction:
    """Set what was predicted against what was measured; filled-in samples do not count."""
    scores = {}
    for channel in channels:
        if channel in record and channel not in POSE:
            seen = record.measured(channel)
            y, y_hat = record[channel][seen], channels[channel][seen]
            scores[channel] = Score(float(fit(y, y_hat)), float(mse(y, y_hat)))
    if "x" not in channels or status != SUCCESSFUL:
        return Prediction(name, status, channels, scores)
    predicted = np.stack([channels[c] for c in POSE], axis=1)
    measured = np.stack([record[c] for c in POSE], axis=1)
    samples = max(round(window / record.dt), 1)
    anchors = np.concatenate(
        [s.start + np.arange(len(s)) // samples * samples for s in record.segments]
    )
    alone = len(record.segments) == 1
    return Prediction(
        name,
        status,
        channels,
        scores,
        whole=_errors(measured, predicted),
        windows=_errors(measured, _anchored(measured, predicted, anchors)),
        aligned=_plain(ate(measured, predicted, Alignment.SE2)) if alone else None,
        relative=_relative(measured, predicted) if alone else None,
    )


def _relative(measured: np.ndarray, predicted: np.ndarray) -> RelativeErrors | None:
    """Errors over stretches of about a tenth of the way, rounded down to 1, 2 or 5 times a power of
    ten; None for a vehicle that stands."""
    way = float(np.hypot(*np.diff(measured[:, :2], axis=0).T).sum())
    if not way > 0.0:
        return None
    power = 10.0 ** np.floor(np.log10(0.1 * way))
    distance = float(power * max(d for d in (1, 2, 5) if d * power <= 0.1 * way * (1 + 1e-9)))
    translation, heading = relative_pose_error(measured, predicted, distance=distance)
    return RelativeErrors(distance, _spread(translation), _spread(np.abs(heading)))


def _spread(errors: np.ndarray) -> dict[str, float]:
    rmse = np.sqrt(np.mean(errors**2))
    return _plain({"max": errors.max(), "mean": errors.mean(), "rmse": rmse})


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
        _plain(ate(measured, predicted, Alignment.NONE)),
    )


def _plain(numbers: Mapping[str, Any]) -> dict[str, float]:
    return {name: float(value) for name, value in numbers.items()}
