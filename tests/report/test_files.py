"""What the commands write is written from Python, too."""

import json

import made_up
import made_up_diagnosis
from vdmsi_jax.diagnose.answer.document import diagnosis_document
from vdmsi_jax.files import plain
from vdmsi_jax.model_file import load_model
from vdmsi_jax.report.files import write_identification


def test_a_diagnosis_writes_what_the_command_writes(tmp_path):
    diagnosis = made_up_diagnosis.siso()
    out = tmp_path / "new" / "folder"
    diagnosis.write(out)
    assert {path.name for path in out.iterdir()} == {"diagnosis.json", "model.json", "report.html"}
    told = json.loads((out / "diagnosis.json").read_text())
    assert told == plain(diagnosis_document(diagnosis))
    assert load_model(out / "model.json").plants.keys() == diagnosis.model.plants.keys()
    assert "Diagnosis: " in (out / "report.html").read_text()


def test_a_comparison_writes_its_scores_its_paths_and_its_report(tmp_path):
    made_up.comparison().write(tmp_path)
    names = {path.name for path in tmp_path.iterdir()}
    assert {"simulation.json", "report.html", "drive.csv.measured.tum"} <= names


def test_grids_write_what_simulate_takes_and_no_report_where_none_is_asked(tmp_path):
    grid = made_up.order_grid()
    grid.write(tmp_path / "one", report=False)
    write_identification(tmp_path / "two", {"steering": grid}, report=False)
    for folder in (tmp_path / "one", tmp_path / "two"):
        assert [path.name for path in folder.iterdir()] == ["identify.json"]
        assert list(load_model(folder / "identify.json").plants) == ["steering"]
