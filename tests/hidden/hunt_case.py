"""One case from its drive to a line of results: what was hidden, how loud it was, what was said.

The loudness is NumPy's alone. `energy` of a channel is the energy of what the cause did to it, in
units of innovations: its change (`runs - clean_runs`) behind the autoregressive filter that whitens
the clean residual (`clean_runs` less the response of the clean twin), in the runs that are fitted.
That is before projection: what a baseline could absorb is still in it. `lambda0` is what remains
behind a projection off what a linear baseline of five freedoms could say instead: of an actuator
the Laguerre filters of its command, of the yaw rate its rate (a lag); summed over the channels of
the stage in which the cause sits, since what it does downstream follows from those.
"""

import math
import time
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from .generator import Case, Drive, generate, siso
from .hunt_plan import Task

WINDOW = 0.5  # s, of an increment of the pose
ORDER, POSE_ORDER = 30, 4  # of the autoregressive filters
POSE = ("turned", "forward", "aside")
FREEDOMS = 5  # of a linear baseline
NEAREST = 5  # rivals of a finding that are kept with what they lack
_STAGE = {"powertrain": ("v",), "steering": ("delta",), "vehicle": ("r", *POSE), "plant": ("y",)}
_SENSORS = {"v": ("v",), "delta": ("delta",), "r": ("r",), "pose": POSE}
_IN_SPEED = ("drag", "road_grade")

Line = dict


def made(tasks: Sequence[Task]) -> list[tuple[Task, Drive, Drive, Drive | None]]:
    """Of each task its drive, the clean twin, and for a pair the drive of its first cause alone."""
    wanted: dict[tuple[Case, bool], Drive] = {}
    for task in tasks:
        for case in _needed(task):
            wanted[case, task.plant] = None  # type: ignore[assignment]
    for plant, make in ((False, generate), (True, siso)):
        cases = [case for case, of_plant in wanted if of_plant == plant]
        for case, drive in zip(cases, make(cases), strict=True):
            wanted[case, plant] = drive
    found = []
    for task in tasks:
        drive, twin, *alone = (wanted[case, task.plant] for case in _needed(task))
        same = zip(drive.clean_runs, twin.runs, strict=True)
        assert all(np.array_equal(a[name], b[name]) for a, b in same for name in a), task.key
        found.append((task, drive, twin, alone[0] if alone else None))
    return found


def _needed(task: Task) -> list[Case]:
    cause = task.case.cause
    cases = [task.case, replace(task.case, cause=())]
    return [*cases, replace(task.case, cause=cause[:1])] if len(cause) == 2 else cases


def records(drive: Drive) -> list:
    """The runs of a drive as the package takes them."""
    import vdmsi_jax as vj

    if drive.geometry:
        how = {"vehicle": vj.VehicleGeometry(*drive.geometry)}
    else:
        how = {"plants": (vj.PlantSpec("plant", "u", "y"),)}
    return [
        vj.Record.from_arrays(
            dt=drive.dt, name=f"run_{i}", **how, **{k: x for k, x in run.items() if k != "t"}
        )
        for i, run in enumerate(drive.runs, start=1)
    ]


def examined(task: Task, drive: Drive, twin: Drive, alone: Drive | None, diagnose) -> Line:
    """The line of one case; a crash of the diagnosis is a line too."""
    line = hidden(task, drive, twin, alone)
    began = time.perf_counter()
    try:
        line |= answer(diagnose(records(drive)))
    except Exception as why:  # whatever it is, the hunt goes on and counts it
        line["error"] = f"{type(why).__name__}: {why}"[:500]
    line["seconds"] = round(time.perf_counter() - began, 2)
    return line


def hidden(task: Task, drive: Drive, twin: Drive, alone: Drive | None) -> Line:
    """What was hidden in a drive, how loud it is, and what could be gained by finding it."""
    case, loudness = task.case, energies(drive.runs, drive.clean_runs, twin)
    truths = []
    for k, cause in enumerate(drive.truth.causes):
        own = loudness
        if alone is not None:
            pair = (drive.runs, alone.runs) if k else (alone.runs, drive.clean_runs)
            own = energies(*pair, twin)
        channels = own_channels(cause)
        truths.append(
            {
                "cause": cause.word,
                "where": cause.where,
                "channel": cause.channel,
                "parameters": {n: v for n, (v, _) in cause.parameters.items() if math.isfinite(v)},
                "form": cause.form,
                "lambda0": sum(own[c][1] for c in channels),
                "before_projection": sum(own[c][0] for c in channels),
            }
        )
    commands = [run.get("v_cmd", run.get("u")) for run in drive.runs]
    return {
        "key": task.key,
        "kind": task.kind,
        "size": case.size,
        "seed": case.seed,
        "driving": case.driving,
        "repeat": case.repeat,
        "slowest": float(min(c.min() for c in commands)),
        "truth": truths,
        "energy": {c: raw for c, (raw, _) in loudness.items()},
        "lambda0": min((t["lambda0"] for t in truths), default=0.0),
        "attainable": attainable(drive),
    }


def own_channels(cause) -> tuple[str, ...]:
    """Channels of the stage in which a cause sits."""
    if cause.where == "sensor":
        return _SENSORS[cause.channel]
    return ("v",) if cause.word in _IN_SPEED else _STAGE[cause.where]


def attainable(drive: Drive) -> dict[str, float]:
    """FIT, percent, of the noise-free response with the cause on the run that is held out."""
    run, response = drive.runs[-1], drive.truth.response[-1]
    fits = {}
    for name in ("v", "delta", "r") if drive.geometry else ("y",):
        y, error = run[name], run[name] - response[name]
        spread = np.linalg.norm(y - y.mean())
        fits[name] = float(100.0 * (1.0 - np.linalg.norm(error) / spread))
    return fits


def energies(runs, others, twin: Drive) -> dict[str, tuple[float, float]]:
    """By channel the energy of what distinguishes `runs` from `others`, in innovations of `twin`'s
    residual, in all runs but the last third, which judge: before and behind the projection."""
    count = len(runs) - (max(1, round(len(runs) / 3)) if len(runs) > 1 else 0)
    vehicle = twin.geometry is not None

    def channels(tables):
        return [_channels(table, twin.dt, vehicle) for table in tables[:count]]

    with_, without = channels(runs), channels(others)
    clean, ideal = channels(twin.runs), channels(twin.truth.response)
    found = {}
    for name in clean[0]:
        noise = [a[name] - b[name] for a, b in zip(clean, ideal, strict=True)]
        change = [a[name] - b[name] for a, b in zip(with_, without, strict=True)]
        if any(x.any() for x in change):
            free = [_freedoms(twin, run, name) for run in range(count)]
            order = POSE_ORDER if name in POSE else ORDER
            found[name] = energy(change, noise, free, order)
        else:
            found[name] = 0.0, 0.0
    return found


def energy(
    change: list[np.ndarray], noise: list[np.ndarray], free: list[np.ndarray], order: int
) -> tuple[float, float]:
    """Sum of squares of `change` behind the filter that whitens `noise`, over its innovations'; the
    second one is of what the columns `free` (rows, n) cannot say."""
    rows = np.concatenate([_past(x, order) for x in noise])
    past, now = rows[:, 1:], rows[:, 0]
    taps, *_ = np.linalg.lstsq(past, now, rcond=None)
    variance = np.sum((now - past @ taps) ** 2) / (len(now) - order)

    def white(x):
        padded = _past(np.concatenate([np.zeros(order), x]), order)
        return padded[:, 0] - padded[:, 1:] @ taps

    seen = np.concatenate([white(x) for x in change])
    columns = [np.column_stack([white(c) for c in f.T]) for f in free if f.shape[1]]
    left = seen
    if columns:
        basis = np.concatenate(columns)
        left = seen - basis @ np.linalg.lstsq(basis, seen, rcond=None)[0]
    return float(seen @ seen / variance), float(left @ left / variance)


def _freedoms(twin: Drive, run: int, name: str) -> np.ndarray:
    """What a baseline can answer a change of this channel with, (rows, n)."""
    table, ideal = twin.runs[run], twin.truth.response[run]
    if name in POSE:
        return np.zeros((0, 0))
    if name == "r":
        return np.gradient(ideal["r"])[:, None]
    machine = twin.truth.machine
    of = {"v": ("v_cmd", "powertrain"), "delta": ("delta_cmd", "steering"), "y": ("u", None)}
    command, place = of[name]
    actuator = getattr(machine, place) if place else machine
    u = table[command] - (ideal[name][0] if place else table[command][0])
    return laguerre(u, float(np.exp(-twin.dt / actuator.time)))


def laguerre(u: np.ndarray, pole: float) -> np.ndarray:
    """The command behind the first Laguerre filters, (rows, FREEDOMS)."""
    columns = []
    for k in range(FREEDOMS):
        x = columns[-1] if k else u
        late = np.concatenate([[0.0], x[:-1]])
        fed = late - pole * x if k else late
        y = np.empty_like(u)
        state = 0.0
        for i, value in enumerate(fed):
            state = pole * state + value
            y[i] = state
        columns.append(y)
    return np.column_stack(columns)


def _past(x: np.ndarray, order: int) -> np.ndarray:
    """Rows of a value and the `order` values before it."""
    return np.lib.stride_tricks.sliding_window_view(x, order + 1)[:, ::-1]


def _channels(table, dt: float, vehicle: bool) -> dict[str, np.ndarray]:
    """The channels that a diagnosis fits: the pose as increments, end to end."""
    if not vehicle:
        return {"y": table["y"]}
    every = slice(None, None, max(1, round(WINDOW / dt)))
    x, y, psi = table["x"][every], table["y"][every], np.unwrap(table["psi"])[every]
    c, s, dx, dy = np.cos(psi[:-1]), np.sin(psi[:-1]), np.diff(x), np.diff(y)
    pose = {"turned": np.diff(psi), "forward": c * dx + s * dy, "aside": c * dy - s * dx}
    return {name: table[name] for name in ("v", "delta", "r")} | pose


def answer(diagnosis) -> Line:
    """What a diagnosis says, as plain data."""
    extended = diagnosis.extended
    return {
        "verdict": diagnosis.verdict,
        "findings": [_finding(f) for f in diagnosis.findings],
        "minor": [_finding(f) for f in diagnosis.minor],
        "unexplained": [
            {"channel": u.channel, "fraction": u.fraction, "test": u.test}
            for u in diagnosis.unexplained
        ],
        "orders": dict(diagnosis.orders),
        "fit": {c: [s.fit, extended[c].fit] for c, s in diagnosis.channels.items()},
    }


def _finding(f) -> dict:
    sizes = {n: [e.value, e.std] for n, e in f.parameters.items() if np.ndim(e.value) == 0}
    return {
        "cause": f.cause,
        "where": f.where,
        "channel": f.channel,
        "form": f.form,
        "parameters": {n: [x if math.isfinite(x) else None for x in p] for n, p in sizes.items()},
        "rivals": [[r.cause, r.where] for r in f.rivals if r.indistinguishable],
        "lacks": [[r.cause, r.where, r.deficit] for r in f.rivals[:NEAREST]],
        "statistic": f.statistic,
        "share": f.share,
        "gain": [f.gain.channel, f.gain.before, f.gain.after],
        "held_out": f.gain.held_out,
        "predicted": None if f.predicted_gain is None else f.predicted_gain.after,
        "experiment": bool(f.separating_experiment),
    }
