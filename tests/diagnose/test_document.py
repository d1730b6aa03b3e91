"""diagnosis.json holds what the contract asks for, in JSON that every parser takes."""

import copy
import dataclasses
import json
import math

import numpy as np
import pytest

import made_up_diagnosis
from vdmsi_jax.diagnose.answer.document import diagnosis_document
from vdmsi_jax.diagnose.answer.words import in_words, left_over, title
from vdmsi_jax.files import write_json

FINDING = {
    "cause", "where", "parameters", "p_value", "predicted_gain", "gain", "indistinguishable_from",
    "separating_experiment",
}  # fmt: skip
GAIN = {"metric", "channel", "before", "after", "se", "held_out", "ate_before", "ate_after"}


@pytest.fixture(scope="module", params=made_up_diagnosis.ALL)
def pair(request):
    diagnosis = made_up_diagnosis.ALL[request.param]()
    return diagnosis, diagnosis_document(diagnosis)


def test_the_keys_are_those_of_the_contract(pair):
    diagnosis, document = pair
    assert document["schema"] == "vdmsi.diagnosis/1"
    assert document["verdict"] == diagnosis.verdict
    asked = {"schema", "verdict", "baseline", "findings", "minor", "unexplained", "noise_ceiling"}
    assert asked <= set(document)
    assert {"model", "channels", "ate"} <= set(document["baseline"])
    for channel, score in diagnosis.channels.items():
        told = document["baseline"]["channels"][channel]
        assert told == {"fit": score.fit, "mse": score.mse, "noise_std": score.noise_std}
        assert document["noise_ceiling"][channel] == {"fit": score.ceiling}
    for left, told in zip(diagnosis.unexplained, document["unexplained"], strict=True):
        assert {"channel", "fraction", "depends_on"} <= set(told)
        assert told["depends_on"] == list(left.depends_on)


def test_every_finding_is_told_in_the_same_form(pair):
    diagnosis, document = pair
    for kind in ("findings", "minor"):
        for finding, told in zip(getattr(diagnosis, kind), document[kind], strict=True):
            assert FINDING <= set(told)
            assert (told["cause"], told["where"]) == (finding.cause, finding.where)
            assert ("channel" in told) == (finding.where == "sensor")
            assert GAIN <= set(told["gain"]) and told["gain"]["metric"] == "fit"
            assert told["gain"]["after"] == finding.gain.after
            assert told["indistinguishable_from"] == list(finding.indistinguishable_from)
            for estimate in told["parameters"].values():
                assert set(estimate) == {"value", "std", "unit"}
            if finding.predicted_gain is None:
                assert told["predicted_gain"] is None
            else:
                assert set(told["predicted_gain"]) == set(told["gain"])


def test_logs_are_named_by_their_files():
    diagnosis = made_up_diagnosis.explained()
    first, *others = diagnosis.records
    read = dataclasses.replace(first, file=f"drives/{first.name}.csv", repairs=("mended",))
    document = diagnosis_document(dataclasses.replace(diagnosis, records=(read, *others)))
    assert document["logs"][0] == f"{first.name}.csv"
    assert document["repairs"][0] == f"{first.name}.csv: mended"


def test_the_json_is_strict(pair, tmp_path):
    _, document = pair
    assert json.loads(json.dumps(document, allow_nan=False)) == document
    assert json.loads(write_json(tmp_path / "diagnosis.json", document).read_text()) == document


def test_the_baseline_is_told_as_a_model_file_tells_plants():
    plants = diagnosis_document(made_up_diagnosis.explained())["baseline"]["model"]["plants"]
    assert plants["steering"] == {
        "input": "delta_cmd", "output": "delta", "order": "P1Z0",
        "num": [7.9], "den": [1.0, 8.0], "delay": 0.02, "offset": 0.001,
    }  # fmt: skip
    unordered = diagnosis_document(made_up_diagnosis.unexplained())["baseline"]["model"]
    assert unordered["plants"]["powertrain"]["order"] == "P1Z0"


def test_a_plant_with_effects_is_told_by_its_transfer_function():
    diagnosis = made_up_diagnosis.siso()
    plant = diagnosis.baseline.plants["motor"]

    @dataclasses.dataclass
    class Extended:
        plant: object
        effects: tuple = ()

    wrapped = copy.copy(plant)
    object.__setattr__(wrapped, "model", Extended(plant.model))
    model = dataclasses.replace(diagnosis.baseline, plants={"motor": wrapped})
    told = diagnosis_document(dataclasses.replace(diagnosis, baseline=model))
    assert told["baseline"] == diagnosis_document(diagnosis)["baseline"]


def test_a_limit_that_is_not_there_is_left_out():
    (told,) = diagnosis_document(made_up_diagnosis.siso())["findings"]
    assert told["parameters"] == {"upper": {"value": 5.0, "std": 0.02, "unit": "V"}}


def test_what_is_not_known_is_null():
    document = diagnosis_document(made_up_diagnosis.explained())
    (minor,) = document["minor"]
    assert minor["parameters"]["time_constant"]["std"] is None
    (unexcited,) = [c for c in document["detectability"] if c["cause"] == "saturation"]
    assert unexcited["smallest"] is None and unexcited["excited"] is False
    assert diagnosis_document(made_up_diagnosis.no_effect())["baseline"]["ate"] is None


def test_the_errors_on_the_road_are_those_of_both_models():
    diagnosis = made_up_diagnosis.explained()
    document = diagnosis_document(diagnosis)
    assert diagnosis.ate is not None
    before, after = document["baseline"]["ate"], document["extended"]["ate"]
    assert set(before) == {"max", "mean", "rmse"}
    assert before["mean"] == diagnosis.ate["baseline"]["mean"] > after["mean"]


def test_the_parts_of_a_budget_add_up(pair):
    for budget in pair[1]["budget"]:
        total = sum(budget["parts"].values()) + budget["noise"] + budget["unexplained"]
        assert math.isclose(total, budget["total"], rel_tol=1e-9)


def test_causes_in_words():
    diagnosis = made_up_diagnosis.explained()
    assert title(diagnosis.findings[0]) == "backlash or Coulomb friction (steering)"
    assert title(diagnosis.minor[0]) == "sensor lag (v)"
    assert in_words("gain_drift") == "gain drift"
    told = left_over(made_up_diagnosis.unexplained().unexplained[0])
    assert "61 %" in told and "depends on t" in told and "run_3.csv 14 to 15.2 s" in told


def test_made_up_signals_are_what_they_claim():
    """The made-up extension is right to the noise, or the pictures of it would mean nothing."""
    diagnosis = made_up_diagnosis.explained()
    for response in diagnosis.responses:
        left = (response.y - response.extended)[response.valid]
        assert np.isclose(left.std(), made_up_diagnosis.NOISE[response.channel], rtol=0.05)
