"""Causes named in measured logs, by the commands alone: nothing in the code knows these logs."""

import json
import math
import subprocess
import sys

import pytest

import floors

pytestmark = pytest.mark.slow


def run(*arguments) -> None:
    subprocess.run([sys.executable, "-m", "vdmsi_jax", *map(str, arguments)], check=True)


def diagnosed(logs, config: str, out) -> dict:
    run("diagnose", *logs, "--config", floors.CONFIGS / config, "--out", out)
    return json.loads((out / "diagnosis.json").read_text())


def named(found: dict) -> dict[tuple[str, str], dict]:
    return {(f["cause"], f["where"]): f for f in found["findings"]}


def test_tanks_spill_and_their_model_simulates_the_log_held_out(shared_data, tmp_path):
    """Simulated from rest, within the 0.45 V asked; linear models are published with 0.76."""
    logs = [shared_data / "cascaded_tanks" / f"{name}.csv" for name in ("estimation", "validation")]
    found = diagnosed(logs, "cascaded_tanks.toml", tmp_path / "diagnosis")
    assert ("saturation", "plant") in named(found)
    model, out = tmp_path / "diagnosis" / "model.json", tmp_path / "simulation"
    run(
        "simulate", model, logs[1], "--config", floors.CONFIGS / "cascaded_tanks.toml", "--out", out
    )
    (told,) = json.loads((out / "simulation.json").read_text())["runs"]
    assert math.sqrt(told["extended"]["channels"]["level"]["mse"]) < 0.45


def test_a_hoop_motor_answers_less_to_more(shared_data, tmp_path):
    logs = [shared_data / "ce109_hoop_motor" / "fixedStepSequence.csv"]
    finding = named(diagnosed(logs, "ce109_hoop_motor.toml", tmp_path))[
        "gain_nonlinearity", "plant"
    ]
    assert finding["gain"]["after"] > 93.0


def test_a_sedan_understeers(shared_data, tmp_path):
    """It leads what is named of the body; FIT of the yaw rate rises by more than 2 points."""
    logs = sorted((shared_data / "genesis_sedan").glob("*.csv"))
    found = diagnosed(logs, "genesis_sedan.toml", tmp_path)
    first = next(f for f in found["findings"] if f["where"] == "vehicle")
    assert first["cause"] == "understeer" and first["parameters"]["gradient"]["value"] > 0.0
    before, after = (found[k]["channels"]["r"]["fit"] for k in ("baseline", "extended"))
    assert after > before + 2.0


def test_a_small_car_steers_late_and_to_one_side(shared_data, tmp_path):
    logs = [shared_data / "cpm_mucar" / "run_a.csv"]
    found = named(diagnosed(logs, "cpm_mucar_run_a.toml", tmp_path))
    assert {("transport_delay", "steering"), ("offset", "steering")} <= set(found)


def test_its_second_log_is_late_in_the_steering_and_in_the_yaw_rate(shared_data, tmp_path):
    """Its documentation tells of both, of a limit of the steering, which only bends what is driven
    here, and of a heading of the pose that is off."""
    logs = [shared_data / "cpm_mucar" / "run_b.csv"]
    found = named(diagnosed(logs, "cpm_mucar_run_b.toml", tmp_path))
    late = {("transport_delay", "steering"), ("sensor_delay", "sensor"), ("sensor_bias", "sensor")}
    assert late <= set(found)


def test_a_position_servo_sticks(shared_data, tmp_path):
    """In so stiff a loop friction is hardly another thing than play of the goal: a set with it."""
    logs = [shared_data / "bam_servo" / "xl330_kp400_sin_sin.csv"]
    (finding,) = diagnosed(logs, "bam_servo.toml", tmp_path)["findings"]
    assert "coulomb_friction" in (finding["cause"], *finding["indistinguishable_from"])
