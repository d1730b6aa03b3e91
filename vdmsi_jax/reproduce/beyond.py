"""What lies beyond the paper, in one document of plain numbers for results, figures and report."""

from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass, is_dataclass
from pathlib import Path
from typing import Any

import numpy as np

from vdmsi_jax.files import read_json
from vdmsi_jax.reproduce.future import (
    DROP,
    STATIONARY,
    WITHIN,
    Imu,
    Online,
    Outage,
    imu,
    online,
    outages,
)
from vdmsi_jax.reproduce.population import BUDGETED, NOISE, Population, population
from vdmsi_jax.reproduce.steering_model import (
    Absorbed,
    absorbed,
    alike,
    explanations,
    paper_zero,
)

RECORDED = Path(__file__).parent / "recorded" / "beyond.json"
"""The document of 200 vehicles, made by `make record`, part of the package."""

RECORDED_SOURCE = (
    "Recorded before, by `make record`; `vdmsi reproduce --beyond` computes it anew, in minutes."
)

_THINNED = 10  # rows of a series per row of it in the document
_DIGITS = 4  # significant, of the numbers of a series


@dataclass(frozen=True)
class Beyond:
    """Results of all studies.

    Attributes:
        population: the two scenarios over drawn vehicles.
        absorbed: what the paper's steering order makes of every fault.
        explanations: the faults that look like the paper's steering model.
        online, imu, outages: the three future works.
    """

    population: Population
    absorbed: list[Absorbed]
    explanations: list[Absorbed]
    online: Online
    imu: Imu
    outages: list[Outage]

    def document(self) -> dict[str, Any]:
        """Plain numbers by name: metres, percent, seconds, rad/s. A spread is `median`, `low` and
        `high`, the middle 95 %. Series keep every tenth row."""
        p = self.population
        followed = asdict(self.online)
        example = followed.pop("example")
        steering = {
            "paper_zero": paper_zero(),
            "absorbed": [_row(row) for row in self.absorbed],
            "explanations": [_row(row) for row in self.explanations],
            "alike": [_series(asdict(alike(row))) for row in self.explanations],
        }
        return {
            "population": {
                "vehicles": int(p.drawn.causes.size),
                "with_causes": int(np.sum(p.drawn.causes > 0)),
                "budgeted": min(BUDGETED, int(p.drawn.causes.size)),
                "noise": dict(NOISE),
                "causes": p.drawn.causes.tolist(),
                "errors": {
                    scenario: {model: _rounded(ate["mean"]) for model, ate in own.ate.items()}
                    for scenario, own in p.experiments.items()
                },
                "ate": _plain(p.table()),
                "by_causes": _plain(p.causes_table()),
                "at_exit": _plain(p.exit_table()),
                "budget": _plain(p.budget_table()),
            },
            "steering_model": steering,
            "online": {
                **_series(followed),
                "ratio": self.online.ratio,
                "stationary": STATIONARY,
                "drop": DROP,
                "within": WITHIN,
                "example": _series(example),
            },
            "imu": _plain(asdict(self.imu)),
            "outages": _plain([asdict(outage) for outage in self.outages]),
        }


def beyond(
    *, vehicles: int = 200, seed: int = 0, told: Callable[[str], None] = lambda _: None
) -> Beyond:
    """Run every study.

    Args:
        vehicles: how many are drawn.
        seed: of vehicles, commands and noise.
        told: is called with what is being done.
    """
    told(f"driving {vehicles} drawn vehicles")
    drawn = population(vehicles, seed=seed)
    told("asking what the paper's steering model was fitting")
    rows = absorbed()
    found = explanations(rows)
    told("identifying during the drive, by an IMU, and through outages")
    return Beyond(drawn, rows, found, online(), imu(), outages())


def recorded() -> dict[str, Any]:
    """The document that is shipped."""
    return read_json(RECORDED)


def _series(parts: Mapping[str, Any]) -> dict[str, Any]:
    """Every tenth row of what is a series; the rest as it is."""
    return {
        key: _rounded(value[::_THINNED]) if isinstance(value, np.ndarray) else value
        for key, value in parts.items()
    }


def _rounded(values: np.ndarray) -> list[float]:
    return [float(f"{value:.{_DIGITS}g}") for value in values]


def _row(row: Absorbed) -> dict[str, Any]:
    more = {"chooses_p2z2": row.chooses_p2z2, "looks_like_the_paper": row.looks_like_the_paper}
    return {**asdict(row), **more}


def _plain(value: Any) -> Any:
    """Dictionaries, lists and numbers only."""
    if is_dataclass(value) and not isinstance(value, type):
        return asdict(value)
    if isinstance(value, Mapping):
        return {key: _plain(inner) for key, inner in value.items()}
    if isinstance(value, (list, tuple)):
        return [_plain(inner) for inner in value]
    return value.tolist() if isinstance(value, np.ndarray) else value
