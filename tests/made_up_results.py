"""A folder as `vdmsi reproduce` leaves it, made without computing: numbers are made up, pictures
are blank, and what lies beyond the paper is the recorded document."""

from pathlib import Path
from typing import Any

from vdmsi_jax.files import write_json, write_text
from vdmsi_jax.reproduce import COURSES, TRIMS, beyond, published
from vdmsi_jax.reproduce.document import ASKED, SCHEMA, UNITS

BLANK = '<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 30 10"><path d="M0 0L9 9"/></svg>'
STATISTICS = {"max": 2.0, "mean": 1.0, "rmse": 1.25}
FIGURES = ("figure_3", "figure_4", "figure_5", "figure_6", "figure_7", "navigated", "vdm_rules")
BEYOND = ("distribution", "budget", "online", "outages", "steering")


def write_results(folder: Path) -> Path:
    """Write `results.json` and `figures/`."""
    write_json(folder / "results.json", results())
    (folder / "figures").mkdir()
    courses = [course.name for course in COURSES]
    names = [f"look_{course}" for course in courses] + [f"beyond_{name}" for name in BEYOND]
    for trim in TRIMS:
        own = (*FIGURES, *(f"open_loop_{course}" for course in courses))
        names += [f"{trim.name}_{name}" for name in own]
    for name in names:
        write_text(folder / "figures" / f"{name}.svg", BLANK)
    return folder


def results() -> dict[str, Any]:
    """The contents of `results.json`."""
    printed = {
        course: {"vdm": rows["VDM"], "vdm_si": rows["VDM-SI"], "improved": STATISTICS}
        for course, rows in published.TABLE_3.items()
    }
    return {
        "schema": SCHEMA,
        "source": "Made up.",
        "units": UNITS,
        "paper": {
            "table_1": published.TABLE_1,
            "table_2": published.TABLE_2,
            "table_3": printed,
            "fit": published.FIT,
        },
        "speed": 4.0,
        "asked": ASKED,
        "cars": {trim.name: _car(trim.name == "worn") for trim in TRIMS},
        "beyond": {"source": beyond.RECORDED_SOURCE, **beyond.recorded()},
    }


def _car(worn: bool) -> dict[str, Any]:
    models = ("vdm", "vdm_si", "extended")[: 2 + worn]
    orders = {"P2Z2": {"fit": 80.0, "mse": 1e-3}, "P1Z0": {"empty": "a reason"}}
    orders["P3Z1"] = {"fit": 81.0, "mse": 9e-4}
    plant = {"unit": "1", "fit_loss": 0.5, "chosen": "P3Z1", "chosen_by_bic": "P3Z1"}
    plants = {name: {**plant, "figure": orders} for name in ("powertrain", "steering")}
    fitted = {"parameters": {"b0": {"value": 1e-7, "low": -0.5, "high": 2e6, "std": 1.0}}}
    table_2 = {
        "chosen": {**fitted, "order": "P3Z1", "warnings": []},
        "paper_order": {**fitted, "order": "P2Z2", "warnings": ["pole -1 is odd", "another"]},
    }
    friction = {"level": {"value": 0.02, "std": 0.001, "unit": "rad"}}
    finding = {"cause": "coulomb_friction", "where": "steering", "parameters": friction}
    gains = ("vdm_si_over_vdm", "extended_over_vdm_si", "extended_over_vdm")
    improved = dict.fromkeys(gains[: 1 + 2 * worn], 40.0)
    run = {"error_at_exit": 1.0, "error_at_end": 2.0, "deviation_max": 3.0}
    rules = ("velocity", "difference", "limited_difference", "rate_limited")
    told = {rule: {"rule": "a rule", "ate_from_rest": STATISTICS} for rule in rules}
    sensor = {"rate": 50.0, "latency": 0.05, "place_noise": 0.005, "heading_noise": 0.001}
    tables = {name: dict(STATISTICS) for name in models}
    better = {gain: STATISTICS for gain in gains[: 1 + worn]}
    causes = {"steering_play": {"value": 0.05, "unit": "rad"}} if worn else {}
    return {
        "title": "a car",
        "table_1": published.TABLE_1,
        "causes": causes,
        "sensor": {name: {"value": value, "unit": "1"} for name, value in sensor.items()},
        "identification": {"low_fit": 60.0, "paper_order": "P2Z2", "plants": plants},
        "table_2": dict.fromkeys(("powertrain", "steering"), table_2),
        "diagnosis": {
            "verdict": "explained" if worn else "unexplained_structure",
            "summary": "Something.",
            "findings": [finding] if worn else [],
        },
        "driven_with": {"findings": []} if worn else None,
        "table_3": {c.name: {**tables, "title": c.title, "improved": better} for c in COURSES},
        "speed_command_ramp": {"value": 1.0, "unit": "m/s^2"},
        "vdm_rules": {c.name: {"ramp": told, "step": told} for c in COURSES},
        "figure_7": {
            c.name: {**dict.fromkeys(models, run), "improved_at_exit": improved} for c in COURSES
        },
    }
