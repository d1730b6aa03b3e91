"""The report of `vdmsi identify`."""

from collections.abc import Mapping, Sequence

import numpy as np

from .. import plots
from ..data.record import Record
from ..errors import InputError
from ..identify.result import Fit, OrderGrid
from .page import Block, Bullets, Formula, Page, Picture, Section, Table, Text, Tiles
from .phrases import capital, ended
from .text import number, percent, polynomial, roots


def identification_page(
    grids: Mapping[str, OrderGrid],
    records: Sequence[Record],
    refused: Mapping[str, InputError] | None = None,
) -> Page:
    """What was read, and for each plant the order grid, the chosen model and its residual; for
    each refused one why."""
    logs = ", ".join(record.name for record in records)
    return Page(
        title="Identification of " + " and ".join(grids),
        lead=f"From {logs}",
        sections=[
            Section("In short", [_summary(grids), *_refused(refused or {})]),
            Section("What was read", what_was_read(records)),
            *(_plant(name, grid) for name, grid in grids.items()),
        ],
    )


def _summary(grids: Mapping[str, OrderGrid]) -> Tiles:
    return Tiles(
        [
            (f"{name} ({grid.plant.input} → {grid.plant.output})", percent(fit.fit), remark)
            for name, grid in grids.items()
            for fit in [grid.best]
            for remark in [f"FIT of {fit.order}; held out {percent(fit.held_out_fit)}"]
        ]
    )


def _refused(refused: Mapping[str, InputError]) -> list[Text]:
    return [
        Text(ended(f"{capital(name)} was not identified: {why}"), kind="warning")
        for name, why in refused.items()
    ]


def what_was_read(records: Sequence[Record]) -> list[Block]:
    """The logs and the repairs that reading them took."""
    rows = [
        [
            record.name,
            f"{record.n}",
            number(record.dt),
            number(record.duration),
            f"{len(record.segments)}",
            ", ".join(record.channels),
        ]
        for record in records
    ]
    header = ["log", "samples", "period (s)", "duration (s)", "segments", "channels"]
    repairs = [f"{record.name}: {told}" for record in records for told in record.repairs]
    said: Block = Bullets(repairs) if repairs else Text("Nothing had to be repaired.")
    return [Table(header, rows), Text("Repairs", kind="caption"), said]


def _plant(name: str, grid: OrderGrid) -> Section:
    fit = grid.best
    blocks: list[Block] = [
        *([Text(ended(capital(grid.note)), kind="note")] if grid.note else []),
        Text(_choice(grid)),
        *_left_out(grid),
        Picture(
            plots.to_svg(plots.order_grid(grid), f"{name}-grid"),
            "FIT and MSE of every order, fitted to all samples.",
        ),
        _orders(grid),
    ]
    if fit.model is not None:
        blocks += [
            _formula(fit),
            *(Text(warning, kind="warning") for warning in fit.warnings),
            _parameters(grid, fit),
            Text(f"Poles (rad/s): {roots(fit.poles)}. Zeros (rad/s): {roots(fit.zeros)}."),
            Picture(
                plots.to_svg(plots.fitted(grid), f"{name}-fitted"),
                "The measured response and the free run of the chosen model.",
            ),
            Picture(
                plots.to_svg(plots.responses(fit, grid.record), f"{name}-responses"),
                "Poles and zeros, step response and frequency response with 95 % bands.",
            ),
            Picture(
                plots.to_svg(plots.residuals(grid), f"{name}-residuals"),
                "The residual over time, its spectrum, and its correlation with itself and with "
                "the command; shaded is where 95 % of the values lie if nothing is left in it.",
            ),
        ]
    return Section(name, blocks)


def _choice(grid: OrderGrid) -> str:
    """Which order is chosen by which rule."""
    rule = (
        f"Of the orders that the data support, {grid.chosen} is the smallest within "
        f"{number(grid.fit_loss)} points of their best FIT"
    )
    if not grid.best.supported:
        rule = (
            f"The data support no order that fits nearly as well; of all, {grid.chosen} is the "
            f"smallest within {number(grid.fit_loss)} points of the best FIT"
        )
    if grid.chosen_by_bic == grid.chosen:
        return f"{rule}, and has the least BIC too."
    other = grid[grid.chosen_by_bic]
    return f"{rule}. {other.order} has the least BIC (FIT {percent(other.fit)})."


def _left_out(grid: OrderGrid) -> list[Block]:
    """The better orders that the data do not support, and why each is left out."""
    if not grid.left_out:
        return []
    reasons = [
        f"{fit.order} (FIT {percent(fit.fit)}): {'; '.join(fit.warnings or (fit.status,))}"
        for fit in grid.left_out
    ]
    said = "Better in FIT, and left out since the data do not tell them from smaller models:"
    return [Text(said), Bullets(reasons)]


def _orders(grid: OrderGrid) -> Table:
    fits = list(grid.fits.values())
    rows = [
        [
            fit.order,
            percent(fit.fit),
            percent(fit.held_out_fit),
            number(fit.mse),
            number(fit.aic, 6),
            number(fit.bic, 6),
            "yes" if fit.supported else "no" if fit.ok else "–",
            fit.status,
        ]
        for fit in fits
    ]
    return Table(
        ["order", "FIT", "held-out FIT", "MSE", "AIC", "BIC", "supported", "status"],
        rows,
        caption="All orders as a table",
        strong=[i for i, fit in enumerate(fits) if fit.order == grid.chosen],
        folded=True,
    )


def _formula(fit: Fit) -> Formula:
    assert fit.model is not None
    delay = 0.0 if fit.model.delay is None else float(fit.model.delay)
    after = f" e<sup>−{number(delay)}&thinsp;<i>s</i></sup>" if delay else ""
    numerator, denominator = (polynomial(np.asarray(c)) for c in (fit.model.num, fit.model.den))
    return Formula(f"{fit.order}: G(s)", numerator, denominator, after)


def _parameters(grid: OrderGrid, fit: Fit) -> Table:
    rows = []
    for name in fit.parameter_names:
        low, high = fit.interval(name)
        estimate, std = fit.value(name), fit.std[name]
        rows.append(
            [name, number(estimate), number(std, 2), f"{number(low)} … {number(high)}"]
            + [f"{abs(std / estimate):.1%}".replace("%", " %") if estimate else "–"]
        )
    unit = grid.record.units.get(grid.plant.output, "1")
    return Table(
        ["parameter", "estimate", "std", "95 % interval", "relative std"],
        rows,
        caption=f"Coefficients of descending powers of s; delay in s, offset in {unit}.",
    )
