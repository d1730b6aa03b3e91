"""`results.json`: every number of the experiments with its unit, for reports to be made from."""

import dataclasses
from collections.abc import Mapping, Sequence
from typing import Any

from ..identify.result import LOW_FIT, Fit, OrderGrid
from ..testbed import UNITS as CAR_UNITS
from . import published
from .closed_loop import ClosedLoop
from .course import PAPER_SPEED, RAMP, Course
from .identification import PAPER_OPTIONS, PAPER_ORDER, Identification
from .open_loop import STATISTICS, OpenLoop, gain
from .reproduce import KEYS, Experiments, named

SCHEMA = "vdmsi.reproduce/1"

UNITS = {
    "fit": "%",
    "mse": "squared unit of the plant's output",
    "ate": "m",
    "error": "m",
    "deviation": "m",
    "heading": "rad",
    "t": "s",
    "improved": "%",
    "l_f": "m",
    "l_r": "m",
    "max_steering": "rad",
    "max_acceleration": "m/s^2",
    "speed": "m/s",
}

ASKED = {
    "vdm_si_over_vdm": 70.0,
    "extended_over_vdm_si": 50.0,
    "at_exit": 60.0,
    "outage": 60.0,
    "outage_seconds": 10.0,
}
"""By how much an error should fall, percent: of table 3; by the extended model; at the end of the
bend without sensors; and after an outage of so many seconds."""


def results_document(
    experiments: Sequence[Experiments],
    *,
    source: str,
    beyond: Mapping[str, Any] | None = None,
    beyond_source: str = "",
) -> dict[str, Any]:
    """The contents of `results.json`.

    Args:
        experiments: one per car.
        source: where the logs came from, for readers.
        beyond: the document of the studies beyond the paper.
        beyond_source: where that came from, for readers.
    """
    return {
        "schema": SCHEMA,
        "source": source,
        "units": UNITS,
        "paper": {
            "table_1": published.TABLE_1,
            "table_2": published.TABLE_2,
            "table_3": {
                course: {KEYS[model]: ate for model, ate in models.items()}
                | {"improved": _improved(models, "VDM", "VDM-SI")}
                for course, models in published.TABLE_3.items()
            },
            "fit": published.FIT,
        },
        "speed": PAPER_SPEED,
        "asked": ASKED,
        "cars": {one.trim.name: _car(one) for one in experiments},
        "beyond": None if beyond is None else {"source": beyond_source, **beyond},
    }


def _car(one: Experiments) -> dict[str, Any]:
    car = one.trim.car
    d = car.dimensions
    return {
        "title": one.trim.title,
        "table_1": {name: getattr(d, name) for name in published.TABLE_1},
        "dimensions": _with_units(d),
        "controllers": _with_units(car.controllers),
        "causes": _with_units(car.causes, changed=True),
        "sensor": _with_units(car.sensor),
        "identification": _identification(one.identification),
        "table_2": {
            name: {
                "chosen": _parameters(grid.best),
                "paper_order": _parameters(grid[PAPER_ORDER]),
            }
            for name, grid in one.identification.grids.items()
        },
        "diagnosis": named(one.diagnosis),
        "driven_with": one.driven_with,
        "table_3": {name: _open_loop(found) for name, found in one.open_loop.items()},
        "speed_command_ramp": {"value": RAMP, "unit": "m/s^2"},
        "vdm_rules": {
            name: {
                profile: {
                    rule.name.lower(): {"rule": rule.value, "ate_from_rest": dict(ate)}
                    for rule, ate in rules.items()
                }
                for profile, rules in found.rules.items()
            }
            for name, found in one.open_loop.items()
        },
        "figure_7": {
            name: _closed(one.open_loop[name].course, runs)
            for name, runs in one.closed_loop.items()
        },
    }


def _with_units(part: Any, *, changed: bool = False) -> dict[str, Any]:
    """The numbers of a part of a car; only those that are not as usual, if `changed`."""
    return {
        own.name: {"value": getattr(part, own.name), "unit": CAR_UNITS[own.name]}
        for own in dataclasses.fields(part)
        if not changed or getattr(part, own.name) != own.default
    }


def _identification(found: Identification) -> dict[str, Any]:
    options = {"delay": PAPER_OPTIONS.delay, "offset": PAPER_OPTIONS.offset}
    return {
        "options": options,
        "low_fit": LOW_FIT,
        "paper_order": PAPER_ORDER,
        "plants": {name: _grid(grid) for name, grid in found.grids.items()},
    }


def _grid(grid: OrderGrid) -> dict[str, Any]:
    output = grid.plant.output
    return {
        "input": grid.plant.input,
        "output": output,
        "unit": grid.record.units.get(output, "1"),
        "fit_loss": grid.fit_loss,
        "chosen": grid.chosen,
        "chosen_by_bic": grid.chosen_by_bic,
        "chosen_by_fit": max((f for f in grid.fits.values() if f.ok), key=lambda f: f.fit).order,
        "figure": {order: _cell(fit) for order, fit in grid.fits.items()},
    }


def _cell(fit: Fit) -> dict[str, Any]:
    """One cell of figure 4 or 5; one without a model says why."""
    if not fit.ok:
        return {"empty": fit.status}
    return {
        "fit": fit.fit,
        "mse": fit.mse,
        "held_out_fit": fit.held_out_fit,
        "bic": fit.bic,
        "low": not fit.fit >= LOW_FIT,
        "status": fit.status,
        "warnings": list(fit.warnings),
    }


def _parameters(fit: Fit) -> dict[str, Any]:
    """The parameters of one order with their 95 % intervals."""
    values = {}
    for name in fit.parameter_names:
        low, high = fit.interval(name)
        values[name] = {"value": fit.value(name), "low": low, "high": high, "std": fit.std[name]}
    return {
        "order": fit.order,
        "fit": fit.fit,
        "mse": fit.mse,
        "parameters": values,
        "interval_level": 0.95,
        "poles": fit.poles,
        "zeros": fit.zeros,
        "gain_at_rest": None if fit.model is None else float(fit.model.num[-1] / fit.model.den[-1]),
        "warnings": list(fit.warnings),
    }


def _open_loop(found: OpenLoop) -> dict[str, Any]:
    def table(which: str) -> dict[str, Any]:
        rows = {name: getattr(own, which) for name, own in found.estimates.items()}
        improved = {
            f"{KEYS[after]}_over_{KEYS[before]}": _improved(rows, before, after)
            for before, after in (("VDM", "VDM-SI"), ("VDM-SI", "extended"))
            if after in rows
        }
        return {KEYS[name]: dict(ate) for name, ate in rows.items()} | {"improved": improved}

    return table("ate") | {
        "title": found.course.title,
        "from_rest": table("from_rest"),
        "channels": {KEYS[name]: dict(own.fit) for name, own in found.estimates.items()},
        "duration": float(found.t[-1]),
        "time_of_exit": float(found.t[found.at_exit]),
    }


def _improved(rows: Any, before: str, after: str) -> dict[str, float]:
    return {name: gain(rows[before][name], rows[after][name]) for name in STATISTICS}


def _closed(course: Course, runs: Any) -> dict[str, Any]:
    found: dict[str, Any] = {KEYS[name]: _run(run) for name, run in runs.items()}
    at_exit = {name: float(run.error[run.at_exit]) for name, run in runs.items()}
    fallen = {
        f"{KEYS[after]}_over_{KEYS[before]}": gain(at_exit[before], at_exit[after])
        for before, after in (("VDM", "VDM-SI"), ("VDM-SI", "extended"), ("VDM", "extended"))
        if after in runs
    }
    return found | {"improved_at_exit": fallen, "title": course.title}


def _run(run: ClosedLoop) -> dict[str, Any]:
    return {
        "time_of_exit": float(run.t[run.at_exit]),
        "error_at_exit": float(run.error[run.at_exit]),
        "error_at_end": float(run.error[-1]),
        "error_max": float(run.error.max()),
        "deviation_at_exit": float(run.deviation[run.at_exit]),
        "deviation_max": float(abs(run.deviation).max()),
        "t": run.t,
        "error": run.error,
    }
