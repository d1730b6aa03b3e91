"""Where a lightly damped pair of poles would explain most of what an order leaves.

The loss over the frequency of a pair has a minimum wherever the residual has a line that the
command could have excited, so a search that starts from a few fixed frequencies misses most of
them. What a pair at p answers is a sum of the held command under exp(p t); its product with the
residual is, for all frequencies at once, the Fourier transform of their damped correlation.
"""

import numpy as np
from jaxtyping import Float

_LASTS = (0.5, 0.1, 0.02)  # how long a pair may ring, as shares of the record
_LONGEST = 2**15  # samples that are looked at


def promising_pairs(
    command: Float[np.ndarray, " n"],
    residual: Float[np.ndarray, " n"],
    dt: float,
    numerator: Float[np.ndarray, " b"],
    denominator: Float[np.ndarray, " a"],
    zeros: int,
    count: int,
) -> list[complex]:
    """The upper one of each pair of poles that promises most, best first.

    Args:
        command: held from sample to sample.
        residual: what the plant leaves.
        dt: sampling period.
        numerator, denominator: of the plant that is to get the pair, highest power first.
        zeros: how many come with it: none, so that the plant tells the phase, or two.
        count: how many are wanted.
    """
    u, e = command[:_LONGEST], residual[:_LONGEST]
    length = 2 ** int(np.ceil(np.log2(2 * e.size)))
    U, E = np.fft.rfft(u - u.mean(), length), np.fft.rfft(e, length)
    across = np.fft.irfft(E * np.conj(U), length)[: e.size]  # at lags 0, 1, ...
    own = np.fft.irfft(np.abs(U) ** 2, length)[: e.size]
    lag = np.arange(e.size)
    turns = 2.0 * np.pi * np.arange(1, length // 2) / length
    found: list[tuple[float, complex]] = []
    for share in _LASTS:
        rate = 1.0 / (share * e.size)
        damped = np.exp(-rate * lag)
        # sums over lags of exp((-rate + 1j turn) lag), so conjugate transforms
        product = np.conj(np.fft.rfft(across * damped, length))[1:-1]
        square = 2.0 * np.fft.rfft(own * damped, length)[1:-1].real - own[0]
        size = np.maximum(square, 1e-9 * own[0]) / (2.0 * rate)
        for turned in (turns, 2.0 * np.pi - turns):  # beyond what the sampling shows, mirrored
            p = (-rate + 1j * turned) / dt
            mirrored = product if turned is turns else np.conj(product)
            if zeros == 0:
                phase = np.polyval(numerator, p) / np.polyval(denominator, p)
                phase = phase * (1.0 - np.exp(-p * dt)) / (1j * p)
                turned_to = mirrored * phase / np.maximum(np.abs(phase), 1e-300)
                gain = 2.0 * turned_to.real**2 / size
            else:
                gain = 2.0 * np.abs(mirrored) ** 2 / size
            inner = np.flatnonzero((gain[1:-1] >= gain[:-2]) & (gain[1:-1] >= gain[2:])) + 1
            best = inner[np.argsort(-gain[inner])][:count]
            found += [(float(gain[k]), complex(p[k])) for k in best]
    found.sort(key=lambda pair: -pair[0])
    kept: list[complex] = []
    for _, p in found:
        if all(abs(p.imag - other.imag) * dt * e.size > 3.0 for other in kept):
            kept.append(p)
    return kept[:count]
