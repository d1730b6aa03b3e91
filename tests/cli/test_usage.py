"""The command line as a user meets it: help, exit codes, and refusals in one line."""

import json
import os
import subprocess
import sys
from pathlib import Path

import jaxlib
import numpy as np
import pytest

from commands import DEMO, EXTENDED, refused
from small_logs import drive, write_csv
from vdmsi_jax.cli import main


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
        (["identify", "LOG", "--out", ""], "identify: --out: an empty word"),
        (["identify", "LOG", "--config="], "identify: --config: an empty word"),
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


def test_a_model_with_a_wrong_effect_is_refused(vdmsi, tmp_path):
    wrong = json.loads(json.dumps(EXTENDED))
    wrong["plants"]["steering"]["effects"][1]["parameters"] = {"gapp": 0.02}
    (tmp_path / "model.json").write_text(json.dumps(wrong))
    done = vdmsi("simulate", tmp_path / "model.json", DEMO / "bend.csv", "--out", tmp_path / "out")
    told = refused(done)
    assert "model.json" in told and "steering effects 2 parameters gapp" in told
    assert "did you mean 'gap'" in told


def test_main_leaves_with_code_two_in_process_too(tmp_path, capsys):
    with pytest.raises(SystemExit) as leaving:
        main(["identify", str(tmp_path / "no.csv"), "--out", str(tmp_path)])
    assert leaving.value.code == 2
    assert "no.csv" in capsys.readouterr().err


PREPARED = """
import os
import jax
import jax.numpy as jnp
from vdmsi_jax.process import prepare
prepare(cache=False)
print(jax.config.jax_platforms, os.environ.get("XLA_FLAGS", ""), flush=True)
print(jnp.ones(3).sum())
"""


def prepared(**environment: str) -> list[str]:
    """The platforms asked for with what XLA was told, and a sum: of a process of its own."""
    ended = subprocess.run(
        [sys.executable, "-c", PREPARED],
        capture_output=True,
        text=True,
        env=os.environ | {"JAX_PLATFORMS": ""} | environment,
    )
    return ended.stdout.splitlines()


@pytest.mark.parametrize("own", ["", "--xla_cpu_use_fusion_emitters=true"])
def test_programs_are_compiled_the_quick_way_unless_a_user_says_how(own):
    known = jaxlib.version.__version_info__ < (0, 12)
    if own and not known:
        pytest.skip("this XLA has one way only")
    told = own or "--xla_cpu_use_fusion_emitters=false" * known
    assert prepared(XLA_FLAGS=own) == [f"cpu {told}", "3.0"]


def test_xla_is_told_nothing_where_jax_has_a_plugin_that_may_not_know_it(tmp_path):
    (tmp_path / "jax_plugins" / "some_accelerator").mkdir(parents=True)
    assert prepared(XLA_FLAGS="", PYTHONPATH=str(tmp_path)) == ["cpu ", "3.0"]


def test_a_command_runs_on_the_platform_that_a_user_names():
    assert prepared(JAX_PLATFORMS="elsewhere")[0].startswith("elsewhere ")


@pytest.mark.parametrize(
    ("log", "said"),
    [(".", "no file"), ("", "an empty word"), ("a" * 300 + ".csv", "too long")],
)
def test_what_cannot_be_a_file_is_refused_in_one_line(here, tmp_path, log, said):
    assert said in refused(here("identify", log, "--out", tmp_path, "--no-report"))


@pytest.mark.parametrize("said", [["--window", "abc"], ["--window=abc"], ["--window"]])
def test_what_should_be_a_number_is_refused_in_one_line(here, said):
    told = refused(here("simulate", "model.json", "log.csv", "--out", "o", *said))
    assert told.startswith("vdmsi: simulate: --window: ")
    assert "is no number" in told


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="no /dev/full on this system")
def test_a_version_that_cannot_be_written_is_refused_in_one_line():
    with open("/dev/full", "w") as full:
        asked = [sys.executable, "-m", "vdmsi_jax", "--version"]
        ended = subprocess.run(asked, stdout=full, stderr=subprocess.PIPE, text=True)
    assert ended.returncode == 2
    assert ended.stderr.count("\n") == 1


def test_the_package_is_a_program_too():
    asked = [sys.executable, "-m", "vdmsi_jax", "--version"]
    assert subprocess.run(asked, capture_output=True, text=True).stdout.startswith("vdmsi ")


@pytest.mark.parametrize(
    ("leaving", "code"),
    [("pass", 0), ("sys.exit()", 0), ("sys.exit(130)", 130), ("sys.exit('no')", 1)],
)
def test_the_program_leaves_with_what_was_said_and_the_code_of_its_command(leaving, code):
    asked = f"""
import sys
from vdmsi_jax import cli
def main():
    sys.stdout.write("said")
    {leaving}
cli.main = main
cli.program()
"""
    ended = subprocess.run([sys.executable, "-c", asked], stdout=subprocess.PIPE, text=True)
    assert (ended.returncode, ended.stdout) == (code, "said")


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


@pytest.mark.skipif(sys.platform == "win32", reason="its pipes break otherwise")
@pytest.mark.parametrize("report", [True, False])
def test_a_reader_that_goes_away_breaks_nothing(report, settings, tmp_path):
    """`vdmsi ... | head -0`: no traceback, and what was asked for is written."""
    logs = [DEMO / "powertrain_steps.csv", "--config", settings, "--out", tmp_path]
    asked = ["identify", *logs] if report else ["--help"]
    code = f"from vdmsi_jax.cli import main; main({[str(a) for a in asked]!r})"
    usual = {name: value for name, value in os.environ.items() if name != "PYTHONUNBUFFERED"}
    with subprocess.Popen(
        [sys.executable, "-c", code],
        env=usual,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    ) as process:
        assert process.stdout is not None and process.stderr is not None
        process.stdout.close()
        told = process.stderr.read()
    assert "Traceback" not in told and "BrokenPipe" not in told
    assert (tmp_path / "report.html").is_file() is report
