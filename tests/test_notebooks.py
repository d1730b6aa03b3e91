"""The notebooks run from top to bottom, show their figures, and are stored without outputs."""

import json
import runpy
from pathlib import Path

import nbformat
import pytest

import made_up_diagnosis
from vdmsi_jax.reproduce import SHIPPED

FOLDER = Path(__file__).parents[1] / "notebooks"
NOTEBOOKS = sorted(FOLDER.glob("*.ipynb"))
FIGURES = {"01_identify": 7, "02_name_the_cause": 3, "03_paper": 5}


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_a_notebook_is_stored_without_outputs(path):
    for cell in nbformat.read(path, as_version=4).cells:
        assert not cell.get("outputs") and cell.get("execution_count") is None


@pytest.mark.parametrize(
    "path",
    [
        # the demo is diagnosed, and the paper is reproduced, in tests of their own
        pytest.param(p, id=p.stem, marks=() if p.stem == "01_identify" else pytest.mark.slow)
        for p in NOTEBOOKS
    ],
)
def test_a_notebook_runs_and_shows_its_figures(path):
    executed = runpy.run_path(str(FOLDER / "run.py"))["execute"](path)
    outputs = [o for cell in executed.cells for o in cell.get("outputs", [])]
    assert sum("image/svg+xml" in o.get("data", {}) for o in outputs) == FIGURES[path.stem]
    warned = [o.text for o in outputs if o.output_type == "stream" and o.name == "stderr"]
    assert not warned


def cells(name: str) -> list[str]:
    return [cell.source for cell in nbformat.read(FOLDER / f"{name}.ipynb", as_version=4).cells]


def test_the_steering_that_is_at_fault_is_among_the_causes_that_are_told(capsys):
    (listing,) = [cell for cell in cells("02_name_the_cause") if "diagnosis.detectable:" in cell]
    d = made_up_diagnosis.explained()
    exec(listing, {"diagnosis": d})
    told = capsys.readouterr().out.splitlines()
    assert len(told) == sum(own.where == "steering" for own in d.detectable) > 0
    assert not any(line.endswith(" 1") or " 1 " in line for line in told)


def test_what_is_said_of_the_worn_car_is_what_was_recorded():
    known = json.loads((SHIPPED / "worn" / "diagnosis.json").read_text())
    assert [own["cause"] for own in known["findings"]] == ["coulomb_friction"]
    (said,) = [cell for cell in cells("03_paper") if "## What the diagnosis says" in cell]
    assert "names Coulomb friction" in said and "cannot tell backlash apart" in said
