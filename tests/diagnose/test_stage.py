"""Where the response of a stage begins."""

import numpy as np
import pytest

from vdmsi_jax.diagnose.actuator.stage import _begins_at

RNG = np.random.default_rng(3)
MANY = 25


def test_what_rests_begins_at_its_mean_and_no_single_sample_tells_it():
    resting = [0.3 + 0.01 * RNG.standard_normal(200) for _ in range(200)]

    found = np.array([_begins_at(y, MANY) for y in resting])

    assert np.std(found) < 0.006  # of 16 samples 0.0025
    assert np.mean(found) == pytest.approx(0.3, abs=0.001)


@pytest.mark.parametrize("rate", [0.002, 0.02, 0.2])
def test_what_moves_begins_where_it_is_first_seen(rate):
    """Or where it is nearly still: it may begin at rest, and bend."""
    moving = [0.3 + rate * np.arange(200) + 0.01 * RNG.standard_normal(200) for _ in range(200)]

    found = np.array([_begins_at(y, MANY) for y in moving])

    assert np.sqrt(np.mean((found - 0.3) ** 2)) < 0.011


def test_what_bends_begins_where_it_is_first_seen():
    bent = 0.3 - 0.3 * np.cos(0.9 * np.arange(200)) + 0.001 * RNG.standard_normal(200)

    assert _begins_at(bent, MANY) == bent[0]


@pytest.mark.parametrize("most", [1, 2])
def test_of_few_samples_the_first_tells_it(most):
    assert _begins_at(np.array([0.3, 0.4]), most) == 0.3


def test_what_has_no_noise_begins_at_its_first_sample_and_nothing_nowhere():
    assert _begins_at(np.r_[np.full(30, 0.2), np.linspace(0.2, 1.0, 100)], MANY) == 0.2
    assert _begins_at(np.linspace(0.2, 1.0, 100), MANY) == 0.2
    assert np.isnan(_begins_at(np.zeros(0), 0))
