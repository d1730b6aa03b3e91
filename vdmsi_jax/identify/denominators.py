"""Denominators that a search starts from: with one pole for all, and with a pole more or less."""

import numpy as np

from vdmsi_jax.identify.response import N_MAX


def equal_poles(cutoff: float, n: int) -> np.ndarray:
    """Coefficients ascending of (s + cutoff)^n without the leading 1, padded to N_MAX."""
    return np.pad(np.poly(np.full(n, -cutoff))[:0:-1], (0, N_MAX - n))


def with_pole(a: np.ndarray, n: int, pole: float) -> np.ndarray:
    """Coefficients ascending of (s^n + ... + a_0) (s + pole), padded to N_MAX."""
    product = np.convolve(np.append(a[:n], 1.0), [pole, 1.0])[: n + 1]
    return np.pad(product, (0, N_MAX - n - 1))


def with_a_pole_less(a: np.ndarray, n: int) -> list[tuple[np.ndarray, float]]:
    """Coefficients ascending of s^n + ... + a_0 with one of its decaying poles less, padded to
    N_MAX, and the lag that this takes away: of a pair the pole that is left has the whole lag."""
    poles = np.roots(np.append(1.0, a[:n][::-1]))
    found = []
    for k, pole in enumerate(poles):
        if pole.imag < 0.0 or pole.real >= 0.0:
            continue
        others, lag = np.delete(poles, k), -1.0 / pole.real
        if pole.imag > 0.0:
            others[np.argmin(np.abs(others - pole.conjugate()))] = abs(pole) ** 2 / (2 * pole.real)
            lag = 0.0
        found.append((np.pad(np.poly(others).real[:0:-1], (0, N_MAX - n + 1)), float(lag)))
    return found
