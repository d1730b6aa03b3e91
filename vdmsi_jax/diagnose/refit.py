"""Refitting hypotheses: plant and causes together, on the whitened simulation error, many at once.

Levenberg-Marquardt whose Jacobians are differences: the lanes of the one compiled simulation give a
difference for a third of the time of a forward-mode tangent, without a second program to compile, and
sticking and steps have useful differences where they have no derivative.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float

from .colour import autoregression, filter_length, whiten
from .stage import LEAD, POLES, Stage

_STEP = 1e-4  # of a parameter's usual size, for differences
_SETTLED = 0.05  # gain of twice the log-likelihood by a step after which a lane rests
_DAMPINGS = (0.1, 3.0, 100.0)
_FREE_STATE = 0.3  # prior standard deviation of a state at the start, of the response's range


@dataclass(frozen=True, eq=False)
class Hypothesis:
    """Which parameters of a stage are free, and their values.

    Attributes:
        poles, zeros: order of the plant.
        active: numbers of the causes that are on.
        theta: the vector.
    """

    poles: int
    zeros: int
    active: tuple[int, ...]
    theta: Float[np.ndarray, " P"]

    def free(self, stage: Stage) -> np.ndarray:
        """Numbers of the free parameters."""
        a = list(range(self.poles))
        b = list(range(POLES + self.poles - 1 - self.zeros, POLES + self.poles))
        slots = [stage.slots[number] for number in self.active]
        lead = [LEAD] if self.poles > 1 and any(slot.forces for slot in slots) else []
        return np.array(a + b + lead + [i for slot in slots for i in slot.index])

    @property
    def order(self) -> str:
        """The paper's name of the order."""
        return f"P{self.poles}Z{self.zeros}"


@dataclass(frozen=True, eq=False)
class Refit:
    """A hypothesis at its optimum.

    Attributes:
        hypothesis: with the values found.
        loglik: log-likelihood of the innovations, up to a constant that all share.
        y: (runs, N) simulated response, with the free response of the starts.
        simulated: (runs, N) without it.
        states: (N, n) response to the states at the start.
        colour: coefficients of its own whitening filter.
        variance: of the innovations.
        covariance: of the free parameters.
    """

    hypothesis: Hypothesis
    loglik: float
    y: Float[np.ndarray, "R N"]
    simulated: Float[np.ndarray, "R N"]
    states: Float[np.ndarray, "N n"]
    colour: Float[np.ndarray, " order"]
    variance: float
    covariance: Float[np.ndarray, "p p"]


@dataclass
class _Lane:
    hypothesis: Hypothesis
    free: np.ndarray
    damping: float
    y: np.ndarray
    states: np.ndarray  # (N, n) free response of the plant to its states
    colour: np.ndarray
    cost: float = np.inf
    settled: bool = False


def refit(
    stage: Stage, hypotheses: Sequence[Hypothesis], rounds: int = 3, steps: int = 3
) -> list[Refit]:
    """Fit all hypotheses, each under its own colour of noise.

    Args:
        stage: the data.
        hypotheses: with starting values.
        rounds: how often the colour is estimated anew.
        steps: steps of Levenberg-Marquardt between.
    """
    if not hypotheses:
        return []
    order = filter_length(stage.dt, int(stage.mask.sum()))
    counted = usable(stage)
    start = _bounded(stage, stage.simulate(np.stack([h.theta for h in hypotheses])))
    lanes = [
        _Lane(h, h.free(stage), 1e-2, y, _states(stage, h), np.zeros(order))
        for h, y in zip(hypotheses, start, strict=True)
    ]
    _recolour(stage, lanes, order)
    for _ in range(rounds):
        for lane in lanes:
            lane.cost = float(_project(stage, lane, counted, [lane.y])[0][0])
            lane.settled = False
        for _ in range(steps):
            moving = [lane for lane in lanes if not lane.settled]
            if moving:
                _advance(stage, moving, counted)
        _recolour(stage, lanes, order)
    return _finish(stage, lanes, counted)


def usable(stage: Stage) -> np.ndarray:
    """Samples whose innovations count. Before the first of a run there is no past, so its innovation
    is the residual itself; without them nothing would hold the states at the start."""
    return stage.mask


def _states(stage: Stage, h: Hypothesis) -> np.ndarray:
    """Response at the rows to each state at the first row."""
    n = h.poles
    A = np.eye(n, k=1)
    A[:, 0] -= h.theta[:n]
    step = _expm(A * (stage.pace * stage.dt))
    rows, power, length = np.eye(n)[:1], step, stage.u.shape[1]
    while len(rows) < length:
        rows = np.concatenate([rows, rows @ power])
        power = power @ power
    rows = rows[:length]
    return np.where(np.isfinite(rows) & (np.abs(rows) < 1e6), rows, 0.0)


def _expm(M: np.ndarray) -> np.ndarray:
    norm = np.abs(M).sum(axis=1).max()
    squarings = int(np.clip(np.ceil(np.log2(max(norm, 1e-300) / 0.25)), 0, 60))
    scaled, term, total = M / 2**squarings, np.eye(len(M)), np.eye(len(M))
    for k in range(1, 14):
        term = term @ scaled / k
        total = total + term
    for _ in range(squarings):
        total = total @ total
    return total


def _bounded(stage: Stage, y: np.ndarray) -> np.ndarray:
    """Responses that an unstable trial made huge or not finite, cut to a size that loses."""
    huge = 1e4 * max(stage.scales.response, np.abs(stage.y).max())
    return np.clip(np.nan_to_num(y, nan=huge, posinf=huge, neginf=-huge), -huge, huge)


def _residual(stage: Stage, y: np.ndarray) -> np.ndarray:
    return np.where(stage.mask, stage.y - y, 0.0)


def _start_of(stage: Stage, lane: _Lane, counted: np.ndarray, whitened: np.ndarray) -> np.ndarray:
    """(runs, n) free states that fit best, by the whitened residual."""
    F = whiten(lane.states.T[None], lane.colour[None])[0]
    variance = max(float(np.mean(whitened[counted] ** 2)), 1e-300)
    prior = variance / (_FREE_STATE * stage.scales.response) ** 2
    found = []
    for e, use in zip(whitened, counted, strict=True):
        own = F[:, use]
        found.append(np.linalg.solve(own @ own.T + prior * np.eye(len(own)), own @ e[use]))
    return np.array(found)


def _project(
    stage: Stage, lane: _Lane, counted: np.ndarray, candidates: Sequence[np.ndarray], J=None
):
    """Costs of candidate responses after the best free states, and with a Jacobian (p, R, N) the
    normal equations at the first of them."""
    F = whiten(lane.states.T[None], lane.colour[None])[0]
    e = whiten(
        np.stack([_residual(stage, y) for y in candidates])[None], lane.colour[None]
    )[0]
    rows = e if J is None else np.concatenate([e, whiten(J[None], lane.colour[None])[0]])
    variance = max(float(np.mean(e[0][counted] ** 2)), 1e-300)
    prior = variance / (_FREE_STATE * stage.scales.response) ** 2
    gram = np.zeros((len(rows), len(rows)))
    for r, use in enumerate(counted):
        own, f = rows[:, r, use], F[:, use]
        across = own @ f.T
        inner = f @ f.T + prior * np.eye(len(f))
        gram += own @ own.T - across @ np.linalg.solve(inner, across.T)
    k = len(candidates)
    return np.diag(gram)[:k], gram[k:, k:], gram[k:, 0]


def sensitivities(
    stage: Stage, hypotheses: Sequence[Hypothesis], y: Sequence[np.ndarray]
) -> list[Float[np.ndarray, "p R N"]]:
    """Differences of the response with respect to the free parameters, about the responses `y`."""
    high = stage.bounds[1]
    shifted, sizes = [], []
    for h in hypotheses:
        free = h.free(stage)
        size = np.maximum(np.abs(h.theta), stage.usual)[free] * _STEP
        size = np.where(h.theta[free] + size > high[free], -size, size)
        own = np.repeat(h.theta[None], len(free), axis=0)
        own[np.arange(len(free)), free] += size
        shifted.append(own)
        sizes.append(size)
    ends = np.cumsum([len(s) for s in sizes])[:-1]
    moved = np.split(_bounded(stage, stage.simulate(np.concatenate(shifted))), ends)
    return [
        (new - old) / size[:, None, None] for new, old, size in zip(moved, y, sizes, strict=True)
    ]


def _advance(stage: Stage, lanes: list[_Lane], counted: np.ndarray) -> None:
    """One step of Levenberg-Marquardt of every lane: differences, then three dampings tried."""
    low, high = stage.bounds
    slopes = sensitivities(stage, [lane.hypothesis for lane in lanes], [lane.y for lane in lanes])
    trials = []
    for lane, J in zip(lanes, slopes, strict=True):
        J = np.where(stage.mask, J, 0.0)
        _, normal, slope = _project(stage, lane, counted, [lane.y], J)
        scale = np.sqrt(np.maximum(np.diag(normal), 1e-300))
        unit, rhs = normal / np.outer(scale, scale), slope / scale
        theta = lane.hypothesis.theta
        for factor in _DAMPINGS:
            step = np.linalg.solve(unit + lane.damping * factor * np.eye(len(unit)), rhs) / scale
            new = theta.copy()
            new[lane.free] = np.clip(theta[lane.free] + step, low[lane.free], high[lane.free])
            trials.append(new)
    answers = _bounded(stage, stage.simulate(np.stack(trials)))
    tried = len(_DAMPINGS)
    for i, lane in enumerate(lanes):
        own = answers[tried * i : tried * (i + 1)]
        costs = _project(stage, lane, counted, list(own))[0]
        best = int(np.nanargmin(np.where(np.isfinite(costs), costs, np.inf)))
        if costs[best] < lane.cost:
            gained = (lane.cost - costs[best]) / lane.cost * counted.sum()
            lane.settled = bool(gained < _SETTLED)
            lane.cost, lane.y = float(costs[best]), own[best]
            lane.hypothesis = replace(lane.hypothesis, theta=trials[tried * i + best])
            lane.damping = max(lane.damping * _DAMPINGS[best], 1e-9)
            lane.states = _states(stage, lane.hypothesis)
        else:
            lane.settled = lane.damping > 1e3
            lane.damping *= 300.0


def _recolour(stage: Stage, lanes: list[_Lane], order: int) -> None:
    """Estimate the colour of every lane's residual, free states taken out."""
    counted = usable(stage)
    for lane in lanes:
        e = _with_states(stage, lane, counted)[1]
        lane.colour = autoregression(e[None], stage.mask, order)[0]


def _with_states(stage: Stage, lane: _Lane, counted: np.ndarray):
    whitened = whiten(_residual(stage, lane.y)[None], lane.colour[None])[0]
    starts = _start_of(stage, lane, counted, whitened)
    y = lane.y + starts @ lane.states.T
    return y, _residual(stage, y)


def _inverse(normal: np.ndarray) -> np.ndarray:
    """Inverse of the normal equations; a parameter without effect gets a huge variance."""
    scale = np.sqrt(np.maximum(np.diag(normal), 1e-300))
    unit = normal / np.outer(scale, scale) + 1e-12 * np.eye(len(scale))
    return np.linalg.inv(unit) / np.outer(scale, scale)


def _finish(stage: Stage, lanes: list[_Lane], counted: np.ndarray) -> list[Refit]:
    found = []
    n = int(counted.sum())
    slopes = sensitivities(stage, [lane.hypothesis for lane in lanes], [lane.y for lane in lanes])
    for lane, J in zip(lanes, slopes, strict=True):
        normal = _project(stage, lane, counted, [lane.y], np.where(stage.mask, J, 0.0))[1]
        y, e = _with_states(stage, lane, counted)
        innovations = whiten(e[None], lane.colour[None])[0][counted]
        variance = float(np.mean(innovations**2))
        found.append(
            Refit(
                lane.hypothesis,
                -0.5 * n * float(np.log(max(variance, 1e-300))),
                y,
                lane.y,
                lane.states,
                lane.colour,
                variance,
                _inverse(normal) * variance,
            )
        )
    return found
