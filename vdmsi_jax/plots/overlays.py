"""A diagnosed response: measured and simulated, and what is wrong with it, when and where."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from matplotlib import colormaps
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.collections import LineCollection
from matplotlib.colors import Normalize
from matplotlib.figure import Figure

from ..config import CANONICAL
from ..correlation import autocorrelation
from ..diagnose.answer.result import Path, Response
from .signals import NAMES, map_axes
from .style import (
    COLOURS,
    MUTED,
    WIDTH,
    envelope,
    framed,
    legend_above,
    pretty_unit,
    styled,
    unit_label,
)

BASELINE, EXTENDED = COLOURS["VDM-SI"], COLOURS["extended"]
BINS = 30
PIECES = 400  # of a path, each of its own colour
BESIDE = 3  # runs that stand in a row


class Run(NamedTuple):
    """One run of a response, NaN where there is no sample."""

    name: str
    t: np.ndarray
    u: np.ndarray
    y: np.ndarray
    baseline: np.ndarray
    extended: np.ndarray
    held_out: np.ndarray

    @property
    def title(self) -> str:
        """The run's name, and whether a fit has seen it."""
        return self.name + (", held out" if self.held_out.any() else ", seen by the fit")


def judged_run(response: Response) -> Run:
    """The run with the most samples that no fit has seen; the longest if there are none."""
    unseen = (response.held_out & response.valid).sum(axis=1)
    counts = unseen if unseen.any() else response.valid.sum(axis=1)
    i = int(np.argmax(counts))
    valid = response.valid[i]
    n = int(np.flatnonzero(valid)[-1]) + 1 if valid.any() else 0
    there = valid[:n]
    u, y, baseline, extended = (
        np.where(there, getattr(response, name)[i, :n], np.nan)
        for name in ("u", "y", "baseline", "extended")
    )
    held_out = response.held_out[i, :n] & there
    return Run(response.runs[i], response.t[i, :n], u, y, baseline, extended, held_out)


def _same(response: Response) -> bool:
    """Whether nothing was put into the model, so that both simulations are one."""
    return np.array_equal(response.baseline[response.valid], response.extended[response.valid])


def _simulations(response: Response, run: Run) -> list[tuple[str, np.ndarray, str]]:
    both = [("baseline", run.baseline, BASELINE), ("extended", run.extended, EXTENDED)]
    return both[:1] if _same(response) else both


def best_window(response: Response, run: Run) -> slice:
    """Where the extension takes most error away (or, without one, where the error is largest):
    a tenth of the run, at least 50 samples, at most 20 s."""
    n = len(run.t)
    width = min(n, max(50, min(n // 10, round(20.0 / response.dt))))
    worth = (run.y - run.baseline) ** 2
    if not _same(response):
        worth = worth - (run.y - run.extended) ** 2
    total = np.concatenate([[0.0], np.cumsum(np.nan_to_num(worth))])
    start = int(np.argmax(total[width:] - total[:-width])) if n else 0
    return slice(start, start + width)


def _label(response: Response) -> str:
    return unit_label(NAMES.get(response.channel, response.channel), response.unit)


def draw_signals(axes: Axes, response: Response, run: Run, part: slice) -> None:
    """Measured, baseline and extended over a part of a run; the command too if it is of the same
    kind and the part is short enough to tell them apart."""
    kinds = {CANONICAL.get(response.command), CANONICAL.get(response.channel)}
    t = run.t[part]
    if len(kinds) == 1 and None not in kinds and len(t) < len(run.t):
        axes.plot(t, run.u[part], color=COLOURS["command"], lw=1.0, label="command")
    options = {"color": COLOURS["measured"], "lw": 2.2, "alpha": 0.45, "label": "measured"}
    axes.plot(*envelope(t, run.y[part]), **options)
    for name, values, tone in _simulations(response, run):
        axes.plot(*envelope(t, values[part]), color=tone, lw=1.2, label=name)
    axes.set_ylabel(_label(response))


def draw_residuals(axes: Axes, response: Response, run: Run, part: slice) -> None:
    """Measured less simulated over a part of a run, with the root mean square of that part."""
    where = " here" if part.stop - part.start < len(run.t) else ""
    axes.axhline(0.0, color=MUTED, lw=0.8)
    for name, values, tone in _simulations(response, run):
        residual = (run.y - values)[part]
        rms = np.sqrt(np.nanmean(residual**2))
        label = f"{name}, rms{where} {rms:.2g} {pretty_unit(response.unit)}".removesuffix(" 1")
        axes.plot(*envelope(run.t[part], residual), color=tone, lw=0.9, alpha=0.85, label=label)
    axes.set_ylabel(unit_label("residual", response.unit))


@styled
def overlay(response: Response) -> Figure:
    """Measured, baseline and extended over the held-out run, a zoom on the window where the
    extension helps most, and the residuals of both."""
    run = judged_run(response)
    window = best_window(response, run)
    everything = slice(0, len(run.t))
    figure = framed(4.8, 2, 2, down=0.5)
    axes = figure.subplot_mosaic("az;rs", width_ratios=(1.5, 1.0), height_ratios=(1.25, 1.0))
    for name, part, draw in (
        ("a", everything, draw_signals),
        ("z", window, draw_signals),
        ("r", everything, draw_residuals),
        ("s", window, draw_residuals),
    ):
        draw(axes[name], response, run, part)
    for name in "ar":
        axes[name].axvspan(*run.t[window][[0, -1]], color=COLOURS["held out"], alpha=0.16, lw=0)
    axes["r"].sharex(axes["a"])
    axes["s"].sharex(axes["z"])
    axes["a"].set_title(f"{response.name}: {run.title}", pad=20)
    axes["z"].set_title("largest error" if _same(response) else "largest gain", pad=20)
    for name in "rs":
        axes[name].set_xlabel("time t (s)")
    for name in "ar":
        legend_above(axes[name])
    command = [line for line in axes["z"].lines if line.get_label() == "command"]
    if command:
        legend_above(axes["z"], handles=command)
    return figure


@styled
def on_path(response: Response, *paths: Path) -> Figure:
    """Where on the road a response goes wrong: the measured path of each run, coloured by the
    residual of baseline and extended, wherever the response was measured.

    Args:
        response: what to draw, with runs of the paths' names.
        paths: drives, those of a run in one picture.

    Raises:
        ValueError: the response has no run of such a name.
    """
    names = tuple(dict.fromkeys(path.run for path in paths))
    unknown = [name for name in names if name not in response.runs]
    if unknown:
        raise ValueError(f"{response.name} has no run {unknown[0]!r}; it has {response.runs}")
    drawn = [
        (name, *_on_one_path(response, name, [path for path in paths if path.run == name]))
        for name in names
    ]
    models = list(drawn[0][-1])  # those of every run
    every_mean = np.concatenate([mean for *_, means in drawn for mean in means.values()])
    reach = float(np.abs(every_mean).max(initial=0.0)) or 1.0
    tint = Normalize(-reach, reach)
    tones = colormaps["coolwarm"].resampled(41)  # so few that the bar is no bitmap
    if len(drawn) == 1:
        rows = [[(*drawn[0], model) for model in models]]
    else:
        parts = [drawn[k : k + BESIDE] for k in range(0, len(drawn), BESIDE)]
        rows = [[(*one, model) for one in part] for part in parts for model in models]
    columns = max(map(len, rows))
    high = 4.0 if columns < 3 else 2.9
    margins = {"left": 0.85, "right": 1.2, "top": 0.35, "bottom": 0.5}
    height = len(rows) * high
    figure = framed(height, len(rows), columns, across=0.5, **margins)
    every = figure.subplots(len(rows), columns, squeeze=False)
    for line, row in zip(every, rows, strict=True):
        for axes in line[len(row) :]:
            axes.remove()
        for axes, (name, pieces, means, model) in zip(line, row, strict=False):
            places = pieces - map_axes(axes, pieces[0, 0] if len(pieces) else np.zeros(2))
            axes.update_datalim(places.reshape(-1, 2))
            coloured = LineCollection(
                list(places), array=means[model], cmap=tones, norm=tint, lw=5.0
            )
            axes.add_collection(coloured)
            axes.autoscale_view()
            axes.set_title(f"{name}, {model}" if len(drawn) > 1 else model)
        for axes in line[1:]:
            axes.set_ylabel("")
    bottom, free = margins["bottom"] / height, height - margins["top"] - margins["bottom"]
    scale = figure.add_axes((1.0 - 1.05 / WIDTH, bottom, 0.12 / WIDTH, free / height))
    bar = figure.colorbar(ScalarMappable(tint, tones), cax=scale)
    scale.set_label("<colorbar>")
    bar.set_label(unit_label(f"residual of {response.channel}", response.unit))
    return figure


def _on_one_path(
    response: Response, name: str, paths: Sequence[Path]
) -> tuple[np.ndarray, dict[str, np.ndarray]]:
    """Pieces (n, 2, 2) of the way of a run, m, and the mean residual of each simulation in each."""
    i = response.runs.index(name)
    there = response.valid[i]
    run = Run(name, *(getattr(response, column)[i, there] for column in Run._fields[1:]))
    total = {
        model: np.concatenate([[0.0], np.cumsum(run.y - values)])
        for model, values, _ in _simulations(response, run)
    }
    pieces, means = [], {model: [] for model in total}
    for path in paths:
        rows = np.linspace(0, len(path.t) - 1, min(len(path.t), PIECES + 1)).astype(int)
        places, at = path.measured[rows, :2], np.searchsorted(run.t, path.t[rows])
        known = np.diff(at) > 0
        pieces.append(np.stack([places[:-1], places[1:]], axis=1)[known])
        for model, sums in total.items():
            means[model].append((np.diff(sums[at]) / np.maximum(np.diff(at), 1))[known])
    return np.concatenate(pieces), {model: np.concatenate(own) for model, own in means.items()}


@styled
def residual_against(response: Response) -> Figure:
    """Residual of baseline and extended against time, command, response and response rate: the
    mean in bins of equally many samples, with the 95 % band of that mean.

    A residual that is only noise has no shape in any of them. Response and rate are the simulated
    ones, since the measured ones share their noise with the residual.

    Args:
        response: what to draw, its held-out samples (all of them if none is held out).
    """
    run = judged_run(response)
    rows = response.valid & (response.held_out if run.held_out.any() else response.valid)
    rate = _rate(response)
    command, output = (NAMES.get(c, c) for c in (response.command, response.channel))
    panels = (
        ("time", f"time t of {run.name} (s)", None),
        ("command", unit_label(command, response.command_unit), response.u),
        ("response", unit_label(f"simulated {output}", response.unit), response.extended),
        ("response rate", unit_label(f"rate of {output}", _per_second(response.unit)), rate),
    )
    figure = framed(5.0, 2, 2, top=0.35, across=0.35)
    every = figure.subplots(2, 2, sharey=True)
    spread = _correlated(response)
    for axes, (title, label, against) in zip(every.flat, panels, strict=True):
        axes.axhline(0.0, color=MUTED, lw=0.8)
        for name, values, tone in _simulations(response, run):
            if against is None:
                shown = run.held_out if run.held_out.any() else np.isfinite(run.y)
                x, mean, half = over_time(run.t[shown], (run.y - values)[shown], spread)
            else:
                at, residual = against[rows], (response.y - getattr(response, name))[rows]
                x, mean, half = binned(at, residual, spread)
            axes.fill_between(x, mean - half, mean + half, color=tone, alpha=0.22, lw=0)
            axes.plot(x, mean, ".-", ms=4, lw=1.1, color=tone, label=name)
        axes.set_title(f"against {title}")
        axes.set_xlabel(label)
    for axes in every[:, 0]:
        axes.set_ylabel(unit_label("residual", response.unit))
    legend_above(every[0, 0])
    return figure


def over_time(
    t: np.ndarray, y: np.ndarray, spread: float, bins: int = 2 * BINS
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """`binned` for each stretch of time, with a gap between them that no line crosses."""
    usual = np.median(np.diff(t)) if t.size > 1 else 0.0
    stops = np.flatnonzero(np.diff(t) > max(t.size / bins, 2.0) * usual) + 1
    parts = []
    for a, b in zip(np.r_[0, stops], np.r_[stops, t.size], strict=True):
        share = max(2, round(bins * (b - a) / max(t.size, 1)))
        parts += [binned(t[a:b], y[a:b], spread, share), (np.full(1, np.nan),) * 3]
    x, mean, half = (np.concatenate(column) for column in zip(*parts, strict=True))
    return x, mean, half


def binned(
    x: np.ndarray, y: np.ndarray, spread: float, bins: int = BINS
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Mean of `x` and `y` in bins of `x` that hold equally many samples (more where the bins would
    be narrower than can be seen), and the half-width of the 95 % interval of the mean of `y`, when
    `spread` samples tell as much as one independent one."""
    fine = np.isfinite(x) & np.isfinite(y)
    x, y = x[fine], y[fine]
    edges = np.quantile(x, np.linspace(0.0, 1.0, bins + 1)) if x.size else x
    narrow = np.ptp(edges[1:-1]) / (2 * bins) if x.size else 0.0
    inner: list[float] = []
    for edge in edges[1:-1]:
        if not inner or edge > inner[-1] + narrow:
            inner.append(edge)
    which = np.searchsorted(inner, x, side="right")
    count = np.bincount(which, minlength=1).astype(float)
    count[count < 2] = np.nan
    x_mean, mean = (np.bincount(which, values, minlength=1) / count for values in (x, y))
    variance = np.bincount(which, (y - mean[which]) ** 2, minlength=1) / (count - 1.0)
    half = 1.96 * np.sqrt(variance * np.minimum(spread, count) / count)
    kept = np.isfinite(mean)
    return x_mean[kept], mean[kept], half[kept]


def _correlated(response: Response) -> float:
    """How many samples of the extended residual tell as much as one independent one."""
    residual = np.where(response.valid, response.y - response.extended, np.nan)
    lags = max(1, min(residual.shape[1] // 4, 2000))
    value = autocorrelation(list(residual), response.dt, lags).value
    below = np.flatnonzero(value <= 0.0)
    return 1.0 + 2.0 * float(value[1 : below[0] if below.size else None].sum())


def _rate(response: Response) -> np.ndarray:
    if response.extended.shape[1] < 2:
        return np.full_like(response.extended, np.nan)
    inside = np.where(response.valid, response.extended, np.nan)
    return np.gradient(inside, response.dt, axis=1)


def _per_second(unit: str) -> str:
    if unit in ("", "1"):
        return "1/s"
    return unit[:-2] + "/s^2" if unit.endswith("/s") else f"{unit}/s"
