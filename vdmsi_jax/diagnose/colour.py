"""The colour of noise: autoregressive whitening, estimated from residuals of several runs."""

import numpy as np
from jaxtyping import Bool, Float

LENGTH = 0.6
"""How much of the past a whitening filter sees, s."""

_MOST, _LEAST = 30, 6


def filter_length(dt: float, samples: int) -> int:
    """Order of the autoregression for a sample period and a number of samples."""
    wanted = int(np.clip(round(LENGTH / dt), _LEAST, _MOST))
    return max(1, min(wanted, samples // 40))


def autoregression(
    e: Float[np.ndarray, "H R N"], mask: Bool[np.ndarray, "R N"], order: int
) -> Float[np.ndarray, "H order"]:
    """Coefficients of the Yule-Walker prediction `e[k] ~ sum a[j] e[k-1-j]`, for each of H residuals
    over R runs; samples outside the mask count as zero.

    Source: Brockwell and Davis, Time Series: Theory and Methods (1991), section 8.1.
    """
    H = e.shape[0]
    size = 1 << (e.shape[2] + order).bit_length()
    spectrum = np.fft.rfft(np.where(mask, e, 0.0), size)
    power = np.sum(np.abs(spectrum) ** 2, axis=1)
    covariance = np.fft.irfft(power, size)[:, : order + 1]
    covariance[:, 0] = covariance[:, 0] * (1 + 1e-9) + 1e-300
    lags = np.abs(np.arange(order)[:, None] - np.arange(order)[None, :])
    matrices = covariance[:, lags]
    return np.linalg.solve(matrices, covariance[:, 1:, None]).reshape(H, order)


def whiten(
    e: Float[np.ndarray, "H ... N"], coefficients: Float[np.ndarray, "H order"]
) -> Float[np.ndarray, "H ... N"]:
    """Innovations `e[k] - sum a[j] e[k-1-j]`; the first `order` of each run are not usable."""
    H, order = coefficients.shape
    taps = np.concatenate([np.ones((H, 1)), -coefficients], axis=1)
    size = 1 << (e.shape[-1] + order).bit_length()
    shape = (H, *(1,) * (e.ndim - 2), size // 2 + 1)
    response = np.fft.rfft(taps, size).reshape(shape)
    return np.fft.irfft(np.fft.rfft(e, size) * response, size)[..., : e.shape[-1]]
