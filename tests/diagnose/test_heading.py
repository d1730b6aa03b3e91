"""Whether an error of the way aside goes with the heading."""

import numpy as np
import pytest
from scipy.signal import lfilter

from vdmsi_jax.diagnose.residual.heading import by_heading

ROWS, DT, SPEED, WINDOW = 2000, 0.05, 1.2, 0.5


def driven(seed: int, deviation: float, slow: float = 0.0):
    """Ways of three runs, of which the last judges, with a compass that deviates by so many rad
    and a position that wanders by so many m/s."""
    rng = np.random.default_rng(seed)
    t = DT * np.arange(ROWS)
    rates = rng.uniform(0.1, 0.3, (3, 1)) * np.sin(rng.uniform(0.1, 0.2, (3, 1)) * t + seed)
    psi = np.cumsum(rates, axis=1) * DT + rng.uniform(-3.0, 3.0, (3, 1))
    error = deviation * (np.sin(psi - 0.7) + 0.3 * np.sin(2.0 * psi + 0.4))
    forward = SPEED * WINDOW * np.ones_like(psi)
    # a satellite receiver's, over 10 s
    drift = np.sqrt(DT / 5.0) * lfilter([1.0], [1.0, DT / 10.0 - 1.0], rng.normal(size=psi.shape))
    aside = -error * forward + 0.02 * rng.normal(size=psi.shape) + slow * WINDOW * drift
    fitted = np.repeat([[True], [True], [False]], ROWS, axis=1)
    return aside, forward, rates * WINDOW, psi + error, (fitted, ~fitted)


@pytest.mark.parametrize("seed", range(4))
def test_a_compass_beside_iron_is_told(seed):
    (left,) = by_heading(*driven(seed, deviation=0.15))

    assert left.channel == "psi" and left.depends_on == ("psi",)
    assert left.fraction > 0.5


def test_noise_and_a_position_that_wanders_are_none():
    told = [by_heading(*driven(seed, deviation=0.0, slow=0.05)) for seed in range(40)]

    assert sum(map(bool, told)) == 0


def test_without_data_to_judge_nothing_is_said():
    *about, masks = driven(0, deviation=0.15)

    assert by_heading(*about, (masks[0] | masks[1], np.zeros_like(masks[1]))) == []
