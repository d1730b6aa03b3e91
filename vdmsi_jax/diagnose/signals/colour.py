"""The colour of noise: autoregressive whitening, estimated from residuals of several runs."""

import numpy as np
from jaxtyping import Bool, Complex, Float

LENGTH = 0.6
"""How much of the past a whitening filter sees, s."""

_MOST, _LEAST = 30, 6
_STRETCH, _FEWEST = 100, 8  # samples by which a colour is compared, and how many stretches say so
_CAPPED = 4.0  # mean square of a stretch's spectrum: an event in one is no colour


def filter_length(dt: float, samples: int) -> int:
    """Order of the autoregression for a sample period and a number of samples."""
    wanted = int(np.clip(round(LENGTH / dt), _LEAST, _MOST))
    return max(1, min(wanted, samples // 40))


def settled(mask: Bool[np.ndarray, "R N"], order: int) -> Bool[np.ndarray, "R N"]:
    """Samples whose past is known as far as a whitening filter looks: no jump from a gap counts."""
    kept = mask.copy()
    kept[:, :order] = False
    for k in range(1, order + 1):
        kept[:, k:] &= mask[:, :-k]
    return kept


def least_squares(
    e: Float[np.ndarray, "R N"], counted: Bool[np.ndarray, "R N"], order: int
) -> Float[np.ndarray, " order"]:
    """Coefficients of the prediction of the `counted` samples by those before them. Unlike
    Yule-Walker's they are not misled by the ends of stretches, which jump by far more than the
    innovations of a smooth residual.

    Source: Kay, Modern Spectral Estimation (1988), section 7.4 (covariance method).
    """
    gram, rise = np.zeros((order + 1, order + 1)), np.zeros((order, order))
    for row, first, stop in _stretches(counted):
        own = e[row, first - order : stop]
        gram[0] += np.correlate(own, own[order:], "valid")[::-1]
        before, last = own[order - 1 :: -1][:order], own[: -order - 1 : -1]
        rise += np.outer(before, before) - np.outer(last, last)
    gram[:, 0] = gram[0]
    for i in range(order):  # products one sample earlier, but for those at the ends
        gram[i + 1, 1:] = gram[i, :-1] + rise[i]
    scale = np.sqrt(np.maximum(np.diag(gram), 1e-300))
    unit = gram / np.outer(scale, scale)
    past = unit[1:, 1:] + 1e-12 * np.eye(order)
    return np.linalg.solve(past, unit[1:, 0]) * scale[0] / scale[1:]


def forgetting(order: int, memory: float, dt: float) -> Float[np.ndarray, " order"]:
    """Factors of a filter's coefficients that leave it a memory of so many seconds at the most, its
    roots moved inwards: what lasts longer is no noise then.

    Source: Tohkura et al., Spectral smoothing technique in PARCOR speech analysis-synthesis (1978),
    by their bandwidth expansion.
    """
    return np.exp(-dt / memory * np.arange(1, order + 1))


def _stretches(counted: Bool[np.ndarray, "R N"]) -> list[tuple[int, int, int]]:
    """Row, first and stop of each unbroken stretch."""
    edges = np.diff(np.pad(counted, ((0, 0), (1, 1))).astype(np.int8), axis=1)
    firsts, stops = np.argwhere(edges == 1), np.argwhere(edges == -1)
    return [(int(r), int(a), int(b)) for (r, a), (_, b) in zip(firsts, stops, strict=True)]


def autoregression(
    e: Float[np.ndarray, "H R N"], mask: Bool[np.ndarray, "R N"], order: int
) -> Float[np.ndarray, "H order"]:
    """Coefficients of the Yule-Walker prediction `e[k] ~ sum a[j] e[k-1-j]`, for each of H
    residuals over R runs; samples outside the mask count as zero.

    Source: Brockwell and Davis, Time Series: Theory and Methods (1991), section 8.1.
    """
    return predicted(spectrum(np.where(mask, e, 0.0)), order)[0]


def spectrum(e: Float[np.ndarray, "... N"]) -> Complex[np.ndarray, "... F"]:
    """Fourier transform, padded so that no lag of a whitening filter wraps around."""
    return np.fft.rfft(e, _transformed(e.shape[-1] + _MOST))


def _transformed(length: int) -> int:
    """The first even length from `length` on that is quick to transform."""
    octave = max(length.bit_length() - 4, 1)
    return min(
        m << k for m in (8, 9, 10, 12, 15, 16) for k in (octave, octave + 1) if m << k >= length
    )


def predicted(
    spectra: Complex[np.ndarray, "H R F"], order: int
) -> tuple[Float[np.ndarray, "H order"], Float[np.ndarray, " H"]]:
    """Coefficients of `autoregression` and the sum of squares that the prediction leaves, from the
    `spectrum` of signals that are zero where they do not count."""
    power = np.sum(np.abs(spectra) ** 2, axis=1)
    covariance = np.fft.irfft(power)[:, : order + 1]
    covariance[:, 0] = covariance[:, 0] * (1 + 1e-9) + 1e-300
    lags = np.abs(np.arange(order)[:, None] - np.arange(order)[None, :])
    later = covariance[:, 1:]
    coefficients = np.linalg.solve(covariance[:, lags], later[..., None])[..., 0]
    return coefficients, covariance[:, 0] - np.sum(coefficients * later, axis=1)


def whiten(
    e: Float[np.ndarray, "H ... N"], coefficients: Float[np.ndarray, "H order"]
) -> Float[np.ndarray, "H ... N"]:
    """Innovations `e[k] - sum a[j] e[k-1-j]`; the first `order` of each run are not usable."""
    H, order = coefficients.shape
    taps = np.concatenate([np.ones((H, 1)), -coefficients], axis=1)
    size = _transformed(e.shape[-1] + order)
    shape = (H, *(1,) * (e.ndim - 2), size // 2 + 1)
    response = np.fft.rfft(taps, size).reshape(shape)
    return np.fft.irfft(np.fft.rfft(e, size) * response, size)[..., : e.shape[-1]]


def unsteadiness(innovations: Float[np.ndarray, "R N"], known: Bool[np.ndarray, "R N"]) -> float:
    """By how many standard errors the colours of short stretches of noise differ from that of all
    of it. Each stretch's periodogram over the mean of all is exponential where the noise is
    stationary, whatever its colour, so that its mean square is twice the square of its mean; what
    swings at a frequency that changes, as a machine that runs up, has all its power in few of them.

    Source: Brockwell and Davis, Time Series: Theory and Methods (1991), section 10.3, for the
    distribution; after Priestley and Subba Rao, A test for non-stationarity of time-series (1969).
    """
    rows = [
        row[at : at + _STRETCH]
        for row, use in zip(innovations, known, strict=True)
        for at in range(0, len(row) - _STRETCH + 1, _STRETCH)
        if use[at : at + _STRETCH].all()
    ]
    if len(rows) < _FEWEST:
        return 0.0
    power = np.abs(np.fft.rfft(np.stack(rows), axis=1)[:, 1 : _STRETCH // 2]) ** 2
    power /= np.maximum(power.mean(axis=1, keepdims=True), 1e-300)  # a louder stretch is no colour
    ratio = power / np.maximum(power.mean(axis=0), 1e-300)
    peaked = np.mean(ratio**2, axis=1) / np.maximum(np.mean(ratio, axis=1) ** 2, 1e-300)
    n = ratio.shape[1]
    usual = 2.0 * n / (n + 1.0)
    return float((np.minimum(peaked, _CAPPED).mean() - usual) * np.sqrt(len(rows) * n / 4.0))
