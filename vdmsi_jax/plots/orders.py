"""The order grid as a picture, in the manner of the paper's figures 4 and 5."""

import numpy as np
from matplotlib import colormaps
from matplotlib.axes import Axes
from matplotlib.colors import LogNorm, Normalize
from matplotlib.figure import Figure
from matplotlib.patches import Patch, Rectangle
from matplotlib.patheffects import withStroke

from ..identify.result import LOW_FIT, Fit, OrderGrid
from ..units import superscript
from .style import INK, MUTED, WIDTH, legible, squared_unit, styled, unit_label


@styled
def order_grid(grid: OrderGrid) -> Figure:
    """FIT and MSE of every order: poles downward, zeros to the right.

    Empty cells say why. A solid frame is the order chosen by the paper's rule, a dashed one that of
    the least BIC; pale are orders with a FIT below 60 %.
    """
    poles = sorted({fit.n_poles for fit in grid.fits.values()})
    zeros = sorted({fit.n_zeros for fit in grid.fits.values()})
    figure = Figure(figsize=(WIDTH, 1.5 + 0.5 * len(poles)))
    left, right = figure.subplots(1, 2)
    unit = grid.record.units.get(grid.plant.output, "1")
    shown = [fit for fit in grid.fits.values() if fit.ok and fit.fit >= LOW_FIT]
    fits, errors = [fit.fit for fit in shown], [fit.mse for fit in shown]
    top, least = max(fits, default=100.0), max(min(errors, default=1.0), np.finfo(float).tiny)
    scale = Normalize(min([*fits, top - 1.0]), top)
    _heat_map(left, grid, "fit", scale, "cividis", "{:.2f}".format)
    scale, power = LogNorm(least, max([*errors, 1.05 * least])), int(np.floor(np.log10(least)))
    _heat_map(right, grid, "mse", scale, "cividis_r", lambda mse: _short_number(mse / 10.0**power))
    left.set_title(f"{grid.plant.name}: FIT (%)")
    scaled = (f"10{superscript(power)} " if power else "") + squared_unit(unit).replace("1", "")
    right.set_title(f"{grid.plant.name}: " + unit_label("MSE", scaled.strip()))
    for axes in (left, right):
        axes.set_xticks(range(len(zeros)), [f"Z{m}" for m in zeros])
        axes.set_yticks(range(len(poles)), [f"P{n}" for n in poles])
        axes.set_xlim(-0.5, len(zeros) - 0.5)
        axes.set_ylim(len(poles) - 0.5, -0.5)
        axes.set_xlabel("zeros")
        axes.grid(False)
        axes.tick_params(length=0)
        axes.spines[:].set_visible(False)
    left.set_ylabel("poles")
    handles = [
        Patch(facecolor="none", edgecolor=INK, linewidth=2.0, label=f"chosen: {grid.chosen}"),
        Patch(
            facecolor="none",
            edgecolor=INK,
            linewidth=1.4,
            linestyle=(0, (2, 1.5)),
            label=f"least BIC: {grid.chosen_by_bic}",
        ),
    ]
    if any(not fit.ok for fit in grid.fits.values()):
        hatched = Patch(facecolor="#f3f4f6", edgecolor="#c5cad1", hatch="////", label="no model")
        handles.append(hatched)
    if any(fit.ok and not fit.fit >= LOW_FIT for fit in grid.fits.values()):
        pale = Patch(facecolor="#fbe9dd", edgecolor="none", label=f"FIT below {LOW_FIT:.0f} %")
        handles.append(pale)
    figure.legend(handles=handles, loc="outside lower center", ncols=4, handlelength=1.4)
    return figure


def _short_number(value: float) -> str:
    """Three digits, or more where a whole number needs them; what is huge as a power of ten."""
    return f"{value:.{max(0, 2 - int(np.log10(value)))}f}" if 1.0 <= value < 1e4 else f"{value:.1e}"


def _heat_map(axes: Axes, grid: OrderGrid, what: str, norm: Normalize, colours: str, text) -> None:
    poles = sorted({fit.n_poles for fit in grid.fits.values()})
    zeros = sorted({fit.n_zeros for fit in grid.fits.values()})
    map_ = colormaps[colours]
    frames: list[Rectangle] = []
    for order, fit in grid.fits.items():
        x, y = zeros.index(fit.n_zeros), poles.index(fit.n_poles)
        cell = (x - 0.47, y - 0.46)
        if not fit.ok:
            axes.add_patch(
                Rectangle(
                    cell, 0.94, 0.92, facecolor="#f3f4f6", edgecolor="#c5cad1", hatch="////", lw=0
                )
            )
            axes.text(
                x,
                y,
                _short(fit),
                ha="center",
                va="center",
                fontsize=6.5,
                color=MUTED,
                bbox={"facecolor": "#f3f4f6", "edgecolor": "none", "pad": 1.0},
            )
            continue
        value, low = getattr(fit, what), not fit.fit >= LOW_FIT
        shade = map_(norm(value))
        face, ink = ("#fbe9dd", INK) if low else (shade, legible(shade))
        axes.add_patch(Rectangle(cell, 0.94, 0.92, facecolor=face, edgecolor="none"))
        axes.text(
            x, y, text(value), ha="center", va="center", fontsize=8, color=ink,
            alpha=0.75 if low else 1.0, fontweight="bold" if order == grid.chosen else "normal",
        )  # fmt: skip
        if order == grid.chosen:
            frames.append(Rectangle(cell, 0.94, 0.92, fill=False, edgecolor=INK, lw=2.2))
        if order == grid.chosen_by_bic:
            inset = 0.07 if order == grid.chosen else 0.0
            frames.append(
                Rectangle(
                    (cell[0] + inset, cell[1] + inset),
                    0.94 - 2 * inset,
                    0.92 - 2 * inset,
                    fill=False,
                    edgecolor=INK,
                    lw=1.4,
                    linestyle=(0, (2, 1.5)),
                )
            )
    for frame in frames:
        halo = withStroke(linewidth=frame.get_linewidth() + 2.0, foreground="white")
        frame.set_path_effects([halo])
        axes.add_patch(frame)


def _short(fit: Fit) -> str:
    """The first words of a status, two short lines at most."""
    return fit.status.split(":")[0].replace(" ", "\n", 1)
