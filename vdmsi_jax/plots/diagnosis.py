"""A diagnosis as pictures: what each cause is worth, who is responsible, the paths, and all in
one."""

import textwrap
from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure, SubFigure

from ..diagnose.answer.result import Budget, Diagnosis, Finding, Path, Response
from ..diagnose.answer.words import disturbances, in_words, left_over, title, verdict
from .overlays import BASELINE, EXTENDED, best_window, draw_residuals, draw_signals, judged_run
from .signals import NAMES, map_axes
from .style import (
    COLOURS,
    INK,
    MUTED,
    WIDTH,
    envelope,
    framed,
    legend_above,
    pretty_unit,
    room_for,
    styled,
)

CAUSES = ("#e69f00", "#56b4e9", "#cc79a7", "#d55e00", "#f0e442", "#8da0cb", "#a6761d", "#66a61e")
"""Of the causes in a budget: none of them is the colour of a model."""
NOISE, UNEXPLAINED = "#d5d9de", "#6b7280"
PATHS = 4
"""Held-out drives that are drawn one below the other, at most."""
_MOST = 101.0  # %, up to which an axis of FIT goes
_WITH, _FIRST = "with, ±1.96 se of the rise", "predicted at first"
_LEGEND = ["baseline", "without", _WITH, _FIRST, "noise ceiling"]
_SHARED = "mean over all orders of putting in causes, not what leaving one out would cost"


@styled
def diagnosis(d: Diagnosis) -> Figure:
    """The whole answer in one picture: the response that matters most, measured and simulated, its
    residual, the path, what each cause is worth, and who is responsible."""
    sentences = [finding.sentence for finding in d.findings]
    sentences += [*map(left_over, d.unexplained), *disturbances(d)]
    said = [line for sentence in sentences for line in textwrap.wrap(sentence, 125)]
    heights = {"words": 0.35 + 0.17 * len(said)}
    if d.responses or d.paths:
        heights["signals"] = 4.1
    heights["gains"] = 1.2 + 0.55 * max(len(d.findings) or len(d.channels), 1)
    if d.budget:
        heights["budget"] = 1.35 + 0.45 * len(d.budget)
    figure = Figure(figsize=(WIDTH, sum(heights.values())))
    ratios = list(heights.values())
    parts = figure.subfigures(len(heights), 1, squeeze=False, height_ratios=ratios)
    room = dict(zip(heights, parts[:, 0], strict=True))
    top = 1.0 - 0.1 / heights["words"]
    room["words"].text(0.01, top, headline(d), va="top", fontsize=11.0, fontweight="bold")
    below = top - 0.24 / heights["words"]
    room["words"].text(0.01, below, "\n".join(said), va="top", linespacing=1.35)
    if "signals" in room:
        _draw_overview(room["signals"], d)
    _draw_gains(room["gains"].subplots(), d)
    if d.budget:
        _draw_budget(room["budget"].subplots(), d.budget)
    return figure


def headline(d: Diagnosis) -> str:
    """The verdict in a line."""
    if d.verdict == "explained":
        return "Explained: " + ", ".join(title(finding) for finding in d.findings)
    return verdict(d)


def _draw_overview(figure: SubFigure, d: Diagnosis) -> None:
    if not d.responses:
        _draw_path(figure.subplots(), *worst_paths(d.paths, 1))
        return
    response = leading_response(d)
    run = judged_run(response)
    part = best_window(response, run)
    layout, widths = ("ap;rp", (1.5, 1.0)) if d.paths else ("a;r", (1.0,))
    axes = figure.subplot_mosaic(layout, width_ratios=widths, height_ratios=(1.25, 1.0))
    draw_signals(axes["a"], response, run, part)
    draw_residuals(axes["r"], response, run, part)
    axes["r"].sharex(axes["a"])
    axes["a"].set_title(f"{response.name}: {run.title}", pad=20)
    axes["r"].set_xlabel("time t (s)")
    for name in "ar":
        legend_above(axes[name])
    if d.paths:
        _draw_path(axes["p"], *worst_paths(d.paths, 1))
        legend_above(axes["p"], handles=[axes["p"].lines[-1]])  # the other colours stand beside it


def leading_response(d: Diagnosis) -> Response:
    """The response that the strongest finding shows in; without one, that of the worst FIT against
    its noise ceiling."""
    channels = [response.channel for response in d.responses]
    wanted = [finding.gain.channel for finding in d.findings]
    found = next((c for c in wanted if c in channels), None)
    if found is None:
        scored = [c for c in channels if c in d.channels]
        room = {c: d.channels[c].ceiling - d.channels[c].fit for c in scored}
        found = max(scored, key=lambda c: room[c]) if scored else channels[0]
    return d.responses[channels.index(found)]


@styled
def gains(d: Diagnosis) -> Figure:
    """FIT before and after each finding on held-out data, with the error bar of the difference (cut
    at 100 %), what the screen had predicted before the cause was refitted, and the noise ceiling;
    and the mean translation error where the drive has a pose. Without a finding, the FIT of each
    channel beside its ceiling."""
    road = [f for f in d.findings if f.gain.ate_before is not None]
    rows = len(d.findings) or len(d.channels)
    columns, left = 2 if road else 1, room_for(_gain_rows(d))
    figure = framed(1.5 + 0.55 * max(rows, 1), 1, columns, left=left, top=0.55, across=0.3)
    if not road:
        _draw_gains(figure.subplots(), d)
        return figure
    left, right = figure.subplots(1, 2, width_ratios=(1.5, 1.0), sharey=True)
    _draw_gains(left, d)
    _draw_errors(right, d.findings)
    right.tick_params(labelleft=False)
    return figure


def _draw_gains(axes: Axes, d: Diagnosis) -> None:
    axes.set_xlabel("FIT (%)")
    labels = _gain_rows(d)
    if not d.findings:
        at = np.arange(len(labels), dtype=float)
        axes.plot([s.fit for s in d.channels.values()], at, "o", color=BASELINE, label="baseline")
        _ceilings(axes, [score.ceiling for score in d.channels.values()])
        axes.set_title("how well each channel is explained", pad=20)
    else:
        worth = [finding.gain for finding in d.findings]
        at = np.arange(len(labels), dtype=float)
        before, after = (
            np.array([getattr(g, name) for g in worth]) for name in ("before", "after")
        )
        axes.hlines(at, before, after, color=EXTENDED, lw=3.0, alpha=0.3)
        axes.plot(before, at, "o", color=BASELINE, label="without")
        bars = {"fmt": "o", "color": EXTENDED, "capsize": 3, "label": _WITH}
        half = 1.96 * np.nan_to_num([g.se for g in worth])
        axes.errorbar(after, at, xerr=[half, np.minimum(half, 100.0 - after)], **bars)
        told = [f.predicted_gain.after if f.predicted_gain else np.nan for f in d.findings]
        if np.isfinite(told).any():
            style = {"marker": "D", "ms": 7, "mfc": "none", "mec": INK, "mew": 0.9, "ls": "none"}
            axes.plot(told, at, label=_FIRST, zorder=4, **style)
        scores = [d.channels.get(gain.channel) for gain in worth]
        _ceilings(axes, [np.nan if score is None else score.ceiling for score in scores])
        for y, low, high in zip(at, before, after, strict=True):
            text = f"{low:.1f} → {high:.1f}"
            where, move = ((low + high) / 2.0, y), (0, 9)
            axes.annotate(text, where, move, textcoords="offset points", ha="center", fontsize=8)
        axes.set_title("what each cause is worth", pad=20)
    _rows(axes, labels)
    low, high = axes.dataLim.x0, axes.dataLim.x1
    margin = max(0.08 * (high - low), 0.5)  # percent; a finer scale would only show rounding
    axes.set_xlim(low - margin, min(high + margin, _MOST))
    axes.ticklabel_format(axis="x", useOffset=False)
    drawn, labels = axes.get_legend_handles_labels()
    order = [labels.index(label) for label in sorted(labels, key=_LEGEND.index)]
    legend_above(axes, handles=[drawn[i] for i in order], handletextpad=0.4)


def _gain_rows(d: Diagnosis) -> list[str]:
    """Labels of the rows: the findings, or the channels where there is none."""
    return [_row_label(f) for f in d.findings] or [NAMES.get(c, c) for c in d.channels]


def _row_label(finding: Finding) -> str:
    """The finding and the channel that it is measured in, on short lines."""
    where = f"FIT of {NAMES.get(finding.gain.channel, finding.gain.channel)}"
    return "\n".join([*textwrap.wrap(title(finding), 30), where])


def _ceilings(axes: Axes, ceilings: Sequence[float]) -> None:
    if not np.isfinite(ceilings).any():
        return
    at = np.arange(len(ceilings))
    style = {"marker": "|", "ms": 17, "mew": 2.0, "color": MUTED, "ls": "none"}
    axes.plot(ceilings, at, label="noise ceiling", zorder=1, **style)


def _rows(axes: Axes, labels: Sequence[str]) -> None:
    """Label the rows, the first on top."""
    axes.set_yticks(range(len(labels)), labels)
    axes.set_ylim(max(len(labels), 1) - 0.45, -0.55)
    axes.grid(False, axis="y")
    axes.tick_params(axis="y", length=0)


def _draw_errors(axes: Axes, findings: Sequence[Finding]) -> None:
    """Mean translation error without and with each finding."""
    reach = max(max(f.gain.ate_before or 0.0, f.gain.ate_after or 0.0) for f in findings)
    for y, finding in enumerate(findings):
        before, after = finding.gain.ate_before, finding.gain.ate_after
        if before is None or after is None:
            continue
        axes.hlines(y, before, after, color=EXTENDED, lw=3.0, alpha=0.3)
        axes.plot(before, y, "o", color=BASELINE)
        axes.plot(after, y, "o", color=EXTENDED)
        text = f"{before:.2f} → {after:.2f} m"
        middle = min(max((before + after) / 2.0, 0.22 * reach), 0.9 * reach)  # within the axes
        options = {"textcoords": "offset points", "ha": "center", "fontsize": 8}
        axes.annotate(text, (middle, y), (0, 9), **options)
    axes.set_title("on the road", pad=20)
    axes.set_xlabel("mean translation error (m)")
    axes.set_xlim(0.0, 1.12 * axes.dataLim.x1)


@styled
def budget(d: Diagnosis) -> Figure:
    """Who is responsible: of the baseline's error of each channel and of the path, the shares of
    each cause, of the noise, and of what stays unexplained. The share of a cause is the mean over
    all orders in which the causes may be put in (Shapley values); the sentence of a finding says
    instead what leaving that one out would cost."""
    labels, pad = [_budget_label(b) for b in d.budget], _over_budget(_responsible(d.budget))
    height = 1.65 + 0.5 * max(len(d.budget), 1)
    figure = framed(height, left=room_for(labels), right=0.2, top=0.25 + pad / 72.0, bottom=0.65)
    _draw_budget(figure.subplots(), d.budget)
    return figure


def _responsible(budgets: Sequence[Budget]) -> list[str]:
    """The causes that have a part in any budget."""
    return list(dict.fromkeys(cause for budget in budgets for cause in budget.parts))


def _over_budget(causes: Sequence[str]) -> float:
    """Room for the lines of a budget's legend, points."""
    return 8.0 + 12.0 * -(-(len(causes) + 2) // 4)


def _draw_budget(axes: Axes, budgets: Sequence[Budget]) -> None:
    """Bars of 100 % of the baseline's error each; a part below zero, which makes things worse, goes
    to the left."""
    causes = _responsible(budgets)
    tones = {cause: CAUSES[i % len(CAUSES)] for i, cause in enumerate(causes)}
    for row, budget in enumerate(budgets):
        parts = [(cause, part, tones[cause]) for cause, part in budget.parts.items()]
        parts += [("noise", budget.noise, NOISE), ("unexplained", budget.unexplained, UNEXPLAINED)]
        ends = {True: 0.0, False: 0.0}
        for name, part, tone in parts:
            share = 100.0 * part / budget.total if budget.total > 0.0 else 0.0
            if not np.isfinite(share):
                continue
            start, up = ends[share >= 0.0], share >= 0.0
            hatch = "////" if name == "unexplained" else None
            axes.barh(row, share, 0.62, start, color=tone, edgecolor="white", lw=0.8, hatch=hatch)
            ends[up] += share
            if abs(share) >= 7.0:
                ink = "white" if name == "unexplained" else INK
                where = (start + share / 2.0, row)
                box = {"facecolor": tone, "edgecolor": "none", "pad": 1.0}
                axes.text(
                    *where, f"{share:.0f} %", ha="center", va="center", fontsize=8, color=ink,
                    bbox=box if hatch else None,
                )  # fmt: skip
    for cause, tone in tones.items():
        axes.barh([np.nan], [np.nan], color=tone, label=in_words(cause))
    axes.barh([np.nan], [np.nan], color=NOISE, label="noise")
    axes.barh([np.nan], [np.nan], color=UNEXPLAINED, hatch="////", ec="white", label="unexplained")
    _rows(axes, [_budget_label(budget) for budget in budgets])
    axes.axvline(0.0, color=INK, lw=0.8)
    axes.set_title("who is responsible for the error", pad=_over_budget(causes))
    label = "share of the baseline's error (%)"
    axes.set_xlabel(f"{label}\n{_SHARED}" if len(causes) > 1 else label)
    legend_above(axes, columns=4)


def _budget_label(budget: Budget) -> str:
    name = "translation" if budget.name == "translation" else NAMES.get(budget.name, budget.name)
    return f"{name}\n{budget.total:.3g} {pretty_unit(budget.unit)}".removesuffix(" 1")


def worst_paths(paths: Sequence[Path], most: int = PATHS) -> list[Path]:
    """Of the held-out drives, no more than `most`, those along which the baseline errs most, in
    their order."""
    errors = [float(np.nanmean(_distance(path, path.baseline))) for path in paths]
    worst = sorted(range(len(paths)), key=lambda k: -errors[k])[:most]
    return [paths[k] for k in sorted(worst)]


@styled
def paths_before_after(d: Diagnosis) -> Figure:
    """The held-out drives on the road, the `worst_paths` of them: measured, baseline and extended,
    and the distance of both from the measured position over time.

    Raises:
        ValueError: no drive has a pose.
    """
    if not d.paths:
        raise ValueError("no held-out drive has a pose, so there is no path to draw")
    paths = worst_paths(d.paths)
    figure = framed(3.9 * len(paths), len(paths), 2, down=1.1)
    every = figure.subplots(len(paths), 2, squeeze=False, width_ratios=(1.2, 1.0))
    for (left, right), path in zip(every, paths, strict=True):
        _draw_path(left, path)
        _draw_distance(right, path)
    return figure


def _simulated(path: Path) -> list[tuple[str, np.ndarray, str]]:
    """Baseline and extended poses; where nothing was put into the model, both are one."""
    both = [("baseline", path.baseline, BASELINE), ("extended", path.extended, EXTENDED)]
    return both[:1] if np.array_equal(path.baseline, path.extended, equal_nan=True) else both


def _distance(path: Path, poses: np.ndarray) -> np.ndarray:
    """Of poses from the measured ones, m."""
    return np.hypot(*(poses - path.measured)[:, :2].T)


def _draw_path(axes: Axes, path: Path) -> None:
    step = max(1, len(path.t) // 3000)
    origin = map_axes(axes, path.measured[0, :2])
    options = {"color": COLOURS["measured"], "lw": 2.6, "alpha": 0.45, "label": "measured"}
    axes.plot(*(path.measured[::step, :2] - origin).T, **options)
    for name, poses, tone in _simulated(path):
        axes.plot(*(poses[::step, :2] - origin).T, color=tone, lw=1.4, label=name)
    x, y = path.measured[0, :2] - origin
    axes.plot(
        x, y, "o", color=COLOURS["measured"], mfc="white", ms=6, mew=1.5, zorder=4, label="start"
    )
    axes.set_title(f"path of {path.run}", pad=20)
    legend_above(axes)


def _draw_distance(axes: Axes, path: Path) -> None:
    for name, poses, tone in _simulated(path):
        distance = _distance(path, poses)
        label = f"{name}, {np.nanmean(distance):.2g} m"
        axes.plot(*envelope(path.t, distance), color=tone, label=label)
    axes.set_ylim(bottom=0.0)
    axes.set_xlabel("time t (s)")
    axes.set_ylabel("translation error (m)")
    axes.set_title("distance from measured, and mean", pad=20)
    legend_above(axes)
