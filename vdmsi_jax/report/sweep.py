"""The report of `vdmsi sweep`."""

from collections.abc import Mapping, Sequence
from math import isfinite, nan
from typing import Any

from .. import plots
from .page import Block, Page, Picture, Section, Table, Text
from .text import number, percent


def sweep_page(rows: Sequence[Mapping[str, Any]], cells: Sequence[Mapping[str, Any]]) -> Page:
    """What every order reaches on every log, and what was chosen.

    Args:
        rows: one line per cell, as `sweep.summarise` makes them.
        cells: the cells' documents, in the same order.
    """
    done = [(row, cell) for row, cell in zip(rows, cells, strict=True) if "refused" not in row]
    refused = [row for row in rows if "refused" in row]
    found: list[Block] = [_summary(done)] if done else [Text("Nothing could be identified.")]
    if done:
        found.insert(0, _picture(done))
    sections = [Section("Orders and logs", found)]
    if refused:
        table = [[row["log"], row["plant"], row["refused"]] for row in refused]
        sections.append(Section("Refused", [Table(["log", "plant", "why"], table)]))
    return Page(
        title="Sweep of orders",
        lead=f"{len(done)} of {len(rows)} plants and logs identified",
        sections=sections,
    )


def _picture(done: Sequence[tuple[Mapping[str, Any], Mapping[str, Any]]]) -> Picture:
    fits, chosen = {}, {}
    for row, cell in done:
        name = f"{row['log']} {row['plant']}"
        fits[name] = {order: _value(fit.get("fit")) for order, fit in cell["orders"].items()}
        chosen[name] = row["chosen"]
    orders = sorted({order for row in fits.values() for order in row})
    empty = [o for o in orders if not any(isfinite(row.get(o, nan)) for row in fits.values())]
    caption = "FIT of every order on every log; a dash where it could not be fitted."
    if empty:
        caption += f" Without a model anywhere, mostly as improper: {', '.join(empty)}."
    return Picture(plots.to_svg(plots.order_sweep(fits, chosen), "sweep"), caption)


def _summary(done: Sequence[tuple[Mapping[str, Any], Mapping[str, Any]]]) -> Table:
    header = ["log", "plant", "chosen", "least BIC", "FIT", "held-out FIT", "MSE", "delay (s)"]
    rows = [
        [
            *(row[key] for key in ("log", "plant", "chosen", "chosen_by_bic")),
            *(percent(_value(row[key])) for key in ("fit", "held_out_fit")),
            number(_value(row["mse"])),
            number(_value(row["delay"])),
        ]
        for row, _ in done
    ]
    return Table(header, rows, caption="The chosen order of each; all numbers are in cells/.")


def _value(found: float | None) -> float:
    return nan if found is None else float(found)
