"""What the command line shows while it works and when it is done. Nothing here computes."""

import math
import os
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn
from rich.segment import Segments
from rich.table import Table

if TYPE_CHECKING:  # a command imports what it uses, which takes a second for all
    from .compare import Comparison
    from .diagnose.answer.result import Diagnosis
    from .identify.result import OrderGrid
    from .reproduce import Experiments


class _Console(Console):
    """One whose reader may go (`vdmsi diagnose ... | head`): what is left to do is done all the
    same, and says nothing more."""

    def on_broken_pipe(self) -> None:
        """Go on without a word."""
        self.quiet = True
        hush()


def hush() -> None:
    """Send what is still to be shown nowhere, since who read it has gone."""
    with suppress(OSError, ValueError):  # an output that is no file
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


_WIDEST = 10_000  # characters, of a table

OUT = _Console(highlight=False, markup=False)  # names and remarks have brackets of their own
ERR = Console(stderr=True, highlight=False, markup=False)


@contextmanager
def working(what: str) -> Iterator[Callable[[str], None]]:
    """A spinner on standard error, where that is a terminal; gives what changes its words."""
    if not ERR.is_terminal:
        yield lambda _: None
        return
    with ERR.status(what) as status:
        yield status.update


def progress() -> Progress:
    """A bar on standard error that is gone when the work is done."""
    columns = (
        TextColumn("{task.description}", markup=False),
        BarColumn(),
        MofNCompleteColumn(),
        TimeElapsedColumn(),
    )
    return Progress(*columns, console=ERR, transient=True, disable=not ERR.is_terminal)


def show_table(header: Sequence[str], rows: Sequence[Sequence[str]]) -> None:
    """A table on standard output, without columns that are empty; those after the first two stand
    to the right. A terminal that is too narrow breaks its lines: a number that lacks its end is
    another number."""
    told = [i for i in range(len(header)) if any(row[i] != "–" for row in rows)]
    header, rows = [header[i] for i in told], [[row[i] for i in told] for row in rows]
    table = Table(box=None, pad_edge=False, header_style="bold")
    for i, name in enumerate(header):
        justify = "left" if i < 2 else "right"
        table.add_column(name, justify=justify, no_wrap=True)
    for row in rows:
        table.add_row(*row)
    whole = OUT.measure(table, options=OUT.options.update(width=_WIDEST)).maximum
    wide = OUT.options.update(width=max(OUT.width, whole))
    OUT.print(Segments(OUT.render(table, wide)), soft_wrap=True, end="")


def _percent(value: float | None) -> str:
    """Two decimals; a dash for what is not there."""
    return "–" if value is None or not math.isfinite(value) else f"{value:.2f}"


def show_grids(grids: Mapping[str, "OrderGrid"]) -> None:
    """The chosen order of each plant, and that of the least BIC where it differs."""
    rows = []
    for name, grid in grids.items():
        for order in dict.fromkeys((grid.chosen, grid.chosen_by_bic)):
            fit = grid[order]
            delay = None if fit.model is None else fit.model.delay
            rows.append(
                [
                    name,
                    order + ("" if order == grid.chosen else " (BIC)"),
                    *(_percent(value) for value in (fit.fit, fit.held_out_fit)),
                    f"{fit.mse:.3g}",
                    "–" if delay is None else f"{1e3 * float(delay):.1f}",
                    fit.status,
                ]
            )
    header = ["plant", "order", "FIT %", "held out %", "MSE", "delay ms", "status"]
    show_table(header, rows)
    for name, grid in grids.items():
        for warning in (*filter(None, [grid.note]), *grid.best.warnings):
            OUT.print(f"{name}: {warning}", soft_wrap=True)
        if grid.left_out:
            told = ", ".join(f"{fit.order} ({fit.fit:.2f} %)" for fit in grid.left_out)
            OUT.print(f"{name}: better, but the data do not support them: {told}", soft_wrap=True)


def show_comparisons(comparisons: Sequence["Comparison"]) -> None:
    """FIT of each channel and translation errors of each model, a line per log and model."""
    channels = list(
        dict.fromkeys(c for k in comparisons for p in k.predictions.values() for c in p.scores)
    )
    header = ["log", "model", *(f"FIT {c} %" for c in channels), "mean error m", "in windows m"]
    rows = []
    for comparison in comparisons:
        for name, prediction in comparison.predictions.items():
            scores = [prediction.scores.get(channel) for channel in channels]
            errors = [prediction.whole, prediction.windows]
            rows.append(
                [comparison.record.name, name]
                + [_percent(score and score.fit) for score in scores]
                + ["–" if error is None else f"{error.ate['mean']:.3f}" for error in errors]
            )
    show_table(header, rows)
    for comparison in comparisons:
        log = comparison.record.name
        for name, prediction in comparison.predictions.items():
            if not prediction.ok:
                _say(f"{log}: {name}: {prediction.status}")
        if comparison.lacking:
            _say(f"{log}: {comparison.lacking}")


def show_reproduction(experiments: Sequence["Experiments"]) -> None:
    """Table 3 and the end of figure 7, a line per car, scenario and model."""
    header = ["car", "scenario", "model", "ATE max m", "mean", "rmse", "without sensors, at exit m"]
    rows = [
        [one.trim.name, course, model]
        + [f"{own.ate[name]:.3f}" for name in ("max", "mean", "rmse")]
        + [f"{run.error[run.at_exit]:.3f}"]
        for one in experiments
        for course, found in one.open_loop.items()
        for model, own in found.estimates.items()
        for run in [one.closed_loop[course][model]]
    ]
    show_table(header, rows)


def show_diagnosis(diagnosis: "Diagnosis") -> None:
    """The verdict, each finding in words, what it gains, and what remains."""
    from .diagnose.answer.words import (
        disturbances,
        in_words,
        left_over,
        resting,
        title,
        verdict,
    )

    for told in diagnosis.contradictions:
        OUT.print(told, style="bold", soft_wrap=True, markup=False)
    OUT.print(f"{verdict(diagnosis)}.", style="bold", soft_wrap=True)
    for i, finding in enumerate(diagnosis.findings, start=1):
        _say(f"{i}. {finding.sentence}")
    rows = [
        [
            f"{i}. {in_words(finding.cause)}",
            gain.channel,
            f"{gain.before:.1f}",
            f"{gain.after:.1f}",
            f"{gain.after - gain.before:+.1f}" + (f" ± {gain.se:.1f}" if gain.se > 0.0 else ""),
            *("–" if e is None else f"{e:.3f}" for e in (gain.ate_before, gain.ate_after)),
        ]
        for i, finding in enumerate(diagnosis.findings, start=1)
        for gain in [finding.gain]
    ]
    if rows:
        header = ["cause", "channel", "FIT %", "with it", "gain", "error m", "with it"]
        show_table(header, rows)
    for left in diagnosis.unexplained[len(diagnosis.contradictions) :]:
        _say(left_over(left))
    for said in disturbances(diagnosis):
        _say(said)
    for level in diagnosis.levels:
        _say(resting(level))
    if diagnosis.small:
        names = ", ".join(title(finding) for finding in diagnosis.small)
        _say(f"Significant, but small or not sure enough to be named: {names}.")
    for unseen in diagnosis.unseen:
        _say(unseen)


def _say(text: str) -> None:
    """A sentence as it is, brackets and all."""
    OUT.print(text, soft_wrap=True, markup=False)


def tell_report(out: Path, *, written: bool) -> None:
    """Say where the report is, or that the one in the folder is not of the results that were just
    written."""
    file = out / "report.html"
    if written:
        _say(f"report: {file}")
    elif file.exists():
        _say(f"{file} is older than these results: it is of an earlier run")


def show_sweep(rows: Sequence[Mapping[str, Any]]) -> None:
    """A line per cell of a sweep."""
    show_table(
        ["log", "plant", "order", "BIC", "FIT %", "held out %", "status"],
        [
            [row["log"], row["plant"], "–", "–", "–", "–", "refused"]
            if "refused" in row
            else [
                *(row[key] for key in ("log", "plant", "chosen", "chosen_by_bic")),
                *(_percent(row[k]) for k in ("fit", "held_out_fit")),
                row["status"],
            ]
            for row in rows
        ],
    )
