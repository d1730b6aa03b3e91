"""The colour of noise, beside plain least squares in NumPy."""

import numpy as np
import pytest

from vdmsi_jax.diagnose.signals.colour import (
    autoregression,
    least_squares,
    settled,
    unsteadiness,
    whiten,
)


def wandering(seed: int, rows: int) -> np.ndarray:
    """A smooth residual, a hundred times as large as its innovations."""
    rng = np.random.default_rng(seed)
    e = np.zeros(rows + 500)
    for k in range(2, rows + 500):
        e[k] = 1.96 * e[k - 1] - 0.9604 * e[k - 2] + rng.standard_normal()
    return e[500:]


def stretches() -> tuple[np.ndarray, np.ndarray]:
    e = np.stack([wandering(1, 900), wandering(2, 900), wandering(3, 900)])
    mask = np.ones(e.shape, bool)
    mask[0, 300:420], mask[1, :50], mask[2, 700:] = False, False, False
    return e, mask


def test_samples_count_whose_past_is_known():
    mask = np.array([[1, 1, 1, 1, 0, 1, 1, 1, 1, 1], [0, 1, 1, 1, 1, 1, 1, 0, 1, 1]], bool)
    wanted = [[0, 0, 1, 1, 0, 0, 0, 1, 1, 1], [0, 0, 0, 1, 1, 1, 1, 0, 0, 0]]
    assert np.array_equal(settled(mask, 2), np.array(wanted, bool))


@pytest.mark.parametrize("order", [1, 2, 7])
def test_the_prediction_is_that_of_least_squares(order):
    e, mask = stretches()
    counted = settled(mask, order)
    rows = [
        e[r, k - order : k + 1] for r, k in zip(*np.nonzero(counted), strict=True) if k >= order
    ]
    past, now = np.stack(rows)[:, :-1][:, ::-1], np.stack(rows)[:, -1]
    wanted = np.linalg.lstsq(past, now, rcond=None)[0]
    assert np.allclose(least_squares(e, counted, order), wanted, rtol=1e-5, atol=1e-6)


def test_the_ends_of_stretches_do_not_mislead_it():
    e, mask = stretches()
    seen = np.where(mask, e, 0.0)
    counted = settled(mask, 2)
    truth = np.array([1.96, -0.9604])
    assert least_squares(seen, counted, 2) == pytest.approx(truth, abs=0.02)
    jumps = autoregression(seen[None], mask, 2)[0]
    assert np.abs(jumps - truth).max() > 0.1  # as Yule-Walker's are


def whitened(e: np.ndarray) -> np.ndarray:
    return whiten(e[None], autoregression(e[None], np.ones(e.shape, bool), 30))[0]


def test_a_frequency_that_changes_is_a_colour_that_does():
    """A sine of 0.5 to 7 Hz in white noise, at 50 Hz; and sines that stay, and one event."""
    rng, t = np.random.default_rng(4), 0.02 * np.arange(3000)
    noise = rng.standard_normal((3, 3000))
    known = np.ones(noise.shape, bool)
    runs_up = noise + 3.0 * np.sin(2.0 * np.pi * (0.5 * t + 0.054 * t**2))
    stays = noise + 3.0 * np.sin(2.0 * np.pi * 3.0 * t)
    once = noise + 8.0 * np.exp(-(((t - 31.0) / 0.1) ** 2))
    assert unsteadiness(whitened(runs_up), known) > 20.0
    for steady in (noise, stays, once, np.stack([wandering(k, 3000) for k in range(3)])):
        assert unsteadiness(whitened(steady), known) < 4.0
    assert unsteadiness(np.zeros((3, 3000)), known) < 3.0
    assert unsteadiness(whitened(runs_up)[:, :400], known[:, :400] & (t[:400] < 1.0)) == 0.0
