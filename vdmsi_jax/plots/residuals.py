"""What a fit leaves over: in time, in frequency, and in correlation with itself and the command."""

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from ..correlation import Correlation, autocorrelation, cross_correlation, spectrum
from ..identify.result import OrderGrid
from .signals import line
from .style import COLOURS, INK, MUTED, WIDTH, legend_above, squared_unit, styled, unit_label

BOUND = {"color": "#56b4e9", "alpha": 0.25, "lw": 0}


@styled
def residuals(grid: OrderGrid, order: str | None = None, lag: float = 2.0) -> Figure:
    """Residual of one order (the chosen one by default) over time; below, its spectrum, its
    autocorrelation and its correlation with the command up to `lag` seconds, with 95 % bounds of a
    residual that holds nothing more."""
    fit = grid.best if order is None else grid[order]
    record = grid.record
    unit = record.units.get(grid.plant.output, "1")
    e = [fit.residual[segment.samples] for segment in record.segments]
    u = [record[grid.plant.input][segment.samples] for segment in record.segments]
    longest = max(len(segment) for segment in record.segments)
    lags = max(min(round(lag / record.dt), longest // 3), 2)

    figure = Figure(figsize=(WIDTH, 5.0))
    axes = figure.subplot_mosaic("ttt;sac", height_ratios=(1.0, 1.1))
    line(axes["t"], record, fit.residual, color=COLOURS["VDM-SI"], lw=0.8)
    axes["t"].axhline(0.0, color=MUTED, lw=0.8)
    axes["t"].set_title(f"{grid.plant.name}, {fit.order}: measured − simulated")
    axes["t"].set_xlabel("time t (s)")
    axes["t"].set_ylabel(unit_label("residual", unit))

    density = spectrum(e, record.dt)
    if density.frequency.size:
        axes["s"].axhspan(*density.white, **BOUND, label="if white, 95 %")
        axes["s"].loglog(density.frequency, density.density, color=COLOURS["VDM-SI"], lw=1.0)
        legend_above(axes["s"])
    axes["s"].set_title("spectrum")
    axes["s"].set_xlabel("frequency (Hz)")
    axes["s"].set_ylabel(unit_label("density", f"{squared_unit(unit)}/Hz"))

    _correlogram(axes["a"], autocorrelation(e, record.dt, lags), "autocorrelation")
    axes["a"].set_ylabel("coefficient (–)")
    _correlogram(axes["c"], cross_correlation(e, u, record.dt, lags), "with the command")
    return figure


def _correlogram(axes: Axes, correlation: Correlation, title: str) -> None:
    value = correlation.value
    axes.axhspan(-correlation.bound, correlation.bound, **BOUND)
    axes.axhline(0.0, color=MUTED, lw=0.8)
    axes.fill_between(correlation.lag, value, color=COLOURS["VDM-SI"], alpha=0.35, lw=0)
    axes.plot(correlation.lag, value, color=COLOURS["VDM-SI"], lw=1.0)
    reach = 1.15 * max(np.abs(value[correlation.lag != 0]).max(initial=0.0), correlation.bound)
    axes.set_ylim(-reach, reach)
    if correlation.lag[0] == 0.0 and reach < 1.0:
        axes.annotate(
            "1 at lag 0", (0.0, reach), (4, -2), textcoords="offset points", va="top",
            fontsize=7.5, color=INK,
        )  # fmt: skip
    axes.set_title(title)
    axes.set_xlabel("lag (s)")
    label = f"95 %: ±{correlation.bound:.2g}"
    axes.text(0.98, 0.97, label, transform=axes.transAxes, ha="right", va="top", fontsize=8)
