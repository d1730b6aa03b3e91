"""Intervals of curves and roots against sampling of the parameters."""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import made_up
from vdmsi_jax.bands import (
    frequency_bands,
    pole_uncertainty,
    settling_time,
    step_band,
    zero_uncertainty,
)
from vdmsi_jax.models.transfer_function import TransferFunction

SMALL = 1e-3  # relative deviation of the parameters: curves are then linear in them
SAMPLES = 4000
SAMPLING = 0.06  # of a standard deviation over so many samples, with room for 100 points


@pytest.fixture(scope="module")
def fit():
    fit = made_up.fit("P3Z2", made_up.record())
    rng = np.random.default_rng(0)
    root = rng.standard_normal((len(fit.parameters), len(fit.parameters)))
    scale = SMALL * np.abs(fit.parameters)
    covariance = scale[:, None] * (root @ root.T / len(scale)) * scale
    return dataclasses.replace(fit, covariance=covariance)


@pytest.fixture(scope="module")
def samples(fit):
    rng = np.random.default_rng(1)
    return rng.multivariate_normal(fit.parameters, fit.covariance, SAMPLES)


def split(theta):
    """num (3), den (4), delay of a P3Z2."""
    return theta[:3], np.append(1.0, theta[3:6]), theta[6]


def step_of(t):
    def response(theta):
        den = jnp.concatenate([jnp.ones(1), theta[3:6]])
        return TransferFunction(theta[:3], den, delay=theta[6]).step_response(t)

    return response


def half_width(band):
    return (band.high - band.low) / 2 / 1.959964


def test_gain_and_phase_bands_are_those_of_sampled_parameters(fit, samples):
    omega = np.geomspace(0.1, 100.0, 25)
    gain, phase = frequency_bands(fit, omega)
    s = 1j * omega
    response = np.array(
        [
            np.polyval(num, s) / np.polyval(den, s) * np.exp(-s * delay)
            for num, den, delay in map(split, samples)
        ]
    )
    nominal = 10 ** (gain.value / 20) * np.exp(1j * np.radians(phase.value))
    np.testing.assert_allclose(
        half_width(gain), np.std(20 * np.log10(np.abs(response)), axis=0), rtol=SAMPLING
    )
    turn = np.degrees(np.angle(response / nominal))
    np.testing.assert_allclose(half_width(phase), np.std(turn, axis=0), rtol=SAMPLING)


def test_the_frequency_response_is_the_models_own(fit):
    omega = np.geomspace(0.1, 50.0, 10)
    gain, phase = frequency_bands(fit, omega)
    own = np.asarray(fit.model.frequency_response(omega))
    np.testing.assert_allclose(
        10 ** (gain.value / 20) * np.exp(1j * np.radians(phase.value)), own, rtol=1e-10
    )


def test_step_band_is_that_of_sampled_parameters(fit, samples):
    t = np.linspace(0.0, settling_time(fit), 12)
    band = step_band(fit, t)
    responses = jax.jit(jax.vmap(step_of(t)))(samples)
    np.testing.assert_allclose(band.value, np.asarray(fit.model.step_response(t)), atol=1e-9)
    late = t > 0.1  # before, the response has hardly begun
    np.testing.assert_allclose(
        half_width(band)[late], np.std(responses, axis=0)[late], rtol=SAMPLING, atol=1e-6
    )


def test_a_settled_step_response_is_shown(fit):
    t = np.linspace(0.0, settling_time(fit), 50)
    assert step_band(fit, t).value[-1] == pytest.approx(float(fit.model.dc_gain()), rel=0.01)


@pytest.mark.parametrize(
    ("uncertainty", "columns"), [(pole_uncertainty, [3, 4, 5]), (zero_uncertainty, [0, 1, 2])]
)
def test_roots_move_as_their_covariance_says(fit, samples, uncertainty, columns):
    for root in uncertainty(fit):
        found = []
        for theta in samples:
            polynomial = theta[columns] if 0 in columns else np.append(1.0, theta[columns])
            roots = np.roots(polynomial)
            found.append(roots[np.argmin(abs(roots - root.value))] - root.value)
        sampled = np.cov(np.real(found), np.imag(found))
        scale = np.trace(root.covariance)
        np.testing.assert_allclose(root.covariance, sampled, atol=0.1 * scale)


def test_an_order_that_ended_as_a_smaller_one_has_its_uncertainty():
    smaller = made_up.fit("P2Z1", made_up.record())
    status = f"no better than what it contains: {smaller.order}"
    fit = dataclasses.replace(smaller, order="P3Z2", status=status, supported=False)
    t = np.linspace(0.0, settling_time(smaller), 30)
    for name in ("value", "low", "high"):
        np.testing.assert_array_equal(
            getattr(step_band(fit, t), name), getattr(step_band(smaller, t), name)
        )
    for uncertainty, count in ((pole_uncertainty, 2), (zero_uncertainty, 1)):
        found, known = uncertainty(fit), uncertainty(smaller)
        assert [root.value for root in found] == [root.value for root in known]
        np.testing.assert_array_equal([r.covariance for r in found], [r.covariance for r in known])
        assert len(found) == count
