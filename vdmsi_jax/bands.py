"""How uncertain parameters make what is drawn from them uncertain, by the delta method.

A band is the estimate plus and minus z times sqrt(diag(J P J')), with P the covariance of the
parameters and J the derivative of what is drawn. It is exact where that is linear in the
parameters, and honest near the estimate elsewhere.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Complex, Float

from .identify.result import Fit, model_of, z_of
from .identify.uncertainty import root_sensitivity
from .models.transfer_function import TransferFunction


class Band(NamedTuple):
    """A curve and its interval at each point of `at`."""

    at: Float[np.ndarray, " k"]
    value: Float[np.ndarray, " k"]
    low: Float[np.ndarray, " k"]
    high: Float[np.ndarray, " k"]


class Root(NamedTuple):
    """A pole or zero, rad/s, and the (2, 2) covariance of its real and imaginary part."""

    value: complex
    covariance: Float[np.ndarray, "2 2"]


def _band(at, value, jacobian, covariance, level: float) -> Band:
    variance = np.einsum("kp,pq,kq->k", jacobian, covariance, jacobian)
    half = z_of(level) * np.sqrt(np.maximum(variance, 0.0))
    return Band(np.asarray(at), value, value - half, value + half)


def settling_time(fit: Fit) -> float:
    """A time that shows a step response whole: the delay and six slowest time constants, s, which
    an integrator or a pole slower than the rest by a factor of 30 does not stretch without end."""
    model = model_of(fit)
    rates = np.sort(np.abs(fit.poles.real))
    rates = rates[rates > rates[-1] / 30.0] if rates.size and rates[-1] > 0 else np.ones(1)
    return float(model.delay or 0.0) + 6.0 / float(rates[0])


def step_band(fit: Fit, t: Float[np.ndarray, " k"], level: float = 0.95) -> Band:
    """Step response (offset left out, delay included) with its interval."""
    model = model_of(fit)
    n = len(model.num)

    def response(theta):
        free = "delay" in fit.parameter_names
        delay = theta[fit.parameter_names.index("delay")] if free else model.delay
        den = jnp.concatenate([jnp.ones(1), theta[n : n + len(model.den) - 1]])
        return TransferFunction(theta[:n], den, delay=delay).step_response(jnp.asarray(t))

    theta = jnp.asarray(fit.parameters)
    value, jacobian = jax.jit(lambda p: (response(p), jax.jacfwd(response)(p)))(theta)
    return _band(t, np.asarray(value), np.asarray(jacobian), fit.covariance, level)


def frequency_bands(
    fit: Fit, omega: Float[np.ndarray, " k"], level: float = 0.95
) -> tuple[Band, Band]:
    """Gain in dB and unwrapped phase in degrees at `omega`, rad/s, with their intervals."""
    model = model_of(fit)
    s = 1j * np.asarray(omega)
    num, den = np.asarray(model.num), np.asarray(model.den)
    delay = float(model.delay or 0.0)
    above, below = np.polyval(num, s), np.polyval(den, s)
    logarithm = {  # derivatives of log G, whose real part is the gain and whose imaginary the phase
        **{f"b{k}": s**k / above for k in range(len(num))},
        **{f"a{k}": -(s**k) / below for k in range(len(den) - 1)},
        "delay": -s,
    }
    nothing = np.zeros_like(s)
    J = np.stack([logarithm.get(name, nothing) for name in fit.parameter_names], axis=1)
    phase = np.unwrap(np.angle(above / below)) - delay * np.asarray(omega)
    decibel, degree = 20.0 / np.log(10.0), 180.0 / np.pi
    gain = _band(
        omega, decibel * np.log(np.abs(above / below)), decibel * J.real, fit.covariance, level
    )
    return gain, _band(omega, degree * phase, degree * J.imag, fit.covariance, level)


def pole_uncertainty(fit: Fit) -> list[Root]:
    """The poles with their covariances."""
    model = model_of(fit)
    names = [f"a{k}" for k in reversed(range(len(model.den) - 1))]
    return _roots(fit, np.asarray(model.den), fit.poles, names)


def zero_uncertainty(fit: Fit) -> list[Root]:
    """The finite zeros with their covariances."""
    model = model_of(fit)
    names = [f"b{k}" for k in reversed(range(len(model.num)))]
    return _roots(fit, np.asarray(model.num), fit.zeros[np.isfinite(fit.zeros)], names)


def _roots(fit: Fit, polynomial, roots: Complex[np.ndarray, " n"], names: list[str]) -> list[Root]:
    """Roots of a polynomial whose coefficients in descending powers, but for a fixed leading 1, are
    the parameters `names`. A multiple root has no linear uncertainty; its covariance is NaN."""
    index = [fit.parameter_names.index(name) for name in names]
    covariance = fit.covariance[np.ix_(index, index)]
    derivatives = root_sensitivity(polynomial, roots)[:, -len(names) :]
    found = []
    for root, derivative in zip(roots, derivatives, strict=True):
        J = np.stack([derivative.real, derivative.imag])
        finite = np.isfinite(J).all()
        found.append(
            Root(complex(root), J @ covariance @ J.T if finite else np.full((2, 2), np.nan))
        )
    return found
