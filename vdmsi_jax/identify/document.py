"""What result files say of an identification."""

from collections.abc import Mapping, Sequence
from typing import Any

from ..data.record import Record
from ..errors import InputError
from ..model_file import IDENTIFY, geometry
from .acceleration import measures_acceleration, speed_response
from .result import Fit, OrderGrid


def identify_document(
    grids: Mapping[str, OrderGrid],
    records: Sequence[Record],
    refused: Mapping[str, InputError] | None = None,
) -> dict[str, Any]:
    """The contents of `identify.json`.

    Args:
        grids: by the plants' names.
        records: what was identified from; their repairs and their vehicle are told.
        refused: by the plants' names, why those without a grid were not identified.
    """
    vehicle = next((record.vehicle for record in records if record.vehicle is not None), None)
    return {
        "schema": IDENTIFY,
        "logs": [record.log for record in records],
        "vehicle": None if vehicle is None else geometry(vehicle),
        "plants": {name: plant_document(grid) for name, grid in grids.items()},
        "refused": {name: str(why) for name, why in (refused or {}).items()},
        "repairs": [
            *(f"{record.log}: {told}" for record in records for told in record.repairs),
            *(f"{name}: {grid.note}" for name, grid in grids.items() if grid.note),
        ],
    }


def plant_document(grid: OrderGrid) -> dict[str, Any]:
    """One plant with all its orders; improper ones have their reason only."""
    return {
        "input": grid.plant.input,
        "output": grid.plant.output,
        "chosen": grid.chosen,
        "chosen_by_bic": grid.chosen_by_bic,
        "orders": {order: _order(fit) for order, fit in grid.fits.items()},
    }


def _order(fit: Fit) -> dict[str, Any]:
    if fit.model is None:
        return {"status": fit.status}
    return _model(fit) | _speed(fit)


def _speed(fit: Fit) -> dict[str, Any]:
    """Of an identified acceleration, the response of the speed that makes it: what is simulated."""
    assert fit.model is not None
    if not measures_acceleration(fit.plant) or len(fit.model.num) < 2:
        return {}
    speed = speed_response(fit).model
    delay = 0.0 if speed.delay is None else float(speed.delay)
    return {"speed": {"num": speed.num, "den": speed.den, "delay": delay}}


def _model(fit: Fit) -> dict[str, Any]:
    assert fit.model is not None
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
        "delay": 0.0 if fit.model.delay is None else float(fit.model.delay),
        "offset": 0.0 if fit.model.offset is None else float(fit.model.offset),
        "poles": fit.poles,
        "zeros": fit.zeros,
        "status": fit.status,
        "warnings": list(fit.warnings),
        "supported": fit.supported,
    }
