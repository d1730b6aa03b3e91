"""What the noise of a channel is known by: its own residual, runs with the same commands, or a
reference.

A colour that every hypothesis estimates from its own residual is always at hand, and takes what is
slow for noise that is slow. Two runs with the same commands answer alike but for their starts and
their noise, so their difference over the square root of two shows the noise without any model. A
reference is noise that was seen elsewhere: at rest, or on another day.
"""

from abc import ABC, abstractmethod
from collections.abc import Hashable, Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Complex, Float

from ...errors import InputError
from .colour import autoregression, filter_length, forgetting, predicted
from .windows import slow_part

_SAME = 0.01  # rms difference of commands, of their spread, up to which they are the same
_SHARED = 0.6  # of the shorter run, that both must have
_SHORTEST = 10.0  # s, likewise
PER_LAG = 20
"""Samples of noise for each coefficient of its colour."""
_MANY = 1_000_000  # samples, of which a colour has all of its coefficients
_SETTLES = 2.0  # time constants of the plant, after which a start is nearly forgotten
_STARTS = (0.5, 1.0, 2.0)  # time constants in which the rest of it dies away
_NOTHING = 1e-9  # of a response's spread: logs that do not differ are one log


class Noise(ABC):
    """The noise of a channel.

    Attributes:
        by: what tells it: `own`, `brief`, `repeat` or `reference`.
        std: standard deviation, in the channel's unit; None where the residual tells it.
        slow: the same of its slow part, as far as it is known.
    """

    by: str
    std: float | None
    slow: float

    @abstractmethod
    def colours(
        self, left: Float[np.ndarray, "H R N"], mask: Bool[np.ndarray, "R N"], order: int
    ) -> Float[np.ndarray, "H order"]:
        """Coefficients of the whitening filter of each hypothesis, whose residual is `left`."""

    @abstractmethod
    def innovations(
        self, spectra: Complex[np.ndarray, "H R F"], order: int
    ) -> Float[np.ndarray, " H"]:
        """Sum of squares of residuals, told by their `colour.spectrum`, once they are whitened."""


class OwnNoise(Noise):
    """Each hypothesis has the colour of its own residual."""

    by = "own"
    std = None
    slow = 0.0

    def colours(self, left, mask, order):
        return autoregression(left, mask, order)

    def innovations(self, spectra, order):
        return predicted(spectra, order)[1]


class BriefNoise(Noise):
    """Each hypothesis has the colour of its own residual, but with a memory of some seconds at the
    most: what lasts longer is no noise, and the hypothesis has to answer for it."""

    by = "brief"
    std = None
    slow = 0.0

    def __init__(self, memory: float, dt: float):
        """Of a memory in s; `dt`: sample period, s."""
        self._memory, self._dt = memory, dt

    def colours(self, left, mask, order):
        return autoregression(left, mask, order) * forgetting(order, self._memory, self._dt)

    def innovations(self, spectra, order):
        kept = forgetting(order, self._memory, self._dt)
        return _filtered(spectra, predicted(spectra, order)[0] * kept)


class KnownNoise(Noise):
    """One colour for all hypotheses."""

    def __init__(
        self,
        samples: Float[np.ndarray, "R N"],
        counted: Bool[np.ndarray, "R N"],
        dt: float,
        by: str,
    ):
        """Of samples of the noise.

        Args:
            samples: (runs, N), zero where there is none; `counted`: where there is.
            dt: sample period, s.
            by: `repeat` or `reference`.
        """
        self.samples, self.counted, self.dt, self.by = samples, counted, dt, by
        self._coefficients: dict[int, np.ndarray] = {}
        self.std = float(np.sqrt(np.mean(samples[counted] ** 2)))
        self.slow = _slow(samples, counted, dt)

    @classmethod
    def reference(cls, samples: Float[np.ndarray, "*runs N"], dt: float) -> "KnownNoise":
        """Noise that was seen elsewhere, in one or more stretches.

        Args:
            samples: in the channel's SI unit.
            dt: sample period, s.

        Raises:
            InputError: not finite, constant, or too short for a colour.
        """
        rows = np.atleast_2d(np.asarray(samples, float))
        if not np.isfinite(rows).all() or not np.std(rows) > 0.0:
            problem = "noise that is constant, or not finite"
            raise InputError("reference", "samples", problem, "give what a sensor tells at rest")
        least = PER_LAG * filter_length(dt, _MANY)
        if rows.shape[1] < least:
            problem = f"{rows.shape[1]} samples of noise are too few for its colour"
            raise InputError("reference", "samples", problem, f"give at least {least} in a row")
        rows = rows - rows.mean(axis=1, keepdims=True)
        return cls(rows, np.ones(rows.shape, bool), dt, "reference")

    def at(self, dt: float) -> "KnownNoise":
        """The same where every so many samples are looked at.

        Raises:
            InputError: not a multiple of its own sample period.
        """
        every = round(dt / self.dt)
        if every < 1 or not np.isclose(every * self.dt, dt, rtol=1e-3):
            problem = f"noise that was sampled every {self.dt:g} s does not tell that of {dt:g} s"
            raise InputError("reference", "dt", problem, "sample it as the logs, or faster")
        return KnownNoise(self.samples[:, ::every], self.counted[:, ::every], dt, self.by)

    def coefficients(self, order: int) -> Float[np.ndarray, " order"]:
        """Of its whitening filter; of few samples only as many as they tell."""
        if order not in self._coefficients:
            told = max(1, min(order, int(self.counted.sum()) // PER_LAG))
            own = autoregression(self.samples[None], self.counted, told)[0]
            self._coefficients[order] = np.pad(own, (0, order - told))
        return self._coefficients[order]

    def colours(self, left, mask, order):
        return np.tile(self.coefficients(order), (len(left), 1))

    def innovations(self, spectra, order):
        return _filtered(spectra, self.coefficients(order))


def _slow(samples: Float[np.ndarray, "R N"], counted: Bool[np.ndarray, "R N"], dt: float) -> float:
    """Standard deviation of the slow part of noise."""
    slow = slow_part(np.where(counted, samples, 0.0), dt)
    return float(np.sqrt(np.mean(slow[counted] ** 2)))


def _filtered(
    spectra: Complex[np.ndarray, "H R F"], coefficients: Float[np.ndarray, "*H order"]
) -> Float[np.ndarray, " H"]:
    """Sum of squares behind whitening filters."""
    size = 2 * (spectra.shape[-1] - 1)
    taps = np.concatenate([np.ones((*coefficients.shape[:-1], 1)), -coefficients], axis=-1)
    weights = np.abs(np.fft.rfft(taps, size)) ** 2
    power = np.sum(np.abs(spectra) ** 2, axis=1) * weights
    return np.fft.irfft(power)[:, 0]


@dataclass(frozen=True)
class Pair:
    """Two runs with the same commands.

    Attributes:
        one, other: their numbers.
        first, begin: the row of each where they begin to agree; `rows`: over how many they do.
    """

    one: int
    other: int
    first: int
    begin: int
    rows: int

    def difference(self, x: np.ndarray) -> Float[np.ndarray, " rows"]:
        """Of a signal in both over the square root of two, which is as large as its noise."""
        a, b = self.cut(x)
        return (a - b) / np.sqrt(2.0)

    def both(self, known: Bool[np.ndarray, "R N"]) -> Bool[np.ndarray, " rows"]:
        """Rows that are known in both."""
        a, b = self.cut(known)
        return a & b

    def cut(self, x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Of either run of a signal (runs, N) the rows where they agree."""
        a, b = x[self.one, self.first :], x[self.other, self.begin :]
        return a[: self.rows], b[: self.rows]


def differences(found: Sequence[Pair], x: Float[np.ndarray, "R N"]) -> Float[np.ndarray, "P N"]:
    """`Pair.difference` of a signal for each pair, zero beyond its rows."""
    rows = np.zeros((len(found), x.shape[1]))
    for row, pair in zip(rows, found, strict=True):
        row[: pair.rows] = pair.difference(x)
    return rows


def shared(found: Sequence[Pair], known: Bool[np.ndarray, "R N"]) -> Bool[np.ndarray, "P N"]:
    """`Pair.both` for each pair, likewise."""
    rows = np.zeros((len(found), known.shape[1]), bool)
    for row, pair in zip(rows, found, strict=True):
        row[: pair.rows] = pair.both(known)
    return rows


def slow_noise(
    found: Sequence[Pair], x: Float[np.ndarray, "R N"], known: Bool[np.ndarray, "R N"], dt: float
) -> float:
    """Standard deviation of what is slow in a signal and does not come again in repeats: wind,
    rough ground and loads are another each time. Zero where there are none."""
    both = shared(found, known)
    return _slow(differences(found, x), both, dt) if both.any() else 0.0


def pairs(
    commands: Float[np.ndarray, "C R N"],
    known: Bool[np.ndarray, "R N"],
    logs: Sequence[Hashable],
    dt: float,
) -> tuple[Pair, ...]:
    """Runs with the same commands, each with the first that it repeats.

    Args:
        commands: all that a run was told.
        known: where something was measured.
        logs: which one each is a part of. Parts of one that go round in the same way are no
            repeats: what changes while it lasts is no noise.
        dt: sample period, s.
    """
    found = []
    stops = [int(np.flatnonzero(use).max()) + 1 if use.any() else 0 for use in known]
    for j in range(len(stops)):
        for i in (i for i in range(j) if logs[i] != logs[j]):
            shift = _shift(commands[:, i, : stops[i]], commands[:, j, : stops[j]])
            first, begin = max(shift, 0), max(-shift, 0)
            rows = min(stops[i] - first, stops[j] - begin)
            if rows < max(_SHARED * min(stops[i], stops[j]), _SHORTEST / dt):
                continue
            pair = Pair(i, j, first, begin, rows)
            parts = [pair.cut(u) for u in commands]
            spreads = [float(np.std(a)) for a, _ in parts]
            far = [float(np.sqrt(np.mean((a - b) ** 2))) for a, b in parts]
            same = all(f <= _SAME * s + 1e-12 for f, s in zip(far, spreads, strict=True))
            if same and max(spreads) > 0.0:
                found.append(pair)
                break
    return tuple(found)


def repeated(
    found: Sequence[Pair],
    y: Float[np.ndarray, "R N"],
    known: Bool[np.ndarray, "R N"],
    slow: float,
    dt: float,
) -> KnownNoise | None:
    """The noise of a response by the runs that have the same commands; None where none have.

    Args:
        found: these runs.
        y: response; `known`: where it was measured.
        slow: about the slowest time constant of the plant, s, in which a start is forgotten.
        dt: sample period, s.
    """
    spread = max((float(np.std(row[use])) for row, use in zip(y, known, strict=True)), default=0.0)
    samples, counted = differences(found, y), shared(found, known)
    t = dt * np.arange(y.shape[1])
    starts = np.exp(-t / slow / np.array(_STARTS)[:, None]).T
    for row, use, pair in zip(samples, counted, found, strict=True):
        use[: min(round(_SETTLES * slow / dt), pair.rows // 4)] = False
        row[use] -= starts[use] @ np.linalg.lstsq(starts[use], row[use], rcond=1e-9)[0]
        use &= bool(use.sum() > _SHORTEST / dt and np.std(row[use]) > _NOTHING * spread)
        row[~use] = 0.0
    return KnownNoise(samples, counted, dt, "repeat") if counted.any() else None


def _shift(a: Float[np.ndarray, "C n"], b: Float[np.ndarray, "C m"]) -> int:
    """By how many rows the second must be moved to agree with the first, by correlation; none where
    that serves as well."""
    if not a.shape[1] or not b.shape[1]:
        return 0
    size = 1 << (a.shape[1] + b.shape[1]).bit_length()
    spread = np.std(a, axis=1, keepdims=True)
    spread[spread == 0.0] = np.inf  # what stands still tells no shift

    def sums(x: np.ndarray, y: np.ndarray) -> np.ndarray:
        """Of products over the rows that both have, at every shift."""
        return np.fft.irfft(np.fft.rfft(x, size) * np.conj(np.fft.rfft(y, size)), size)

    a, b = a / spread, b / spread
    ones = np.ones_like(a), np.ones_like(b)
    far = sums(a**2, ones[1]) + sums(ones[0], b**2) - 2.0 * sums(a, b)
    shared = sums(ones[0][:1], ones[1][:1])[0]
    enough = shared > _SHARED * min(a.shape[1], b.shape[1])
    error = np.where(enough, far.sum(axis=0) / np.maximum(shared, 1.0), np.inf)
    if error[0] <= error.min() + 1e-9:
        return 0
    best = int(np.argmin(error))
    return best if best < size // 2 else best - size
