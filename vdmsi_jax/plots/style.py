"""One look for all figures: colours that the colour-blind can tell apart, and type for report
width.

Figures are made through matplotlib's objects alone, so that drawing them changes no global state.
"""

import functools
import io
import re
from collections.abc import Callable, Iterator, Sequence
from typing import Any, ParamSpec

import numpy as np
from matplotlib import rc_context
from matplotlib.axes import Axes
from matplotlib.axis import Axis
from matplotlib.figure import Figure
from matplotlib.text import Text
from matplotlib.ticker import AutoLocator, FixedFormatter, FuncFormatter

P = ParamSpec("P")

INK = "#1b1f24"
MUTED = "#6b7280"
GRID = "#e3e6ea"

# Okabe & Ito (2008), with near-black for what was measured.
COLOURS = {
    "measured": INK,
    "command": "#9aa1ab",
    "VDM": "#d55e00",
    "VDM-SI": "#0072b2",
    "extended": "#009e73",
    "measured responses": "#9aa1ab",
    "held out": "#cc79a7",
}
SPARE = ("#e69f00", "#56b4e9", "#cc79a7", "#009e73", "#d55e00")

_TICKS = 5  # intervals along an axis: a report has some fifty axes, and most of its time is ticks

WIDTH = 9.0  # inches: the report's text width

_STYLE: dict[Any, Any] = {
    "figure.facecolor": "white",
    "figure.constrained_layout.use": True,
    "font.size": 9.0,
    "axes.titlesize": 10.0,
    "axes.titleweight": "bold",
    "axes.titlelocation": "left",
    "axes.titlepad": 8.0,
    "axes.titley": 1.0,  # left to matplotlib, it measures all ticks for it
    "axes.labelsize": 9.0,
    "axes.labelcolor": INK,
    "axes.edgecolor": "#aab0b8",
    "axes.linewidth": 0.8,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "axes.axisbelow": True,
    "axes.xmargin": 0.01,
    "grid.color": GRID,
    "grid.linewidth": 0.7,
    "xtick.color": MUTED,
    "ytick.color": MUTED,
    "xtick.labelcolor": INK,
    "ytick.labelcolor": INK,
    "text.color": INK,
    "lines.linewidth": 1.4,
    "legend.frameon": False,
    "legend.fontsize": 9.0,
    "hatch.linewidth": 0.6,
    "svg.fonttype": "path",
}


def legible(rgba: Sequence[float]) -> str:
    """The ink that is read best on a face of this colour (relative luminance of WCAG 2)."""
    red, green, blue = (c / 12.92 if c <= 0.04 else ((c + 0.055) / 1.055) ** 2.4 for c in rgba[:3])
    return INK if 0.2126 * red + 0.7152 * green + 0.0722 * blue > 0.22 else "white"


def styled(draw: Callable[P, Figure]) -> Callable[P, Figure]:
    """Decorate a function that returns a figure, to draw it in the project's style."""

    @functools.wraps(draw)
    def drawn(*args: P.args, **kwargs: P.kwargs) -> Figure:
        with rc_context(_STYLE):
            figure = draw(*args, **kwargs)
        for axes in figure.axes:
            for axis in (axes.xaxis, axes.yaxis):
                locator = axis.get_major_locator()
                if isinstance(locator, AutoLocator):
                    locator.set_params(nbins=_TICKS)
        for text in _texts(figure):
            if "$" in text.get_text() and not text.get_text().startswith("$\\math"):
                text.set_parse_math(False)  # a name, which may be anything
        return figure

    return drawn


def _texts(figure: Figure) -> Iterator[Text]:
    """All texts of a figure but the numbers at its axes, for which these would have to make all
    their ticks: a tenth of the time of a report."""
    for part in figure.get_children():
        if not isinstance(part, Axes):
            yield from part.findobj(Text)
    for axes in figure.axes:
        for part in axes.get_children():
            if not isinstance(part, Axis):
                yield from part.findobj(Text)
            else:
                yield part.label
                if isinstance(part.get_major_formatter(), FixedFormatter | FuncFormatter):
                    yield from part.get_ticklabels()


def framed(
    height: float,
    rows: int = 1,
    columns: int = 1,
    *,
    left: float = 0.85,
    right: float = 0.1,
    top: float = 0.5,
    bottom: float = 0.5,
    across: float = 0.8,
    down: float = 0.75,
) -> Figure:
    """A figure of the report's width, with room for labels in inches: outside on each side, and
    between columns (`across`) and rows (`down`).

    To measure every label, as a layout engine does, costs as much as to draw it; a report draws a
    dozen figures. And axes with the same margins stand in line down the page.
    """
    with rc_context({"figure.constrained_layout.use": False}):
        figure = Figure(figsize=(WIDTH, height))
    wide = (WIDTH - left - right - (columns - 1) * across) / columns
    high = (height - top - bottom - (rows - 1) * down) / rows
    figure.subplots_adjust(
        left=left / WIDTH,
        right=1.0 - right / WIDTH,
        bottom=bottom / height,
        top=1.0 - top / height,
        wspace=across / wide,
        hspace=down / high,
    )
    return figure


def room_for(labels: Sequence[str]) -> float:
    """Inches that the longest line of some labels takes, about."""
    return 0.25 + 0.075 * max(
        (len(line) for label in labels for line in label.split("\n")), default=0
    )


def to_svg(figure: Figure, name: str) -> str:
    """The figure as an SVG element for an HTML page.

    Args:
        figure: what to draw.
        name: unique on the page; it keeps the figure's internal ids apart from those of others.
            What may not stand in an id becomes its code point.
    """
    name = re.sub(r"[^A-Za-z0-9_-]", lambda found: f".{ord(found[0]):x}", name)
    buffer = io.StringIO()
    with rc_context({**_STYLE, "svg.hashsalt": name}):
        figure.savefig(buffer, format="svg", metadata={"Date": None, "Creator": None})
    svg = buffer.getvalue()
    svg = svg[svg.index("<svg") :]
    svg = re.sub(r"<metadata>.*?</metadata>", "", svg, flags=re.S)
    # Ids that matplotlib numbers or names alike in every figure (groups, glyphs) get the name
    # before.
    svg = re.sub(r'\bid="', f'id="{name}-', svg)
    svg = re.sub(r'(xlink:href="|url\()#', rf"\1#{name}-", svg)
    return svg


def colour(name: str) -> str:
    """The fixed colour of a model or signal; names without one take a spare."""
    return COLOURS.get(name) or SPARE[sum(map(ord, name)) % len(SPARE)]


def unit_label(quantity: str, unit: str) -> str:
    """`v (m/s)`; a pure number has no unit to show."""
    return quantity if unit in ("", "1") else f"{quantity} ({pretty_unit(unit)})"


def pretty_unit(unit: str) -> str:
    """`m/s^2` as `m/s²`."""
    return unit.replace("^2", "²").replace("^3", "³").replace("*", "·")


def squared_unit(unit: str) -> str:
    """The unit of a variance: `rad^2`, `(m/s)^2`."""
    return unit if unit in ("", "1") else f"{unit}^2" if unit.isalpha() else f"({unit})^2"


def envelope(t: np.ndarray, y: np.ndarray, points: int = 3000) -> tuple[np.ndarray, np.ndarray]:
    """A line with at most about `points` points that looks like the one given: of every bin of
    samples its least and its greatest, in their order. NaN breaks the line, as before."""
    size = len(y) * 2 // points
    if size < 2:
        return t, y
    keep: list[np.ndarray] = []
    for start in range(0, len(y), size):
        piece = y[start : start + size]
        if np.isnan(piece).any():
            keep.append(np.arange(start, start + len(piece)))
        else:
            keep.append(np.unique([start + int(piece.argmin()), start + int(piece.argmax())]))
    index = np.concatenate(keep)
    return t[index], y[index]


def legend_above(axes: Axes, columns: int = 6, **options) -> None:
    """A one-line legend between the title and the axes' upper right corner."""
    axes.legend(
        loc="lower right",
        bbox_to_anchor=(1.0, 1.0),
        ncols=columns,
        borderaxespad=0.2,
        handlelength=1.6,
        columnspacing=1.4,
        **options,
    )
