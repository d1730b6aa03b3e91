"""Covariances against formulas and direct solves, and what is said about poles and zeros."""

import numpy as np
import pytest
from scipy.linalg import solve_toeplitz

import known_plants as known
from vdmsi_jax.config import DEFAULT_PLANTS
from vdmsi_jax.identify import uncertainty
from vdmsi_jax.identify.result import Fit

# direct solve and recursion of the same well-conditioned equations
EXACT = 1e-10
# central differences of roots, step 1e-6: truncation 1e-12, rounding 1e-10
DIFFERENCES = 1e-6
DT, DURATION = 0.01, 30.0


def test_autocovariance_against_its_definition_over_segments():
    e = known.white(500, 1.0, seed=0)
    segments = [slice(0, 200), slice(200, 500)]
    found = uncertainty.autocovariance(e, segments, 5)
    for lag in range(6):
        products = sum(float(e[s][lag:] @ e[s][: len(e[s]) - lag]) for s in segments)
        assert found[lag] == pytest.approx(products / 500, rel=EXACT)


def test_autoregression_against_a_direct_solve():
    e = known.coloured(5000, 2.0, 0.8, seed=1)
    covariance = uncertainty.autocovariance(e, [slice(0, 5000)], 10)
    phi, variance = uncertainty.ar_model(covariance, 5000)
    order = len(phi)
    assert order >= 1
    direct = solve_toeplitz(covariance[:order], covariance[1 : order + 1])
    np.testing.assert_allclose(phi, direct, atol=EXACT)
    assert variance == pytest.approx(covariance[0] - direct @ covariance[1 : order + 1])
    # the truth, within three standard deviations of an estimate from 5000 samples
    assert phi[0] == pytest.approx(0.8, abs=3 * np.sqrt((1 - 0.8**2) / 5000))
    assert np.sqrt(variance) == pytest.approx(2.0 * 0.6, rel=0.04)


def test_white_residual_needs_no_autoregression():
    e = known.white(5000, 0.3, seed=2)
    phi, variance = uncertainty.ar_model(uncertainty.autocovariance(e, [slice(0, 5000)], 30), 5000)
    assert len(phi) == 0
    assert variance == pytest.approx(np.mean(e**2))


def test_covariance_under_white_noise_is_the_plain_formula():
    n = 2000
    J = np.random.default_rng(3).standard_normal((n, 4)) @ np.diag([1e-3, 1.0, 50.0, 2e4])
    e = known.white(n, 0.3, seed=4)
    found = uncertainty.parameter_covariance(J, e, [slice(0, n)], 4)
    np.testing.assert_allclose(found, e @ e / (n - 4) * np.linalg.inv(J.T @ J), rtol=1e-8, atol=0)


@pytest.mark.parametrize("edges", [[], [700, 1100]], ids=["one segment", "three segments"])
def test_covariance_under_coloured_noise_is_the_sandwich(edges):
    """(J'J)^-1 J'SJ (J'J)^-1 with the covariance S of the autoregression, written out."""
    n = 1600
    bounds = [0, *edges, n]
    segments = [slice(a, b) for a, b in zip(bounds[:-1], bounds[1:], strict=True)]
    J = np.cumsum(np.random.default_rng(5).standard_normal((n, 3)), axis=0)
    e = np.concatenate([known.coloured(s.stop - s.start, 0.3, 0.6, 6 + s.start) for s in segments])
    found = uncertainty.parameter_covariance(J, e, segments, 3)
    phi, variance = uncertainty.ar_model(uncertainty.autocovariance(e, segments, 30), n)
    lags = np.arange(n)
    # covariance of an autoregression from its impulse response
    h = np.zeros(4000)
    h[0] = 1.0
    for t in range(1, len(h)):
        h[t] = sum(phi[i] * h[t - 1 - i] for i in range(min(len(phi), t)))
    r = np.array([h[: len(h) - k] @ h[k:] if k < 200 else 0.0 for k in lags]) * variance
    middle = np.zeros((3, 3))
    for s in segments:
        m = s.stop - s.start
        middle += J[s].T @ r[abs(np.subtract.outer(lags[:m], lags[:m]))] @ J[s]
    inverse = np.linalg.inv(J.T @ J)
    expected = inverse @ middle @ inverse * n / (n - 3)
    np.testing.assert_allclose(found, expected, rtol=1e-6)


@pytest.mark.parametrize("roots", [[-1.0, -3.0, 0.5], [-1 + 2j, -1 - 2j, -4.0], [-2.0]])
def test_root_sensitivity_against_differences(roots):
    coefficients = 1.7 * np.real(np.poly(roots))
    found = uncertainty.root_sensitivity(coefficients, np.array(roots))
    for i in range(len(coefficients)):
        step = np.zeros(len(coefficients))
        step[i] = 1e-6
        moved = []
        for by in (step, -step):
            new = np.roots(coefficients + by)
            moved.append([new[abs(new - root).argmin()] for root in roots])
        slope = (np.array(moved[0]) - np.array(moved[1])) / 2e-6
        np.testing.assert_allclose(found[:, i], slope, atol=DIFFERENCES)


def remarks(num, den, relative=1e-3):
    """What is said of a model whose coefficients are known to a share of themselves."""
    covariance = np.diag((relative * np.array([*num, *den[1:]])) ** 2)
    told = uncertainty.support_remarks(
        np.array(num, float), np.array(den, float), covariance, dt=DT, duration=DURATION
    )
    return told


def test_a_plain_plant_is_left_in_peace():
    assert remarks(known.POWERTRAIN.num, known.POWERTRAIN.den) == ()


def test_the_papers_steering_model_is_not_supported():
    """Poles -25.44 and -6.7e-9, zeros -49.28 and +0.0212 (Yan, Hsu & Wen 2023, table 2)."""
    told = remarks((0.47, 23.15, -0.49), (1.0, 25.44, 1.7e-7))
    integrator = [r for r in told if "integrator" in r.message]
    assert len(integrator) == 1 and integrator[0].unsupported
    assert "-6.68e-09" in integrator[0].message and "30 s" in integrator[0].message
    assert any("0.0211" in r.message or "0.0212" in r.message for r in told)
    assert any(r.unsupported for r in told)


@pytest.mark.parametrize(
    ("den", "unsound"),
    [
        ((1.0, 2.0, -3.0), True),  # grows by e^30 in the record
        ((1.0, 2.0, 0.0), False),
        ((1.0, 2.0, 100.0), False),
        ((1.0, 2.0, (1.5 * np.pi / DT) ** 2), True),  # an alias
        ((1.0, 1000.0), False),
    ],
)
def test_which_models_no_simulation_should_get(den, unsound):
    assert any(r.unsound for r in remarks((5.0,), den)) == unsound


@pytest.mark.parametrize(
    ("num", "den", "relative", "word", "unsupported"),
    [
        ((1.0, 2.001), (1.0, 5.0, 6.0), 1e-3, "nearly cancel", True),
        ((1.0, 2.3), (1.0, 5.0, 6.0), 0.3, "nearly cancel", True),
        ((5.0,), (1.0, 2.0, 0.0), 1e-3, "integrator", True),
        ((5.0,), (1.0, 2.0, -3.0), 1e-3, "unstable", True),
        ((5.0,), (1.0, 1000.0), 1e-3, "faster than the sampling", True),
        ((-1.0, 4.0), (1.0, 3.0, 4.0), 1e-3, "non-minimum-phase", False),
        ((-0.001, 4.0), (1.0, 3.0, 4.0), 1e-3, "within the noise", False),
    ],
)
def test_what_is_said(num, den, relative, word, unsupported):
    told = [r for r in remarks(num, den, relative) if word in r.message]
    assert told and all(r.unsupported == unsupported for r in told)


def test_a_zero_far_from_every_pole_is_no_cancellation():
    assert not any("cancel" in r.message for r in remarks((1.0, 8.0), (1.0, 5.0, 6.0)))


@pytest.mark.parametrize(("delay", "low"), [(0.0, 0.0), (0.003, 0.0), (0.05, 0.05 - 1.96 * 0.002)])
def test_the_interval_of_a_delay_ends_at_zero(delay, low):
    names, values = ("delay", "offset"), np.array([delay, 0.0])
    found = Fit(
        "P1Z0",
        DEFAULT_PLANTS[0],
        "",
        parameter_names=names,
        parameters=values,
        covariance=np.diag([0.002**2, 0.1**2]),
    )
    assert found.interval("delay") == pytest.approx((low, delay + 1.96 * 0.002), abs=1e-6)
    assert found.interval("offset") == pytest.approx((-0.196, 0.196), abs=1e-5)
