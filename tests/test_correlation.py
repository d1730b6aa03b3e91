"""Correlations and spectra against what white noise and known filters must give."""

import numpy as np
import pytest

from vdmsi_jax.correlation import autocorrelation, cross_correlation, spectrum

DT = 0.01
SEEDS = 200


def white(n: int, seed: int) -> np.ndarray:
    return np.random.default_rng(seed).standard_normal(n)


def ar1(n: int, seed: int, pole: float = 0.9) -> np.ndarray:
    e, y = white(n, seed), np.zeros(n)
    for k in range(1, n):
        y[k] = pole * y[k - 1] + e[k]
    return y


def test_autocorrelation_equals_the_sum_written_out():
    x = white(400, 0)
    c = x - x.mean()
    expected = [np.mean(c[k:] * c[: 400 - k]) / np.mean(c * c) for k in range(20)]
    found = autocorrelation([x], DT, 19)
    np.testing.assert_allclose(found.value, expected, atol=1e-12)
    np.testing.assert_allclose(found.lag, np.arange(20) * DT)


def test_pieces_and_holes_are_never_paired_across():
    a, b = white(300, 1), 5.0 + white(250, 2)
    joined = autocorrelation([np.concatenate([a, np.full(50, np.nan), b])], DT, 49)
    apart = autocorrelation([a, b], DT, 49)
    np.testing.assert_allclose(joined.value, apart.value, atol=1e-12)


@pytest.mark.parametrize("colour", [white, ar1])
def test_cross_correlation_of_strangers_stays_within_its_bound(colour):
    """The share outside of 95 % bounds, over seeds at lag 0, is 5 % whatever the colour of both:
    between 1.5 and 9 % is 2.3 standard deviations of that share."""
    outside = [
        abs(c.value[100]) > c.bound
        for seed in range(SEEDS)
        for c in [cross_correlation([colour(1500, seed)], [colour(1500, 999 + seed)], DT, 100)]
    ]
    assert 0.015 <= np.mean(outside) <= 0.09


def test_cross_correlation_finds_the_lag_of_an_echo():
    u = white(2000, 3)
    echo = np.concatenate([np.zeros(7), u[:-7]])
    found = cross_correlation([echo], [u], DT, 30)
    assert found.lag[np.argmax(found.value)] == pytest.approx(7 * DT)
    assert found.value.max() > 0.98


def test_a_signal_that_does_not_move_has_no_correlation():
    found = cross_correlation([white(100, 4)], [np.ones(100)], DT, 10)
    assert not found.value.any()


def test_spectrum_of_white_noise_is_flat_and_holds_its_power():
    densities = [spectrum([2.0 * white(8192, seed)], DT) for seed in range(20)]
    level = 2.0 * DT * 4.0
    mean = np.mean([s.density[1:-1] for s in densities], axis=0)
    assert np.mean(mean) == pytest.approx(level, rel=0.02)
    inside = [(s.density > s.white[0]) & (s.density < s.white[1]) for s in densities]
    assert np.mean(inside) == pytest.approx(0.95, abs=0.03)


def test_spectrum_of_a_sine_peaks_at_its_frequency():
    t = np.arange(4096) * DT
    found = spectrum([np.sin(2 * np.pi * 12.5 * t)], DT)
    assert found.frequency[np.argmax(found.density)] == pytest.approx(12.5, abs=0.2)


def test_a_stretch_too_short_for_a_spectrum_gives_an_empty_one():
    assert spectrum([white(5, 0)], DT).frequency.size == 0
