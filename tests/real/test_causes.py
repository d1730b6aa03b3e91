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
