"""A sweep as a picture: what every order reaches on every log."""

from collections.abc import Mapping

import numpy as np
from matplotlib import colormaps
from matplotlib.colors import Normalize
from matplotlib.figure import Figure
from matplotlib.patches import Patch, Rectangle

from .style import INK, MUTED, WIDTH, legible, styled

MOST_LOST = 10.0  # points of FIT below the best of its row at which a cell is darkest


@styled
def order_sweep(rows: Mapping[str, Mapping[str, float]], chosen: Mapping[str, str]) -> Figure:
    """FIT of every order (to the right) on every plant and log (downward).

    The colour says how far an order stays below the best of its row, so that rows of unlike noise
    compare; a frame marks the chosen order.

    Args:
        rows: name of the row -> order -> FIT in percent. What is not finite stays empty; orders
            without any FIT have no column.
        chosen: name of the row -> its chosen order.
    """
    orders = sorted({order for row in rows.values() for order in row if np.isfinite(row[order])})
    figure = Figure(figsize=(WIDTH, 1.3 + 0.26 * len(rows)))
    axes = figure.subplots()
    shade, colours = Normalize(0.0, MOST_LOST), colormaps["cividis_r"]
    for y, (name, row) in enumerate(rows.items()):
        best = max((fit for fit in row.values() if np.isfinite(fit)), default=np.nan)
        for x, order in enumerate(orders):
            fit = row.get(order, np.nan)
            if not np.isfinite(fit):
                axes.text(x, y, "–", ha="center", va="center", fontsize=6.5, color=MUTED)
                continue
            face = colours(shade(best - fit))
            frame = {"edgecolor": INK, "lw": 1.8, "zorder": 3} if chosen.get(name) == order else {}
            axes.add_patch(Rectangle((x - 0.48, y - 0.46), 0.96, 0.92, facecolor=face, **frame))
            axes.text(
                x, y, f"{fit:.1f}", ha="center", va="center", fontsize=7, color=legible(face),
                zorder=4, fontweight="bold" if frame else "normal",
            )  # fmt: skip
    axes.set_xticks(range(len(orders)), orders, rotation=90, fontsize=7)
    axes.set_yticks(range(len(rows)), list(rows), fontsize=7)
    axes.set_xlim(-0.5, len(orders) - 0.5)
    axes.set_ylim(len(rows) - 0.5, -0.5)
    axes.set_title("FIT (%)")
    axes.set_xlabel("order")
    axes.grid(False)
    axes.tick_params(length=0)
    axes.spines[:].set_visible(False)
    handles = [
        Patch(facecolor=colours(shade(lost)), label=label)
        for lost, label in ((0.0, "best of its row"), (MOST_LOST, f"{MOST_LOST:.0f} points less"))
    ]
    handles.append(Patch(facecolor="none", edgecolor=INK, linewidth=1.8, label="chosen"))
    figure.legend(handles=handles, loc="outside lower center", ncols=3, handlelength=1.4)
    return figure
