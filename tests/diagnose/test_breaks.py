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
