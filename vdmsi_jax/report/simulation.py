"""The report of `vdmsi simulate`."""

from collections.abc import Mapping, Sequence

from .. import plots
from ..compare import SUCCESSFUL, Comparison
from .identification import what_was_read
from .page import Block, Page, Picture, Section, Table, Text, Tiles
from .text import number, percent


def simulation_page(comparisons: Sequence[Comparison]) -> Page:
    """For each log: the scores of each channel, the path and its error, for every model."""
    names = list(comparisons[0].predictions)
    records = [comparison.record for comparison in comparisons]
    return Page(
        title="Simulation: " + " and ".join(names) + " beside the measurement",
        lead="On " + ", ".join(record.name for record in records),
        sections=[
            Section("What was read", what_was_read(records)),
            *(_run(i, comparison) for i, comparison in enumerate(comparisons)),
        ],
    )


def _run(i: int, comparison: Comparison) -> Section:
    predictions = comparison.predictions
    blocks: list[Block] = []
    if any(p.whole is not None for p in predictions.values()):
        blocks += [_tiles(comparison), _errors(comparison)]
    blocks += [
        Text(f"{name}: {p.status}", kind="warning")
        for name, p in predictions.items()
        if p.status != SUCCESSFUL
    ]
    channels = list(dict.fromkeys(c for p in predictions.values() for c in p.scores))
    if channels:
        rows = [
            [channel, *(percent(p.scores[channel].fit) for p in predictions.values())]
            + [number(p.scores[channel].mse) for p in predictions.values()]
            for channel in channels
        ]
        header = ["channel", *(f"FIT {n}" for n in predictions), *(f"MSE {n}" for n in predictions)]
        blocks += [
            Table(header, rows, caption="How well each channel is predicted, in SI units."),
            Picture(
                plots.to_svg(plots.channels(comparison), f"run{i}-channels"),
                "Measured and predicted responses.",
            ),
        ]
    if any(p.whole is not None for p in predictions.values()):
        blocks += [
            Picture(
                plots.to_svg(plots.paths(comparison), f"run{i}-paths"),
                "Measured and predicted paths from the same start.",
            ),
            Picture(
                plots.to_svg(plots.translation_error(comparison), f"run{i}-error"),
                "Distance between predicted and measured position.",
            ),
        ]
    return Section(comparison.record.name, blocks)


def _tiles(comparison: Comparison) -> Tiles:
    window = f"{comparison.window:g} s"
    return Tiles(
        [
            (f"{name}: mean translation error", f"{number(p.whole.ate['mean'], 3)} m", remark)
            for name, p in comparison.predictions.items()
            if p.whole is not None
            for remark in [
                "whole run"
                if p.windows is None
                else f"whole run; {number(p.windows.ate['mean'], 3)} m over {window} windows"
            ]
        ]
    )


def _errors(comparison: Comparison) -> Table:
    """Max, mean and rmse of each model, and what the last takes off the first."""
    names = [name for name, p in comparison.predictions.items() if p.whole is not None]
    kinds = {
        "whole run, from its start": [comparison.predictions[n].whole for n in names],
        f"{comparison.window:g} s windows": [comparison.predictions[n].windows for n in names],
    }
    table: list[tuple[str, list[Mapping[str, float]]]] = [
        (kind, [errors.ate for errors in found if errors is not None])
        for kind, found in kinds.items()
    ]
    aligned = [comparison.predictions[n].aligned for n in names]
    table.append(("whole run, aligned", [ate for ate in aligned if ate is not None]))
    rows = [
        [kind, statistic, *(number(ate[statistic]) for ate in ates)]
        + ([_taken_off(ates[0][statistic], ates[-1][statistic])] if len(names) > 1 else [])
        for kind, ates in table
        if len(ates) == len(names)
        for statistic in ("max", "mean", "rmse")
    ]
    header = ["translation error (m)", "", *names]
    header += [f"{names[-1]} against {names[0]}"] if len(names) > 1 else []
    return Table(header, rows, strong=[i for i, row in enumerate(rows) if row[1] == "mean"])


def _taken_off(before: float, after: float) -> str:
    return f"{100.0 * (after / before - 1.0):+.1f} %".replace("-", "−") if before > 0 else "–"
