"""How noisy a measured channel is, told from the channel alone, without a model of what moved
it."""

import math

import numpy as np
from jaxtyping import Float

_ORDERS = range(2, 7)
_SHARE = 0.8  # of the differences, the smallest ones, that count
_QUANTILE = 1.2815515655446004  # of |z|, z standard normal, below which that share lies
_DENSITY = math.exp(-0.5 * _QUANTILE**2) / math.sqrt(2.0 * math.pi)
_TRIMMED_VARIANCE = 1.0 - 2.0 * _QUANTILE * _DENSITY / _SHARE  # of z, given |z| below the quantile


def white_noise_std(pieces: list[Float[np.ndarray, " _"]]) -> float:
    """Standard deviation of the white part of the noise on a smoothly moving signal.

    Repeated differences remove smooth motion (the k-th difference of a polynomial of lower degree
    is zero) and leave white noise of variance σ² with variance σ²·(2k choose k). The root mean
    square of the smallest four fifths of them, put right for a normal distribution, is blind to
    steps, kinks and outliers, and yet sees the steps of a quantised signal. Too low an order leaves
    motion in, so the smallest estimate over the orders 2 to 6 is the answer. Noise that is coloured
    below the sampling frequency passes for motion: the answer is then a lower bound.

    Source: difference-based variance estimators, von Neumann (1941), Gasser, Sroka and
    Jennen-Steinmetz (1986), Hall, Kay and Titterington (1990).

    Args:
        pieces: stretches of evenly spaced samples, each without a gap; differences are taken inside
            each.

    Returns:
        The standard deviation in the unit of the samples; NaN if no piece is longer than the
        highest order.
    """
    long = [piece for piece in pieces if piece.size > _ORDERS[-1]]
    if not long:
        return math.nan
    estimates = []
    for order in _ORDERS:
        squares = np.concatenate([np.diff(piece, order) for piece in long]) ** 2
        count = max(1, math.ceil(_SHARE * squares.size))
        smallest = np.partition(squares, count - 1)[:count]
        variance = float(np.mean(smallest)) / _TRIMMED_VARIANCE
        estimates.append(math.sqrt(variance / math.comb(2 * order, order)))
    return min(estimates)
