"""The paper's figures, and what belongs beside them."""

from collections.abc import Mapping

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Polygon

from ..data.record import Record
from ..reproduce import ClosedLoop, Experiments, OpenLoop
from ..reproduce.vdm import Rule
from ..testbed import Dimensions
from .style import COLOURS, INK, MUTED, WIDTH, colour, legend_above, styled

TRACK = "#8a93a0"
PROFILES = {
    "ramp": ("speed command rises by 1 m/s²", "#56b4e9"),
    "step": ("speed command is a step", "#d55e00"),
}
RULES = {
    Rule.VELOCITY: "speed = command",
    Rule.RATE_LIMITED: "towards the command,\nat most 4.5 m/s²",
    Rule.DIFFERENCE: "a = difference\nof the command",
    Rule.LIMITED_DIFFERENCE: "that difference,\ncut to 4.5 m/s²",
}


@styled
def step_inputs(powertrain: Record, steering: Record) -> Figure:
    """Figure 3: the steps that excite powertrain and steering, and what answered."""
    figure = Figure(figsize=(WIDTH, 4.6))
    above, below = figure.subplots(2, 1, sharex=True)
    panels = (
        (above, powertrain, "v", "speed v (m/s)", "(a) powertrain, the wheel straight"),
        (below, steering, "delta", "angle δ (rad)", "(b) steering, at 1 m/s"),
    )
    for axes, record, channel, label, title in panels:
        t = record.t - record.t[0]
        seen = np.where(record.measured(channel), record[channel], np.nan)
        axes.plot(t, seen, color=COLOURS["VDM-SI"], lw=0.8, label="measured")
        command = record[f"{channel}_cmd"]
        axes.plot(t, command, color=INK, lw=1.4, label="command", drawstyle="steps-post")
        axes.set_ylabel(label)
        axes.set_title(title)
    legend_above(above)
    below.set_xlabel("time t (s)")
    return figure


@styled
def courses(one: Experiments) -> Figure:
    """Figure 6: both designed tracks from above, where the car went by its sensors, and the car
    itself, true to scale."""
    figure = Figure(figsize=(WIDTH, 3.9))
    every = figure.subplots(1, len(one.open_loop))
    for axes, letter, found in zip(every, "ab", one.open_loop.values(), strict=True):
        _track(axes, found.course.path())
        record = found.record
        axes.plot(record["x"], record["y"], color=INK, lw=1.2, label="driven by its sensors")
        whole = len(record.t)
        for k in np.linspace(0.25 * whole, whole - 1, 6).astype(int):
            pose = np.array([record[c][k] for c in ("x", "y", "psi")])
            _car(axes, pose, float(record["delta_cmd"][k]), one.trim.car.dimensions)
        entrance = found.measured[0]
        axes.plot(*entrance[:2], "o", color=COLOURS["VDM"], ms=5, label="sensors are cut here")
        axes.set_title(f"({letter}) {found.course.title}")
        _plane(axes)
    every[0].set_ylabel("y (m)")
    figure.legend(*every[0].get_legend_handles_labels(), loc="outside lower center", ncols=3)
    return figure


@styled
def open_loop(found: OpenLoop) -> Figure:
    """Where each model thinks the car went, given its commands alone, and its error."""
    figure = Figure(figsize=(WIDTH, 3.7))
    left, right = figure.subplots(1, 2, width_ratios=(1.0, 1.15))
    left.plot(*found.measured[:, :2].T, color=INK, lw=3.0, alpha=0.4, label="measured")
    for name, own in found.estimates.items():
        left.plot(*own.poses[:, :2].T, color=colour(name), label=name)
        right.plot(found.t, own.error, color=colour(name))
    left.set_title(found.course.title)
    _plane(left)
    left.set_ylabel("y (m)")
    right.set_title("translation error")
    right.set_xlabel("time since the bend began (s)")
    right.set_ylabel("error (m)")
    right.set_ylim(bottom=0.0)
    _exit(right, found.t[found.at_exit])
    figure.legend(*left.get_legend_handles_labels(), loc="outside lower center", ncols=4)
    return figure


@styled
def navigation(one: Experiments) -> Figure:
    """Figure 7: the error of navigation without sensors, by the source of pose."""
    figure = Figure(figsize=(WIDTH, 3.5))
    every = figure.subplots(1, len(one.closed_loop))
    titles = [found.course.title for found in one.open_loop.values()]
    panels = zip(every, "ab", titles, one.closed_loop.values(), strict=True)
    for axes, letter, title, runs in panels:
        for name, run in runs.items():
            axes.plot(run.t, run.error, color=colour(name), label=name)
            at = run.at_exit
            axes.plot(run.t[at], run.error[at], "o", color=colour(name), ms=5, mfc="white", mew=1.4)
        axes.plot([], [], "o", color=MUTED, ms=5, mfc="white", mew=1.4, label="end of the bend")
        axes.set_title(f"({letter}) {title}")
        axes.set_xlabel("time since the sensors were cut (s)")
        axes.set_ylim(bottom=0.0)
    every[0].set_ylabel("translation error (m)")
    figure.legend(*every[0].get_legend_handles_labels(), loc="outside lower center", ncols=4)
    return figure


@styled
def navigated(one: Experiments) -> Figure:
    """Where the car really went when a model was all it was steered by."""
    figure = Figure(figsize=(WIDTH, 3.9))
    every = figure.subplots(1, len(one.closed_loop))
    for axes, found, runs in zip(
        every, one.open_loop.values(), one.closed_loop.values(), strict=True
    ):
        _track(axes, found.course.path())
        for name, run in runs.items():
            _navigated(axes, name, run, one.trim.car.dimensions)
        axes.set_title(found.course.title)
        _plane(axes)
    every[0].set_ylabel("y (m)")
    figure.legend(*every[0].get_legend_handles_labels(), loc="outside lower center", ncols=4)
    return figure


@styled
def vdm_rules(one: Experiments) -> Figure:
    """Mean translation error of VDM from rest, by the rule that makes its speed of the command."""
    figure = Figure(figsize=(WIDTH, 3.3))
    every = figure.subplots(1, len(one.open_loop), sharey=True)
    for axes, found in zip(every, one.open_loop.values(), strict=True):
        for i, (profile, (label, tone)) in enumerate(PROFILES.items()):
            told: Mapping[Rule, Mapping[str, float]] = found.rules[profile]
            values = [told[rule]["mean"] for rule in RULES]
            rows = np.arange(len(values)) + 0.38 * (i - 0.5)
            axes.barh(rows, values, height=0.36, color=tone, label=label)
            for row, value in zip(rows, values, strict=True):
                axes.text(value, row, f" {value:.2f}", va="center", fontsize=8)
        axes.set_xlim(0.0, 1.12 * axes.get_xlim()[1])
        axes.set_yticks(range(len(RULES)), list(RULES.values()))
        axes.grid(False, axis="y")
        axes.set_xlabel("mean translation error (m)")
        axes.set_title(found.course.title)
    every[0].invert_yaxis()
    figure.legend(*every[0].get_legend_handles_labels(), loc="outside lower center", ncols=2)
    return figure


def _navigated(axes: Axes, name: str, run: ClosedLoop, dimensions: Dimensions) -> None:
    axes.plot(*run.measured[:, :2].T, color=colour(name), label=name)
    _car(axes, run.measured[-1], 0.0, dimensions, colour(name))


def _track(axes: Axes, path: np.ndarray) -> None:
    axes.plot(*path.T, color=TRACK, lw=1.4, ls=(0, (5, 3)), label="designed track")


def _exit(axes: Axes, t: float) -> None:
    axes.axvline(t, color=MUTED, lw=0.9, ls=(0, (4, 3)))
    top = axes.get_xaxis_transform()
    axes.text(t, 0.98, " end of the bend", transform=top, va="top", fontsize=8, color=MUTED)


def _plane(axes: Axes) -> None:
    axes.set_aspect("equal", adjustable="datalim")
    axes.margins(0.06)
    axes.set_xlabel("x (m)")


def _car(
    axes: Axes, pose: np.ndarray, delta: float, d: Dimensions, tone: str = COLOURS["VDM-SI"]
) -> None:
    """The car from above: body and wheels."""
    middle, overhang = 0.5 * (d.l_f - d.l_r), 0.65
    half = 0.5 * d.wheelbase + overhang, 0.5 * d.track + 0.1
    body = _box((middle, 0.0), half, 0.0)
    axes.add_patch(Polygon(_placed(body, pose), fc=tone, alpha=0.35, ec=tone, lw=0.9, zorder=3))
    for x, turn in ((d.l_f, delta), (-d.l_r, 0.0)):
        for side in (0.5, -0.5):
            wheel = _box((x, side * d.track), (d.wheel_radius, 0.1), turn)
            axes.add_patch(Polygon(_placed(wheel, pose), fc=INK, ec="none", zorder=4))


def _box(centre: tuple[float, float], half: tuple[float, float], turn: float) -> np.ndarray:
    corners = np.array([[1, 1], [-1, 1], [-1, -1], [1, -1]]) * np.array(half)
    return _turned(corners, turn) + np.array(centre)


def _placed(points: np.ndarray, pose: np.ndarray) -> np.ndarray:
    return _turned(points, pose[2]) + pose[:2]


def _turned(points: np.ndarray, angle: float) -> np.ndarray:
    c, s = np.cos(angle), np.sin(angle)
    return points @ np.array([[c, s], [-s, c]])
