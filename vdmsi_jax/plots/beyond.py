"""What lies beyond the paper, from the plain numbers of `vdmsi_jax.reproduce.beyond`."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import FixedLocator, NullLocator

from .style import COLOURS, INK, MUTED, WIDTH, colour, styled

MODELS = ("VDM", "VDM-SI", "extended")
SCENARIOS = {"bend": "90° bend", "s_curve": "S-curve"}
GAINS = {
    "VDM-SI over VDM": ("VDM-SI below VDM", COLOURS["VDM-SI"]),
    "extended over VDM-SI": ("extended below VDM-SI,\nwhere there is a cause", COLOURS["extended"]),
}
PARTS = {
    "powertrain": "powertrain's response",
    "steering": "steering's response",
    "offset": "steering offset",
    "gain_nonlinearity": "steering gain\nthat bends",
    "backlash": "play in the steering",
    "understeer": "understeer",
}
ASKED = 70.0  # percent by which VDM-SI should lower the error


@styled
def distribution(population: Mapping[str, Any], published: Mapping[str, Any]) -> Figure:
    """Table 3 over drawn vehicles: the mean error of each, and by how much one model lowers
    another's, medians with the middle 95 %.

    Args:
        population: of the document.
        published: table 3 of `results.json`, for the marks of what the paper printed.
    """
    figure = Figure(figsize=(WIDTH, 5.8))
    panels = figure.subplots(2, len(SCENARIOS), height_ratios=(1.0, 1.15))
    for above, below, letter, (scenario, title) in zip(
        *panels, "ab", SCENARIOS.items(), strict=True
    ):
        rows = [row for row in population["ate"] if row["scenario"] == scenario]
        mean = next(row for row in rows if row["statistic"] == "mean")
        _swarms(above, population["errors"][scenario], mean)
        above.set_title(f"({letter}) {title}, {population['vehicles']} vehicles")
        for i, row in enumerate(rows):
            for j, (key, (label, tone)) in enumerate(GAINS.items()):
                _interval(below, row[key], i + 0.3 * (j - 0.5), tone, label if i == 0 else None)
            said = published[scenario]["improved"][row["statistic"]]
            mark = {"label": "published"} if i == 0 else {}
            below.plot(said, i - 0.15, "D", ms=6, mfc="none", mec=INK, mew=1.1, zorder=5, **mark)
        asked = {"label": f"asked of VDM-SI, {ASKED:g} %"}
        below.axvline(ASKED, color=MUTED, lw=0.9, ls=(0, (4, 3)), **asked)
        below.plot([], [], color=MUTED, lw=2.2, alpha=0.6, label="middle 95 % of the vehicles")
        below.margins(x=0.04)
        below.set_yticks(range(len(rows)), [f"{row['statistic']} error" for row in rows])
        below.set_ylim(len(rows) - 0.5, -0.5)
        below.set_xlim(right=101.0)
        below.grid(False, axis="y")
        below.set_xlabel("error taken off (%)")
    figure.legend(*panels[1, 0].get_legend_handles_labels(), loc="outside lower center", ncols=3)
    return figure


def _swarms(axes: Axes, errors: Mapping[str, Sequence[float]], spreads: Mapping[str, Any]) -> None:
    rng = np.random.default_rng(0)  # of the vertical scatter, which means nothing
    for i, name in enumerate(MODELS):
        values = np.asarray(errors[name])
        rows = i + rng.uniform(-0.3, 0.3, values.size)
        axes.plot(values, rows, "o", color=colour(name), ms=2.2, alpha=0.35, mew=0.0)
        own = spreads[name]
        axes.plot([own["low"], own["high"]], [i, i], color=INK, lw=1.6)
        axes.plot(own["median"], i, "o", color=colour(name), ms=7, mec=INK, mew=1.2, zorder=5)
        axes.text(own["median"], i - 0.36, f"{own['median']:.2f} m", ha="center", fontsize=8.5)
    axes.set_xscale("log")
    axes.set_yticks(range(len(MODELS)), list(MODELS))
    axes.set_ylim(len(MODELS) - 0.5, -0.75)
    axes.grid(False, axis="y")
    axes.set_xlabel("mean translation error (m); median and middle 95 %")
    _decades(axes)


def _decades(axes: Axes) -> None:
    """Ticks at 1, 2 and 5 of every decade, as plain numbers."""
    ticks = [m * 10.0**e for e in range(-4, 4) for m in (1, 2, 5)]
    low, high = axes.get_xlim()
    shown = [tick for tick in ticks if low <= tick <= high]
    shown = shown if len(shown) < 8 else [t for t in shown if f"{t:e}"[0] == "1"]
    axes.xaxis.set_major_locator(FixedLocator(shown))
    axes.xaxis.set_minor_locator(NullLocator())
    axes.set_xticks(shown, [f"{tick:g}" for tick in shown])


def _interval(
    axes: Axes, spread: Mapping[str, float], row: float, tone: str, label: str | None
) -> None:
    axes.plot([spread["low"], spread["high"]], [row, row], color=tone, lw=2.2, alpha=0.6)
    axes.plot(spread["median"], row, "o", color=tone, ms=6.5, label=label, zorder=4)


@styled
def shares(population: Mapping[str, Any]) -> Figure:
    """Error budget: how many metres of VDM's mean error each part of a vehicle makes."""
    figure = Figure(figsize=(WIDTH, 3.4))
    every = figure.subplots(1, len(SCENARIOS), sharey=True)
    for axes, letter, row in zip(every, "ab", population["budget"], strict=True):
        for i, part in enumerate(PARTS):
            own = row[part]
            axes.barh(i, own["mean"], height=0.6, color=COLOURS["VDM-SI" if i < 2 else "extended"])
            axes.plot([own["low"], own["high"]], [i, i], color=INK, lw=1.3)
            right = max(own["high"], own["mean"])
            axes.text(right, i, f"  {own['mean']:.2f} m", va="center", fontsize=8.5)
        axes.axvline(0.0, color=INK, lw=0.8)
        axes.set_xlim(right=1.18 * axes.get_xlim()[1])
        axes.set_yticks(range(len(PARTS)), list(PARTS.values()))
        axes.grid(False, axis="y")
        axes.set_xlabel("share of VDM's mean error (m)")
        axes.set_title(f"({letter}) {SCENARIOS[row['scenario']]}")
    every[0].invert_yaxis()
    return figure


@styled
def tracking(online: Mapping[str, Any]) -> Figure:
    """Identification during the drive: one drive with its interval, and the error and the coverage
    of that interval over all of them, about a change of the gain."""
    figure = Figure(figsize=(WIDTH, 4.8))
    parts = figure.subplot_mosaic([["one", "one"], ["error", "held"]])
    one, example = parts["one"], online["example"]
    t, gain, std = (np.asarray(example[key]) for key in ("t", "gain", "std"))
    one.fill_between(
        t, gain - 1.96 * std, gain + 1.96 * std, color=COLOURS["VDM-SI"], alpha=0.25, lw=0.0
    )
    one.plot(t, gain, color=COLOURS["VDM-SI"], label="estimate, with its 95 % interval")
    one.plot(t, example["truth"], color=INK, lw=1.2, ls=(0, (4, 2)), label="truth")
    one.set_ylim(0.6, 1.3)
    one.set_ylabel("static gain")
    one.set_xlabel("time since the change (s)")
    one.set_title("(a) one drive")
    one.legend(loc="upper right", ncols=2)
    error, held = parts["error"], parts["held"]
    error.plot(online["t"], 100.0 * np.asarray(online["gain_error"]), color=COLOURS["VDM-SI"])
    error.axhline(5.0, color=MUTED, lw=0.9, ls=(0, (4, 3)))
    error.axvline(online["recovered"], color=MUTED, lw=0.9, ls=(0, (4, 3)))
    error.text(
        online["recovered"],
        15.0,
        f"  {online['recovered']:.1f} s: nine of ten\n  drives are within 5 %",
        fontsize=8.5,
    )
    error.set_ylabel("error of the gain, median (%)")
    error.set_title("(b) all drives")
    held.plot(online["t"], 100.0 * np.asarray(online["held"]), color=COLOURS["VDM-SI"])
    held.axhline(95.0, color=MUTED, lw=0.9, ls=(0, (4, 3)))
    held.set_ylabel("intervals that hold the truth (%)")
    held.set_title("(c) the intervals")
    held.set_ylim(0.0, 104.0)
    for axes in (error, held):
        axes.set_xlabel("time since the change (s)")
    return figure


@styled
def outages(rows: Sequence[Mapping[str, Any]]) -> Figure:
    """The filter without its sensor: position error at the end of an outage over its length, and
    whether the filter knew."""
    figure = Figure(figsize=(WIDTH, 3.5))
    left, right = figure.subplots(1, 2)
    seconds = [row["seconds"] for row in rows]
    for name in ("VDM", "VDM-SI"):
        error, low, high, nees = (
            [row[key][name] for row in rows] for key in ("error", "low", "high", "nees")
        )
        left.fill_between(seconds, low, high, color=colour(name), alpha=0.18, lw=0.0)
        left.plot(seconds, error, "o-", ms=4, color=colour(name), label=name)
        right.plot(seconds, nees, "o-", ms=4, color=colour(name))
    low, high = np.array([row["nees_bounds"] for row in rows]).T
    right.fill_between(seconds, low, high, color=MUTED, alpha=0.3, lw=0.0, label="consistent, 95 %")
    for axes in (left, right):
        axes.set_xscale("log")
        axes.set_xlabel("length of the outage (s)")
        axes.xaxis.set_minor_locator(NullLocator())
        axes.set_xticks(seconds, [f"{s:g}" for s in seconds])
    left.set_yscale("log")
    left.yaxis.set_major_formatter("{x:g}")
    left.set_ylabel("position error (m); median, middle 95 %")
    left.set_title("(a) error at its end")
    right.axhline(3.0, color=MUTED, lw=0.9, ls=(0, (4, 3)))
    right.set_ylim(bottom=0.0)
    right.set_ylabel("mean NEES of the pose (3 if consistent)")
    right.set_title("(b) consistency there")
    handles, labels = (
        a + b
        for a, b in zip(
            left.get_legend_handles_labels(), right.get_legend_handles_labels(), strict=True
        )
    )
    figure.legend(handles, labels, loc="outside lower center", ncols=3)
    return figure


@styled
def steering_explained(steering: Mapping[str, Any]) -> Figure:
    """The paper's steering model beside a steering that has nothing but a plain fault; and the slow
    zero that the paper's order makes of every fault."""
    figure = Figure(figsize=(WIDTH, 6.0))
    above, below = figure.subplots(2, 1, height_ratios=(1.0, 1.25))
    first = steering["alike"][0]
    t = first["t"]
    above.plot(t, first["command"], color=COLOURS["command"], lw=1.0, label="command")
    above.plot(t, first["sound"], color=INK, lw=1.0, ls=(0, (4, 2)), label="steering, sound")
    tones = (COLOURS["extended"], "#cc79a7", "#e69f00")
    for own, tone in zip(steering["alike"], tones, strict=False):
        above.plot(own["t"], own["faulty"], color=tone, label=f"with {own['fault']}")
    above.plot(t, first["paper"], color=COLOURS["VDM"], label="table 2 of the paper")
    above.set_xlabel("time t (s)")
    above.set_ylabel("angle δ (rad)")
    above.set_title("(a) steps to one side, without noise")
    above.legend(loc="upper center", bbox_to_anchor=(0.42, -0.24), ncols=5, columnspacing=1.2)
    _zeros(below, steering)
    return figure


def _zeros(axes: Axes, steering: Mapping[str, Any]) -> None:
    rows = [*steering["absorbed"], *steering["explanations"]]
    rows = [row for row in rows if row["excitation"] == "to one side" and row["chooses_p2z2"]]
    rows.sort(key=lambda row: (row["fault"], row["size"]))
    for i, row in enumerate(rows):
        own, like = row["slow_zero"], row["looks_like_the_paper"]
        tone = COLOURS["VDM"] if like else COLOURS["command"]
        axes.plot([own["low"], own["high"]], [i, i], color=tone, lw=2.0)
        axes.plot(own["median"], i, "o", color=tone, ms=6)
    zero = steering["paper_zero"]
    axes.axvline(zero, color=INK, lw=1.1, ls=(0, (4, 2)))
    said = f"paper's zero, {zero:+.4f} rad/s "
    axes.text(zero, -0.9, said, fontsize=8.5, va="center", ha="right")
    axes.axvline(0.0, color=MUTED, lw=0.8)
    sizes = [f"{row['size']:.2g} {row['unit'].replace('-', '')}" for row in rows]
    named = zip(rows, sizes, strict=True)
    labels = [f"{row['fault']}, {size.replace('-', '−')}" for row, size in named]
    axes.set_yticks(range(len(rows)), labels)
    axes.set_ylim(len(rows) - 0.4, -1.6)
    axes.set_xscale("symlog", linthresh=0.02)
    axes.grid(False, axis="y")
    axes.set_xlabel("slow zero of P2Z2 (rad/s); median and middle 95 %")
    axes.set_title("(b) what the paper's order makes of a fault; in colour where it looks alike")
