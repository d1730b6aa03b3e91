"""What `vdmsi identify` and `vdmsi simulate` write and say."""

import contextlib
import json
import os
import re

import numpy as np
import pytest

from commands import DEMO, EXTENDED, refused
from small_logs import drive, write_csv
from vdmsi_jax import cli
from vdmsi_jax.errors import InputError
from vdmsi_jax.identify import vehicle
from vdmsi_jax.report.text import number, percent


@pytest.fixture(scope="module")
def identified(tmp_path_factory, vdmsi, settings):
    """Identify both step logs together, in a process that may not import matplotlib."""
    out = tmp_path_factory.mktemp("identified")
    logs = [DEMO / "powertrain_steps.csv", DEMO / "steering_steps.csv"]
    asked = ["identify", *logs, "--config", settings, "--out", out, "--no-report"]
    done = vdmsi(*asked, first='sys.modules["matplotlib"] = None')
    assert done.returncode == 0, done.stderr
    assert done.stderr == ""
    assert os.listdir(out) == ["identify.json"]
    return out, done.stdout


def test_a_refused_plant_is_told_beside_a_good_one(here, tmp_path):
    still = {name: np.zeros(200) if name == "v" else x for name, x in drive().items()}
    log = write_csv(tmp_path / "still.csv", still)
    (tmp_path / "vehicle.toml").write_text("[identify]\npoles = [1]\nzeros = [0]\n")
    done = here("identify", log, "--out", tmp_path / "out")
    assert done.returncode == 0 and "powertrain" not in done.stdout
    told = done.stderr.strip()
    assert told.startswith(f"vdmsi: powertrain was not identified: {log}: v: ")
    assert told.count("\n") == 0
    document = json.loads((tmp_path / "out" / "identify.json").read_text())
    assert list(document["plants"]) == ["steering"]
    assert told.endswith(document["refused"]["powertrain"])
    report = (tmp_path / "out" / "report.html").read_text()
    assert "Powertrain was not identified" in report and "zero in all 200 samples" in report


def test_an_actuator_without_a_command_is_told_beside_a_good_one(here, tmp_path):
    columns = {name: x for name, x in drive().items() if name != "delta_cmd"}
    log = write_csv(tmp_path / "slow.csv", columns)
    vehicle = "[vehicle]\nl_f = 1.0\nl_r = 1.0\n"
    (tmp_path / "vehicle.toml").write_text(f"{vehicle}[identify]\npoles = [1]\nzeros = [0]\n")
    done = here("identify", log, "--out", tmp_path / "out", "--no-report")
    assert done.returncode == 0 and "powertrain" in done.stdout
    told = done.stderr.strip()
    assert told.startswith("vdmsi: The steering was not looked at") and told.count("\n") == 0


def test_where_all_plants_are_refused_each_says_why(here, tmp_path):
    constant = {n: x if n in ("t", "v", "delta") else np.ones(200) for n, x in drive().items()}
    log = write_csv(tmp_path / "const.csv", constant)
    told = refused(here("identify", log, "--out", tmp_path / "out"))
    for channel, plant in (("v_cmd", "powertrain"), ("delta_cmd", "steering")):
        assert f"{log}: {channel}: the command of {plant} is 1 in all 200 samples" in told


def test_without_a_configuration_whole_runs_of_three_are_held_out(tmp_path, monkeypatch):
    asked = []

    def ask(records, options):
        asked.append(options)
        raise InputError("log", "", "asked", "no more")

    monkeypatch.setattr(vehicle, "each_plant", ask)
    log, other = write_csv(tmp_path / "log.csv", drive()), tmp_path / "other.toml"
    other.write_text("[identify]\nsplit = 'blocks'\n")
    monkeypatch.setattr(cli, "prepare", lambda cache: None)
    silent = tmp_path / "silent.toml"
    silent.write_text("[vehicle]\nl_f = 1.0\nl_r = 1.0\n")
    for config in (None, other, silent):
        with contextlib.suppress(InputError):
            cli.identify((log, log, log), config=config, out=tmp_path / "out", report=False)
    assert asked[0] is None  # which `identify` takes as runs, of three and more
    assert asked[1].split == "blocks"
    assert asked[2] is None


def test_identify_needs_no_matplotlib_and_fits_each_plant_where_it_moves(identified):
    out, said = identified
    document = json.loads((out / "identify.json").read_text())
    powertrain, steering = (document["plants"][name] for name in ("powertrain", "steering"))
    best = {name: p["orders"][p["chosen"]] for name, p in document["plants"].items()}
    assert len(powertrain["orders"]) == len(steering["orders"]) == 6
    # The truth (configs/demo/make_logs.py): 45 ms of steering delay, a gain of 0.93.
    assert best["steering"]["delay"] == pytest.approx(0.045, abs=0.005)
    gain = best["steering"]["num"][-1] / best["steering"]["den"][-1]
    assert gain == pytest.approx(0.93, abs=0.02)
    assert best["powertrain"]["fit"] > 87.0
    assert "powertrain" in said and f"{best['powertrain']['fit']:.2f}" in said


def test_the_cache_of_compiled_programs_is_filled(identified, cache):
    assert any((cache / "vdmsi_jax" / "xla").iterdir())


def test_simulate_writes_scores_trajectories_and_a_report(identified, vdmsi, tmp_path):
    out, _ = identified
    logs = [DEMO / "bend.csv", DEMO / "s_curve.csv"]
    done = vdmsi("simulate", out / "identify.json", *logs, "--out", tmp_path / "new" / "folder")
    assert (done.returncode, done.stderr) == (0, "")
    results = tmp_path / "new" / "folder"
    document = json.loads((results / "simulation.json").read_text())
    assert document["schema"] == "vdmsi.simulation/1"
    for run, log in zip(document["runs"], ("bend", "s_curve"), strict=True):
        assert run["log"] == f"{log}.csv"
        assert {"fit", "mse"} == set(run["channels"]["v"])
        for statistic in ("max", "mean", "rmse"):  # identified actuators halve the error at least
            assert 0.0 < run["vdm_si"]["ate"][statistic] < 0.5 * run["vdm"]["ate"][statistic]
        for model in ("measured", "vdm", "vdm_si"):
            assert np.loadtxt(results / f"{log}.{model}.tum").shape[1] == 8
    html = (results / "report.html").read_text()
    assert html.startswith("<!doctype html>") and html.count("<svg") == 6
    assert not [name for name in os.listdir(results) if name.startswith(".")]


def test_simulate_takes_a_model_with_effects(vdmsi, tmp_path):
    (tmp_path / "model.json").write_text(json.dumps(EXTENDED))
    out = tmp_path / "out"
    done = vdmsi("simulate", tmp_path / "model.json", DEMO / "bend.csv", "--out", out)
    assert (done.returncode, done.stderr) == (0, "")
    assert "extended" in done.stdout
    run = json.loads((out / "simulation.json").read_text())["runs"][0]
    assert run["channels"] == run["extended"]["channels"]
    # the truth has this lag, gain and delay, and hardly any play
    assert run["extended"]["channels"]["delta"]["fit"] > run["vdm_si"]["channels"]["delta"]["fit"]
    assert run["extended"]["ate"]["mean"] < 0.5 * run["vdm_si"]["ate"]["mean"]
    # but its speed sensor is right, so what this one adds is wrong
    assert run["extended"]["channels"]["v"]["fit"] < run["vdm_si"]["channels"]["v"]["fit"] - 10.0
    assert np.loadtxt(out / "bend.extended.tum").shape[1] == 8
    html = (out / "report.html").read_text()
    assert "VDM, VDM-SI and extended" in html and html.count("<svg") == 3


def test_a_log_of_another_vehicle_than_the_model_s_is_told(here, tmp_path):
    (tmp_path / "model.json").write_text(json.dumps(EXTENDED))
    log = write_csv(tmp_path / "small.csv", drive())
    (tmp_path / "vehicle.toml").write_text("[vehicle]\nl_f = 0.15\nl_r = 0.17\n")
    done = here("simulate", tmp_path / "model.json", log, "--out", tmp_path / "out", "--no-report")
    assert done.returncode == 0 and done.stderr.count("\n") == 1
    said = "small.csv: driven by its own l_f and l_r, 0.15 and 0.17 m, not those of model.json"
    assert said in done.stderr


def test_a_response_of_another_unit_than_its_command_has_no_score_without_a_model(here, tmp_path):
    t = 0.01 * np.arange(400)
    u = np.repeat([0.0, 6.0, 3.0, 9.0], 100)
    w = np.convolve(u, 20.0 * 0.05 * 0.95 ** np.arange(200))[: t.size]
    log = write_csv(tmp_path / "motor.csv", {"t": t, "u": u, "w": w})
    (tmp_path / "motor.toml").write_text(
        '[units]\nu = "V"\nw = "rad/s"\n[[plants]]\nname = "motor"\ninput = "u"\noutput = "w"\n'
    )
    plant = {"input": "u", "output": "w", "num": [100.0], "den": [1.0, 5.0]}
    model = {"schema": "vdmsi.model/1", "plants": {"motor": plant}}
    (tmp_path / "model.json").write_text(json.dumps(model))
    out = tmp_path / "out"
    asked = ["simulate", tmp_path / "model.json", log, "--config", tmp_path / "motor.toml"]
    done = here(*asked, "--out", out)
    assert (done.returncode, done.stderr) == (0, "")
    run = json.loads((out / "simulation.json").read_text())["runs"][0]
    assert "w" not in run["vdm"]["channels"] and run["vdm_si"]["channels"]["w"]["fit"] > 90.0
    (row,) = re.findall(r"<tr[^>]*><td[^>]*>w</td>.*?</tr>", (out / "report.html").read_text())
    cells = re.findall(r"<td[^>]*>([^<]*)</td>", row)
    fit, mse = (run["vdm_si"]["channels"]["w"][name] for name in ("fit", "mse"))
    assert cells == ["w", "–", percent(fit), "–", number(mse)]


def test_a_model_that_runs_away_is_told(here, tmp_path):
    unstable = json.loads(json.dumps(EXTENDED)) | {"body": [], "sensors": []}
    plant = {"input": "delta_cmd", "output": "delta", "num": [50.0], "den": [1.0, -50.0]}
    unstable["plants"]["steering"] = plant
    (tmp_path / "model.json").write_text(json.dumps(unstable))
    out = tmp_path / "out"
    done = here("simulate", tmp_path / "model.json", DEMO / "bend.csv", "--out", out)
    assert done.returncode == 0, done.stderr
    assert "bend: VDM-SI: The trajectory is not finite" in done.stdout.replace("\n", " ")
    assert "nan" not in done.stdout
    assert "runs away" in (out / "report.html").read_text()
    asked = ["simulate", tmp_path / "model.json", DEMO / "bend.csv", "--out", out, "--no-report"]
    assert "report.html is older than these results" in here(*asked).stdout.replace("\n", " ")
    (out / "report.html").unlink()
    assert "older" not in here(*asked).stdout
