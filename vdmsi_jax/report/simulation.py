"""The report of `vdmsi simulate`."""

from collections.abc import Sequence
from typing import Any

from .. import plots
from ..compare import Comparison, Prediction
from .identification import what_was_read
from .page import Block, Page, Picture, Section, Table, Text, Tiles
from .phrases import capital, ended
from .text import number, percent

_MOST = 60.0  # percent of what measured responses would take off an error, to be told as one's


def simulation_page(comparisons: Sequence[Comparison]) -> Page:
    """For each log: the scores of each channel, the path and its error, for every model."""
    names = list(comparisons[0].predictions)
    records = [comparison.record for comparison in comparisons]
    return Page(
        title=f"Simulation: {', '.join(names[:-1])} and {names[-1]} beside the measurement",
        lead="On " + ", ".join(record.name for record in records),
        sections=[
            Section("What was read", what_was_read(records)),
            *(_run(i, comparison) for i, comparison in enumerate(comparisons)),
        ],
    )


def _run(i: int, comparison: Comparison) -> Section:
    predictions = comparison.predictions
    blocks: list[Block] = []
    located = any(p.whole is not None for p in predictions.values())
    if located:
        blocks += [_tiles(comparison), *_errors(comparison)]
        compared = [*predictions.values()][-1:] + [*comparison.with_measured.values()]
        if comparison.with_measured and all(p.windows is not None for p in compared):
            blocks.append(Text(_where_the_rest_comes_from(comparison)))
    blocks += [
        Text(f"{name}: {p.status}", kind="warning") for name, p in predictions.items() if not p.ok
    ]
    channels = list(dict.fromkeys(c for p in predictions.values() for c in p.scores))
    if comparison.lacking:
        blocks.append(Text(ended(capital(comparison.lacking)), kind="warning"))
    if channels:
        rows = [
            [channel, *(percent(s.fit) if s else "–" for s in scored)]
            + [number(s.mse) if s else "–" for s in scored]
            for channel in channels
            if (scored := [p.scores.get(channel) for p in predictions.values()])
        ]
        header = ["channel", *(f"FIT {n}" for n in predictions), *(f"MSE {n}" for n in predictions)]
        blocks += [
            Table(header, rows, caption="How well each channel is predicted, in SI units."),
            Picture(
                plots.to_svg(plots.channels(comparison), f"run{i}-channels"),
                "Measured and predicted responses.",
            ),
        ]
    if any(p.has_path for p in predictions.values()):
        caption = "Predicted paths; no pose was measured, and they start at the origin."
        if located:
            caption = "Measured and predicted paths from the same start"
            caption += "." if len(comparison.record.segments) == 1 else " of each stretch."
        blocks.append(Picture(plots.to_svg(plots.paths(comparison), f"run{i}-paths"), caption))
    if located:
        drawn = plots.to_svg(plots.translation_error(comparison), f"run{i}-error")
        blocks.append(Picture(drawn, "Distance between predicted and measured position."))
    return Section(comparison.record.name, blocks)


def _tiles(comparison: Comparison) -> Tiles:
    tiles = []
    for name, p in comparison.predictions.items():
        if p.whole is not None and p.windows is not None:
            whole, over = (f"{number(e.ate['mean'], 3)} m" for e in (p.whole, p.windows))
            remark = f"{comparison.stretch}; {over} over {comparison.window:g} s windows"
            tiles.append((f"{name}: mean translation error", whole, remark))
    return Tiles(tiles)


def _errors(comparison: Comparison) -> list[Table]:
    """Max, mean and rmse of each model's errors of position and heading, what the last takes off
    the first, and the floor."""
    models = [p for p in comparison.predictions.values() if p.whole is not None]
    floor = [] if comparison.floor is None else [comparison.floor]
    told = []
    if floor:
        told.append(
            "Measured responses: the bicycle on the measured speed and angle, whose error no model "
            "of the actuators can take away."
        )
    if (stretches := len(comparison.record.segments)) > 1:
        told.append(
            f"Gaps part the log into {stretches} stretches; each starts at its measured pose."
        )
    names = [p.name for p in (*models, *floor)]
    columns = [_statistics(p, comparison) for p in (*models, *floor)]
    positions, headings = (
        [{kind: both[i] for kind, both in column.items()} for column in columns] for i in (0, 1)
    )
    return [
        _table("translation error (m)", names, positions, len(models), " ".join(told)),
        _table("heading error (rad)", names, headings, len(models)),
    ]


def _table(
    what: str, names: list[str], columns: list[dict[str, Any]], models: int, caption: str = ""
) -> Table:
    """A column for each name, of which the first are the models to be set against each other."""
    rows = []
    for kind, first in columns[0].items():
        if any(column[kind] is None for column in columns):
            continue
        for statistic in first or {}:
            values = [column[kind][statistic] for column in columns]
            taken = _taken_off(values[0], values[models - 1])
            rows.append([kind, statistic, taken, *(number(value) for value in values)])
    return Table(
        [what, "", f"{names[models - 1]} against {names[0]}", *names],
        rows,
        strong=[i for i, row in enumerate(rows) if row[1] == "mean"],
        caption=caption,
    )


def _where_the_rest_comes_from(comparison: Comparison) -> str:
    """What the last model's error over windows would be with one response, or both, as measured."""

    def mean(prediction: Prediction | None) -> float:
        assert prediction is not None and prediction.windows is not None
        return prediction.windows.ate["mean"]

    last = list(comparison.predictions.values())[-1]
    own, least = mean(last), mean(comparison.floor)
    speed, angle = (mean(comparison.with_measured[channel]) for channel in ("v", "delta"))
    told = (
        f"Where the error comes from, in the mean over {comparison.window:g} s windows: "
        f"{last.name} is off by {number(own, 3)} m; with the measured speed in place of its own by "
        f"{number(speed, 3)} m, with the measured angle by {number(angle, 3)} m, with both by "
        f"{number(least, 3)} m."
    )
    if not own > least:
        return f"{told} What is left is the bicycle's own, or the pose's."
    name, taken = min(("powertrain", speed), ("steering", angle), key=lambda pair: pair[1])
    share = 100.0 * (own - taken) / (own - least)
    if share < _MOST:
        return f"{told} Neither actuator's model alone accounts for what more it could reach."
    most = f"{min(share, 100.0):.0f} %"
    return f"{told} So {most} of what better actuator models could take off is the {name}'s."


def _statistics(prediction: Prediction, comparison: Comparison) -> dict[str, tuple[Any, Any]]:
    """By kind of error, those of the position and of the heading; None where one has no such."""
    whole, windows, relative = prediction.whole, prediction.windows, prediction.relative
    assert whole is not None and windows is not None
    kinds: dict[str, tuple[Any, Any]] = {
        f"{comparison.stretch}, from its start": (whole.ate, whole.turned),
        f"{comparison.window:g} s windows": (windows.ate, windows.turned),
        f"{comparison.stretch}, aligned": (prediction.aligned, None),
    }
    if relative is not None:
        kinds[f"over every {relative.distance:g} m"] = relative.translation, relative.heading
    return kinds


def _taken_off(before: float, after: float) -> str:
    return f"{100.0 * (after / before - 1.0):+.1f} %".replace("-", "−") if before > 0 else "–"
