"""Comparisons against a vehicle integrated here, sample by sample, without the library."""

import dataclasses

import jax.numpy as jnp
import numpy as np
import pytest

from vdmsi_jax.compare import compare, simulation_document, write_trajectories
from vdmsi_jax.config import PlantSpec, VehicleGeometry
from vdmsi_jax.data.record import Record, Segment
from vdmsi_jax.effects.backlash import Backlash
from vdmsi_jax.effects.base import Signals
from vdmsi_jax.effects.gain_drift import GainDrift
from vdmsi_jax.effects.offset import Offset
from vdmsi_jax.effects.sensor import SensorBias, SensorDelay, SensorLag
from vdmsi_jax.effects.speed_dependent_gain import SpeedDependentGain
from vdmsi_jax.effects.understeer import Understeer
from vdmsi_jax.errors import InputError
from vdmsi_jax.model_file import Model, Plant, load_model, save_model
from vdmsi_jax.models.extended_plant import ExtendedPlant
from vdmsi_jax.models.transfer_function import TransferFunction
from vdmsi_jax.report.page import render
from vdmsi_jax.report.simulation import simulation_page
from vdmsi_jax.simulate import Commands, Start, simulate

DT, FINE = 0.02, 40  # s; steps of the integration per sample
RATE = 5.0  # rad/s, of the steering lag
L_F, L_R = 1.0, 1.5
NEAR = 4e-3  # m; Euler at 0.5 ms drifts by 1 to 2.3 mm over 40 s


def drive(n: int = 2000, seed: int = 0, *, ahead: float = L_R, start: float = 0.0) -> dict:
    """A vehicle at the commanded speed whose wheel lags; pose and speed are those of a point
    `ahead` of the rear axle."""
    rng = np.random.default_rng(seed)
    command = np.repeat(rng.uniform(-0.3, 0.3, n // 100 + 1), 100)[:n]
    speed = np.repeat(rng.uniform(1.0, 4.0, n // 500 + 1), 500)[:n]
    rows, delta, x, y, psi = [], start, 3.0, -2.0, 0.7
    for k in range(n):
        rows.append((delta, x, y, psi))
        for _ in range(FINE):
            h = DT / FINE
            slip = np.arctan(ahead / (L_F + L_R) * np.tan(delta))
            x += h * speed[k] * np.cos(psi + slip)
            y += h * speed[k] * np.sin(psi + slip)
            psi += h * speed[k] * np.cos(slip) * np.tan(delta) / (L_F + L_R)
            delta += h * RATE * (command[k] - delta)
    delta, x, y, psi = np.array(rows).T
    return dict(v_cmd=speed, delta_cmd=command, v=speed, delta=delta, x=x, y=y, psi=psi)


def record(channels: dict, **options) -> Record:
    vehicle = VehicleGeometry(L_F, L_R, **options)
    return Record.from_arrays(dt=DT, name="drive", vehicle=vehicle, **channels)


@pytest.fixture(scope="module")
def model() -> Model:
    lag = Plant(PlantSpec("steering", "delta_cmd", "delta"), TransferFunction([RATE], [1.0, RATE]))
    return Model({"steering": lag})


@pytest.mark.parametrize(
    ("ahead", "options"),
    [
        (L_R, {}),
        (0.0, {"reference_point": "rear_axle"}),
        (L_R + 0.4, {"reference_point": "sensor", "lever_arm": 0.4}),
    ],
)
def test_the_true_model_meets_the_measured_path_at_any_reference_point(model, ahead, options):
    comparison = compare(record(drive(ahead=ahead), **options), model)
    vdm, vdm_si = comparison.predictions.values()
    assert vdm_si.whole.ate["max"] < NEAR
    assert vdm_si.windows.ate["max"] < NEAR
    assert vdm_si.scores["delta"].fit > 99.9
    assert vdm.whole.ate["mean"] > 50 * NEAR
    assert vdm.aligned["mean"] < vdm.whole.ate["mean"]


def test_a_comparison_says_what_it_found_on_one_line(model):
    said = repr(compare(record(drive()), model))
    assert "\n" not in said and len(said) < 400
    assert "VDM-SI: FIT of v" in said and "mean error" in said


def test_a_comparison_of_commands_alone_says_that_nothing_was_measured(model):
    commands = {name: x for name, x in drive().items() if name.endswith("_cmd")}
    said = repr(compare(record(commands), model))
    assert "VDM-SI: nothing measured to compare with" in said


def test_a_plant_starts_where_the_measurement_starts(model):
    rolling = drive(start=-0.3)
    assert abs(rolling["delta_cmd"][0] - rolling["delta"][0]) > 0.3
    vdm_si = compare(record(rolling), model).predictions["VDM-SI"]
    assert vdm_si.channels["delta"][0] == pytest.approx(-0.3, abs=1e-3)
    assert vdm_si.whole.ate["max"] < NEAR


def test_windows_start_anew_at_the_measured_pose(model):
    log = record(drive())
    window = 10.0
    vdm = compare(log, model, window=window).predictions["VDM"]
    samples = round(window / DT)
    for start in range(0, log.n, samples):
        assert vdm.windows.translation[start] == pytest.approx(0.0, abs=1e-12)
        assert vdm.windows.heading[start] == pytest.approx(0.0, abs=1e-12)
        alone = compare(log.between(start * DT, (start + samples) * DT), model)
        np.testing.assert_allclose(
            vdm.windows.translation[start : start + samples],
            alone.predictions["VDM"].whole.translation,
            atol=1e-9,
        )


def test_every_segment_starts_at_its_own_measured_pose(model):
    parts = [record(drive(n=700, seed=1)), record(drive(n=500, seed=2))]
    both = compare(Record.concatenate(parts), model).predictions["VDM"]
    alone = [compare(part, model).predictions["VDM"].whole.translation for part in parts]
    np.testing.assert_allclose(both.whole.translation, np.concatenate(alone), atol=1e-9)


def test_stretches_between_gaps_are_told_as_such_and_scored_one_by_one(model):
    whole = record(drive())
    torn = whole.select([Segment(0, 1200), Segment(1300, 2000)])
    comparison = compare(torn, model)
    vdm = comparison.predictions["VDM"]
    alone = [compare(torn.select([s]), model).predictions["VDM"] for s in torn.segments]
    sizes = np.array([1200, 700])
    mean = np.average([own.aligned["mean"] for own in alone], weights=sizes)
    assert vdm.aligned["mean"] == pytest.approx(mean)
    assert vdm.aligned["mean"] < vdm.whole.ate["mean"]
    heading = np.average([own.whole.turned["mean"] for own in alone], weights=sizes)
    assert vdm.whole.turned["mean"] == pytest.approx(heading)
    assert vdm.relative.distance == alone[0].relative.distance, "a tenth of the longest"
    assert vdm.relative.translation["max"] >= alone[0].relative.translation["max"] - 1e-9
    html = render(simulation_page([comparison]))
    assert "each stretch, from its start" in html and "each stretch, aligned" in html
    assert "whole run" not in html and "over every" in html
    assert "heading error (rad)" in html and "part the log into 2 stretches" in html
    told = simulation_document([comparison])["runs"][0]
    assert told["segments"] == 2 and told["vdm"]["relative"]["heading"]["max"] > 0.0
    assert set(told["vdm"]["heading"]) == set(told["vdm"]["ate_aligned"]) == {"max", "mean", "rmse"}
    page = render(simulation_page([compare(whole, model)]))
    assert "whole run, aligned" in page and "stretch" not in page


@pytest.mark.parametrize(("rows", "windows"), [(700, 1), (740, 1), (750, 2), (300, 1), (1260, 3)])
def test_what_is_shorter_than_half_a_window_is_none_of_its_own(model, rows, windows):
    log = record(drive()).select([Segment(0, rows)])
    vdm = compare(log, model, window=10.0).predictions["VDM"]
    anchored = np.flatnonzero(vdm.windows.translation < 1e-12)
    assert sum(start in anchored for start in range(0, rows, 500)) == windows


def test_the_floor_is_what_the_bicycle_gets_wrong(model):
    log = record(drive())
    comparison = compare(log, model)
    # What moves between rows is taken at the middle of them; the speed jumps there, by up to 3 m/s.
    assert comparison.floor.whole.ate["max"] < 0.1
    slippery = dict(log.channels) | {"x": 1.05 * log["x"], "y": 1.05 * log["y"]}
    worse = compare(record(slippery), model).floor
    assert worse.whole.ate["mean"] > 5 * comparison.floor.whole.ate["mean"]


def test_the_actuator_whose_model_is_wrong_is_told_by_its_measured_response(model):
    """The speed is as commanded, and the steering lags more than its model says."""
    late = Plant(model.plants["steering"].spec, TransferFunction([3 * RATE], [1.0, 3 * RATE]))
    comparison = compare(record(drive()), Model({"steering": late}))
    own, floor = comparison.predictions["VDM-SI"].windows, comparison.floor.windows
    by_speed, by_angle = (comparison.with_measured[name].windows for name in ("v", "delta"))
    assert own.ate["mean"] > 5 * floor.ate["mean"]
    assert by_angle.ate["mean"] == pytest.approx(floor.ate["mean"], rel=0.05, abs=NEAR)
    assert by_speed.ate["mean"] == pytest.approx(own.ate["mean"], rel=0.05)
    text = next(str(b) for s in simulation_page([comparison]).sections[1:] for b in s.blocks
                if "Where the error comes from" in str(b))  # fmt: skip
    assert "of what better actuator models could take off is the steering's" in text


def test_a_single_actuator_is_compared_by_its_response(model, tmp_path):
    channels = drive()
    log = Record.from_arrays(dt=DT, delta_cmd=channels["delta_cmd"], delta=channels["delta"])
    comparison = compare(log, model)
    assert comparison.predictions["VDM-SI"].scores["delta"].fit > 99.9
    assert all(p.whole is None for p in comparison.predictions.values())
    assert comparison.floor is None and not comparison.with_measured
    assert write_trajectories(tmp_path, comparison) == []


def test_commands_alone_are_driven_from_the_origin(model, tmp_path):
    channels = drive()
    log = record({name: channels[name] for name in ("v_cmd", "delta_cmd")})
    comparison = compare(log, model)
    posed = compare(record(channels), model).predictions["VDM"].channels
    for prediction in comparison.predictions.values():
        assert prediction.has_path and prediction.scores == {} and prediction.whole is None
    c, s = np.cos(channels["psi"][0]), np.sin(channels["psi"][0])
    x, y = (posed[name] - channels[name][0] for name in ("x", "y"))
    own = comparison.predictions["VDM"].channels
    np.testing.assert_allclose(own["x"], c * x + s * y, atol=1e-6)
    np.testing.assert_allclose(own["y"], c * y - s * x, atol=1e-6)
    assert "nothing is compared" in comparison.lacking
    written = write_trajectories(tmp_path, comparison)
    assert [path.name for path in written] == ["drive.vdm.tum", "drive.vdm_si.tum"]


def test_the_yaw_rate_is_predicted_where_no_pose_was_measured(model):
    channels = drive()
    psi = channels["psi"]
    told = {name: channels[name] for name in ("v_cmd", "delta_cmd")}
    comparison = compare(record(told | {"r": np.gradient(psi, DT)}), model)
    vdm, vdm_si = (prediction.scores["r"].fit for prediction in comparison.predictions.values())
    assert vdm_si > vdm + 5.0
    assert comparison.lacking == ""


def test_a_heading_alone_is_where_each_segment_starts(model):
    channels = drive()
    turned = {name: channels[name] for name in ("v_cmd", "delta_cmd", "v", "delta")}
    turned["psi"] = channels["psi"] + 1.5 - channels["psi"][0]
    whole = record(turned)
    for log in (whole, whole.select([Segment(0, 1200), Segment(1300, 2000)])):
        vdm_si = compare(log, model).predictions["VDM-SI"]
        for segment in log.segments:
            assert vdm_si.channels["psi"][segment.start] == log["psi"][segment.start]
        assert vdm_si.scores["psi"].fit > 99.0
        assert vdm_si.whole is None


@pytest.mark.parametrize("told", [("x",), ("y",), ("x", "y"), ("x", "psi")])
def test_half_a_pose_is_not_scored(model, told):
    channels = drive(n=600)
    kept = ("v_cmd", "delta_cmd", "v", "delta", *told)
    comparison = compare(record({name: channels[name] for name in kept}), model)
    for prediction in comparison.predictions.values():
        assert set(prediction.scores) == {"v", "delta"} | ({"psi"} & set(told))
        assert prediction.whole is None


def test_a_path_without_a_pose_goes_on_behind_a_gap(model):
    channels = drive(n=1000)
    told = {name: channels[name] for name in ("v_cmd", "delta_cmd")}
    whole = record(told)
    torn = whole.select([Segment(0, 400), Segment(600, 1000)])
    x, y = (compare(torn, model).predictions["VDM"].channels[name] for name in ("x", "y"))
    assert np.hypot(x[400], y[400]) > 1.0
    assert np.hypot(x[400] - x[399], y[400] - y[399]) < 0.1
    both = compare(Record.concatenate([torn, whole]), model).predictions["VDM"].channels["x"]
    assert both[800] == 0.0


def test_samples_that_were_filled_in_do_not_count(model):
    channels = drive()
    bad = channels["delta"].copy()
    bad[500:600] = 7.0
    filled = np.zeros(len(bad), bool)
    filled[500:600] = True
    log = dataclasses.replace(record(channels | {"delta": bad}), filled={"delta": filled})
    assert compare(log, model).predictions["VDM-SI"].scores["delta"].fit > 99.9


def test_a_log_without_the_models_commands_is_refused(model):
    log = Record.from_arrays(dt=DT, v_cmd=np.ones(100), v=np.ones(100))
    with pytest.raises(InputError, match="delta_cmd"):
        compare(log, model)
    with pytest.raises(InputError, match="no actuator"):
        compare(log, dataclasses.replace(model, plants={}))


@pytest.mark.parametrize("window", [0.0, -1.0, float("nan")])
def test_windows_have_a_length(model, window):
    with pytest.raises(InputError, match="window: .* is no duration; give seconds"):
        compare(record(drive(300)), model, window=window)


def driven(model: Model, n: int = 1200) -> Record:
    """A record that is the extended model itself, seen by its sensors; what a log would hold."""
    channels = {name: values[:n] for name, values in drive(n=n).items()}
    commands = Commands(channels["v_cmd"], channels["delta_cmd"], DT)
    vehicle = dataclasses.replace(model, vehicle=VehicleGeometry(L_F, L_R)).to_vehicle()
    path = simulate(vehicle, commands, Start(3.0, -2.0, 0.7))
    seen = {name: np.array(getattr(path, name)) for name in ("v", "delta", "r", "x", "y", "psi")}
    seen["r"] = np.r_[[seen["r"][0]] * 3, seen["r"][:-3]] + 0.05
    return record(channels | seen)


@pytest.fixture(scope="module")
def extended(model) -> Model:
    steering = Plant(model.plants["steering"].spec, ExtendedPlant(
        model.plants["steering"].model, (SpeedDependentGain(-0.08), Backlash(0.06))
    ))  # fmt: skip
    sensors = (("r", SensorDelay(3 * DT)), ("r", SensorBias(0.05)), ("pose", SensorDelay(1.0)))
    return Model({"steering": steering}, None, (Understeer(0.02),), sensors)


def test_a_model_with_effects_is_a_third_prediction(extended, tmp_path):
    log = driven(extended)
    comparison = compare(log, extended)
    assert list(comparison.predictions) == ["VDM", "VDM-SI", "extended"]
    plain = compare(log, Model({"steering": Plant(
        extended.plants["steering"].spec, extended.plants["steering"].linear
    )}))  # fmt: skip
    assert list(plain.predictions) == ["VDM", "VDM-SI"]
    for name in plain.predictions:
        np.testing.assert_array_equal(
            comparison.predictions[name].whole.translation,
            plain.predictions[name].whole.translation,
        )
    vdm_si, best = (comparison.predictions[name] for name in ("VDM-SI", "extended"))
    assert best.whole.ate["max"] < 1e-6, "the log is the model itself"
    floors = [c.floor.whole.ate["mean"] for c in (comparison, plain)]
    assert 5 * floors[0] < floors[1], "with measured responses the extended body is what is driven"
    assert min(best.scores[c].fit for c in ("delta", "r")) > 99.99
    assert vdm_si.whole.ate["mean"] > 0.1 and vdm_si.scores["r"].fit < 90.0
    document = simulation_document([comparison])["runs"][0]
    assert document["extended"]["ate"]["max"] < 1e-6
    assert document["channels"]["r"]["fit"] == best.scores["r"].fit
    names = {path.name for path in write_trajectories(tmp_path, comparison)}
    assert names == {f"drive.{kind}.tum" for kind in ("measured", "vdm", "vdm_si", "extended")}
    second = dataclasses.replace(comparison, record=comparison.record.renamed("monday/run.2"))
    names = {path.name for path in write_trajectories(tmp_path, second)}
    assert "monday.run.2.measured.tum" in names, "run.1 and run.2 would share their files"


@pytest.mark.parametrize(
    "sensor", [SensorBias(0.2), SensorDelay(12 * DT), SensorLag(8 * DT)], ids=lambda s: s.cause
)
def test_a_heading_is_begun_as_it_is_and_not_as_its_sensor_tells_it(extended, sensor, tmp_path):
    """A path that begins where a late or turned heading points leads elsewhere."""
    model = dataclasses.replace(extended, sensors=(*extended.sensors[:2], ("psi", sensor)))
    model = load_model(save_model(tmp_path / "model.json", model))
    log = driven(extended)
    psi = np.asarray(sensor.sensor(jnp.asarray(log["psi"]), Signals.plain(log.n, DT)))
    turning = int(np.argmax(np.abs(log["r"][50:600]))) + 50
    log = record({name: x[turning:] for name, x in {**log.channels, "psi": psi}.items()})
    apart, best = (
        compare(log, m).predictions["extended"].whole.ate["max"]
        for m in (dataclasses.replace(model, sensors=model.sensors[:2]), model)
    )
    assert best < 0.1 < 0.2 * apart


def test_vdm_si_is_the_baseline_and_not_what_effects_leave(extended):
    """A plant that was fitted with effects is none that was fitted without."""
    log, fitted = driven(extended), extended.plants["steering"]
    alone = TransferFunction([3.0], [1.0, 3.0])
    told = dataclasses.replace(fitted, baseline=alone)
    both = compare(log, dataclasses.replace(extended, plants={"steering": told})).predictions
    plain = compare(log, Model({"steering": Plant(fitted.spec, alone)})).predictions
    for channel in ("delta", "x", "psi"):
        np.testing.assert_array_equal(
            both["VDM-SI"].channels[channel], plain["VDM-SI"].channels[channel]
        )
    assert both["extended"].whole.ate["max"] < 1e-6


def test_an_extended_actuator_alone_hears_the_speed(extended):
    log = driven(extended)
    channels = {name: log[name] for name in ("v_cmd", "delta_cmd", "v", "delta")}
    alone = compare(Record.from_arrays(dt=DT, **channels), extended)
    assert alone.predictions["extended"].scores["delta"].fit > 99.99
    assert alone.predictions["extended"].whole is None


def test_a_run_goes_on_behind_a_gap(model):
    """What changes as a run goes on does so behind a gap, too, and in a new run anew."""
    steering = Plant(model.plants["steering"].spec, ExtendedPlant(
        model.plants["steering"].model, (GainDrift(0.02),)
    ))  # fmt: skip
    whole = driven(Model({"steering": steering}))
    torn = whole.select([Segment(0, 500), Segment(700, 1200)])
    assert [len(segment) for segment in torn.segments] == [500, 500]
    for log in (torn, Record.concatenate([whole, whole])):
        prediction = compare(log, Model({"steering": steering})).predictions["extended"]
        assert prediction.scores["delta"].fit > 99.9
        assert prediction.whole.ate["max"] < 1e-3


def test_an_extended_plant_starts_where_the_measurement_starts(model):
    """Play and an offset stand between the state and what is measured of it."""
    made = (Backlash(0.1), Offset(0.07))
    linear = model.plants["steering"].model
    plant = Plant(model.plants["steering"].spec, ExtendedPlant(linear, made))
    channels = drive(n=600)
    x0 = -0.3 * linear.to_plant().rest
    delta = np.array(plant.model.simulate(channels["delta_cmd"], DT, x0).y)
    log = Record.from_arrays(dt=DT, delta_cmd=channels["delta_cmd"], delta=delta)
    best = compare(log, Model({"steering": plant})).predictions["extended"]
    np.testing.assert_allclose(best.channels["delta"], delta, atol=1e-6)


def test_a_plant_whose_response_is_not_measured_at_first_rests_under_the_first_commands(model):
    """An angle that is told by a yaw rate is held back to where the vehicle stood, which says
    nothing; what sensors make of the command there is noise, which play would keep."""
    linear = model.plants["steering"].model
    plant = Plant(model.plants["steering"].spec, ExtendedPlant(linear, (Backlash(0.1),)))
    command = 0.01 * np.random.default_rng(3).standard_normal(600)
    command[0] = 0.03
    command[200:] += 0.2
    delta = np.array(plant.model.simulate(command, DT, 0.0 * linear.to_plant().rest).y)
    delta[:30] = 0.4
    log = Record.from_arrays(dt=DT, delta_cmd=command, delta=delta)
    log = dataclasses.replace(log, filled={"delta": np.arange(600) < 30})
    found = compare(log, Model({"steering": plant})).predictions["extended"]
    assert np.abs(found.channels["delta"] - delta)[30:].max() < 0.006
