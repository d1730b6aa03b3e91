"""What the extended model leaves of a response: is it noise?"""

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator, MaxNLocator, NullFormatter

from ..correlation import autocorrelation, spectrum
from ..diagnose.answer.result import Response
from .residuals import BOUND
from .style import COLOURS, INK, MUTED, framed, legend_above, styled

EXTENDED = COLOURS["extended"]


@styled
def innovations(response: Response, lag: float = 2.0) -> Figure:
    """What the extended model leaves, with the predictable part of the noise taken out: its size
    over time, its spectrum and its autocorrelation, each with the 95 % band of white noise.

    Args:
        response: what to draw.
        lag: longest lag of the autocorrelation, s.
    """
    left = np.where(response.valid, response.innovations, np.nan)
    size = np.nanstd(left) if np.isfinite(left).any() else 1.0
    pieces = [row[: np.flatnonzero(np.isfinite(row))[-1] + 1] for row in left if _any(row)]
    pieces = [piece / (size or 1.0) for piece in pieces]
    figure = framed(4.6, 2, 2, top=0.35)
    axes = figure.subplot_mosaic("tt;sa", height_ratios=(1.0, 1.15))
    _sizes(axes["t"], response, pieces)
    if pieces:
        density = spectrum(pieces, response.dt)
        if density.frequency.size:
            axes["s"].axhspan(*density.white, **BOUND, label="if white, 95 %")
            axes["s"].loglog(density.frequency, density.density, color=EXTENDED, lw=1.0)
            axes["s"].yaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
            for axis in (axes["s"].xaxis, axes["s"].yaxis):
                axis.set_major_formatter("{x:g}")  # a power of ten is slow to typeset
                axis.set_minor_formatter(NullFormatter())
            legend_above(axes["s"])
        longest = max(len(piece) for piece in pieces)
        lags = max(min(round(lag / response.dt), longest // 3), 2)
        _correlogram(axes["a"], pieces, response.dt, lags)
    axes["s"].set_title("spectrum")
    axes["s"].set_xlabel("frequency (Hz)")
    axes["s"].set_ylabel("density (1/Hz)")
    axes["a"].set_title("autocorrelation")
    axes["a"].set_xlabel("lag (s)")
    axes["a"].set_ylabel("coefficient (–)")
    return figure


def _any(row: np.ndarray) -> bool:
    return bool(np.isfinite(row).any())


def _sizes(axes: Axes, response: Response, pieces: list[np.ndarray]) -> None:
    """Root mean square in windows of 50 samples or more, the runs one after another."""
    total = sum(map(len, pieces))
    width = max(50, total // 200)
    half = 1.96 / np.sqrt(2.0 * width)
    axes.axhspan(max(1.0 - half, 0.0), 1.0 + half, **BOUND, label="if white, 95 %")
    begin = 0.0
    for i, piece in enumerate(pieces):
        windows = [piece[k : k + width] for k in range(0, max(len(piece) - width // 2, 1), width)]
        full = [w for w in windows if np.isfinite(w).sum() >= width // 2]
        rms = [np.sqrt(np.nanmean(w**2)) for w in full]
        at = begin + response.dt * width * (np.arange(len(full)) + 0.5)
        axes.plot(at, rms, ".-", ms=4, lw=0.9, color=EXTENDED)
        if i:
            axes.axvline(begin, color=INK, lw=0.8, ls=(0, (3, 3)))
        begin += len(piece) * response.dt
    axes.set_title(
        f"{response.name}: size of what remains, in windows of {width * response.dt:g} s"
    )
    axes.set_xlabel("time, the runs one after another (s)")
    axes.set_ylabel("rms / overall rms (–)")
    axes.yaxis.set_major_locator(MaxNLocator(5))
    legend_above(axes)


def _correlogram(axes: Axes, pieces: list[np.ndarray], dt: float, lags: int) -> None:
    lag, value, bound = autocorrelation(pieces, dt, lags)
    axes.axhspan(-bound, bound, **BOUND)
    axes.axhline(0.0, color=MUTED, lw=0.8)
    axes.plot(lag[1:], value[1:], color=EXTENDED, lw=1.0)
    reach = 1.25 * max(np.abs(value[1:]).max(initial=0.0), 1.5 * bound)
    axes.set_ylim(-reach, reach)
    label = f"95 %: ±{bound:.2g}; 1 at lag 0"
    axes.text(0.98, 0.97, label, transform=axes.transAxes, ha="right", va="top", fontsize=8)
