"""The demo logs are what their script makes, and what the paper's figures imply."""

import runpy
import tokenize
from pathlib import Path

import numpy as np
import pytest

DEMO = Path(__file__).resolve().parents[1] / "configs" / "demo"
LOGS = ["powertrain_steps", "steering_steps", "bend", "s_curve"]


def columns(name):
    return np.genfromtxt(DEMO / f"{name}.csv", delimiter=",", names=True)


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    folder = tmp_path_factory.mktemp("demo")
    runpy.run_path(str(DEMO / "make_logs.py"))["main"](folder)
    return folder


@pytest.mark.parametrize("name", LOGS)
def test_script_makes_the_committed_logs(made, name):
    committed = DEMO / f"{name}.csv"
    assert committed.stat().st_size < 300_000
    again = np.genfromtxt(made / committed.name, delimiter=",", names=True)
    log = columns(name)
    assert log.dtype.names == ("t", "v_cmd", "delta_cmd", "v", "delta", "r", "x", "y", "psi")
    for channel in log.dtype.names:  # to the last digit written, which a platform may round apart
        np.testing.assert_allclose(again[channel], log[channel], atol=1.1e-3)


def test_script_shares_no_code_with_the_toolkit():
    with tokenize.open(DEMO / "make_logs.py") as source:
        imports = [line for line in source if line.startswith(("import ", "from "))]
    assert sorted(imports) == ["from pathlib import Path\n", "import numpy as np\n", "import sys\n"]


def test_noise_is_that_of_the_paper():
    log = columns("powertrain_steps")
    assert set(log["v_cmd"]) == {0.0, 1.0} and not log["delta_cmd"].any()
    np.testing.assert_allclose(np.std(log["v"]), 0.483, atol=0.02)
    rest = log["v"][:100]  # standing, before the first step
    np.testing.assert_allclose(np.std(rest), 0.054, rtol=0.25)
    assert set(columns("steering_steps")["delta_cmd"]) == {0.0, 0.52, -0.52}


def test_drives_follow_their_tracks():
    end = columns("bend")[-100:]
    np.testing.assert_allclose(end["x"].mean(), 40.0, atol=0.2)  # 20 m, then a radius of 20 m
    np.testing.assert_allclose(end["psi"].mean(), np.pi / 2, atol=0.02)
    end = columns("s_curve")[-100:]
    np.testing.assert_allclose(end["y"].mean(), 30.0, atol=0.3)  # two radii of 15 m
    np.testing.assert_allclose(end["psi"].mean(), 0.0, atol=0.02)
