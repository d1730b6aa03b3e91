"""The paper's section 5 with one car after the other."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ..diagnose import Diagnosis, diagnose
from ..files import read_json, write_json
from ..model_file import Model
from ..models.vehicle import Vehicle
from ..testbed import write_log
from .closed_loop import ClosedLoop, judge, record_run
from .course import COURSES, Course
from .identification import Identification, identify_actuators
from .logs import (
    DRIVES,
    STEPS,
    TRIMS,
    Trim,
    make_logs,
    make_looks,
    read_logs,
    read_run,
    run_file,
    start_name,
)
from .open_loop import OpenLoop, open_loop

NAMED = "diagnosis.json"
"""File beside the logs of a car: the diagnosis whose extended model drove without sensors."""

KEYS = {"VDM": "vdm", "VDM-SI": "vdm_si", "extended": "extended"}
"""How models are called in names of files and keys."""


@dataclass(frozen=True)
class Experiments:
    """Everything that was found with one car.

    Attributes:
        trim: the car.
        identification: section 5.1, figures 4 and 5, table 2.
        diagnosis: what else is wrong with it, from driving that is neither steps nor a course.
        open_loop: table 3, by course.
        closed_loop: figure 7, by course and model.
        driven_with: what was known of the car when the closed loop was driven, as `named` tells it;
            None if that was not kept.
    """

    trim: Trim
    identification: Identification
    diagnosis: Diagnosis
    open_loop: Mapping[str, OpenLoop]
    closed_loop: Mapping[str, Mapping[str, ClosedLoop]]
    driven_with: Mapping[str, Any] | None = None

    @property
    def extended(self) -> Model | None:
        """The model with the causes that the diagnosis named, if it named any."""
        return extended_model(self.diagnosis)


def named(diagnosis: Diagnosis) -> dict[str, Any]:
    """What was found, as plain numbers with their units."""
    return {
        "verdict": diagnosis.verdict,
        "summary": diagnosis.summary,
        "findings": [
            {
                "cause": finding.cause,
                "where": finding.where,
                "parameters": {
                    name: {"value": own.value, "std": own.std, "unit": own.unit}
                    for name, own in finding.parameters.items()
                },
            }
            for finding in diagnosis.findings
        ],
    }


def extended_model(diagnosis: Diagnosis) -> Model | None:
    """The extended model, where there is a finding; what is minor alone makes none."""
    return diagnosis.model if diagnosis.findings else None


def reproduce(
    folder: Path,
    *,
    engine: bool = False,
    told: Callable[[str], None] = lambda _: None,
    trims: Sequence[Trim] = TRIMS,
) -> list[Experiments]:
    """Make the paper's experiments with every car.

    Args:
        folder: of the logs, one folder in it per car.
        engine: drive the cars first, and write the logs into `folder`; else they are read.
        told: is called with what is being done.
        trims: the cars.

    Raises:
        InputError: a log is missing or refused; or MuJoCo is not installed, and `engine` asks for
            it.
    """
    found = [_one(trim, folder / trim.name, engine, told) for trim in trims]
    if engine:
        told("taking pictures")
        make_looks(folder, read_logs(folder / trims[0].name))
    return found


def _one(trim: Trim, folder: Path, engine: bool, told: Callable[[str], None]) -> Experiments:
    if engine:
        make_logs(trim, folder, told)
    logs = read_logs(folder)
    told(f"identifying the {trim.name} car")
    found = identify_actuators([logs[name] for name in STEPS])
    told(f"diagnosing the {trim.name} car")
    diagnosis = diagnose([logs[name] for name in DRIVES])
    if engine:
        write_json(folder / NAMED, named(diagnosis))
    extended = extended_model(diagnosis)
    models = {"VDM": found.model.to_vehicle(dynamics=False), "VDM-SI": found.model.to_vehicle()}
    if extended is not None:
        models["extended"] = extended.to_vehicle()
    opened, closed = {}, {}
    for course in COURSES:
        told(f"comparing on the {course.title}, {trim.name} car")
        acceleration = trim.car.dimensions.max_acceleration
        drives = logs[course.name], logs[start_name(course)]
        opened[course.name] = open_loop(course, *drives, models, acceleration)
        closed[course.name] = _closed(trim, folder, course, models, engine, told)
    kept = folder / NAMED
    driven_with = read_json(kept) if kept.is_file() else None
    return Experiments(trim, found, diagnosis, opened, closed, driven_with)


def _closed(
    trim: Trim,
    folder: Path,
    course: Course,
    models: Mapping[str, Vehicle],
    engine: bool,
    told: Callable[[str], None],
) -> dict[str, ClosedLoop]:
    """Every model as the only source of pose, recorded or read."""
    runs = {}
    for i, (name, vehicle) in enumerate(models.items()):
        path = run_file(folder, course, KEYS[name])
        if engine:
            told(f"cutting the sensors of the {trim.name} car: {course.name} by {name}")
            write_log(path, record_run(trim.car, course, vehicle, seed=trim.seed + 50 + i))
        runs[name] = judge(name, course, read_run(path))
    return runs
