"""Steps in which a channel was measured."""

import numpy as np
import pytest

import vdmsi_jax as vj
from vdmsi_jax.data.lattice import lattice_step

STEP = 0.03


def angle(n: int = 800) -> np.ndarray:
    rng = np.random.default_rng(3)
    smooth = 0.4 * np.sin(0.05 * np.arange(n)) + 0.01 * rng.standard_normal(n)
    return STEP * np.round(smooth / STEP)


def test_values_on_a_lattice_tell_its_step():
    assert lattice_step(angle()) == pytest.approx(STEP)
    assert lattice_step(angle() + np.random.default_rng(4).normal(0.0, 0.01, 800)) is None


def test_uneven_stamps_do_not_hide_the_steps_of_a_sensor(tmp_path):
    rng = np.random.default_rng(5)
    t = 0.02 * np.arange(800) + rng.uniform(-0.004, 0.004, 800)
    u = np.repeat(rng.uniform(-0.4, 0.4, 20), 40)
    table = np.stack([t - t[0], u, angle()], axis=1)
    file = tmp_path / "run.csv"
    np.savetxt(file, table, delimiter=",", header="t,delta_cmd,delta", comments="", fmt="%.6f")
    record = vj.read_log(file)
    assert any("resampled" in told for told in record.repairs)
    assert lattice_step(record["delta"]) is None
    assert record.step("delta") == pytest.approx(STEP)
    assert record.select(record.segments).step("delta") == pytest.approx(STEP)
    assert record.step("delta_cmd") is None
