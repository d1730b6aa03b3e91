"""From time stamps to an even grid: what the sample period is, whether the log is even, and how to
make it so.

Commands are held: between two rows the older one counts, and a sample is the mean of what is held
until the next, since a plant answers to that: a command that changes in between is not late.
Measurements are interpolated linearly; where the grid is coarser than the log, those on it are
taken as they are: a low-pass before would be taken for a part of the plant, whose command passes
none (Ljung, System Identification, 1999, section 14.4). So are samples that were even already.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int

_JITTERS, _OFF = 0.1, 0.01  # of the median step, from which on stamps jitter by much, and of the
# mean of the steps near it, by which a line through such stamps is off
_CLOSE, _BRIDGED = 1.75, 3.5  # samples between two rows, between which all are measured; of stamps
# that jitter, which leave some out, more: a colour of noise needs all of the past of a sample


@dataclass(frozen=True)
class Grid:
    """An even grid over one piece of a log, and where the rows of the piece lie on it.

    Attributes:
        start: time of its first sample, s.
        step: its spacing, s; a whole fraction of the sample period.
        every: how many of its points make one sample period (1 unless decimating).
        position: (rows,) of the rows in steps; whole numbers if `even`.
        even: whether the rows lie on the grid, up to the jitter that is tolerated.
    """

    start: float
    step: float
    every: int
    position: Float[np.ndarray, " rows"]
    even: bool

    @property
    def points(self) -> int:
        """Number of points of the grid."""
        return int(np.floor(self.position[-1] + 1e-6)) + 1

    @property
    def samples(self) -> int:
        """Number of samples that come of it."""
        return (self.points - 1) // self.every + 1

    @property
    def absent(self) -> Bool[np.ndarray, " samples"]:
        """Mask of samples on an even grid for which the log has no row."""
        mask = np.zeros(self.points, dtype=bool)
        if self.even:
            mask[:] = True
            mask[np.round(self.position).astype(int)] = False
        return mask[:: self.every]


def resolution(t: Float[np.ndarray, " N"]) -> Float[np.ndarray, " N"]:
    """Half a unit of the last digit that the time stamps were printed with, s.

    Logs print time with so many decimals or so many significant digits. Rounding is no jitter:
    stamps that are even up to it mean an even log.
    """
    scale = np.abs(t) + 1e-300
    exponent = np.floor(np.log10(scale))
    half = np.zeros_like(t)
    exact = 4.0 * np.finfo(float).eps * scale
    for decimals in range(10):
        if np.all(np.abs(np.round(t, decimals) - t) <= exact):
            half = np.maximum(half, 0.5 * 10.0**-decimals)
            break
    for digits in range(2, 12):
        unit = 10.0 ** (exponent - digits + 1)
        if np.all(np.abs(np.round(t / unit) * unit - t) <= exact):
            return np.maximum(half, 0.5 * unit)
    return half


def sample_period(t: Float[np.ndarray, " N"], breaks: Bool[np.ndarray, " N"]) -> float:
    """The period at which a log was sampled, s.

    The median of the differences says what is near; a least-squares line through the stamps over
    their rounded counts says it exactly, however coarsely they were printed, unless they jitter by
    much of a period. A rounder number replaces it if it moves no stamp by more than a hundredth of
    a period.

    Args:
        t: (N,) stamps, s, increasing inside each piece.
        breaks: (N,) true where a new run or piece starts.

    Raises:
        ValueError: no two stamps belong together.
    """
    steps = np.diff(t)[~breaks[1:]]
    if steps.size == 0:
        raise ValueError("no two rows belong together")
    median = float(np.quantile(steps, 0.5, method="lower"))  # one of them, near which there is one
    near = steps[(steps > 0.5 * median) & (steps < 1.5 * median)]
    period = usual = float(np.mean(near))
    counts = np.concatenate([[0.0], np.round(np.diff(t) / usual)])
    counts[breaks | (counts > 1000.0)] = 0.0
    fresh = np.flatnonzero(breaks | (counts == 0.0))
    lengths = np.diff(np.append(fresh, t.size))
    index = np.cumsum(counts)
    index -= np.repeat(index[fresh], lengths)
    start = np.repeat(t[fresh], lengths)
    if np.any(index > 0.0):
        mean_index = np.repeat(np.add.reduceat(index, fresh) / lengths, lengths)
        mean_time = np.repeat(np.add.reduceat(t - start, fresh) / lengths, lengths)
        centred = index - mean_index
        period = float(np.sum(centred * (t - start - mean_time)) / np.sum(centred**2))
    if abs(period - usual) > _OFF * usual and np.std(near) > max(
        _JITTERS * median, 4.0 * float(resolution(t).max())
    ):
        return usual  # which step is how many periods is not told
    return rounded(period, 0.01 * period / max(float(index.max()), 1.0))


def rounded(value: float, tolerance: float) -> float:
    """The number with the fewest digits within `tolerance`."""
    for digits in range(1, 16):
        candidate = float(f"{value:.{digits}g}")
        if abs(candidate - value) <= tolerance:
            return candidate
    return value


def make_grid(t: Float[np.ndarray, " rows"], logged: float, dt: float, jitter: float) -> Grid:
    """Lay an even grid over one piece.

    Args:
        t: (rows,) stamps of the piece, s, increasing.
        logged: period at which the log was sampled, s.
        dt: period that is wanted, s.
        jitter: share of a step by which stamps may lie off it.
    """
    every = max(1, round(dt / logged))
    step = dt / every
    counts = np.concatenate([[0.0], np.cumsum(np.maximum(np.round(np.diff(t) / step), 1.0))])
    start = float(t[0] + np.median(t - t[0] - counts * step))
    off = np.abs(t - start - counts * step)
    if off.max() <= jitter * step or np.all(off <= 1.01 * resolution(t) + 1e-9 * step):
        return Grid(start, step, every, counts, True)
    return Grid(float(t[0]), step, every, (t - t[0]) / step, False)


def hold(grid: Grid, values: Float[np.ndarray, " rows"]) -> Float[np.ndarray, " samples"]:
    """A command on the grid: the mean, from each sample to the next, of the last row."""
    first = values[_row_before(grid)][:: grid.every]
    if grid.even and grid.every == 1:
        return first
    last = max(grid.samples * grid.every, grid.position[-1] + 1.0)
    knots = np.append(grid.position, last)
    total = np.concatenate([[0.0], np.cumsum(values * np.diff(knots))])
    edges = grid.every * np.arange(grid.samples + 1)
    mean = np.diff(np.interp(edges, knots, total)) / grid.every
    return np.where(np.abs(mean - first) > 1e-9 * np.ptp(values), mean, first)  # up to rounding


def interpolate(
    grid: Grid, values: Float[np.ndarray, " rows"], known: Bool[np.ndarray, " rows"]
) -> Float[np.ndarray, " samples"]:
    """A measurement on the grid: linear between the rows in which it is known; of one that has
    several rows for each point of an uneven grid, the mean from halfway before to halfway
    behind."""
    there, rows = np.flatnonzero(known), np.arange(known.size)
    first, last = (there[0], there[-1]) if there.size else (known.size, 0)
    used = known | (rows <= first) | (rows >= last)  # with what fills in its ends
    own, values, points = grid.position[used], values[used], np.arange(0, grid.points, grid.every)
    uneven = not grid.even and own.size > 1
    many = round(1.0 / max(float(np.median(np.diff(own))), 1e-3)) if uneven else 1
    if many < 2:
        return np.interp(points, own, values)
    within = (np.arange(2 * many) + 0.5) / (2 * many) - 0.5
    return np.mean([np.interp(points + part, own, values) for part in within], axis=0)


def measured(grid: Grid, known: Bool[np.ndarray, " rows"]) -> Bool[np.ndarray, " samples"]:
    """Samples that rows tell in which a channel was measured: the nearest of each such row, and
    those between two rows that are hardly farther apart than samples are."""
    own = grid.position[known] / grid.every
    told = np.zeros(grid.samples, dtype=bool)
    told[np.clip(np.round(own).astype(int), 0, grid.samples - 1)] = True
    apart = np.diff(own, prepend=-np.inf, append=np.inf)  # nothing is before the first and behind
    close = _CLOSE if grid.even else _BRIDGED
    return told | (apart[np.searchsorted(own, np.arange(grid.samples))] < close)


def _row_before(grid: Grid) -> Int[np.ndarray, " points"]:
    return np.searchsorted(grid.position, np.arange(grid.points) + 1e-6, side="right") - 1
