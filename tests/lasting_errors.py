"""Noise, wind and events in a response, for tests of errors that last."""

import numpy as np

from vdmsi_jax.diagnose.signals.disturbance import demands
from vdmsi_jax.diagnose.signals.unexplained import slow_error

DT = 0.02
N = 3000
RNG = np.random.default_rng(4)
T = DT * np.arange(N)
RESPONSE = 8.0 + 2.0 * np.sign(np.sin(2 * np.pi * T / 9.0))[None]
NOISE = 0.03 * RNG.standard_normal((1, N))
EVERYWHERE = np.ones((1, N), bool)
COMMAND = RESPONSE.copy()
ASKED = demands(COMMAND, RESPONSE, EVERYWHERE, DT)


def slow(error):
    masks = EVERYWHERE, ~EVERYWHERE
    return slow_error("v", NOISE + error, NOISE, RESPONSE, ASKED, masks, DT)


def wind(size, seconds=1.5):
    """Gaussian, of a first-order spectrum."""
    rng, keep = np.random.default_rng(7), np.exp(-DT / seconds)
    gusts = np.empty((1, N))
    gusts[:, 0] = rng.standard_normal()
    for k, now in enumerate(np.sqrt(1.0 - keep**2) * rng.standard_normal(N - 1)):
        gusts[:, k + 1] = keep * gusts[:, k] + now
    return size * gusts


def when_it_jumps(x):
    """Where the response has just jumped."""
    since = T % 4.5
    return np.where(since < 1.0, x, 0.0)
