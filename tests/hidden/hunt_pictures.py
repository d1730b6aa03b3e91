"""The hunt's two pictures: what was taken for what, and how loud a cause must be to be heard."""

from collections.abc import Sequence

import numpy as np
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle

from . import hunt_scores as score
from .hunt_scores import Line

INK, BLUE, ORANGE, GREY = "#1b1f24", "#0072b2", "#d55e00", "#6b7280"
_LAST = ("elsewhere", "unexplained", "none")


def confusion(singles: Sequence[Line]) -> Figure:
    """Rows: what was hidden; columns: what led the answer."""
    table = score.confusion(singles)
    rows = sorted({truth for truth, _ in table})
    told = sorted({x for _, x in table if x not in _LAST} | set(rows))
    columns = [*told, *_LAST]
    counts = np.array([[table[a, b] for b in columns] for a in rows], float)
    shares = counts / np.maximum(counts.sum(1, keepdims=True), 1.0)
    figure = Figure(
        figsize=(max(7.5, 2.6 + 0.3 * len(columns)), 2.4 + 0.28 * len(rows)), layout="constrained"
    )
    axes = figure.subplots()
    axes.imshow(shares, cmap="Blues", vmin=0.0, vmax=1.0, aspect="auto")
    for i, row in enumerate(rows):
        for j, column in enumerate(columns):
            if counts[i, j]:
                ink = "white" if shares[i, j] > 0.55 else INK
                axes.text(j, i, f"{counts[i, j]:.0f}", ha="center", va="center", color=ink, size=7)
            if row == column:
                box = Rectangle((j - 0.5, i - 0.5), 1, 1, fill=False, edgecolor=GREY, linewidth=0.8)
                axes.add_patch(box)
    words = [c.replace("_", " ") for c in columns]
    axes.set_xticks(range(len(columns)), words, rotation=60, ha="right", size=8)
    axes.set_yticks(range(len(rows)), [r.replace("_", " ") for r in rows], size=8)
    axes.axvline(len(told) - 0.5, color=INK, linewidth=0.8)
    axes.set_xlabel("answer that leads (the truth within its set counts as the truth)")
    axes.set_ylabel("hidden cause")
    axes.set_title(f"{len(singles)} single causes: cases, shaded by share of the row", loc="left")
    return figure


def detection(singles: Sequence[Line]) -> Figure:
    """Share detected over lambda0, with intervals, beside the laws."""
    figure = Figure(figsize=(7.5, 4.2), layout="constrained")
    axes = figure.subplots()
    grid = np.geomspace(0.5, 2000.0, 300)
    curves = ((5.35, BLUE, "-", "prototype"), (4.7, GREY, "--", "oracle"))
    for threshold, colour, dash, who in curves:
        label = f"Φ(√λ₀ − {threshold}): {who}"
        axes.plot(grid, [score.law(x, threshold) for x in grid], dash, color=colour, label=label)
    for i, (x, r) in enumerate(score.detection(singles)):
        x, (low, high) = float(np.clip(x, 0.5, 2000.0)), r.interval
        axes.plot([x, x], [low, high], color=ORANGE, linewidth=1.2)
        label = "this project, 95 % interval" if i == 0 else None
        axes.plot([x], [r.share], "o", color=ORANGE, label=label)
        axes.annotate(f"{r.n}", (x, r.share), (5, -10), textcoords="offset points", size=7)
    axes.set_xscale("log")
    axes.set_ylim(-0.03, 1.05)
    axes.set_xlabel(
        "λ₀: energy of the cause in innovations, behind a projection off linear filters"
    )
    axes.set_ylabel("share detected")
    axes.set_title("Detection (numbers: cases; outermost points hold what lies beyond)", loc="left")
    axes.spines[["top", "right"]].set_visible(False)
    axes.legend(frameon=False, loc="lower right")
    return figure
