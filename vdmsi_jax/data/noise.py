"""How noisy a measured channel is, told from the channel alone, without a model of what moved
it."""

import math

import numpy as np
from jaxtyping import Float

_ORDERS = range(2, 7)
_MAD_TO_STD = 1.0 / 0.6744897501960817  # of a normal distribution


def white_noise_std(pieces: list[Float[np.ndarray, " _"]]) -> float:
    """Standard deviation of the white part of the noise on a smoothly moving signal.

    Repeated differences remove smooth motion (the k-th difference of a polynomial of lower degree
    is zero) and leave white noise of variance σ² with variance σ²·(2k choose k). Their spread is
    taken as the median absolute deviation, so that steps, kinks and outliers do not count. Too low
    an order leaves motion in, so the smallest estimate over the orders 2 to 6 is the answer. Where
    more than half of the differences vanish (quantised or repeated samples), their root mean square
    takes the place of the median. Noise that is coloured below the sampling frequency passes for
    motion: the answer is then a lower bound.

    Source: difference-based variance estimators, von Neumann (1941), Gasser, Sroka and
    Jennen-Steinmetz (1986), Hall, Kay and Titterington (1990); the median absolute deviation as in
    Rousseeuw and Croux (1993).

    Args:
        pieces: stretches of evenly spaced samples, each without a gap; differences are taken inside
            each.

    Returns:
        The standard deviation in the unit of the samples; NaN if no piece is longer than the
        highest order.
    """
    estimates = []
    for order in _ORDERS:
        differences = [np.diff(piece, order) for piece in pieces if piece.size > _ORDERS[-1]]
        if not differences:
            return math.nan
        spread = np.concatenate(differences)
        median = _MAD_TO_STD * float(np.median(np.abs(spread)))
        scale = median if median > 0.0 else float(np.sqrt(np.mean(spread**2)))
        estimates.append(scale / math.sqrt(math.comb(2 * order, order)))
    return min(estimates)
