"""A quick global look: which lag and delay a first-order response would have.

It sets the unit of time and the delays from which the real search starts; the loss over the delay
has several minima, so all of them are looked at, by correlation.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

_LAGS = 24  # time constants tried, from half a sample to a quarter of the record
_LONGEST = 1 << 15  # samples of a segment that are looked at in one
_NOTHING = 1e-12  # of the largest energy, what a response has that is none
_ROUNDED = 1e-24  # of an output's square, what is left of a constant one
_WORSE = 0.5  # a second delay is tried if it leaves at most this much more unexplained


@dataclass(frozen=True)
class FirstLook:
    """`lag` in samples; `delays` in samples, the best first; `explained` the share of the output's
    squared deviation that the best of them explains."""

    lag: float
    delays: tuple[int, ...]
    explained: float


def _pieces(
    u: list[Floats], y: list[Floats], counts: list[NDArray[np.bool_]]
) -> Iterator[tuple[Floats, Floats, NDArray[np.bool_]]]:
    """The segments in pieces of no more samples than are looked at in one, those of which any
    count."""
    for us, ys, use in zip(u, y, counts, strict=True):
        for start in range(0, len(us), _LONGEST):
            part = slice(start, start + _LONGEST)
            if use[part].any():
                yield us[part], ys[part], use[part]


def first_look(
    u: list[Floats], y: list[Floats], counts: list[NDArray[np.bool_]], longest_delay: int
) -> FirstLook:
    """Correlate first-order responses with the output over all whole delays.

    **Arguments:** `u`, `y`: input and output of each segment, and which samples of the output
    count; `longest_delay` in samples.
    """
    lags = np.geomspace(0.5, max(len(s) for s in u) / 4, _LAGS)
    energy_y = size_y = 0.0
    cross = np.zeros((_LAGS, longest_delay + 1))
    energy_x = np.zeros((_LAGS, longest_delay + 1))
    for us, ys, use in _pieces(u, y, counts):
        n, known = len(us), int(use.sum())
        padded = np.concatenate([np.full(longest_delay, us[0]), us]) - us[0]
        size = 1 << int(np.ceil(np.log2(len(padded) + n)))
        target = np.where(use, ys - ys[use].mean(), 0.0)
        energy_y += float(target @ target)
        size_y += float(ys[use] @ ys[use])
        spectrum_y, spectrum_use = np.fft.rfft(target, size), np.fft.rfft(use, size)
        spectrum_u = np.fft.rfft(padded, size)
        shifts = longest_delay - np.arange(longest_delay + 1)
        for i, lag in enumerate(lags):
            # zero-order hold response of 1 / (lag s + 1): no answer in the sample of the command
            response = np.exp(-np.arange(n) / lag) * np.expm1(1 / lag) * (np.arange(n) > 0)
            x = np.fft.irfft(spectrum_u * np.fft.rfft(response, size), size)[: len(padded)]
            spectrum_x, squares = np.fft.rfft(x, size), np.fft.rfft(x**2, size)
            cross[i] += np.fft.irfft(np.conj(spectrum_y) * spectrum_x, size)[shifts]
            total = np.fft.irfft(np.conj(spectrum_use) * spectrum_x, size)[shifts]
            square = np.fft.irfft(np.conj(spectrum_use) * squares, size)[shifts]
            energy_x[i] += square - total**2 / known
    energy_x = np.where(energy_x > _NOTHING * energy_x.max(), energy_x, 0.0)
    if energy_y <= _ROUNDED * size_y:
        return FirstLook(float(lags[0]), (0,), 0.0)
    with np.errstate(divide="ignore", invalid="ignore"):
        explained = np.where(energy_x > 0, cross**2 / (energy_x * energy_y), 0.0)
    best = np.nan_to_num(explained.max(0))
    lag = lags[int(explained.max(1).argmax())]
    peaks = [
        i for i in range(len(best)) if best[i] == best[max(i - 1, 0) : i + 2].max() and best[i] > 0
    ]
    peaks.sort(key=lambda i: -best[i])
    good = [i for i in peaks if 1 - best[i] <= (1 - best[peaks[0]]) * (1 + _WORSE)][:2]
    return FirstLook(float(lag), tuple(good) or (0,), float(best.max()))
