"""The result files: what `identify.json` and `simulation.json` say of finished results."""

from collections.abc import Mapping, Sequence
from typing import Any

from ..compare import Comparison, Prediction
from ..identify.result import Fit, OrderGrid

IDENTIFY = "vdmsi.identify/1"
SIMULATION = "vdmsi.simulation/1"


def identify_document(grids: Mapping[str, OrderGrid], repairs: Sequence[str]) -> dict[str, Any]:
    """The contents of `identify.json`.

    Args:
        grids: by the plants' names.
        repairs: what was done to the logs, a sentence each.
    """
    return {
        "schema": IDENTIFY,
        "plants": {
            name: {
                "input": grid.plant.input,
                "output": grid.plant.output,
                "chosen": grid.chosen,
                "chosen_by_bic": grid.chosen_by_bic,
                "orders": {order: _order(fit) for order, fit in grid.fits.items()},
            }
            for name, grid in grids.items()
        },
        "repairs": list(repairs),
    }


def _order(fit: Fit) -> dict[str, Any]:
    if fit.model is None:
        return {"status": fit.status}
    return {
        "fit": fit.fit,
        "mse": fit.mse,
        "held_out_fit": fit.held_out_fit,
        "held_out_mse": fit.held_out_mse,
        "aic": fit.aic,
        "bic": fit.bic,
        "num": fit.model.num,
        "den": fit.model.den,
        "std": fit.std,
        "delay": 0.0 if fit.model.delay is None else fit.model.delay,
        "offset": 0.0 if fit.model.offset is None else fit.model.offset,
        "poles": fit.poles,
        "zeros": fit.zeros,
        "status": fit.status,
        "warnings": list(fit.warnings),
    }


KEYS = {"VDM": "vdm", "VDM-SI": "vdm_si", "extended": "extended"}
"""How the models of a comparison are called in `simulation.json`."""


def simulation_document(comparisons: Sequence[Comparison]) -> dict[str, Any]:
    """The contents of `simulation.json`. `channels` are the scores of the best model that was given
    (the last one); every model has its own beside its errors."""
    return {"schema": SIMULATION, "runs": [_run(comparison) for comparison in comparisons]}


def _run(comparison: Comparison) -> dict[str, Any]:
    last = list(comparison.predictions.values())[-1]
    return {
        "log": comparison.record.name,
        "channels": _scores(last),
        "window": comparison.window,
        **{KEYS.get(name, name): _model(p) for name, p in comparison.predictions.items()},
    }


def _scores(prediction: Prediction) -> dict[str, Any]:
    return {name: score._asdict() for name, score in prediction.scores.items()}


def _model(prediction: Prediction) -> dict[str, Any]:
    return {
        "status": prediction.status,
        "channels": _scores(prediction),
        "ate": None if prediction.whole is None else prediction.whole.ate,
        "ate_aligned": prediction.aligned,
        "ate_windows": None if prediction.windows is None else prediction.windows.ate,
    }
