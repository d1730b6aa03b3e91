"""Outliers of a sensor, and what only looks like one."""

from dataclasses import replace

import numpy as np
import pytest

import vdmsi_jax as vj
from vdmsi_jax.data.outliers import without_outliers

DT, ROWS = 0.02, 2000
T = DT * np.arange(ROWS)
RNG = np.random.default_rng(4)
COMMAND = np.repeat(RNG.uniform(-1.0, 1.0, ROWS // 50), 50)
SMOOTH = np.convolve(np.pad(COMMAND, (99, 0), "edge"), np.full(100, 0.01), "valid")
MOVING = SMOOTH + 0.002 * RNG.standard_normal(ROWS)
AT = np.array([150, 700, 701, 1400])
PLANT = vj.PlantSpec("servo", "u", "y")


def record(y: np.ndarray, u: np.ndarray = COMMAND, **channels) -> vj.Record:
    return vj.Record.from_arrays(dt=DT, plants=(PLANT,), u=u, y=y, **channels)


def spoilt(x: np.ndarray, by: float = 0.5) -> np.ndarray:
    y = x.copy()
    y[AT] += by
    return y


def test_samples_that_stand_alone_are_filled_in_and_no_longer_count_as_measured():
    log = record(spoilt(MOVING))
    mended, counts = without_outliers(log)
    assert counts == {"y": len(AT)}
    assert np.array_equal(np.flatnonzero(~mended.measured("y")), AT)
    np.testing.assert_allclose(mended["y"][AT], MOVING[AT], atol=0.02)
    rest = np.setdiff1d(np.arange(ROWS), AT)
    assert np.array_equal(mended["y"][rest], log["y"][rest])
    assert np.array_equal(mended["u"], log["u"])


def test_on_a_slope_a_sample_to_which_and_from_which_it_steps_is_one():
    """Off those about it by less than these are off their middle on the slopes, which are long."""
    slopes = 2.0 * np.abs((0.5 * T) % 2.0 - 1.0) + 0.01 * np.random.default_rng(2).standard_normal(
        ROWS
    )
    log = record(slopes)
    assert without_outliers(log) == (log, {})
    found, counts = without_outliers(record(spoilt(slopes, by=0.25)))
    assert counts == {"y": len(AT)}
    np.testing.assert_array_less(np.abs(found["y"] - slopes), 0.1)


def test_what_was_filled_in_before_stays_so_and_counts_for_nothing():
    known = np.zeros(ROWS, bool)
    known[AT[:1]] = known[30] = True
    mended, counts = without_outliers(replace(record(spoilt(MOVING)), filled={"y": known}))
    assert counts == {"y": len(AT) - 1}
    assert not mended.measured("y")[[30, *AT]].any()


LADDER = np.repeat(RNG.integers(-3, 4, ROWS // 40), 40).astype(float)


@pytest.mark.parametrize(
    "y",
    [
        MOVING,
        LADDER,
        0.2 * np.round((SMOOTH + 0.02 * RNG.standard_normal(ROWS)) / 0.2),
        np.abs(np.sin(0.7 * T)) + 1e-4 * RNG.standard_normal(ROWS),
        np.cumsum(4.0 * np.cos(0.25 * T + 0.3 * np.sin(0.3 * T))) * DT,
        np.where(np.arange(ROWS) % 9 < 2, 1.0, 0.0),
        RNG.standard_t(4.0, ROWS),
        np.where((T > 10.0) & (T < 10.2), 3.0, MOVING),
        np.zeros(ROWS),
    ],
    ids=[
        *("noise", "steps", "coarse steps of a counter", "corners", "a path that turns"),
        *("pulses all the time", "heavy tails", "a drop-out of ten samples", "nothing"),
    ],
)
def test_other_things_are_none(y):
    log = record(y)
    assert without_outliers(log) == (log, {})


def test_what_answers_a_pulse_of_the_command_is_none():
    u = spoilt(COMMAND, 2.0)
    y = MOVING.copy()
    y[AT + 1] += 0.8
    log = record(y, u)
    assert without_outliers(log) == (log, {})


@pytest.mark.parametrize("noise", [0.0, 1e-4])
def test_sharp_turns_of_a_quick_response_are_none(noise):
    """A lag of some samples behind a ramp that jumps: its apex is off the middle of what is about
    it, and on the straight way that leads there."""
    u = 0.25 * np.sin(0.8 * T) + np.where(T % 8.0 < 4.0, 0.1, -0.1)
    y, now = np.empty(ROWS), u[0]
    for k, command in enumerate(u):
        y[k] = now
        now += (1.0 - np.exp(-DT / 0.15)) * (command - now)
    y += noise * np.random.default_rng(1).standard_normal(ROWS)
    log = record(y, u)
    assert without_outliers(log) == (log, {})
    assert without_outliers(record(spoilt(y), u))[1] == {"y": len(AT)}


def test_a_heading_that_wraps_jumps_nowhere():
    psi = np.angle(np.exp(1j * (1.7 * T + 0.001 * RNG.standard_normal(ROWS))))
    mended, counts = without_outliers(record(MOVING, psi=spoilt(psi)))
    assert counts == {"psi": len(AT)}
    turned = np.exp(1j * (mended["psi"] - psi))
    np.testing.assert_allclose(turned, 1.0, atol=0.01)


def test_a_run_may_begin_and_end_in_the_middle_of_anything():
    y = MOVING.copy()
    y[:4], y[-2:] = 3.0, -3.0
    log = record(y)
    assert without_outliers(log) == (log, {})
    # and swing in from there
    log = record(MOVING + 3.0 * np.exp(-T / (1.5 * DT)))
    assert without_outliers(log) == (log, {})


@pytest.mark.parametrize("many", [1, 3])
def test_what_a_log_says_before_it_begins_is_none_of_it(many):
    y = MOVING.copy()
    y[:many] = 3.0
    mended, counts = without_outliers(record(y))
    assert counts == {"y": many}
    assert np.all(mended["y"][:many] == MOVING[many])
    assert np.array_equal(np.flatnonzero(~mended.measured("y")), np.arange(many))


def test_short_logs_have_none():
    log = vj.Record.from_arrays(dt=DT, y=np.array([0.0, 0.0, 5.0, 0.0, 0.0]))
    assert without_outliers(log) == (log, {})


def test_a_diagnosis_leaves_them_out_and_says_so():
    """Of a plain lag with an outlier in a hundred samples nothing is left unexplained."""
    logs = []
    for run in range(3):
        rng = np.random.default_rng(run)
        u = np.repeat(rng.uniform(-1.0, 1.0, ROWS // 50), 50)
        y, now = np.empty(ROWS), u[0]
        for k, command in enumerate(u):
            y[k] = now
            now += (1.0 - np.exp(-DT / 0.3)) * (command - now)
        y += 0.01 * rng.standard_normal(ROWS)
        y[rng.choice(ROWS, ROWS // 100, replace=False)] += 1.5
        logs.append(replace(record(y, u), name=f"run_{run}"))
    found = vj.diagnose(logs)
    assert found.verdict == "no_effect" and not found.unexplained
    assert found.channels["y"].fit > 95.0
    assert sum("outliers of a sensor" in told for told in found.unseen) == 3
