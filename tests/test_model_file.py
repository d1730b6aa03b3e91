"""Models survive the way to disk and back, and a file that is no model is refused in one line."""

import dataclasses
import json
import math

import jax
import numpy as np
import pytest

import made_up
from vdmsi_jax.compare import identified
from vdmsi_jax.config import PlantSpec, VehicleGeometry
from vdmsi_jax.effects import ACTUATOR, SENSOR, VEHICLE
from vdmsi_jax.effects.backlash import Backlash
from vdmsi_jax.effects.base import AbstractEffect
from vdmsi_jax.effects.offset import Offset
from vdmsi_jax.effects.road_grade import KNOTS
from vdmsi_jax.effects.sensor import SensorBias, SensorDelay
from vdmsi_jax.errors import InputError
from vdmsi_jax.files import write_json
from vdmsi_jax.identify.document import identify_document
from vdmsi_jax.model_file import Model, Plant, load_model, save_model
from vdmsi_jax.models.bicycle import Bicycle
from vdmsi_jax.models.extended_plant import ExtendedPlant
from vdmsi_jax.models.following import FollowedAtOnce
from vdmsi_jax.models.transfer_function import TransferFunction
from vdmsi_jax.models.vehicle import Vehicle
from vdmsi_jax.parameters import parameters


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


def test_the_plant_without_effects_comes_back_beside_the_one_with_them(tmp_path, grid):
    fitted = identified({"steering": grid}).plants["steering"]
    made = ExtendedPlant(fitted.model, (Backlash(0.1),))
    plain = TransferFunction([2.0, 7.0], [1.0, 3.0, 7.0], delay=0.01, offset=0.2)
    model = Model({"steering": Plant(fitted.spec, made, plain)})
    loaded = load_model(save_model(tmp_path / "model.json", model)).plants["steering"]
    same(Plant(loaded.spec, loaded.plain), plain)
    same(Plant(loaded.spec, loaded.linear), fitted.model)


def test_an_identification_is_a_model(tmp_path, grid):
    document = identify_document({"steering": grid}, [grid.record])
    path = write_json(tmp_path / "identify.json", document)
    loaded = load_model(path)
    same(loaded.plants["steering"], grid.best.model)
    assert loaded.vehicle == grid.record.vehicle


def test_identify_json_names_logs_by_their_files(grid):
    read = {"name": "run_3", "file": "drives/run_3.csv", "repairs": ("mended",)}
    log = dataclasses.replace(grid.record, **read)
    document = identify_document({"steering": grid}, [log])
    assert document["logs"] == ["run_3.csv"]
    assert document["repairs"] == ["run_3.csv: mended"]


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
    assert fit["supported"] is True
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
        (lambda d: d["plants"]["steering"].update(baseline={"num": [1.0]}), "baseline den"),
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


def switched_on(effect, seed):
    """The effect with numbers inside its bounds, none of them round or off, and constants of its
    own."""
    rng = np.random.default_rng(seed)
    new = {}
    for name, known in parameters(effect).items():
        low, high = max(known.lower, -1.0), min(known.upper, 1.0)
        new[name] = rng.uniform(low, high, np.shape(known.off))
    for field in dataclasses.fields(effect):
        if field.name not in new and not field.metadata.get("static"):
            new[field.name] = rng.uniform(1.0, 100.0)
    return dataclasses.replace(effect, **new)


def registered(registry):
    return tuple(switched_on(effect, i) for i, effect in enumerate(registry))


STEERING = PlantSpec("steering", "delta_cmd", "delta")


def lagged(*effects, **more):
    linear = TransferFunction([7.1, 8.0], [1.0, 8.0], delay=0.05, offset=-0.01)
    return Plant(STEERING, ExtendedPlant(linear, effects, **more))


def test_every_effect_comes_back_bit_for_bit(tmp_path):
    sensors = [
        (channel, effect) for channel in ("r", "delta", "pose") for effect in registered(SENSOR)
    ]
    model = Model(
        {"steering": lagged(*registered(ACTUATOR), leads=(0.123, 0.01), substeps=3)},
        VehicleGeometry(1.0, 1.5),
        registered(VEHICLE),
        tuple(sensors),
    )
    path = save_model(tmp_path / "model.json", model)
    loaded = load_model(path)
    old, new = (
        (m.plants["steering"].model, m.body, [e for _, e in m.sensors]) for m in (model, loaded)
    )
    assert jax.tree.structure(old) == jax.tree.structure(new)  # classes, forms and sub-steps
    for a, b in zip(jax.tree.leaves(old), jax.tree.leaves(new), strict=True):
        np.testing.assert_array_equal(a, b)
    assert [channel for channel, _ in loaded.sensors] == [channel for channel, _ in sensors]
    assert loaded.extended and loaded.vehicle == model.vehicle
    again = save_model(tmp_path / "again.json", loaded)
    assert again.read_text() == path.read_text()


def test_a_model_without_effects_is_written_as_before(tmp_path, grid):
    plain = identified({"steering": grid})
    path = save_model(tmp_path / "model.json", plain)
    assert not {"body", "sensors"} & set(json.loads(path.read_text()))
    bare = Plant(grid.plant, ExtendedPlant(grid.best.model, ()))
    same_model = Model({"steering": bare}, plain.vehicle)
    assert save_model(tmp_path / "bare.json", same_model).read_text() == path.read_text()
    assert not same_model.extended


def test_a_vehicle_has_its_effects_or_not():
    model = Model({"steering": lagged(Backlash(0.1))}, VehicleGeometry(1.0, 1.5), VEHICLE)
    whole, plain, none = (
        model.to_vehicle(),
        model.to_vehicle(effects=False),
        model.to_vehicle(dynamics=False),
    )
    assert isinstance(whole.steering, ExtendedPlant) and whole.effects == VEHICLE
    assert isinstance(plain.steering, TransferFunction) and plain.effects == ()
    assert isinstance(none.steering, FollowedAtOnce) and none.effects == ()


class Homemade(AbstractEffect):
    cause = "homemade"

    def probes(self, scales):
        return []


def test_path_and_model_are_not_exchanged_in_silence(unchecked, tmp_path, grid):
    model = identified({"steering": grid})
    vehicle = Vehicle(Bicycle(1.0, 1.0))
    with pytest.raises(InputError, match=r"Vehicle is no model; make one .*Model\(\{.steering"):
        save_model(tmp_path / "model.json", vehicle)
    with pytest.raises(InputError, match=r"str is no model; .*save_model\(path, model\)"):
        save_model(model, str(tmp_path / "model.json"))


def test_what_could_not_be_read_again_is_not_written(tmp_path):
    path = tmp_path / "model.json"
    for model, told in (
        (Model({"steering": lagged(Homemade())}), "Homemade is none of vdmsi_jax.effects.ACTUATOR"),
        (Model({"steering": lagged(Offset(0.1), Backlash(0.1))}), "in the order of"),
        (Model({}, sensors=(("r", SensorBias(0.1)), ("r", SensorDelay(0.1)))), "in the order of"),
        (Model({}, body=(Backlash(0.1),)), "Backlash is none of vdmsi_jax.effects.VEHICLE"),
    ):
        with pytest.raises(ValueError, match=told):
            save_model(path, model)
        assert not path.exists()


def extended():
    document = valid()
    document["plants"]["steering"] |= {
        "effects": [
            {"cause": "backlash", "parameters": {"gap": 0.03}},
            {"cause": "saturation", "parameters": {"upper": 2}, "form": {"at": "command"}},
            {"cause": "road_grade", "parameters": {"slope": [0.0, 0.01] * (KNOTS // 2)}},
        ],
        "leads": [0.1, 0.0],
    }
    return document | {
        "body": [{"cause": "understeer", "parameters": {"gradient": 0.002}}],
        "sensors": [
            {"channel": "r", "cause": "sensor_delay", "parameters": {"delay": 0.02}},
            {"channel": "delta", "cause": "sensor_lag", "parameters": {"time_constant": 0.02}},
            {"channel": "r", "cause": "sensor_lag", "parameters": {"time_constant": 0.02}},
        ],
    }


def test_effects_act_in_their_order_however_they_are_written(tmp_path):
    loaded = load_model(write_json(tmp_path / "model.json", extended()))
    model = loaded.plants["steering"].model
    causes = ["saturation", "road_grade", "backlash"]
    assert [effect.cause for effect in model.effects] == causes
    assert float(model.effects[0].lower) == 0.0, "what is not told is off"
    assert model.effects[2].at == "response", "a form that is not told is the usual one"
    told = [(channel, effect.cause) for channel, effect in loaded.sensors]
    assert told == [("r", "sensor_lag"), ("r", "sensor_delay"), ("delta", "sensor_lag")]


def first(document):
    return document["plants"]["steering"]["effects"][0]


@pytest.mark.parametrize(
    ("change", "told"),
    [
        (lambda d: first(d).update(cause="backlsh"), "effects 1 cause.*did you mean 'backlash'"),
        (lambda d: first(d).update(cause="understeer"), "unknown cause 'understeer'"),
        (lambda d: first(d).pop("cause"), "cause.*missing"),
        (lambda d: first(d).update(parameters={"gapp": 0.1}), "gapp.*did you mean 'gap'"),
        (lambda d: first(d).update(parameters={"gap": math.nan}), "gap.*not finite"),
        (lambda d: first(d).update(parameters={"gap": math.inf}), "gap.*not finite"),
        (lambda d: first(d).update(parameters={"gap": None}), "gap.*None is not a number"),
        (lambda d: first(d).update(parameters={"gap": -0.1}), "gap.*out of range.*0 to inf"),
        (lambda d: first(d).update(parameters={"gap": [0.1, 0.1]}), "gap.*2 numbers.*give one"),
        (lambda d: first(d).update(form={"by": "command"}), "form by.*has no such form"),
        (lambda d: first(d).update(constants={"span": 1.0}), "span.*has no such constant"),
        (lambda d: first(d).update(channel="v"), "channel.*only a sensor"),
        (lambda d: first(d).update(size=3), "size.*unknown key"),
        (
            lambda d: d["plants"]["steering"]["effects"][1]["form"].update(at="commnd"),
            "did you mean 'command'",
        ),
        (
            lambda d: d["plants"]["steering"]["effects"][2]["parameters"].update(slope=[0.1]),
            f"slope.*1 numbers.*give {KNOTS}",
        ),
        (
            lambda d: d["plants"]["steering"]["effects"][2].update(constants={"span": math.nan}),
            "span.*not finite",
        ),
        (lambda d: d["plants"]["steering"].update(leads=[-1.0, 0.0]), "leads.*negative"),
        (lambda d: d["plants"]["steering"].update(substeps=0), "substeps.*out of range"),
        (lambda d: d["body"][0].update(cause="backlash"), r"body 1 cause.*unknown cause"),
        (lambda d: d["body"][0].update(parameters=[0.002]), r"body.*not a table"),
        (lambda d: d["sensors"][0].pop("channel"), "sensors 1 channel: missing"),
        (lambda d: d["sensors"][0].update(channel="rr"), "sensors 1 channel.*did you mean 'r'"),
        (lambda d: d["sensors"][0].update(channel="x"), "nothing measures 'x'"),
        (lambda d: d["sensors"][0].update(cause="offset"), "sensors 1 cause.*unknown cause"),
    ],
)
def test_a_wrong_effect_is_refused_in_one_line(tmp_path, change, told):
    document = extended()
    change(document)
    path = tmp_path / "model.json"
    path.write_text(json.dumps(document))  # which writes NaN where strict JSON has no word for it
    with pytest.raises(InputError, match=told) as refused:
        load_model(path)
    assert "\n" not in str(refused.value) and str(path) in str(refused.value)


def test_a_model_prints_its_plants_and_causes():
    late = ExtendedPlant(TransferFunction([8.0], [1.0, 8.0]), Backlash(0.02))
    plants = {"steering": Plant(PlantSpec("steering", "delta_cmd", "delta"), late)}
    said = repr(Model(plants, VehicleGeometry(1.0, 1.2), sensors=(("delta", SensorBias(0.01)),)))
    assert said.startswith("<Model steering=ExtendedPlant(") and "Backlash(gap=0.02)" in said
    assert "SensorBias(bias=0.01" in said and "of delta" in said and "l_r=1.2" in said
