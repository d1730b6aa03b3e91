"""What repeats with the way: a torque that ripples once a turn, and hums that do not."""

import numpy as np
import pytest

from vdmsi_jax.diagnose.travelled import line_over

DT, ROWS = 0.01, 4000
T = DT * np.arange(ROWS)
SPEED = np.stack([2.0 + 1.2 * np.sin(0.7 * T), 2.0 + np.sign(np.sin(0.5 * T + 1.0))])
WAY = np.cumsum(SPEED, axis=1) * DT
EVERYWHERE = np.ones(WAY.shape, bool)
NOISE = 0.1 * np.random.default_rng(8).standard_normal(WAY.shape)


def line(error, use=EVERYWHERE):
    e = NOISE + error
    return line_over(WAY, e, e, use, DT)


def test_a_ripple_over_the_way_is_told_by_its_period_and_share():
    phases = np.array([[0.3], [2.1]])  # each run begins at another
    found = line(0.05 * np.sin(2.0 * np.pi * WAY / 0.62 + phases))
    assert found is not None
    assert found.period == pytest.approx(0.62, rel=0.01)
    assert found.share == pytest.approx(0.00125 / 0.01125, rel=0.3)


def test_noise_and_a_hum_of_one_frequency_do_not_repeat_with_the_way():
    assert line(0.0) is None
    assert line(0.1 * np.sin(2.0 * np.pi * 3.1 * T)) is None


def test_what_stands_still_travels_nothing():
    still = np.zeros(WAY.shape)
    assert line_over(still, NOISE, NOISE, EVERYWHERE, DT) is None
    assert line_over(WAY, NOISE, NOISE, ~EVERYWHERE, DT) is None
