"""How runs of single plants begin, in logs made by plain NumPy."""

from dataclasses import replace

import numpy as np
import pytest

import vdmsi_jax as vj
from driven_servo import DT, FINE, ROWS, driven
from vdmsi_jax.data.segment import Segment
from vdmsi_jax.diagnose.actuator.free_response import free_response, on_its_way


@pytest.mark.slow
def test_what_swings_begins_each_run_where_it_likes():
    found = vj.diagnose(driven(1, swing=0.08))
    assert [f.cause for f in found.findings] == ["periodic_disturbance"]
    assert "a phase of its own" in found.findings[0].sentence
    told = found.findings[0].parameters
    assert told["frequency"].value == pytest.approx(1.3, abs=0.002)
    assert told["amplitude"].value == pytest.approx(0.08, rel=0.03)
    assert abs(told["amplitude"].value - 0.08) < 4.0 * told["amplitude"].std
    assert found.extended["y"].fit > 97.0 > 90.0 > found.channels["y"].fit


@pytest.mark.slow
def test_a_delay_is_told_where_a_command_was_on_its_way_when_the_log_began():
    found = vj.diagnose(driven(8, delay=0.4, awake=True))
    assert [f.cause for f in found.findings] == ["transport_delay"]
    assert found.findings[0].parameters["delay"].value == pytest.approx(0.4, abs=0.005)
    assert found.extended["y"].fit > 97.0


@pytest.mark.slow
def test_a_mast_that_rings_when_a_log_begins_is_a_resonance():
    plant, w, damping = vj.PlantSpec("mast", "u", "y"), 2.0 * np.pi * 1.4, 0.03
    made, h, keep = [], 0.001, 400
    for run, record in enumerate(driven(9, noise=0.0)):
        base = np.interp(h * np.arange(ROWS * FINE), DT * np.arange(ROWS), record["y"])
        away = speed = 0.0
        y, pushed = [], np.gradient(np.gradient(base, h), h)
        pushed = np.convolve(pushed, np.ones(FINE) / FINE, "same")
        for k in range(ROWS * FINE):
            if k % FINE == 0:
                y.append(base[k] + away)
            speed += h * (-0.5 * pushed[k] - 2.0 * damping * w * speed - w * w * away)
            away += h * speed
        y = np.asarray(y) + 0.004 * np.random.default_rng(run).standard_normal(ROWS)
        u = record["u"]
        own = vj.Record.from_arrays(
            dt=DT, name=f"run_{run}", plants=(plant,), u=u[keep:], y=y[keep:]
        )
        made.append(own)
    found = vj.diagnose(made)
    assert [f.cause for f in found.findings] == ["resonance"]
    told = found.findings[0].parameters
    assert told["frequency"].value == pytest.approx(1.4, abs=0.02)
    assert told["damping"].value == pytest.approx(0.03, abs=0.01)


def test_a_pole_that_is_too_fast_to_see_changes_no_free_response():
    slow = free_response(np.poly([-2.0, -1.5 + 3.0j, -1.5 - 3.0j]), 0.01, 600)
    fast = free_response(np.poly([-2.0, -1.5 + 3.0j, -1.5 - 3.0j, -4000.0]), 0.01, 600)
    assert np.allclose(np.abs(fast).max(axis=0), 1.0) and fast.shape == (600, 4)
    for column in slow.T:  # each can still be told, by numbers of the size of what it adds
        shares = np.linalg.lstsq(fast[1:], column[1:], rcond=None)[0]
        assert np.allclose(fast[1:] @ shares, column[1:], atol=1e-6)
        assert np.abs(shares).max() < 5.0


def test_what_is_on_its_way_is_answered_until_it_has_passed():
    den, num = np.real(np.poly([-2.0, -1.5 + 3.0j, -1.5 - 3.0j])), np.array([0.5, 2.0])
    delay, dt, rows = 0.237, 0.02, 300
    fine = 20_000 * dt
    x, y = np.zeros(3), []
    for k in range(round(rows * fine)):
        if k % fine == 0:
            y.append(num[0] * x[1] + num[1] * x[0])
        u = 1.0 if k < delay / dt * fine else 0.0
        x = x + dt / fine * np.array([x[1], x[2], u - den[:0:-1] @ x])
    y = np.array(y) / np.abs(y).max()
    assert np.allclose(on_its_way(den, num, delay, dt, rows), y, atol=5e-3)


@pytest.mark.slow
def test_logs_that_begin_in_motion_do_not_cost_a_plant_its_poles():
    whole = driven(7)
    cut = [record.select([Segment(400, record.n, record.name)]) for record in whole]
    found = vj.diagnose(cut)
    assert found.verdict == "no_effect" and not found.findings
    assert found.orders["servo"] in ("P3Z0", "P3Z1", "P4Z0", "P4Z1")
    assert found.channels["y"].fit > 97.0


def test_a_run_whose_first_samples_are_missing_began_where_they_end():
    """A lag of half a second that does not begin at rest; a fifth of a second is not measured."""
    rng, made, lost = np.random.default_rng(1), [], np.arange(2000) < 10
    for run in range(3):
        u = np.repeat(rng.uniform(0.0, 4.0, 40), 50)
        x, y = u[0] + 3.0, []
        for command in u:
            y.append(x)
            x = command + (x - command) * np.exp(-DT / 0.5)
        w = np.where(lost, 0.0, y) + 0.05 * rng.standard_normal(2000)
        plant = vj.PlantSpec("motor", "u", "w")
        record = vj.Record.from_arrays(dt=DT, name=f"{run}", plants=(plant,), u=u, w=w)
        made.append(replace(record, filled={"w": lost}))
    found = vj.diagnose(made)
    assert found.verdict == "no_effect" and not found.findings
    assert found.channels["w"].fit > 93.0
