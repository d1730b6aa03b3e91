"""Models survive the way to disk and back, and a file that is no model is refused in one line."""

import json

import numpy as np
import pytest

import made_up
from vdmsi_jax.compare import identified
from vdmsi_jax.errors import InputError
from vdmsi_jax.files import write_json
from vdmsi_jax.identify.document import identify_document
from vdmsi_jax.model_file import load_model, save_model


@pytest.fixture(scope="module")
def grid():
    return made_up.order_grid()


def same(plant, model):
    for name in ("num", "den", "delay", "offset"):
        np.testing.assert_array_equal(getattr(plant.model, name), getattr(model, name))


def test_a_model_comes_back_bit_for_bit(tmp_path, grid):
    path = save_model(tmp_path / "model.json", identified({"steering": grid}))
    loaded = load_model(path)
    same(loaded.plants["steering"], grid.best.model)
    assert loaded.plants["steering"].spec == grid.plant
    assert loaded.vehicle == grid.record.vehicle


def test_an_identification_is_a_model(tmp_path, grid):
    document = identify_document({"steering": grid}, [grid.record])
    path = write_json(tmp_path / "identify.json", document)
    loaded = load_model(path)
    same(loaded.plants["steering"], grid.best.model)
    assert loaded.vehicle == grid.record.vehicle


def test_identify_json_is_what_the_contract_says(tmp_path, grid):
    path = write_json(
        tmp_path / "identify.json", identify_document({"steering": grid}, [grid.record])
    )
    document = json.loads(path.read_text())
    assert document["schema"] == "vdmsi.identify/1"
    assert document["repairs"] == []
    plant = document["plants"]["steering"]
    assert (plant["input"], plant["output"], plant["chosen"]) == ("delta_cmd", "delta", "P2Z1")
    assert len(plant["orders"]) == 30
    assert set(plant["orders"]["P1Z3"]) == {"status"}
    assert plant["orders"]["P1Z3"]["status"].startswith("improper: ")
    fit = plant["orders"]["P2Z1"]
    needed = "fit mse held_out_fit aic bic num den std delay offset poles zeros status"
    assert set(needed.split()) <= set(fit)
    assert fit["den"][0] == 1.0 and len(fit["den"]) == 3 and len(fit["num"]) == 2
    assert np.shape(fit["poles"]) == (2, 2)
    assert set(fit["std"]) == {"b1", "b0", "a1", "a0", "delay", "offset"}


def valid():
    return {
        "schema": "vdmsi.model/1",
        "plants": {
            "steering": {
                "input": "delta_cmd",
                "output": "delta",
                "num": [8.0],
                "den": [1.0, 8.0],
                "delay": 0.05,
            }
        },
    }


@pytest.mark.parametrize(
    ("change", "told"),
    [
        (lambda d: d.update(schema="vdmsi.model/9"), "did you mean 'vdmsi.model/1'"),
        (lambda d: d.pop("plants"), "plants"),
        (lambda d: d["plants"]["steering"].update(den=[2.0, 8.0]), "den"),
        (lambda d: d["plants"]["steering"].update(num=[1.0, 1.0, 1.0]), "improper"),
        (lambda d: d["plants"]["steering"].update(delay=-0.1), "negative"),
        (lambda d: d["plants"]["steering"].update(num=["8"]), "num"),
        (lambda d: d["plants"]["steering"].update(dealy=0.1), "did you mean 'delay'"),
        (lambda d: d["plants"]["steering"].pop("input"), "input"),
        (lambda d: d.update(vehicle={"l_f": 1.0}), "l_r"),
    ],
)
def test_a_wrong_model_is_refused_in_one_line(tmp_path, change, told):
    document = valid()
    load_model(write_json(tmp_path / "model.json", document))
    change(document)
    path = write_json(tmp_path / "model.json", document)
    with pytest.raises(InputError, match=told) as refused:
        load_model(path)
    assert "\n" not in str(refused.value) and str(path) in str(refused.value)


@pytest.mark.parametrize("document", [[], "text", 3, {"schema": ["x"]}])
def test_what_is_no_table_is_refused(tmp_path, document):
    with pytest.raises(InputError):
        load_model(write_json(tmp_path / "model.json", document))
