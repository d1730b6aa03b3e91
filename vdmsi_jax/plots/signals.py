"""Signals over time: what was measured under what a model says."""

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from ..compare import Comparison
from ..data.mend import LONG_BEFORE
from ..data.record import Record
from ..identify.result import OrderGrid, model_of
from .style import COLOURS, WIDTH, colour, envelope, legend_above, styled, unit_label

_FAR = 1e4  # m from the origin
_FARTHEST = 10.0  # times what was measured, beyond which a prediction is not drawn

NAMES = {
    "v": "speed v",
    "v_cmd": "speed command",
    "delta": "steering angle δ",
    "delta_cmd": "steering command",
    "r": "yaw rate r",
    "a": "acceleration a",
    "x": "x",
    "y": "y",
    "psi": "heading ψ",
}


def channel_label(record: Record, channel: str) -> str:
    """Name and unit of a channel for an axis."""
    return unit_label(NAMES.get(channel, channel), record.units.get(channel, "1"))


def seconds(record: Record) -> np.ndarray:
    """Time (N,) for an axis, s: as logged, or since the first sample where the clock counts from
    long before, whose digits no axis has room for."""
    return record.t - record.t[0] if abs(record.t[0]) > LONG_BEFORE else record.t


def with_gaps(record: Record, values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Time and values with a NaN after each segment, so that lines do not bridge gaps."""
    stops = [segment.stop for segment in record.segments[:-1]]
    values = np.asarray(values, float)
    return np.insert(seconds(record), stops, np.nan), np.insert(values, stops, np.nan)


def map_axes(axes: Axes, start: np.ndarray) -> np.ndarray:
    """Make axes those of a map, and give what to take off each place (2,): the start where it is
    far from the origin, as in the coordinates of a whole country, else nothing."""
    far = bool(np.hypot(*start) > _FAR)
    axes.set_aspect("equal", adjustable="datalim")
    axes.set_xlabel("x from the start (m)" if far else "x (m)")
    axes.set_ylabel("y from the start (m)" if far else "y (m)")
    return np.asarray(start, float) if far else np.zeros(2)


def line(axes: Axes, record: Record, values: np.ndarray, **options) -> None:
    """Draw samples of a record over its time, gaps left open."""
    t, y = with_gaps(record, values)
    axes.plot(*envelope(t, y), **options)


def shade_held_out(axes: Axes, grid: OrderGrid) -> None:
    """Tint the stretches of time that are held out for the held-out score."""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], grid.held_out, [0]])))
    for start, stop in edges.reshape(-1, 2):
        span = seconds(grid.record)[[start, stop - 1]]
        axes.axvspan(*span, color=COLOURS["held out"], alpha=0.12, lw=0)


@styled
def fitted(grid: OrderGrid, order: str | None = None) -> Figure:
    """Command, measured response and free-run simulation of one order, the chosen one by default;
    and, over the stretches that are held out, what a fit without them predicts there."""
    fit = grid.best if order is None else grid[order]
    model_of(fit)
    record, output, command = grid.record, grid.plant.output, grid.plant.input
    figure = Figure(figsize=(WIDTH, 3.0))
    axes = figure.subplots()
    shade_held_out(axes, grid)
    if record.units.get(command) == record.units.get(output):
        line(axes, record, record[command], color=COLOURS["command"], lw=1.0, label="command")
    line(axes, record, record[output], color=COLOURS["measured"], lw=1.0, label="measured")
    label = f"{fit.order}, FIT {fit.fit:.2f} %"
    line(axes, record, fit.predicted, color=COLOURS["VDM-SI"], lw=1.5, label=label)
    if grid.held_out.any() and fit.held_out_predicted.size:
        unseen, label = COLOURS["held out"], f"held out, FIT {fit.held_out_fit:.2f} %"
        line(axes, record, fit.held_out_predicted, color=unseen, lw=1.5, label=label)
    axes.set_xlabel("time t (s)")
    axes.set_ylabel(channel_label(record, output))
    axes.set_title(grid.plant.name)
    legend_above(axes)
    return figure


def _near(predicted: np.ndarray, measured: np.ndarray) -> np.ndarray:
    """The samples (N,) that lie where they can be drawn beside the measured ones, NaN in place of
    others: a model that runs away would flatten all else, or has values that no axis holds."""
    reach = _FARTHEST * max(float(np.ptp(measured)), float(np.abs(measured).max()), 1e-9)
    return np.where(np.abs(predicted) <= reach, predicted, np.nan)


@styled
def channels(comparison: Comparison) -> Figure:
    """Every measured channel that a model predicts, over time, with each model's FIT."""
    record = comparison.record
    names = [
        name
        for name in ("v", "delta", "r", "a", *record.channels)
        if name not in ("x", "y", "psi")
        and any(name in prediction.scores for prediction in comparison.predictions.values())
    ]
    names = list(dict.fromkeys(names))
    figure = Figure(figsize=(WIDTH, 0.5 + 2.3 * max(len(names), 1)))
    every = figure.subplots(max(len(names), 1), 1, sharex=True, squeeze=False)[:, 0]
    for axes, name in zip(every, names, strict=False):
        line(axes, record, record[name], color=COLOURS["measured"], lw=1.0, label="measured")
        for model, prediction in comparison.predictions.items():
            if name in prediction.scores:
                own, fit = prediction.channels[name], prediction.scores[name].fit
                label = f"{model}, FIT {fit:.1f} %" if np.isfinite(fit) else f"{model}, runs away"
                line(axes, record, _near(own, record[name]), color=colour(model), label=label)
        axes.set_ylabel(channel_label(record, name))
        legend_above(axes)
    every[-1].set_xlabel("time t (s)")
    return figure
