"""The command line as a user meets it: exit codes, one-line refusals, result files, resumption."""

import contextlib
import json
import os
import subprocess
import sys
from pathlib import Path

import jax
import numpy as np
import pytest

from small_logs import drive, write_csv
from vdmsi_jax import cli
from vdmsi_jax.cli import main
from vdmsi_jax.errors import InputError
from vdmsi_jax.identify import vehicle

DEMO = Path(__file__).parents[1] / "configs" / "demo"
FEW_ORDERS = """
[vehicle]
l_f = 1.75
l_r = 1.20

[identify]
poles = [1, 2]
zeros = [0, 1, 2]
"""


@pytest.fixture(scope="session")
def cache(tmp_path_factory):
    """Compiled programs of these tests, so that only the first of them compiles."""
    return tmp_path_factory.mktemp("cache")


@pytest.fixture
def vdmsi(cache):
    """Run the command in a process of its own; `then` is executed after it, before it ends."""

    def run(*arguments, then=""):
        program = f"""
import sys
from vdmsi_jax.cli import main
try:
    main({[str(a) for a in arguments]!r})
finally:
    {then or "pass"}
"""
        environment = os.environ | {"XDG_CACHE_HOME": str(cache), "COLUMNS": "200"}
        environment.pop("JAX_COMPILATION_CACHE_DIR", None)
        return subprocess.run(
            [sys.executable, "-c", program],
            capture_output=True,
            text=True,
            env=environment,
            stdin=subprocess.DEVNULL,
        )

    return run


@pytest.fixture
def here(capsys):
    """Run the command in this process, which has compiled much of it already."""
    kept = jax.config.jax_persistent_cache_min_compile_time_secs

    def run(*arguments):
        code = 0
        try:
            main([str(a) for a in arguments])
        except SystemExit as left:
            code = left.code
        return subprocess.CompletedProcess(arguments, code, *capsys.readouterr())

    yield run
    jax.config.update("jax_persistent_cache_min_compile_time_secs", kept)


@pytest.fixture(scope="module")
def settings(tmp_path_factory):
    path = tmp_path_factory.mktemp("config") / "vehicle.toml"
    path.write_text(FEW_ORDERS)
    return path


def refused(done) -> str:
    assert done.returncode == 2, done.stderr
    assert done.stdout == ""
    assert done.stderr.endswith("\n") and done.stderr.count("\n") == 1, done.stderr
    assert "Traceback" not in done.stderr
    return done.stderr


@pytest.mark.parametrize("command", [[], ["identify"], ["simulate"], ["sweep"]])
def test_help_explains_itself_without_waiting_for_jax(vdmsi, command):
    told = "print(sorted({'jax', 'matplotlib', 'diffrax'} & set(sys.modules)), file=sys.stderr)"
    done = vdmsi(*command, "--help", then=told)
    assert (done.returncode, done.stderr.strip()) == (0, "[]")
    assert "vdmsi" in done.stdout


def test_version(vdmsi):
    done = vdmsi("--version")
    assert done.returncode == 0
    assert done.stdout.startswith("vdmsi ") and done.stderr == ""


@pytest.mark.parametrize(
    ("arguments", "told"),
    [
        ([], "identify"),
        (["idntify"], "idntify: there is no such command; did you mean 'identify'?"),
        (
            ["identify", "x", "--confg", "y"],
            "--confg: there is no such option; did you mean '--config",
        ),
        (["simulate", "m", "x", "--no-reprt", "--out", "OUT"], "did you mean '--no-report'?"),
        (["identify", "run.csv"], "--out"),
        (["identify", "run.csv", "--out", "OUT", "--nosuch"], "--nosuch"),
        (["identify", "--out", "OUT"], "no log"),
        (["identify", "no.csv", "--out", "OUT"], "no.csv"),
        (["identify", "LOG", "--config", "no.toml", "--out", "OUT"], "no.toml"),
        (["identify", "LOG", "--out", "LOG"], "--out"),
        (["simulate", "no.json", "LOG", "--out", "OUT"], "no.json"),
        (["simulate", "LOG", "LOG", "--out", "OUT"], "no JSON"),
        (["simulate", "LOG", "LOG", "--out", "OUT", "--window", "-1"], "--window"),
        (["sweep", "no.toml", "--out", "OUT"], "no.toml"),
        (["sweep", "VEHICLE", "--out", "OUT"], "[sweep]"),
        (["sweep", "SWEEP", "--out", "OUT"], "sweep.toml: [sweep] runs 2 log: there is no such"),
    ],
)
def test_what_is_wrong_is_told_in_one_line(vdmsi, tmp_path, arguments, told):
    names = {
        "LOG": DEMO / "bend.csv",
        "OUT": tmp_path / "out",
        "VEHICLE": DEMO / "vehicle.toml",
        "SWEEP": tmp_path / "sweep.toml",
    }
    runs = f'[sweep]\nruns = [{{ log = "{DEMO / "bend.csv"}" }}, {{ log = "nolog.csv" }}]\n'
    names["SWEEP"].write_text(runs)
    said = refused(vdmsi(*(names.get(a, a) for a in arguments)))
    assert told in said and len(said) < 400


def test_an_unknown_key_is_answered_with_the_nearest_right_one(vdmsi, tmp_path):
    (tmp_path / "vehicle.toml").write_text("[vehicle]\nl_f = 1.0\nl_rr = 1.0\n")
    config = ["--config", tmp_path / "vehicle.toml"]
    done = vdmsi("identify", DEMO / "bend.csv", *config, "--out", tmp_path)
    assert "did you mean 'l_r'" in refused(done)


def test_a_constant_command_is_refused(vdmsi, tmp_path):
    t = np.arange(500) * 0.01
    rows = "\n".join(f"{time:.2f},1,{v:.3f}" for time, v in zip(t, np.sin(t), strict=True))
    (tmp_path / "log.csv").write_text(f"t,v_cmd,v\n{rows}\n")
    assert "v_cmd" in refused(vdmsi("identify", tmp_path / "log.csv", "--out", tmp_path))


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
    monkeypatch.setattr(cli, "_prepare_jax", lambda cache: None)
    for config in (None, other):
        with contextlib.suppress(InputError):
            cli.identify((log, log, log), config=config, out=tmp_path / "out", report=False)
    assert asked[0] is None  # which `identify` takes as runs, of three and more
    assert asked[1].split == "blocks"


@pytest.fixture(scope="module")
def identified(tmp_path_factory, cache, settings):
    """Identify both step logs together, in a process that may not import matplotlib."""
    out = tmp_path_factory.mktemp("identified")
    logs = [str(DEMO / "powertrain_steps.csv"), str(DEMO / "steering_steps.csv")]
    arguments = ["identify", *logs, "--config", str(settings), "--out", str(out), "--no-report"]
    program = f"""
import sys
sys.modules["matplotlib"] = None
from vdmsi_jax.cli import main
main({arguments!r})
"""
    environment = os.environ | {"XDG_CACHE_HOME": str(cache), "COLUMNS": "200"}
    environment.pop("JAX_COMPILATION_CACHE_DIR", None)
    done = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, env=environment
    )
    assert done.returncode == 0, done.stderr
    assert done.stderr == ""
    assert os.listdir(out) == ["identify.json"]
    return out, done.stdout


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


EXTENDED = {
    "schema": "vdmsi.model/1",
    "vehicle": {"l_f": 1.75, "l_r": 1.20},
    "plants": {
        "powertrain": {
            "input": "v_cmd",
            "output": "v",
            "num": [2.21, 143.9],
            "den": [1.0, 18.15, 143.2],
        },
        "steering": {
            "input": "delta_cmd",
            "output": "delta",
            "num": [15.5],
            "den": [1.0, 16.667],
            "effects": [
                {"cause": "transport_delay", "parameters": {"delay": 0.045}},
                {"cause": "backlash", "parameters": {"gap": 0.001}},
            ],
        },
    },
    "body": [{"cause": "understeer", "parameters": {"gradient": 0.0002}}],
    "sensors": [{"channel": "v", "cause": "sensor_bias", "parameters": {"bias": 0.3}}],
}


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


def test_a_model_with_a_wrong_effect_is_refused(vdmsi, tmp_path):
    wrong = json.loads(json.dumps(EXTENDED))
    wrong["plants"]["steering"]["effects"][1]["parameters"] = {"gapp": 0.02}
    (tmp_path / "model.json").write_text(json.dumps(wrong))
    done = vdmsi("simulate", tmp_path / "model.json", DEMO / "bend.csv", "--out", tmp_path / "out")
    told = refused(done)
    assert "model.json" in told and "steering effects 2 parameters gapp" in told
    assert "did you mean 'gap'" in told


def test_a_sweep_goes_on_where_it_was_stopped(here, tmp_path, settings):
    config = tmp_path / "sweep.toml"
    runs = [
        (DEMO / "powertrain_steps.csv", "powertrain"),
        (DEMO / "steering_steps.csv", "steering"),
    ]
    config.write_text(
        "[identify]\npoles = [1, 2]\nzeros = [0, 1, 2]\n[sweep]\nruns = [\n"
        + "".join(
            f'{{ log = "{log}", config = "{settings}", plants = ["{plant}"] }},\n'
            for log, plant in runs
        )
        + "]\n"
    )
    done = here("sweep", config, "--out", tmp_path / "out")
    assert (done.returncode, done.stderr) == (0, "")
    cells = sorted((tmp_path / "out" / "cells").iterdir())
    assert len(cells) == 2
    report = (tmp_path / "out" / "report.html").read_text()
    assert report.count("<svg ") == 1 and "P1Z2" in report and "steering_steps.csv" in report
    finished = {cell: cell.stat().st_mtime_ns for cell in cells}
    summary = (tmp_path / "out" / "sweep.json").read_text()

    cells[0].unlink()  # as if the sweep had been stopped before it
    cells[1].write_text(cells[1].read_text())
    kept = cells[1].stat().st_mtime_ns
    done = here("sweep", config, "--out", tmp_path / "out")
    assert done.returncode == 0
    assert cells[0].stat().st_mtime_ns != finished[cells[0]]
    assert cells[1].stat().st_mtime_ns == kept, "a finished cell was made again"
    assert (tmp_path / "out" / "sweep.json").read_text() == summary

    config.write_text(config.read_text().replace("[identify]", "[identify]\nfit_loss = 30.0"))
    assert here("sweep", config, "--out", tmp_path / "out").returncode == 0
    assert json.loads(cells[0].read_text())["chosen"] == "P1Z0", "a changed cell was kept"


def test_cells_of_a_sweep_have_files_of_their_own(here, tmp_path):
    """Whatever plants are called, and where logs of one name lie in folders of one name."""
    logs = []
    for folder in ("a/day", "b/day"):
        (tmp_path / folder).mkdir(parents=True)
        logs.append(write_csv(tmp_path / folder / "run.csv", drive()))
        logs[-1].write_text(logs[-1].read_text() + f"2.0,1.0,0.1,{1.0 + len(logs) / 10},0.1\n")
    plants = ["left/right", "n" * 300]
    named = "".join(
        f'[[plants]]\nname = "{name}"\ninput = "v_cmd"\noutput = "v"\n' for name in plants
    )
    (tmp_path / "plants.toml").write_text(named)
    runs = "".join(f'{{ log = "{log}", config = "plants.toml" }},' for log in logs)
    (tmp_path / "sweep.toml").write_text(
        f"[identify]\npoles = [1]\nzeros = [0]\n[sweep]\nruns = [{runs}]\n"
    )
    done = here("sweep", tmp_path / "sweep.toml", "--out", tmp_path / "out", "--no-report")
    assert done.returncode == 0, done.stderr
    cells = sorted((tmp_path / "out" / "cells").iterdir())
    assert len(cells) == 4
    assert {json.loads(cell.read_text())["plant"] for cell in cells} == set(plants)
    for cell in cells:  # what someone else has put there
        cell.write_text(json.dumps([1] if cell == cells[0] else {"key": "none"}))
    done = here("sweep", tmp_path / "sweep.toml", "--out", tmp_path / "out", "--no-report")
    assert done.returncode == 0, done.stderr


def test_a_refused_log_does_not_stop_a_sweep(here, tmp_path, settings):
    (tmp_path / "bad.csv").write_text("t,v_cmd,v\n0,1,oops\n")
    config = tmp_path / "sweep.toml"
    good = DEMO / "steering_steps.csv"
    config.write_text(
        "[identify]\npoles = [1, 2]\nzeros = [0, 1, 2]\n[sweep]\nruns = [\n"
        f'{{ log = "bad.csv", config = "{settings}", plants = ["powertrain"] }},\n'
        f'{{ log = "{good}", config = "{settings}", plants = ["steering"] }}]\n'
    )
    done = here("sweep", config, "--out", tmp_path / "out")
    assert done.returncode == 2
    assert done.stderr.count("\n") == 1 and "bad.csv" in done.stderr
    rows = json.loads((tmp_path / "out" / "sweep.json").read_text())["cells"]
    assert "refused" in rows[0] and rows[1]["fit"] > 80.0


def test_a_configuration_beside_the_log_says_which_orders(here, tmp_path, settings):
    (tmp_path / "log.csv").write_bytes((DEMO / "steering_steps.csv").read_bytes())
    vehicle = settings.read_text().split("[identify]")[0]
    (tmp_path / "vehicle.toml").write_text(vehicle + "[identify]\npoles = [1]\nzeros = [0]\n")
    (tmp_path / "sweep.toml").write_text('[sweep]\nruns = [{ log = "log.csv" }]\n')
    done = here("identify", tmp_path / "log.csv", "--out", tmp_path / "out", "--no-report")
    assert done.returncode == 0, done.stderr
    found = json.loads((tmp_path / "out" / "identify.json").read_text())
    assert list(found["plants"]["steering"]["orders"]) == ["P1Z0"]
    done = here("sweep", tmp_path / "sweep.toml", "--out", tmp_path / "swept", "--no-report")
    (cell,) = (tmp_path / "swept" / "cells").glob("*steering.json")
    assert list(json.loads(cell.read_text())["orders"]) == ["P1Z0"]


def test_main_leaves_with_code_two_in_process_too(tmp_path, capsys):
    with pytest.raises(SystemExit) as leaving:
        main(["identify", str(tmp_path / "no.csv"), "--out", str(tmp_path)])
    assert leaving.value.code == 2
    assert "no.csv" in capsys.readouterr().err


@pytest.mark.parametrize("own", ["", "--xla_cpu_use_fusion_emitters=true"])
def test_programs_are_compiled_the_quick_way_unless_a_user_says_how(own):
    program = """
import os
import jax.numpy as jnp
from vdmsi_jax.cli import _prepare_jax
_prepare_jax(cache=False)
print(os.environ["XLA_FLAGS"], jnp.ones(3).sum())
"""
    environment = os.environ | {"XLA_FLAGS": own}
    ended = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, env=environment
    )
    assert ended.stdout.strip() == f"{own or '--xla_cpu_use_fusion_emitters=false'} 3.0"


@pytest.mark.parametrize(
    ("log", "said"), [(".", "no file"), ("", "no file"), ("a" * 300 + ".csv", "too long")]
)
def test_what_cannot_be_a_file_is_refused_in_one_line(here, tmp_path, log, said):
    assert said in refused(here("identify", log, "--out", tmp_path, "--no-report"))


def test_the_package_is_a_program_too():
    asked = [sys.executable, "-m", "vdmsi_jax", "--version"]
    assert subprocess.run(asked, capture_output=True, text=True).stdout.startswith("vdmsi ")


def test_numbers_of_absurd_size_in_a_model_are_refused(here, tmp_path):
    absurd = json.loads(json.dumps(EXTENDED))
    absurd["plants"]["steering"]["num"] = [10**400]
    (tmp_path / "model.json").write_text(json.dumps(absurd))
    log = write_csv(tmp_path / "log.csv", drive())
    told = refused(here("simulate", tmp_path / "model.json", log, "--out", tmp_path))
    assert "steering num 1: a number of absurd size" in told


def test_json_that_is_too_deep_is_refused(here, tmp_path):
    (tmp_path / "model.json").write_text("[" * 100_000)
    log = write_csv(tmp_path / "log.csv", drive())
    told = refused(here("simulate", tmp_path / "model.json", log, "--out", tmp_path))
    assert "model.json: cannot be read" in told


def test_a_folder_where_a_result_should_be_is_told(here, tmp_path, settings):
    log = write_csv(tmp_path / "log.csv", drive())
    (tmp_path / "identify.json").mkdir()
    told = refused(here("identify", log, "--config", settings, "--out", tmp_path, "--no-report"))
    assert "identify.json: is a directory" in told
    assert not list(tmp_path.glob(".identify*"))
