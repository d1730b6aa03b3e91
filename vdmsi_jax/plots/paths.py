"""Where the vehicle went, where models say it went, and how far apart the two are."""

import numpy as np
from matplotlib.figure import Figure

from ..compare import Comparison, PoseErrors, has_pose
from .signals import map_axes, with_gaps
from .style import COLOURS, WIDTH, colour, envelope, legend_above, styled


@styled
def paths(comparison: Comparison) -> Figure:
    """Measured and predicted paths in the plane, from the same start; those that are predicted
    alone where no pose was measured."""
    record = comparison.record
    figure = Figure()
    axes = figure.subplots()
    moved = {"measured": record.channels} if has_pose(record.channels) else {}
    moved |= {name: p.channels for name, p in comparison.predictions.items() if p.has_path}
    starts = [segment.start for segment in record.segments]
    first = next(iter(moved.values()))
    origin = map_axes(axes, np.array([first["x"][0], first["y"][0]]))
    for name, channels in moved.items():
        lw, alpha = (2.6, 0.45) if name == "measured" else (1.5, 1.0)
        east, north = (
            with_gaps(record, channels[place] - zero)[1]
            for place, zero in zip(("x", "y"), origin, strict=True)
        )
        axes.plot(east, north, color=colour(name), label=name, lw=lw, alpha=alpha)
    begun = [first[place][starts] - zero for place, zero in zip(("x", "y"), origin, strict=True)]
    mark = {"color": COLOURS["measured"], "mfc": "white", "ms": 6, "mew": 1.5, "zorder": 4}
    axes.plot(*begun, "o", label="start", **mark)
    wide, high = axes.dataLim.size
    room = WIDTH * high / max(wide, 1e-9) + 0.9  # inches, of one scale in both directions
    figure.set_size_inches(WIDTH, np.clip(room, 2.6, 6.5))
    axes.set_title("path")
    legend_above(axes)
    return figure


@styled
def translation_error(comparison: Comparison) -> Figure:
    """Distance between predicted and measured position over time: of the whole run, or of each
    stretch between gaps, and of windows that start anew at the measured pose, unless the whole run
    is one window."""
    record = comparison.record
    floor = {} if comparison.floor is None else {comparison.floor.name: comparison.floor}
    errors_of = {
        name: (prediction.whole, prediction.windows)
        for name, prediction in (floor | dict(comparison.predictions)).items()
    }
    one = all(_same(whole, windows) for whole, windows in errors_of.values())
    rows = 1 if one else 2
    figure = Figure(figsize=(WIDTH, 2.4 * rows))
    every = figure.subplots(rows, 1, sharex=True, squeeze=False)[:, 0]
    for name, pair in errors_of.items():
        for axes, errors in zip(every, pair, strict=False):
            if errors is not None:
                t, y = with_gaps(record, errors.translation)
                label = f"{name}, {errors.ate['mean']:.3g} m"
                axes.plot(*envelope(t, y), color=colour(name), label=label)
    titles = (
        f"{comparison.stretch} from its start, and the mean",
        f"windows of {comparison.window:g} s, and their mean",
    )
    every[-1].set_xlabel("time t (s)")
    for axes, title in zip(every, titles, strict=False):
        axes.set_title(title, pad=20)
        axes.set_ylabel("translation error (m)")
        axes.set_ylim(bottom=0.0)
        legend_above(axes)
    return figure


def _same(whole: PoseErrors | None, windows: PoseErrors | None) -> bool:
    """Whether windows say nothing that the whole run does not."""
    if whole is None or windows is None:
        return windows is None
    return np.array_equal(whole.translation, windows.translation, equal_nan=True)
