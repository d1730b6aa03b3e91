"""What a residual still holds: its spectrum, its correlation with itself and with the input.

All of them take samples in pieces (the segments of a record) and never pair samples across a gap;
NaN stands for a sample that is not there.
"""

from collections.abc import Sequence
from statistics import NormalDist
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

Pieces = Sequence[np.ndarray]


class Correlation(NamedTuple):
    """A normalised correlation and the half-width of its interval under "there is none".

    Attributes:
        lag: time by which the residual comes after the other signal, s.
        value: correlation coefficient at each lag.
        bound: half-width within which `level` of the values lie if nothing is left to explain.
    """

    lag: Float[np.ndarray, " k"]
    value: Float[np.ndarray, " k"]
    bound: float


class Spectrum(NamedTuple):
    """A one-sided power spectral density and where a white residual of the same power would lie.

    Attributes:
        frequency: Hz.
        density: squared unit per Hz.
        white: (low, high), the interval of each value for white noise of the same variance.
    """

    frequency: Float[np.ndarray, " k"]
    density: Float[np.ndarray, " k"]
    white: tuple[float, float]


def _products(a: Pieces, b: Pieces, lags: int) -> tuple[np.ndarray, np.ndarray]:
    """Mean of `a[i + k] b[i]` over the pairs that exist, for k = 0..lags, and their number."""
    sums, counts = np.zeros(lags + 1), np.zeros(lags + 1)
    for first, second in zip(a, b, strict=True):
        width = 1 << (len(first) + lags).bit_length()
        present = [np.isfinite(x).astype(float) for x in (first, second)]
        values = [np.where(np.isfinite(x), x, 0.0) for x in (first, second)]
        for total, (x, y) in ((sums, values), (counts, present)):
            spectrum = np.fft.rfft(x, width) * np.fft.rfft(y, width).conj()
            total += np.fft.irfft(spectrum, width)[: lags + 1]
    counts = np.round(counts)
    return np.divide(sums, counts, out=np.zeros_like(sums), where=counts > 0), counts


def _centred(pieces: Pieces) -> list[np.ndarray]:
    everything = np.concatenate([np.asarray(piece, float) for piece in pieces])
    level = np.nanmean(everything) if np.isfinite(everything).any() else 0.0
    return [np.asarray(piece, float) - level for piece in pieces]


def autocorrelation(residual: Pieces, dt: float, lags: int, level: float = 0.95) -> Correlation:
    """Correlation of a residual with itself at `lags` sample periods and fewer.

    The bound is that of white noise, z / sqrt(N).
    """
    centred = _centred(residual)
    means, counts = _products(centred, centred, lags)
    value = means / means[0] if means[0] > 0 else np.zeros_like(means)
    z = NormalDist().inv_cdf(0.5 + level / 2)
    return Correlation(np.arange(lags + 1) * dt, value, z / np.sqrt(max(counts[0], 1.0)))


def cross_correlation(
    residual: Pieces, signal: Pieces, dt: float, lags: int, level: float = 0.95
) -> Correlation:
    """Correlation of a residual with a signal up to `lags` sample periods before and after it.

    Positive lags are dynamics that the model lacks, negative ones feedback. The bound allows for
    the colour of both: z sqrt(sum_k R_e(k) R_u(k) / N), Ljung, System Identification (1999), eq.
    16.72.
    """
    e, u = _centred(residual), _centred(signal)
    u = [np.where(np.isfinite(x), y, np.nan) for x, y in zip(e, u, strict=True)]
    own_e, counts = _products(e, e, lags)
    own_u, _ = _products(u, u, lags)
    after, _ = _products(e, u, lags)
    before, _ = _products(u, e, lags)
    scale = np.sqrt(own_e[0] * own_u[0])
    lag = np.arange(-lags, lags + 1) * dt
    if not scale > 0.0:
        return Correlation(lag, np.zeros(2 * lags + 1), 1.0)
    value = np.concatenate([before[:0:-1], after]) / scale
    taper = 1.0 - np.arange(lags + 1) / (lags + 1)
    colour = own_e * own_u * taper / (own_e[0] * own_u[0])
    spread = max(colour[0] + 2.0 * colour[1:].sum(), 1.0)
    z = NormalDist().inv_cdf(0.5 + level / 2)
    return Correlation(lag, value, z * np.sqrt(spread / max(counts[0], 1.0)))


def spectrum(residual: Pieces, dt: float, window: int = 512, level: float = 0.95) -> Spectrum:
    """Welch's averaged periodogram (Hann window, half overlapped) of the gap-free stretches.

    The window shrinks to the longest stretch if that is shorter. The interval takes the averages as
    independent, with the chi-square quantile of Wilson and Hilferty (1931).
    """
    stretches = [s for piece in _centred(residual) for s in _finite_stretches(piece)]
    longest = max((len(s) for s in stretches), default=0)
    width = min(window, longest)
    if width < 8:
        return Spectrum(np.zeros(0), np.zeros(0), (np.nan, np.nan))
    taper = np.hanning(width + 1)[:-1]
    periodograms = [
        np.abs(np.fft.rfft(taper * s[i : i + width])) ** 2
        for s in stretches
        for i in range(0, len(s) - width + 1, width // 2)
    ]
    density = 2.0 * dt * np.mean(periodograms, axis=0) / (taper**2).sum()
    variance = float(np.mean(np.concatenate(stretches) ** 2))
    z = NormalDist().inv_cdf(0.5 + level / 2)
    freedom = 2.0 * max(len(periodograms) / 1.06, 1.0)  # 1.06: half-overlapped Hann windows
    low, high = (
        2.0
        * dt
        * variance
        * max(1 - 2 / (9 * freedom) + sign * z * np.sqrt(2 / (9 * freedom)), 0) ** 3
        for sign in (-1, 1)
    )
    return Spectrum(np.fft.rfftfreq(width, dt)[1:], density[1:], (low, high))


def _finite_stretches(piece: np.ndarray) -> list[np.ndarray]:
    edges = np.flatnonzero(np.diff(np.isfinite(piece)))
    parts = np.split(piece, edges + 1)
    return [part for part in parts if len(part) and np.isfinite(part[0])]
