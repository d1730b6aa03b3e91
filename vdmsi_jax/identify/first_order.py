"""A quick global look: which lag and delay a first-order response would have.

It sets the unit of time and the delays from which the real search starts; the loss over the delay
has several minima, so all of them are looked at, by correlation.
"""

from dataclasses import dataclass

import numpy as np

from vdmsi_jax.identify.result import Floats

_LAGS = 24  # time constants tried, from half a sample to a quarter of the record
_LONGEST = 1 << 15  # samples of a segment that are looked at
_WORSE = 0.5  # a second delay is tried if it leaves at most this much more unexplained


@dataclass(frozen=True)
class FirstLook:
    """`lag` in samples; `delays` in samples, the best first."""

    lag: float
    delays: tuple[int, ...]


def first_look(u: list[Floats], y: list[Floats], longest_delay: int) -> FirstLook:
    """Correlate first-order responses with the output over all whole delays.

    **Arguments:** `u`, `y`: input and output of each segment; `longest_delay` in samples.
    """
    lags = np.geomspace(0.5, max(len(s) for s in u) / 4, _LAGS)
    explained = np.zeros((_LAGS, longest_delay + 1))
    energy_y = 0.0
    cross = np.zeros((_LAGS, longest_delay + 1))
    energy_x = np.zeros((_LAGS, longest_delay + 1))
    for us, ys in zip(u, y, strict=True):
        us, ys = us[:_LONGEST], ys[:_LONGEST]
        n = len(us)
        padded = np.concatenate([np.full(longest_delay, us[0]), us])
        size = 1 << int(np.ceil(np.log2(len(padded) + n)))
        target = ys - ys.mean()
        energy_y += target @ target
        spectrum_y = np.fft.rfft(target, size)
        spectrum_u = np.fft.rfft(padded - us[0], size)
        for i, lag in enumerate(lags):
            # zero-order hold response of 1 / (lag s + 1): no answer in the sample of the command
            response = np.exp(-np.arange(n) / lag) * np.expm1(1 / lag) * (np.arange(n) > 0)
            x = np.fft.irfft(spectrum_u * np.fft.rfft(response, size), size)[: len(padded)]
            shifts = longest_delay - np.arange(longest_delay + 1)
            spectrum_x = np.fft.rfft(x, size)
            correlation = np.fft.irfft(np.conj(spectrum_y) * spectrum_x, size)
            total, squares = np.cumsum(np.append(0.0, x)), np.cumsum(np.append(0.0, x**2))
            cross[i] += correlation[shifts]
            mean = (total[shifts + n] - total[shifts]) / n
            energy_x[i] += squares[shifts + n] - squares[shifts] - n * mean**2
    with np.errstate(divide="ignore", invalid="ignore"):
        explained = np.where(energy_x > 0, cross**2 / (energy_x * energy_y), 0.0)
    best = np.nan_to_num(explained.max(0))
    lag = lags[int(explained.max(1).argmax())]
    peaks = [
        i for i in range(len(best)) if best[i] == best[max(i - 1, 0) : i + 2].max() and best[i] > 0
    ]
    peaks.sort(key=lambda i: -best[i])
    good = [i for i in peaks if 1 - best[i] <= (1 - best[peaks[0]]) * (1 + _WORSE)][:2]
    return FirstLook(float(lag), tuple(good) or (0,))
