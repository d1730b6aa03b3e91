"""The logs of one car: who makes them, what they are called, and where they are kept."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ..data.read import read_log
from ..data.record import Record
from ..errors import InputError
from ..files import output_folder, write_text
from ..scenarios import PAPER_DURATION, paper_powertrain_steps, paper_steering_steps, random_steps
from ..testbed import ROW, Car, Causes, Driver, drive, replay, vehicle_toml, write_log
from ..testbed.picture import look
from .course import COURSES, Course, Pursuer, ramped, stepped

SHIPPED = Path(__file__).parent / "recorded"
"""Logs that `vdmsi reproduce --engine` made, part of the package."""

STEPS = ("powertrain_steps", "steering_steps")
"""The two experiments of figure 3."""

DRIVES = ("drive_1", "drive_2")
"""Mixed driving, which a diagnosis sees beside the steps; no course is among it."""

_MIXED_DURATION = 40.0  # s
_MIXED_RAMP = 1.5  # m/s²


@dataclass(frozen=True)
class Trim:
    """A car that the experiments are made with.

    Attributes:
        name: folder of its logs.
        title: for readers.
        car: what drives.
        seed: of its sensor's noise; each drive has one of its own above it.
    """

    name: str
    title: str
    car: Car
    seed: int


TRIMS = (
    Trim("sound", "the car as it was built", Car(), 100),
    Trim(
        "worn",
        "the same car with play in its steering, and commands that arrive late",
        Car(causes=Causes(steering_play=0.05, steering_friction=25.0, command_delay=0.08)),
        200,
    ),
)


def start_name(course: Course) -> str:
    """Name of the drive along a course whose speed command is a step."""
    return f"{course.name}_step"


def make_logs(trim: Trim, folder: Path, told: Callable[[str], None]) -> None:
    """Drive the car for everything but the closed loop, and write `vehicle.toml` and the logs.

    Raises:
        InputError: MuJoCo is not installed, or the folder cannot be written.
    """
    output_folder(folder)
    write_text(folder / "vehicle.toml", vehicle_toml(trim.car))
    for i, (name, (duration, driver)) in enumerate(_drives(trim).items()):
        told(f"driving the {trim.name} car: {name}")
        done = drive(trim.car, driver, duration=duration, seed=trim.seed + i)
        write_log(folder / f"{name}.csv", done.log())


def _drives(trim: Trim) -> dict[str, tuple[float, Driver]]:
    """Duration (s) and driver of every log."""
    steps = (paper_powertrain_steps(), paper_steering_steps())
    plan: dict[str, tuple[float, Driver]] = {
        name: (PAPER_DURATION, replay(np.asarray(c.v_cmd), np.asarray(c.delta_cmd)))
        for name, c in zip(STEPS, steps, strict=True)
    }
    for seed, name in enumerate(DRIVES, start=1):
        plan[name] = (_MIXED_DURATION, replay(*mixed(seed)))
    geometry, limit = trim.car.dimensions.geometry, trim.car.dimensions.max_steering
    for course in COURSES:
        rows = round(course.duration / ROW) + 1
        for name, speed in ((course.name, ramped), (start_name(course), stepped)):
            pursuer = Pursuer(course, geometry, limit=limit, rows=rows, speed=speed)
            plan[name] = (course.duration, pursuer)
    return plan


def mixed(seed: int) -> tuple[np.ndarray, np.ndarray]:
    """Commands of mixed driving: ramps of the speed between 1 and 15 km/h's 4.2 m/s, steps of the
    angle of all sizes; (N,) m/s and (N,) rad."""
    timing = {"duration": _MIXED_DURATION, "dt": ROW}
    levels = random_steps([1.0, 2.5, 4.2, 3.3], dwell=(4.0, 8.0), seed=seed, **timing)
    v = np.empty_like(levels)
    speed = 0.0
    for k, level in enumerate(levels):
        v[k] = speed
        speed += np.clip(level - speed, -_MIXED_RAMP * ROW, _MIXED_RAMP * ROW)
    angles = [0.0, 0.08, -0.15, 0.22, -0.05, 0.15, -0.22]
    return v, random_steps(angles, dwell=(0.6, 2.2), seed=seed + 10, **timing)


def read_logs(folder: Path) -> Mapping[str, Record]:
    """The records of one car, by name.

    Raises:
        InputError: a log is missing or refused.
    """
    names = [*STEPS, *DRIVES, *(n for c in COURSES for n in (c.name, start_name(c)))]
    if not (folder / "vehicle.toml").is_file():
        mend = "make them with `vdmsi reproduce --engine`"
        raise InputError(str(folder), "vehicle.toml", "there are no logs here", mend)
    return {name: read_log(folder / f"{name}.csv", folder / "vehicle.toml") for name in names}


def look_file(folder: Path, course: Course) -> Path:
    """Where the picture of the car on a course is kept, beside the folders of the cars."""
    return folder / f"look_{course.name}.png"


def make_looks(folder: Path, logs: Mapping[str, Record]) -> str | None:
    """Draw the car before, in and after the bend of each course; None, or why it cannot be."""
    for course in COURSES:
        record = logs[course.name]
        poses = np.stack([record[c] for c in ("x", "y", "psi")], axis=1)
        marks = (course.entrance, 0.5 * (course.entrance + course.exit), course.exit + 5.0)
        progress = course.progress(poses)
        rows = [int(np.argmax(progress >= mark)) for mark in marks]
        moments = np.column_stack([poses, record["delta_cmd"]])[rows]
        refused = look(look_file(folder, course), course.path(), moments)
        if refused is not None:
            return refused
    return None


def looks(folder: Path) -> dict[str, bytes]:
    """The pictures that there are, as PNG, by the course's name."""
    files = {course.name: look_file(folder, course) for course in COURSES}
    return {name: file.read_bytes() for name, file in files.items() if file.is_file()}


def run_file(folder: Path, course: Course, model: str) -> Path:
    """Where a closed-loop run is kept."""
    return folder / f"closed_{course.name}.{model}.csv"


def read_run(path: Path) -> dict[str, np.ndarray]:
    """The columns of a recorded closed-loop run.

    Raises:
        InputError: it is not there or no table of numbers.
    """
    try:
        head, *_ = path.read_text(encoding="utf-8").split("\n", 1)
        table = np.loadtxt(path, delimiter=",", skiprows=1, ndmin=2)
    except FileNotFoundError:
        mend = "record it with `vdmsi reproduce --engine`"
        raise InputError(str(path), "", "there is no such run", mend) from None
    except ValueError as error:
        raise InputError(str(path), "", f"no table ({error})", "record the run anew") from None
    return dict(zip(head.split(","), table.T, strict=True))
