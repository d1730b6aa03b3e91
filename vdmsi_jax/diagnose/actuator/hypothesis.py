"""Hypotheses about a plant: what they answer, and what is left of the measurement under them, white
and with the best free states taken out."""

from collections.abc import Iterable, Sequence, Set
from dataclasses import dataclass, field, replace

import numpy as np
from jaxtyping import Bool, Float

from ..signals.colour import whiten
from . import swing
from .free_response import begun, mode
from .lanes import FEED, FIRST_CAUSE, LEADS, POLES
from .stage import Stage

_STEP = 1e-4  # of a parameter's usual size, for differences
_ROUNDING = 1e-11  # of a response, below which a difference is that of rounding
BEYOND = 8  # reaches of the whitening filter, over which residuals count as one sample
GROWTH = 0.3
"""Exponent by which a response may grow over a run for a pole in the right half plane: as much as
an integrator's is off by noise. Beyond that the pole makes up for what the plant lacks."""
FREE_STATE = 0.3  # prior standard deviation of a state at the start, of the response's range


@dataclass(frozen=True, eq=False)
class Hypothesis:
    """Which parameters of a stage are free, and their values.

    Attributes:
        poles, zeros: order of the plant.
        active: numbers of the causes that are on.
        theta: the vector.
        swing: sine and cosine of a periodic disturbance, each run's own; in `theta` they are off.
    """

    poles: int
    zeros: int
    active: tuple[int, ...]
    theta: Float[np.ndarray, " P"]
    swing: Float[np.ndarray, "R 2"] | None = None

    def free(self, stage: Stage) -> np.ndarray:
        """Numbers of the free parameters."""
        a = list(range(self.poles))
        first = max(self.poles - 1 - self.zeros, 0)
        b = list(range(POLES + first, POLES + self.poles)) + self._feed
        slots = [stage.slots[number] for number in self.active]
        forced = any(slot.forces for slot in slots)
        lead = [LEADS[0]] if forced and self.poles > 1 else []
        lead += [LEADS[1]] if forced and self.poles > 2 and self.theta[LEADS[1]] != 0.0 else []
        own = [i for s in slots for i in (s.index[:1] if s.cause == swing.CAUSE else s.index)]
        return np.array(a + b + lead + own)

    def size(self, stage: Stage) -> int:
        """How many parameters it has, a swing's two among them."""
        return len(self.free(stage)) + 2 * (self.frequency(stage) is not None)

    def frequency(self, stage: Stage) -> float | None:
        """Of the periodic disturbance, Hz; None where there is none."""
        number = swing.number_of(stage, self.active)
        return None if number is None else float(self.theta[stage.slots[number].index[0]])

    @property
    def den(self) -> Float[np.ndarray, " n"]:
        """Denominator of the plant, highest power first, in units of its pace."""
        return np.concatenate([[1.0], self.theta[: self.poles]])

    @property
    def num(self) -> Float[np.ndarray, " m"]:
        """Numerator, likewise."""
        first = max(self.poles - 1 - self.zeros, 0)
        own = self.theta[POLES + first : POLES + self.poles]
        return np.concatenate([self.theta[self._feed], own])

    @property
    def _feed(self) -> list[int]:
        """Where the feed-through stands, if there is one."""
        return [FEED] if self.zeros == self.poles else []

    @property
    def order(self) -> str:
        """The paper's name of the order."""
        return f"P{self.poles}Z{self.zeros}"

    @property
    def kind(self) -> tuple[int, int, frozenset[int]]:
        """What two of one kind share: poles, zeros, and the causes that are on."""
        return self.poles, self.zeros, frozenset(self.active)

    @property
    def key(self) -> tuple:
        """What two that are the same share."""
        own = None if self.swing is None else self.swing.tobytes()
        return self.poles, self.zeros, self.active, self.theta.tobytes(), own


@dataclass(frozen=True, eq=False)
class Refit:
    """A hypothesis at its optimum.

    Attributes:
        hypothesis: with the values found.
        loglik: log-likelihood of the innovations, up to a constant that all share; and of the
            residual itself, a sample every few reaches of the whitening filter: an estimated colour
            takes an error that lasts for noise that hardly moves, and sees but its ends.
        y: (runs, N) simulated response, with the free response of the starts.
        simulated: (runs, N) without it.
        states: (N, n) response to the states at the start.
        colour: coefficients of its own whitening filter.
        variance: of the innovations.
        covariance: of the free parameters, by the last slopes.
    """

    hypothesis: Hypothesis
    loglik: float
    y: Float[np.ndarray, "R N"]
    simulated: Float[np.ndarray, "R N"]
    states: Float[np.ndarray, "N n"]
    colour: Float[np.ndarray, " order"]
    variance: float
    covariance: Float[np.ndarray, "p p"]

    def error(self, stage: Stage) -> float:
        """Mean squared residual of the samples that count in a fit."""
        return float(np.mean((stage.y - self.y)[stage.mask] ** 2))

    def adds_one_to(self, causes: Set[int]) -> bool:
        """Whether it has these causes, by their numbers, and just one more."""
        own = set(self.hypothesis.active)
        return causes < own and len(own) == len(causes) + 1


@dataclass
class Lane:
    """A hypothesis on its way. White is what has passed the whitening filter, zero where it does
    not count."""

    hypothesis: Hypothesis
    free: np.ndarray
    y: np.ndarray
    states: np.ndarray  # (N, n) free response of the plant to its states
    colour: np.ndarray
    damping: float = 1e-2
    cost: float = np.inf
    settled: bool = False
    slopes: np.ndarray | None = None  # (p, R, N) differences, None where they are wanted anew
    drift: float = 0.0  # gain since they were taken
    white_error: np.ndarray = field(default_factory=lambda: np.zeros((0, 0)))  # (R, N)
    energy: float = 0.0  # of it
    white_states: np.ndarray = field(default_factory=lambda: np.zeros((1, 0, 0)))
    white_slopes: np.ndarray | None = None

    def leave(self, white_error: np.ndarray) -> None:
        """Note what is left of the measurement, white."""
        self.white_error, self.energy = white_error, float(np.sum(white_error**2))


def responses(stage: Stage, hypotheses: Sequence[Hypothesis]) -> Float[np.ndarray, "L R N"]:
    """What hypotheses answer to the commands."""
    y = stage.simulate(np.stack([h.theta for h in hypotheses]))
    for own, h in zip(y, hypotheses, strict=True):
        frequency = h.frequency(stage)
        if frequency is not None and h.swing is not None:
            own += h.swing @ swing.columns(stage, frequency)
    return bounded(stage, y)


def sensitivities(
    stage: Stage, hypotheses: Sequence[Hypothesis], y: Sequence[np.ndarray]
) -> list[Float[np.ndarray, "p R N"]]:
    """Differences of the response with respect to the free parameters, about the responses `y`.

    What changes no response, as the lead of a force that is constant, has a difference of exactly
    zero: one of rounding would be a direction like any other, along which steps are huge.
    """
    if not hypotheses:
        return []
    high = stage.bounds[1]
    shifted, sizes = [], []
    for h in hypotheses:
        free = h.free(stage)
        size = np.maximum(np.abs(h.theta), stage.usual)[free] * _STEP
        size = np.where(h.theta[free] + size > high[free], -size, size)
        own = np.repeat(h.theta[None], len(free), axis=0)
        own[np.arange(len(free)), free] += size
        shifted += [replace(h, theta=theta) for theta in own]
        sizes.append(size)
    ends = np.cumsum([len(s) for s in sizes])[:-1]
    moved = np.split(responses(stage, shifted), ends)
    return [
        np.where(_tells(new - old, old)[:, None, None], new - old, 0.0) / size[:, None, None]
        for new, old, size in zip(moved, y, sizes, strict=True)
    ]


def _tells(change: Float[np.ndarray, "p R N"], y: np.ndarray) -> Bool[np.ndarray, " p"]:
    """Which of some changes of a response are more than rounding."""
    return np.abs(change).max(axis=(1, 2)) > _ROUNDING * np.abs(y).max()


def states_of(stage: Stage, h: Hypothesis) -> np.ndarray:
    """Response at the rows to each state at the first row, those of a mode among them, to what was
    on its way then, and to a swing of each phase."""
    den, delay = h.den, 0.0
    for slot in (stage.slots[number] for number in h.active):
        own = h.theta[list(slot.index)]
        if slot.cause == "resonance":
            den = np.polymul(den, mode(2.0 * np.pi * own[0] / stage.pace, own[1]))
        if slot.cause == "transport_delay":
            delay = stage.pace * own[0]
    rows = begun(den, h.den, h.num, delay, stage.pace * stage.dt, stage.u.shape[1])
    frequency = h.frequency(stage)
    if frequency is None:
        return rows
    return np.concatenate([rows, swing.columns(stage, frequency).T], axis=1)


def growth(stage: Stage, hypotheses: Sequence[Hypothesis]) -> Float[np.ndarray, " L"]:
    """How much the least stable pole of each plant grows over a run, as an exponent; nothing
    where all decay. A plant that a step has led out of all bounds has no end."""
    A = np.zeros((len(hypotheses), POLES, POLES))
    for own, h in zip(A, hypotheses, strict=True):  # companion matrices; what is idle rests
        own[0, : h.poles] = -h.theta[: h.poles]
        own[np.arange(1, h.poles), np.arange(h.poles - 1)] = 1.0
    there = np.isfinite(A).all(axis=(1, 2))
    fastest = np.full(len(A), np.inf)
    fastest[there] = np.linalg.eigvals(A[there]).real.max(axis=1)
    return fastest * stage.pace * stage.dt * stage.u.shape[1]


def bounded(stage: Stage, y: np.ndarray) -> np.ndarray:
    """Responses that an unstable trial made huge or not finite, cut to a size that loses."""
    huge = 1e4 * max(stage.scales.response, np.abs(stage.y).max())
    if y.size == 0 or max(y.max(), -y.min()) < huge:  # neither holds of what is not a number
        return y
    return np.clip(np.nan_to_num(y, nan=huge, posinf=huge, neginf=-huge), -huge, huge)


def residual(stage: Stage, y: np.ndarray) -> np.ndarray:
    return np.where(stage.mask, stage.y - y, 0.0)


def whitened(stage: Stage, lane: Lane, x: np.ndarray) -> np.ndarray:
    return whiten(x[None], lane.colour[None])[0] * stage.mask


def _variance(stage: Stage, lane: Lane) -> float:
    """Of the innovations, as a lane stands."""
    return max(lane.energy / stage.mask.sum(), 1e-300)


def _prior(stage: Stage, lane: Lane) -> float:
    """What holds the free states, in units of the innovations."""
    return _variance(stage, lane) / (FREE_STATE * stage.scales.response) ** 2


def pulled(stage: Stage, lane: Lane) -> Float[np.ndarray, " p"]:
    """What holds the free parameters that are believed to be small, likewise."""
    return _variance(stage, lane) * stage.ridge[lane.free]


def unlikely(stage: Stage, lane: Lane, theta: np.ndarray) -> float:
    """What that costs, likewise."""
    return _variance(stage, lane) * float(stage.ridge @ (theta - stage.off) ** 2)


def project(stage: Stage, lane: Lane, rows: Float[np.ndarray, "q R N"]) -> Float[np.ndarray, "q q"]:
    """Products of white rows, what the best free states of each run explain taken out."""
    prior = _prior(stage, lane) * np.eye(lane.white_states.shape[1])
    own, f = np.swapaxes(rows, 0, 1), lane.white_states
    across, turned = own @ np.swapaxes(f, 1, 2), np.swapaxes(own, 1, 2)
    states = np.linalg.solve(f @ np.swapaxes(f, 1, 2) + prior, np.swapaxes(across, 1, 2))
    return np.sum(own @ turned - across @ states, axis=0)


def repaint(stage: Stage, lane: Lane) -> None:
    """Whiten all of a lane by its colour."""
    lane.white_states = white_states(stage, lane)
    lane.leave(whitened(stage, lane, residual(stage, lane.y)))
    if lane.slopes is not None:
        lane.white_slopes = whitened(stage, lane, lane.slopes)


def white_states(stage: Stage, lane: Lane) -> Float[np.ndarray, "R n N"]:
    """Responses to the states at the starts, whitened, where samples count; zero before the first
    that does, as the residual is."""
    rows = lane.states.T[None]
    if stage.late.any():
        rows = np.where(np.maximum.accumulate(stage.mask, axis=1)[:, None], rows, 0.0)
    return whiten(rows[None], lane.colour[None])[0] * stage.mask[:, None]


def with_states(stage: Stage, lane: Lane) -> Float[np.ndarray, "R N"]:
    """A lane's response with the free response of the states at the starts that fit best."""
    return lane.y + free_states(stage, lane) @ lane.states.T


def free_states(stage: Stage, lane: Lane) -> Float[np.ndarray, "R n"]:
    """The states at the start of each run that fit best."""
    prior = _prior(stage, lane) * np.eye(lane.white_states.shape[1])
    f = lane.white_states
    toward = f @ lane.white_error[..., None]
    return np.linalg.solve(f @ np.swapaxes(f, 1, 2) + prior, toward)[..., 0]


def without(stage: Stage, h: Hypothesis, number: int) -> Hypothesis:
    """The same with one cause off."""
    kept = tuple(k for k in h.active if k != number)
    return replace(h, active=kept, theta=cleared(stage, h, kept))


def cleared(stage: Stage, h: Hypothesis, keep: Iterable[int] = ()) -> np.ndarray:
    """The vector with all causes off but those to keep."""
    theta = stage.off.copy()
    theta[:FIRST_CAUSE] = h.theta[:FIRST_CAUSE]
    for number in keep:
        index = list(stage.slots[number].index)
        theta[index] = h.theta[index]
    return theta
