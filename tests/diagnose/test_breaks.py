"""What breaks in single plants, in logs made by plain NumPy."""

import numpy as np
import pytest

import vdmsi_jax as vj
from driven_servo import DT, FINE, driven


@pytest.mark.slow
@pytest.mark.parametrize("when", [41.7, 71.7])
def test_what_breaks_in_one_log_stays_broken_in_the_next(when):
    diagnosis = vj.diagnose(driven(11, fails=when))
    (finding,) = diagnosis.findings
    assert finding.cause == "regime_change" and finding.form == "over the session"
    assert finding.parameters["time"].value == pytest.approx(when, abs=0.1)
    assert finding.parameters["gain"].value == pytest.approx(-1.0 / 7.0, abs=0.01)
    assert diagnosis.verdict == "explained"


@pytest.mark.slow
def test_what_breaks_in_a_part_that_judges_is_found_with_other_parts_held_out():
    """Of the one log the parts from 15 to 18 s judge, too, unless something happens there."""
    (finding,) = vj.diagnose(driven(11, fails=16.5)[:1]).findings
    assert finding.cause == "regime_change"
    assert finding.parameters["time"].value == pytest.approx(16.5, abs=0.1)
    assert finding.parameters["gain"].value == pytest.approx(-1.0 / 7.0, abs=0.02)


@pytest.mark.slow
def test_what_fails_in_a_slow_plant_that_does_not_begin_at_rest_is_found():
    """The start says nothing of the gain: taken for a part of the response to the command, it led
    the first fits to a plant that hardly moved."""
    rng = np.random.default_rng(3)
    u, y, hot = np.repeat(rng.uniform(0.2, 1.0, 12), 100), [], 40.0
    for k, power in enumerate(np.repeat(u, 50)):
        if k % 50 == 0:
            y.append(hot)
        hot += 0.001 / 3.2 * ((1.0 if 0.001 * k < 26.0 else 0.76) * 60.0 * power - hot)
    y = np.asarray(y) + 0.15 * rng.standard_normal(len(u))
    plant = vj.PlantSpec("heater", "u", "y")
    log = vj.Record.from_arrays(dt=0.05, name="run", plants=(plant,), u=u, y=y)
    (finding,) = vj.diagnose(log).findings
    assert finding.cause == "regime_change"
    assert finding.parameters["time"].value == pytest.approx(26.0, abs=0.5)
    assert finding.parameters["gain"].value == pytest.approx(-0.24, abs=0.02)


@pytest.mark.slow
def test_a_gain_that_sinks_for_seconds_is_a_change_as_well():
    """A jump errs by so much about the moment that hills were found in its place, and then nothing:
    the speed that is a third too low from there on was taken for wind."""
    rng, logs = np.random.default_rng(8), []
    for name in ("a", "b", "c"):
        u = np.repeat(np.repeat(rng.uniform(10.0, 26.0, 12), 4), 100)
        u = np.convolve(u, np.ones(50) / 50, "same")
        v = smooth = u[0]
        y = np.empty(len(u))
        for k, command in enumerate(u):
            y[k] = v
            for step in range(20):
                t = 0.02 * k + 0.001 * step
                gain = 1.0 - 0.38 * min(max((t - 50.0) / 2.6, 0.0), 1.0)
                smooth += 0.001 / 0.3 * (gain * command - smooth)
                v += 0.001 / 1.1 * (smooth - v)
        y += 0.1 * rng.standard_normal(len(u))
        plant = vj.PlantSpec("powertrain", "v_cmd", "v")
        logs.append(vj.Record.from_arrays(dt=0.02, name=name, plants=(plant,), v_cmd=u, v=y))
    found = vj.diagnose(logs)
    assert found.verdict == "explained"
    (finding,) = found.findings
    assert finding.cause == "regime_change"
    sizes = {name: e.value for name, e in finding.parameters.items()}
    assert sizes["time"] == pytest.approx(51.3, abs=0.3)
    assert sizes["gain"] == pytest.approx(-0.38, abs=0.03)
    assert sizes["ramp"] == pytest.approx(2.6, rel=0.25)


@pytest.mark.slow
def test_what_may_be_steps_of_a_command_and_is_none_is_looked_at_by_longer_rows_again():
    """A wide play under a command of few levels, sampled at 250 Hz: to tell whether that acts in
    steps every row is looked at, and so many are cut into pieces that tell little of a slow
    plant."""
    rng, logs = np.random.default_rng(2), []
    for name in ("a", "b", "c"):
        levels = rng.choice([3.7, 5.5, 7.2, 9.1, 10.7, 12.5], 8)
        u = np.repeat(levels, rng.integers(1000, 2000, 8))
        lags = np.full(3, u[0])
        v, y = float(u[0]), np.empty(len(u))
        for k, command in enumerate(u):
            y[k] = v
            for _ in range(4):
                lags += 0.001 / 0.58 * (np.array([command, *lags[:2]]) - lags)
                v = min(max(v, lags[2] - 1.15), lags[2] + 1.15)
        y += 0.03 * rng.standard_normal(len(u))
        channels = {"v_cmd": u, "v": y}
        geometry = vj.VehicleGeometry(2.0, 2.0)
        logs.append(vj.Record.from_arrays(dt=0.004, name=name, vehicle=geometry, **channels))
    (finding,) = vj.diagnose(logs).findings
    assert (finding.cause, finding.where) == ("backlash", "powertrain")
    assert finding.parameters["gap"].value == pytest.approx(2.3, rel=0.05)


@pytest.mark.slow
def test_what_only_a_part_that_judges_shows_is_fitted_by_other_parts():
    """A single log of a loop whose rate is limited; its steps are small but in one of ten parts."""
    rng, rows = np.random.default_rng(5), 4000
    u = 0.15 * np.repeat(rng.uniform(-1.0, 1.0, rows // 40), 40)
    u[2050:2350] += np.repeat([0.0, 1.2, -1.0, 0.8, -1.2, 0.0], 50)
    x, v, y = u[0], 0.0, np.empty(rows)
    for k, command in enumerate(u):
        y[k] = x
        for _ in range(FINE):
            v += 0.001 / 0.06 * (4.0 * (command - x) - v)
            x += 0.001 * np.clip(v, -1.5, 1.5)
    y += 0.004 * rng.standard_normal(rows)
    plant = vj.PlantSpec("loop", "u", "y")
    log = vj.Record.from_arrays(dt=DT, name="run", plants=(plant,), u=u, y=y)
    found = vj.diagnose(log)
    assert [f.cause for f in found.findings] == ["rate_limit"]
    limits = [e.value for e in found.findings[0].parameters.values()]
    assert limits == pytest.approx([1.5] * len(limits), rel=0.1)
