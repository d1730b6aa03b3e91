"""Does an error repeat with the way, or with the place: the cogging of a motor, a wheel, a gear or
an encoder out of round?

Its frequency goes with the speed, so that no disturbance of one frequency tells it. Counted over
the way instead of over time it is a line of the spectrum; likewise over the place, where the
response is one.

Source: Fyfe and Munck, Analysis of computed order tracking (Mechanical Systems and Signal
Processing 11, 1997).
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float

_TURNS = 10  # in the longest run, at the least
_SURE = (45.0, 1.5)  # power of a line over that of white noise, and over that of the best line over
# time: logs without reach 30 and 1.3, cogging of two blind exams 94 and 103, and 6 to 10
_TURNS_IN_PLACE = 4  # from the least place to the greatest; below, any bend has them
_SURE_IN_PLACE = (90.0, 2.0)  # likewise, the second over lines of fewer turns, too: logs without
# reach 25 and 1.2, detents of a blind exam 598, and 8


@dataclass(frozen=True)
class Line:
    """What repeats.

    Attributes:
        period: way after which it does, or how far the places are apart.
        share: of the squared error, that it is.
    """

    period: float
    share: float


def line_over(
    way: Float[np.ndarray, "R N"],
    residual: Float[np.ndarray, "R N"],
    innovations: Float[np.ndarray, "R N"],
    use: Bool[np.ndarray, "R N"],
    dt: float,
    place: bool = False,
) -> Line | None:
    """The line of an error over the way, where it is sure. Each run begins at a phase of its own.

    Args:
        way: that was travelled since a run began.
        residual: the error; `innovations`: the same whitened.
        use: samples that count.
        dt: sample period, s.
        place: whether `way` is a place, to which one comes back, and with which an error may bend.
    """
    turns, (least, times) = (_TURNS_IN_PLACE, _SURE_IN_PLACE) if place else (_TURNS, _SURE)
    t = np.broadcast_to(dt * np.arange(way.shape[1]), way.shape)
    over_way, longest = _spectrum(way, innovations, use)
    if longest <= 0.0:
        return None
    over_time, _ = _spectrum(t, innovations, use)
    few = 2 * turns
    at = few + int(np.argmax(over_way[few:]))
    power, other = over_way[at], float(over_time[few:].max(initial=0.0))
    if place:
        other = max(other, float(over_way[1:few].max()))
    if power < least or power < times * other:
        return None
    share = 2.0 * float(_spectrum(way, residual, use)[0][at]) / float(use.sum())
    return Line(2.0 * longest / at, min(share, 1.0))


def _spectrum(
    over: Float[np.ndarray, "R N"], x: Float[np.ndarray, "R N"], use: Bool[np.ndarray, "R N"]
) -> tuple[Float[np.ndarray, " lines"], float]:
    """Powers of the lines `k / (2 longest)` of a signal over a quantity, of all runs together, one
    for each run where it is white; and the longest run in that quantity."""
    runs = [(s[on], row[on]) for s, row, on in zip(over, x, use, strict=True) if on.any()]
    longest = max((float(np.ptp(s)) for s, _ in runs), default=0.0)
    cells = 1 << max(over.shape[1] - 1, 4 * _TURNS).bit_length()
    power = np.zeros(cells // 2 + 1)
    if longest <= 0.0:
        return power, 0.0
    square = max(float(np.mean(x[use] ** 2)), 1e-300)
    for s, row in runs:
        cell = np.minimum(((s - s.min()) * (0.5 * cells / longest)).astype(int), cells - 1)
        summed = np.bincount(cell, weights=row, minlength=cells)
        power += np.abs(np.fft.rfft(summed)) ** 2 / (square * len(row))
    return power, longest
