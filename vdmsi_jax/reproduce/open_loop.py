"""Table 3: where the models think the car went, given nothing but its commands."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from ..config import POSE
from ..data.record import Record
from ..metrics import Alignment, aligned, ate, fit, heading_error, translation_error
from ..models.commands import Commands
from ..models.vehicle import Vehicle
from ..simulate import at_rest, simulate
from .course import Course
from .vdm import Rule, rules

STATISTICS = ("max", "mean", "rmse")


@dataclass(frozen=True)
class Estimate:
    """Where one model thinks the car went, from the entrance of the bend on.

    Attributes:
        poses: laid on the measured pose at the entrance, (N, 3).
        error: distance to the measured position, m.
        heading: error of the heading, rad.
        ate: max, mean and rmse of `error`, m.
        from_rest: the same of the whole drive, laid on the first pose.
        fit: FIT of speed and yaw rate over the whole drive, percent.
    """

    poses: Float[np.ndarray, "N 3"]
    error: Float[np.ndarray, " N"]
    heading: Float[np.ndarray, " N"]
    ate: Mapping[str, float]
    from_rest: Mapping[str, float]
    fit: Mapping[str, float]


@dataclass(frozen=True)
class OpenLoop:
    """One course driven by sensors, and what each model made of its commands.

    Attributes:
        course: what was driven.
        record: the whole drive, from rest.
        t: time since the car came to the bend, s.
        measured: its poses from there on.
        at_exit: row of them at which it passes the end of the last arc.
        estimates: by model.
        rules: ATE of VDM from rest by each rule for its speed, for the ramped (`ramp`) and for the
            stepped (`step`) speed command.
    """

    course: Course
    record: Record
    t: Float[np.ndarray, " N"]
    measured: Float[np.ndarray, "N 3"]
    at_exit: int
    estimates: Mapping[str, Estimate]
    rules: Mapping[str, Mapping[Rule, Mapping[str, float]]]


def gain(before: float, after: float) -> float:
    """By how much of itself an error fell, percent."""
    return 100.0 * (1.0 - after / before)


def open_loop(
    course: Course,
    drive: Record,
    start: Record,
    vehicles: Mapping[str, Vehicle],
    acceleration: float,
) -> OpenLoop:
    """Let every model follow the commands of a drive along a course.

    The models are at rest with the car, under the command with which the drive begins, and hear
    every one from there on. As in the paper the errors count from the bend on, where each path is
    laid on the measured pose.

    Args:
        course: what was driven.
        drive: along it, with a ramped speed command.
        start: likewise, with a stepped one.
        vehicles: by the models' names.
        acceleration: greatest of the vehicle, m/s².
    """
    poses = np.stack([drive[c] for c in POSE], axis=1)
    progress = course.progress(poses)
    entered = int(np.argmax(progress >= course.entrance))
    passed = progress[entered:] >= course.exit
    told = {
        name: rules(record, acceleration) for name, record in (("ramp", drive), ("step", start))
    }
    return OpenLoop(
        course,
        drive,
        drive.t[entered:] - drive.t[entered],
        poses[entered:],
        int(np.argmax(passed)) if passed.any() else len(passed) - 1,
        {name: _estimate(vehicle, drive, poses, entered) for name, vehicle in vehicles.items()},
        told,
    )


def _estimate(
    vehicle: Vehicle, drive: Record, poses: Float[np.ndarray, "N 3"], entered: int
) -> Estimate:
    commands, (x, y, psi) = Commands.of(drive), poses[0]
    motion = simulate(vehicle, commands, at_rest(vehicle, commands, x=x, y=y, psi=psi))
    path, truth = np.asarray(motion.poses), poses[entered:]
    return Estimate(
        np.asarray(aligned(truth, path[entered:], Alignment.START)),
        np.asarray(translation_error(truth, path[entered:], Alignment.START)),
        np.asarray(heading_error(truth, path[entered:], Alignment.START)),
        _plain(ate(truth, path[entered:], Alignment.START)),
        _plain(ate(poses, path, Alignment.NONE)),
        {name: float(fit(drive[name], np.asarray(getattr(motion, name)))) for name in ("v", "r")},
    )


def _plain(numbers: Mapping) -> dict[str, float]:
    return {name: float(value) for name, value in numbers.items()}
