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


PLACE = np.stack([0.8 * np.sin(0.21 * T + 0.4 * np.sin(T)), 0.7 * np.cos(0.37 * T)])


def place(error):
    e = NOISE + error
    return line_over(PLACE, e, e, EVERYWHERE, DT, place=True)


def test_detents_are_told_by_how_far_they_are_apart():
    found = place(0.08 * np.sin(2.0 * np.pi * PLACE / 0.25))
    assert found is not None
    assert found.period == pytest.approx(0.25, rel=0.07)  # few turns make a broad line


@pytest.mark.parametrize(
    "error",
    [0.0, 0.2 * PLACE**2, 0.2 * np.abs(PLACE), 0.1 * np.sin(2.0 * np.pi * 1.3 * T)],
    ids=["noise", "a bend", "a kink", "a hum"],
)
def test_what_bends_with_the_place_has_no_detents(error):
    assert place(error) is None
