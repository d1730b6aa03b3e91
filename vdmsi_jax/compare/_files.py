"""What a comparison leaves on disk: `simulation.json` and TUM trajectories."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from ..config import POSE
from ..files import in_a_file_name
from ..metrics import write_tum
from ._nouns import Comparison, Prediction, has_pose

SIMULATION = "vdmsi.simulation/1"

KEYS = {"VDM": "vdm", "VDM-SI": "vdm_si", "extended": "extended"}
"""How the models of a comparison are called in files."""


def write_trajectories(folder: str | Path, comparison: Comparison) -> list[Path]:
    """Write the measured path, where there is one, and every predicted one as TUM files,
    `LOG.MODEL.tum`."""
    record, paths = comparison.record, {}
    if has_pose(record.channels):
        paths["measured"] = [record[c] for c in POSE]
    for name, prediction in comparison.predictions.items():
        if prediction.has_path:
            paths[KEYS.get(name, name)] = [prediction.channels[c] for c in POSE]
    written = []
    for name, columns in paths.items():
        stem = in_a_file_name(record.name)
        written.append(Path(folder) / f"{stem}.{name}.tum")
        write_tum(written[-1], record.t, np.stack(columns, axis=1))
    return written


def simulation_document(comparisons: Sequence[Comparison]) -> dict[str, Any]:
    """The contents of `simulation.json`. The `channels` of a run are the scores of the last model,
    the best informed; every model has its own beside its errors: of positions (`ate`), m, and of
    headings, rad, from the measured start of each of its `segments` and of each window."""
    return {"schema": SIMULATION, "runs": [_run(comparison) for comparison in comparisons]}


def _run(comparison: Comparison) -> dict[str, Any]:
    last = list(comparison.predictions.values())[-1]
    return {
        "log": comparison.record.log,
        "channels": _scores(last),
        "segments": len(comparison.record.segments),
        "window": comparison.window,
        "repairs": list(comparison.record.repairs),
        "floor": None if comparison.floor is None else _model(comparison.floor),
        "with_measured": {name: _model(p) for name, p in comparison.with_measured.items()},
        **{KEYS.get(name, name): _model(p) for name, p in comparison.predictions.items()},
    }


def _scores(prediction: Prediction) -> dict[str, Any]:
    return {name: score._asdict() for name, score in prediction.scores.items()}


def _model(prediction: Prediction) -> dict[str, Any]:
    whole, windows = prediction.whole, prediction.windows
    return {
        "status": prediction.status,
        "channels": _scores(prediction),
        "ate": None if whole is None else whole.ate,
        "ate_aligned": prediction.aligned,
        "relative": None if prediction.relative is None else prediction.relative._asdict(),
        "ate_windows": None if windows is None else windows.ate,
        "heading": None if whole is None else whole.turned,
        "heading_windows": None if windows is None else windows.turned,
    }
