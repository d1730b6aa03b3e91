"""What an identified model is: poles and zeros, step response and frequency response, with
bands."""

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import NullLocator

from ..bands import (
    Band,
    Root,
    frequency_bands,
    pole_uncertainty,
    settling_time,
    step_band,
    zero_uncertainty,
)
from ..data.record import Record
from ..identify.result import Fit
from .signals import NAMES
from .style import COLOURS, INK, MUTED, WIDTH, legend_above, pretty_unit, styled

CHI_SQUARE_95 = 5.991
"""Of two degrees of freedom: the squared radius of a 95 % ellipse."""
_LINE = 0.03  # of what an axis spans: a band no wider is hardly seen beside its line


@styled
def responses(fit: Fit, record: Record) -> Figure:
    """Pole-zero map, step response and Bode plot of a fit, each with its 95 % interval; the legend
    says where that is as narrow as the line."""
    figure = Figure(figsize=(WIDTH, 5.4))
    axes = figure.subplot_mosaic("ps;gh")
    _pole_zero_map(axes["p"], pole_uncertainty(fit), zero_uncertainty(fit))
    into, out = (record.units.get(c, "1") for c in (fit.plant.input, fit.plant.output))
    ratio = "" if into == out else f" ({pretty_unit(out)} per {pretty_unit(into)})"

    t = np.linspace(0.0, settling_time(fit), 400)
    _draw_band(axes["s"], step_band(fit, t))
    axes["s"].set_title("step response")
    axes["s"].set_xlabel("time (s)")
    output, command = (NAMES.get(c, c) for c in (fit.plant.output, fit.plant.input))
    axes["s"].set_ylabel(f"{output}\nper {command}{ratio}")

    nyquist = np.pi / record.dt
    low = max(2.0 * np.pi / max(record.duration, 1e-9), nyquist * 1e-4)
    gain, phase = frequency_bands(fit, np.geomspace(low, nyquist, 400))
    for name, band, title, label in (
        ("g", gain, "gain", "gain (dB)"),
        ("h", phase, "phase", "phase (°)"),
    ):
        hertz = Band(band.at / (2 * np.pi), *band[1:])
        _draw_band(axes[name], hertz)
        axes[name].set_xscale("log")
        axes[name].set_title(title)
        axes[name].set_xlabel("frequency (Hz)")
        axes[name].set_ylabel(label)
    return figure


def _draw_band(axes: Axes, band: Band) -> None:
    span = np.ptp(band.value[np.isfinite(band.value)]) or 1.0
    steep = np.gradient(band.value) * len(band.value) / span  # heights per width of the axes
    across = (band.high - band.low) / np.hypot(1.0, 0.5 * steep)  # axes are twice as wide as high
    seen = np.nanmax(across) > _LINE * span
    low = np.maximum(band.low, band.value.min() - 2 * span)  # a wild band must not hide the curve
    high = np.minimum(band.high, band.value.max() + 2 * span)
    label = "95 %" if seen else "95 %, as narrow as the line"
    axes.fill_between(band.at, low, high, color=COLOURS["VDM-SI"], alpha=0.22, lw=0, label=label)
    axes.plot(band.at, band.value, color=COLOURS["VDM-SI"])
    legend_above(axes)


def _pole_zero_map(axes: Axes, poles: list[Root], zeros: list[Root]) -> None:
    """Logarithmic beyond the slowest root, so that roots decades apart are seen together."""
    values = np.array([root.value for root in [*poles, *zeros]], dtype=np.complex128)
    sizes = np.abs(values)
    sizes = sizes[sizes > 1e-12]
    reach = sizes.max(initial=1.0)
    spread = sizes.size > 0 and reach > 30.0 * sizes.min()
    for roots, marker, label in ((poles, "x", "poles"), (zeros, "o", "zeros")):
        if not roots:
            continue
        tone = COLOURS["VDM-SI"] if marker == "x" else COLOURS["VDM"]
        for root in roots:
            _interval(axes, root, tone, reach)
        axes.plot(
            [root.value.real for root in roots], [root.value.imag for root in roots], marker,
            ms=7, mew=1.8, mfc="none", color=tone, ls="none", label=label, zorder=3,
        )  # fmt: skip
    axes.axvline(0.0, color=INK, lw=0.9)
    axes.axhline(0.0, color=MUTED, lw=0.7)
    margin = 3.0 if spread else 1.25
    threshold = max(sizes.min(initial=reach), reach * 1e-4)
    right = max(margin * values.real.max(initial=0.0), threshold if spread else 0.1 * reach)
    axes.set_xlim(-margin * max(-values.real.min(initial=0.0), 0.3 * reach), right)
    height = margin * max(np.abs(values.imag).max(initial=0.0), 0.25 * reach)
    axes.set_ylim(-height, height)
    if spread:
        _logarithmic(axes, threshold)
    axes.set_title("poles and zeros (95 %)")
    axes.set_xlabel("real part (rad/s)")
    axes.set_ylabel("imaginary part (rad/s)")
    legend_above(axes, handletextpad=0.3)


def _logarithmic(axes: Axes, threshold: float) -> None:
    """Make the axes logarithmic in size beyond `threshold`, linear within, with few ticks."""
    for axis, limits, scale in (
        (axes.xaxis, axes.get_xlim(), axes.set_xscale),
        (axes.yaxis, axes.get_ylim(), axes.set_yscale),
    ):
        scale("symlog", linthresh=threshold, linscale=0.8)
        first, last = np.log10(threshold), np.log10(max(np.abs(limits)))
        decades = np.arange(np.ceil(first), np.floor(last) + 1)
        decades = 10.0 ** decades[:: max(1, -(-len(decades) // 3))]
        axis.set_ticks([*-decades[::-1], 0.0, *decades])
        axis.set_minor_locator(NullLocator())
        axis.axes.set(**{f"{axis.axis_name}lim": limits})


def _interval(axes: Axes, root: Root, tone: str, reach: float) -> None:
    """The ellipse of a complex root, the bar of a real one, cut where it leaves the picture."""
    if not np.isfinite(root.covariance).all():
        return
    limit = 3.0 * reach
    if root.value.imag == 0.0:
        half = min(1.96 * np.sqrt(max(root.covariance[0, 0], 0.0)), limit)
        axes.plot(
            [root.value.real - half, root.value.real + half], [0.0, 0.0],
            color=tone, lw=4.0, alpha=0.3, solid_capstyle="butt",
        )  # fmt: skip
        return
    scale, directions = np.linalg.eigh(root.covariance)
    radii = np.minimum(np.sqrt(CHI_SQUARE_95 * np.maximum(scale, 0.0)), limit)
    angle = np.linspace(0.0, 2.0 * np.pi, 121)
    x, y = directions @ (radii[:, None] * np.stack([np.cos(angle), np.sin(angle)]))
    axes.fill(root.value.real + x, root.value.imag + y, color=tone, alpha=0.22, lw=0)
