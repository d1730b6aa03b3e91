"""Sensors that are slower than the log."""

import numpy as np
import pytest

import vdmsi_jax as vj
from small_logs import write_csv
from vdmsi_jax.config import Config, Prepare
from vdmsi_jax.data import read_log
from vdmsi_jax.data.slow_sensors import between_their_samples

DT, ROWS, EACH = 0.02, 3000, 5
T = DT * np.arange(ROWS)


def motor(seed: int) -> dict[str, np.ndarray]:
    """A lag with a dead zone, whose response is logged in every fifth row."""
    rng = np.random.default_rng(seed)
    u = np.repeat(rng.uniform(-1.0, 1.0, ROWS // 60), 60)
    moved = np.sign(u) * np.maximum(np.abs(u) - 0.2, 0.0)
    y, now = np.empty(ROWS), 0.0
    for k in range(ROWS):
        y[k] = now
        now += -np.expm1(-DT / 0.3) * (moved[k] - now)
    y += 0.005 * rng.standard_normal(ROWS)
    return {"t": T, "u": u, "y": np.where(np.arange(ROWS) % EACH == 0, y, np.nan)}


def read(tmp_path, columns, policy="interpolate"):
    path = write_csv(tmp_path / "run.csv", columns)
    return read_log(path, Config(prepare=Prepare(missing=policy)))


def test_a_line_leads_from_sample_to_sample(tmp_path):
    for policy in ("interpolate", "hold"):  # the last value is as old as it is
        log = read(tmp_path, motor(0), policy)
        assert log.measured("y").mean() < 0.25
        whole, slow = between_their_samples(log)
        assert slow == {"y": EACH * DT}
        last = np.flatnonzero(log.measured("y"))[-1]
        assert whole.measured("y")[: last + 1].all()
        np.testing.assert_allclose(
            np.diff(whole["y"][: last + 1], 2).reshape(-1)[1:4], 0.0, atol=1e-9
        )
        assert np.array_equal(whole["u"], log["u"])


def test_what_is_missing_for_longer_stays_so(tmp_path):
    columns = motor(0)
    columns["y"][EACH * 100 : EACH * 103] = np.nan  # three samples of the sensor
    log = read(tmp_path, columns)
    whole, _ = between_their_samples(log)
    gone = ~whole.measured("y")
    assert gone[EACH * 99 + 1 : EACH * 103].all() and gone.sum() < 4 * EACH


def test_a_log_with_all_samples_or_a_few_holes_stays_as_it_is(tmp_path):
    columns = motor(0) | {"y": np.sin(T)}
    log = read(tmp_path, columns)
    assert between_their_samples(log) == (log, {})
    columns["y"][[40, 41, 900]] = np.nan
    log = read(tmp_path, columns)
    assert between_their_samples(log) == (log, {})


def test_a_diagnosis_sees_through_it(tmp_path):
    """It had ended in a singular matrix, since no five rows in turn were measured."""
    logs = [read(tmp_path, motor(seed)).renamed(f"run_{seed}") for seed in range(2)]
    found = vj.diagnose(logs)
    assert [f.cause for f in found.findings] == ["dead_zone"]
    assert found.findings[0].parameters["half_width"].value == pytest.approx(0.2, rel=0.1)
    assert any("y was measured every 0.1 s" in told for told in found.unseen)
