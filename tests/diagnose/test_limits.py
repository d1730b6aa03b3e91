"""Limits of single plants, in logs made by plain NumPy at a millisecond."""

import numpy as np
import pytest

import vdmsi_jax as vj
from driven_servo import DT, ROWS, driven


def valve(seed: int, rate: float, rows: int = 800, dt: float = 0.05):
    """Three logs of a hydraulic position loop whose pump bounds the flow that is asked for; the
    flow follows in 30 ms."""
    rng, made = np.random.default_rng(seed), []
    for run in range(3):
        steps = np.repeat(rng.uniform(-0.35, 0.35, 200), rng.integers(10, 50, 200))[:rows]
        at, flow, y = steps[0], 0.0, []
        for k, command in enumerate(np.repeat(steps, round(dt / 0.001))):
            if k % round(dt / 0.001) == 0:
                y.append(at)
            flow += 0.001 / 0.03 * (np.clip(5.0 * (command - at), -rate, rate) - flow)
            at += 0.001 * flow
        y = np.asarray(y) + 0.002 * rng.standard_normal(rows)
        plant = vj.PlantSpec("valve", "u", "y")
        made.append(vj.Record.from_arrays(dt=dt, name=f"{run}", plants=(plant,), u=steps, y=y))
    return made


@pytest.mark.slow
def test_what_lags_behind_a_limit_is_no_delay():
    """A limit of the response itself leaves the lag behind it, which a delay then tells."""
    found = vj.diagnose(valve(1, 0.22))
    assert [f.cause for f in found.findings] == ["rate_limit"]
    assert found.findings[0].form == "of the drive in a position loop"
    for side in ("rising", "falling"):
        assert found.findings[0].parameters[side].value == pytest.approx(0.22, rel=0.01)


@pytest.mark.slow
def test_a_command_is_ramped_slower_upward_than_downward():
    found = vj.diagnose(driven(4, ramps=(0.8, 2.5), noise=0.02))
    assert [f.cause for f in found.findings] == ["rate_limit"]
    told = found.findings[0].parameters
    assert told["rising"].value == pytest.approx(0.8, rel=0.03)
    assert told["falling"].value == pytest.approx(2.5, rel=0.05)


def test_a_limit_that_is_never_reached_is_not_told():
    rng = np.random.default_rng(5)
    plant, made = vj.PlantSpec("servo", "u", "y"), []
    for run in range(3):
        u, level, y = np.repeat(rng.uniform(0.0, 1.0, ROWS // 30), 30), 0.0, []
        for command in u:
            y.append(level)
            level += DT / 0.3 * (min(command, 0.6) - level)
        y = np.asarray(y) + 0.01 * rng.standard_normal(ROWS)
        made.append(vj.Record.from_arrays(dt=DT, name=f"run_{run}", plants=(plant,), u=u, y=y))
    (finding,) = vj.diagnose(made).findings
    assert finding.cause == "saturation" and set(finding.parameters) == {"upper"}
    assert finding.parameters["upper"].value == pytest.approx(0.6, rel=0.02)


def test_a_limit_between_two_lags_is_no_bend():
    """A pump's flow cannot pass 2.4, which a rotor drives and a meter tells: both follow late."""
    h, plant, made = 0.001, vj.PlantSpec("pump", "u", "y"), []
    for run in range(2):
        rng = np.random.default_rng(run)
        u, rotor, meter, y = np.repeat(rng.uniform(0.3, 4.0, 40), 75), 1.0, 1.0, []
        for command in u:
            y.append(meter)
            for _ in range(20):
                rotor += h / 0.35 * (command - rotor)
                meter += h / 0.12 * (rotor / (1.0 + (rotor / 2.4) ** 8) ** 0.125 - meter)
        y = np.asarray(y) + 0.01 * rng.standard_normal(u.size)
        made.append(vj.Record.from_arrays(dt=0.02, name=f"{run}", plants=(plant,), u=u, y=y))
    (finding,) = vj.diagnose(made).findings
    assert finding.cause == "saturation" and finding.form == "of what follows the command late"
    assert finding.parameters["upper"].value == pytest.approx(2.4, rel=0.03)
    assert finding.parameters["before"].value == pytest.approx(0.35, rel=0.1)
