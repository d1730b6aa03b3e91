"""The verb: what is hidden in logs is named, sized, and gained on drives that no fit has seen."""

import json
from dataclasses import replace
from pathlib import Path

import jax
import numpy as np
import pytest

import vdmsi_jax as vj
from hidden.generator import Case, generate
from vdmsi_jax.diagnose.answer.document import diagnosis_document
from vdmsi_jax.diagnose.body.body import Body
from vdmsi_jax.diagnose.body.fit import fit_body, robust

DEMO = Path(__file__).parents[2] / "configs" / "demo" / "fault"
TRUE_GAP = 0.020282853292926506  # rad, as configs/demo/make_fault.py prints it


def records(drive, channels=("v_cmd", "delta_cmd", "v", "delta", "r", "x", "y", "psi"), rows=None):
    geometry = vj.VehicleGeometry(*drive.geometry)
    return [
        vj.Record.from_arrays(
            dt=drive.dt,
            name=f"run_{i + 1}",
            vehicle=geometry,
            **{c: run[c][:rows] for c in channels},
        )
        for i, run in enumerate(drive.runs)
    ]


@pytest.fixture(scope="module")
def logs():
    return vj.read_logs([DEMO / f"run_{i}.csv" for i in (1, 2, 3)], config=DEMO / "vehicle.toml")


@pytest.fixture(scope="module")
def play(logs):
    return vj.diagnose(logs)


def test_the_play_of_the_demo_is_named_and_nothing_else(play):
    assert play.verdict == "explained"
    assert [(f.cause, f.where) for f in play.findings] == [("backlash", "steering")]
    assert play.findings[0].indistinguishable_from == ()


def test_its_size_is_told_with_an_interval_that_holds_it(play):
    gap = play.findings[0].parameters["gap"]
    assert gap.unit == "rad"
    assert abs(gap.value - TRUE_GAP) < max(3.0 * gap.std, 0.01 * TRUE_GAP)


def test_the_gain_is_measured_on_a_drive_that_no_fit_has_seen(play):
    gain = play.findings[0].gain
    assert gain.held_out and gain.channel == "delta"
    assert gain.after - gain.before > 10.0 > gain.se
    assert gain.ate_after < gain.ate_before <= play.ate["baseline"]["mean"]  # as in pictures
    assert play.extended["delta"].fit == pytest.approx(gain.after)


def test_the_budget_adds_up(play):
    for budget in play.budget:
        parts = sum(budget.parts.values()) + budget.noise + budget.unexplained
        assert parts == pytest.approx(budget.total)
    steering = next(b for b in play.budget if b.name == "delta")
    assert steering.parts["backlash (steering)"] > 0.8 * steering.total


def test_the_logs_say_what_they_could_have_shown(play):
    known = {(d.where, d.cause): d for d in play.detectable}
    delay = known["steering", "transport_delay"]
    assert 0.0 < delay.smallest < 0.1 and delay.unit == "s"
    assert known["powertrain", "gain_nonlinearity"].unit == "1/(m/s)"
    assert known["powertrain", "rate_limit"].unit == "m/s^2"


def test_a_limit_shows_only_where_the_command_comes_to_it(play, logs):
    known = {(d.where, d.cause): d for d in play.detectable}
    for where, channel in (("powertrain", "v_cmd"), ("steering", "delta_cmd")):
        largest = max(float(log[channel].max()) for log in logs)
        assert 0.6 * largest < known[where, "saturation"].smallest < largest


def test_the_extended_model_survives_the_disk_and_drives_better(play, logs, tmp_path):
    model = vj.load_model(vj.save_model(tmp_path / "model.json", play.model))
    predictions = vj.compare(logs[2], model).predictions
    assert set(predictions) == {"VDM", "VDM-SI", "extended"}
    assert predictions["extended"].scores["delta"].fit > 90.0
    assert predictions["extended"].scores["delta"].fit > predictions["VDM-SI"].scores["delta"].fit


def test_the_document_is_strict_and_has_the_contract_s_keys(play):
    document = diagnosis_document(play)
    json.dumps(document, allow_nan=False)
    asked = {"schema", "verdict", "baseline", "findings", "minor", "unexplained", "noise_ceiling"}
    assert asked <= set(document)
    assert {"cause", "where", "parameters", "p_value", "gain"} <= set(document["findings"][0])


def test_a_speed_alone_is_diagnosed_with_what_is_there():
    case = Case((("dead_zone", "powertrain"),), "middle", seed=3, duration=40.0)
    (drive,) = generate([case])
    with jax.enable_x64(False):  # as a session that never heard of double precision
        found = vj.diagnose(records(drive, ("v_cmd", "v")))
    assert [f.cause for f in found.findings] == ["dead_zone"]
    truth = drive.truth.causes[0].parameters["half_width"][0]
    assert found.findings[0].parameters["half_width"].value == pytest.approx(truth, rel=0.1)
    assert any("could not be looked at" in sentence for sentence in found.unseen)
    assert found.ate is None


@pytest.mark.slow
def test_a_steering_angle_that_was_not_logged_is_told_from_the_yaw_rate():
    case = Case((("backlash", "steering"),), "middle", seed=3, duration=40.0)
    (drive,) = generate([case])
    found = vj.diagnose(records(drive, ("v_cmd", "delta_cmd", "v", "r")))
    assert [(f.cause, f.where) for f in found.findings] == [("backlash", "steering")]
    json.dumps(diagnosis_document(found), allow_nan=False)


@pytest.mark.slow
@pytest.mark.parametrize("cause", [(), (("offset", "steering"),)])
def test_poses_alone_show_what_is_there_and_no_more(tmp_path, cause):
    """Speed and angle are made of the pose: that makes no fault, and hides none."""
    drive = generate([Case(cause=cause, seed=3, duration=30.0)])[0]
    geometry = "[vehicle]\nl_f = {}\nl_r = {}\n".format(*drive.geometry)
    (tmp_path / "vehicle.toml").write_text(geometry)
    names, paths = ("t", "v_cmd", "delta_cmd", "x", "y", "psi"), []
    for k, run in enumerate(drive.runs):
        paths.append(tmp_path / f"run_{k}.csv")
        table = np.stack([run[name] for name in names], axis=1)
        np.savetxt(paths[-1], table, delimiter=",", header=",".join(names), comments="")
    found = vj.diagnose(vj.read_logs(paths))
    assert tuple((f.cause, f.where) for f in found.findings) == cause
    assert found.verdict == ("explained" if cause else "no_effect")


def test_a_body_whose_lag_stands_at_its_bound_has_its_fit_as_it_is():
    n, dt = 1500, 0.02
    rng = np.random.default_rng(2)
    v, delta = (np.repeat(rng.uniform(*ends, n // 50), 50)[None] for ends in ((4, 8), (-0.1, 0.1)))
    bicycle = vj.Bicycle(1.0, 1.0)
    r = np.asarray(bicycle.yaw_rate(v, delta)) + 0.002 * rng.standard_normal((1, n))
    here, nowhere = {"r": np.ones((1, n), bool)}, {"r": np.zeros((1, n), bool)}
    zero = np.zeros((1, n))
    body = Body(v, delta, zero, zero, {"r": r}, here, nowhere, bicycle, dt)
    fit = fit_body(body, [()])[0]
    bound = replace(fit, theta=np.where(np.arange(fit.theta.size) == 0, 0.0, fit.theta))
    assert robust(body, bound) is bound
    assert robust(body, fit).covariance.shape == fit.covariance.shape


def test_logs_that_do_not_go_together_are_refused(logs):
    with pytest.raises(vj.InputError, match="no record"):
        vj.diagnose([])
    n = 400
    other = vj.Record.from_arrays(dt=0.05, name="slow", v_cmd=np.arange(n) % 7.0, v=np.zeros(n))
    with pytest.raises(vj.InputError, match="sampled every"):
        vj.diagnose([*logs, other])


def test_logs_of_different_vehicles_are_refused():
    n = 400
    u = np.repeat(np.random.default_rng(0).uniform(1.0, 3.0, n // 20), 20)
    v = np.convolve(u, 0.1 * 0.9 ** np.arange(60))[:n]
    car, model, untold = (
        vj.Record.from_arrays(dt=0.05, name=name, vehicle=vehicle, v_cmd=u, v=v)
        for name, vehicle in (
            ("car", vj.VehicleGeometry(1.0, 1.0)),
            ("model", vj.VehicleGeometry(0.1, 0.1)),
            ("untold", None),
        )
    )
    told = r"^model: vehicle: another vehicle than that of car; "
    for logs in ([car, model], [untold, car, model]):
        with pytest.raises(vj.InputError, match=told):
            vj.diagnose(logs)


def test_a_refusal_names_the_files_that_were_given():
    logs = []
    for name in ("run_1", "run_2"):
        u = len(logs) + np.arange(400) % 7.0
        echo = vj.Record.from_arrays(dt=0.05, name=name, v_cmd=u, v=u)
        logs.append(replace(echo, file=f"drives/{name}.csv"))
    with pytest.raises(vj.InputError, match=r"^drives/run_1\.csv, drives/run_2\.csv: .*an echo"):
        vj.diagnose(logs)


def test_channels_that_some_logs_lack_are_told(logs):
    alone = replace(logs[0], channels={c: logs[0][c] for c in ("v_cmd", "delta_cmd", "v")})
    found = vj.diagnose([alone, *logs[1:]])
    lacking = "run_1.csv lacks delta, r, x, y, psi: not looked at in any log."
    assert lacking in found.unseen
    assert repr(found).endswith("; not all was looked at, see unseen>")
    assert set(found.channels) == {"v"}
    other = replace(logs[1], channels={c: logs[1][c] for c in ("delta_cmd", "delta", "r")})
    with pytest.raises(vj.InputError, match=r"run_1\.csv lacks delta, r: not looked at"):
        vj.diagnose([alone, other])


@pytest.mark.slow
def test_a_copy_of_a_drive_does_not_judge_it():
    rng = np.random.default_rng(0)
    u = np.repeat(rng.normal(size=20), 20)
    lag = np.convolve(u, 0.2 * 0.8 ** np.arange(40))[:400] + 0.01 * rng.normal(size=400)
    plant = vj.PlantSpec("motor", "u", "w")
    log = vj.Record.from_arrays(dt=0.05, name="log", u=u, w=lag, plants=(plant,))
    found = vj.diagnose([log, log.renamed("copy")])
    assert found.unseen[0] == "copy holds what log holds and was left out."
    assert [r.name for r in found.records] == ["log"]


def test_a_log_that_answers_to_nothing_is_refused():
    lonely = vj.Record.from_arrays(dt=0.02, name="lonely", v=np.sin(np.arange(500) * 0.01))
    with pytest.raises(vj.InputError, match="command"):
        vj.diagnose(lonely)


def plant_log(u, y, name="log"):
    plant = vj.PlantSpec("motor", "u", "w")
    return vj.Record.from_arrays(dt=0.02, name=name, u=u, w=y, plants=(plant,))


def test_a_log_of_a_second_is_refused_in_one_line():
    u = np.repeat([1.0, -1.0, 1.0], 10)
    with pytest.raises(vj.InputError, match="30 samples; give logs of 40 or more"):
        vj.diagnose(plant_log(u, 0.5 * u))


def test_a_response_that_is_constant_is_told_as_such_and_is_no_dead_sensor_of_a_pose():
    u = np.repeat([1.0, -1.0, 1.0, -1.0], 100)
    with pytest.raises(vj.InputError, match="y: the response of plant is zero in all 400 samples"):
        vj.diagnose(vj.Record.from_arrays(dt=0.02, u=u, y=0.0 * u))


@pytest.mark.parametrize(
    ("arguments", "told"),
    [
        (("car.csv",), "str is no record; give records, as read_log"),
        ((None,), "NoneType is no record"),
        ((plant_log(np.arange(400) % 7, np.zeros(400)), "car.toml"), "'car.toml' is no geometry"),
    ],
)
def test_what_is_no_record_and_no_vehicle_is_refused_in_one_line(unchecked, arguments, told):
    with pytest.raises(vj.InputError, match=told):
        vj.diagnose(*arguments)
    if len(arguments) == 1:
        with pytest.raises(vj.InputError, match=told):
            vj.identify(*arguments, "steering")
        with pytest.raises(vj.InputError, match=told):
            vj.identify_vehicle(*arguments)


def test_noise_that_is_a_number_is_refused(unchecked):
    u = np.repeat([1.0, -1.0, 1.0, -1.0], 100)
    with pytest.raises(vj.InputError, match="noise: w: 0.1 is no KnownNoise"):
        vj.diagnose(plant_log(u, 0.5 * u), noise={"w": 0.1})


@pytest.mark.parametrize("step", [1, 998])
def test_a_command_that_changes_once_at_an_end_is_no_fault(step):
    """What causes need to be tried is not there: no size of the command, no rate."""
    u = np.zeros(1000)
    u[:step] = 1.0
    u = u if step == 1 else 1.0 - u
    lag = np.convolve(u, 0.1 * 0.9 ** np.arange(100))[:1000]
    noisy = lag + 0.01 * np.random.default_rng(1).normal(size=1000)
    found = vj.diagnose(plant_log(u, noisy))
    assert found.verdict == "no_effect"
    assert not found.unseen and not repr(found).endswith("see unseen>")
    named = vj.diagnose(vj.Record.from_arrays(dt=0.02, u=u, y=noisy))  # which is no position
    assert not named.unseen


@pytest.mark.parametrize("noise", [0.0, 0.02])
def test_a_vehicle_that_stands_has_no_body(noise):
    """Steered at rest: its speed is zero, or noise, and its pose tells of nothing."""
    rng = np.random.default_rng(0)
    n = 1000
    delta_cmd = np.repeat(rng.uniform(-0.3, 0.3, n // 25), 25)
    delta = np.convolve(delta_cmd, 0.1 * 0.9 ** np.arange(100))[:n]
    told = {"v_cmd": np.zeros(n), "delta_cmd": delta_cmd, "delta": delta}
    told |= {c: np.zeros(n) for c in ("v", "r", "x", "y", "psi")}
    logged = {c: x + noise * rng.normal(size=n) * (c[-4:] != "_cmd") for c, x in told.items()}
    log = vj.Record.from_arrays(dt=0.02, vehicle=vj.VehicleGeometry(0.15, 0.15), **logged)
    found = vj.diagnose(log)
    assert not found.findings
    assert any("stands" in told for told in found.unseen)


@pytest.mark.slow
def test_a_dead_sensor_is_left_out(logs):
    """A yaw rate of zero throughout; it had been told as a late angle."""
    dead = [replace(r, channels=r.channels | {"r": np.zeros(r.n)}) for r in logs]
    found = vj.diagnose(dead)
    assert [(f.cause, f.where) for f in found.findings] == [("backlash", "steering")]
    assert any(told.startswith("r never changes") for told in found.unseen)
    assert "r" not in found.records[0]


def test_a_command_that_is_logged_as_its_own_response_is_refused():
    u = np.repeat(np.random.default_rng(0).normal(size=20), 20)
    with pytest.raises(vj.InputError, match="w is u in every sample"):
        vj.diagnose(plant_log(u, u))


@pytest.mark.slow
def test_a_response_that_is_its_own_command_is_left_out(logs):
    echo = [replace(r, channels=r.channels | {"v": r["v_cmd"]}) for r in logs]
    found = vj.diagnose(echo)
    assert any("v is v_cmd in every sample" in told for told in found.unseen)
    assert ("backlash", "steering") in [(f.cause, f.where) for f in found.findings]


@pytest.mark.slow
def test_a_bias_of_the_yaw_rate_is_told_where_the_angle_is_made_of_it(logs):
    """The heading tells it; else the angle would have an offset that changes with the speed."""

    def biased(record):
        kept = {c: x for c, x in record.channels.items() if c != "delta"}
        return replace(record, channels=kept | {"r": record["r"] + 0.03})

    found = vj.diagnose([biased(record) for record in logs])
    named = {(f.cause, f.where, f.channel): f for f in found.findings}
    assert set(named) == {("backlash", "steering", None), ("sensor_bias", "sensor", "r")}
    bias = named["sensor_bias", "sensor", "r"].parameters["bias"]
    assert bias.unit == "rad/s" and bias.value == pytest.approx(0.03, abs=0.003)
