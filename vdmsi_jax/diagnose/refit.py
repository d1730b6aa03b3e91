"""Refitting hypotheses: plant and causes together, on the whitened simulation error, many at once.

Levenberg-Marquardt whose Jacobians are differences: the lanes of the one compiled simulation give a
difference for a third of the time of a forward-mode tangent, without a second program to compile,
and sticking and steps have useful differences where they have no derivative. Where many hypotheses
are fitted at once, a Jacobian is kept and corrected along the steps that are taken (Broyden, A
class of methods for solving nonlinear simultaneous equations, 1965) for as long as the steps it
proposes help; not with forces inside, whose sticking makes a response rough.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from jaxtyping import Float

from . import swing
from .colour import filter_length, whiten
from .free_response import begun, mode
from .stage import LEADS, POLES, Stage
from .windows import inverse

_STEP = 1e-4  # of a parameter's usual size, for differences
_SETTLED = 0.05  # gain of twice the log-likelihood by a step after which a lane rests
_HELPS = 2.0  # gain above which steps make slopes old, and old ones still help
_FAR = 10.0  # gain of a round, above which another follows
_FEW = 8  # lanes, for which differences cost next to nothing
_DAMPINGS = (0.1, 3.0, 100.0)
BEYOND = 8  # reaches of the whitening filter, over which residuals count as one sample
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
        b = list(range(POLES + self.poles - 1 - self.zeros, POLES + self.poles))
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
        return self.theta[POLES + self.poles - 1 - self.zeros : POLES + self.poles]

    @property
    def order(self) -> str:
        """The paper's name of the order."""
        return f"P{self.poles}Z{self.zeros}"


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
    white_states: np.ndarray = field(default_factory=lambda: np.zeros((0, 0)))  # (n, N)
    white_slopes: np.ndarray | None = None


def refit(
    stage: Stage,
    hypotheses: Sequence[Hypothesis],
    rounds: int = 3,
    steps: int = 3,
    further: int = 6,
    worth: Callable[[Hypothesis, float], float] | None = None,
    reach: float = np.inf,
) -> list[Refit]:
    """Fit all hypotheses, each under its own colour of noise.

    Args:
        stage: the data.
        hypotheses: with starting values.
        rounds: how often the colour is estimated anew.
        steps: steps of Levenberg-Marquardt between.
        further: rounds more for those that the last one still took far.
        worth: of a hypothesis and its log-likelihood; with it, those that are more than `reach`
            below the best after the first round are given up, and missing in the answer.
        reach: see `worth`.
    """
    if not hypotheses:
        return []
    order = filter_length(stage.dt, int(stage.mask.sum()))
    counted = usable(stage)
    hypotheses = [_begun(stage, h) for h in hypotheses]
    start = responses(stage, hypotheses)
    lanes = [
        Lane(h, h.free(stage), y, _states(stage, h), np.zeros(order))
        for h, y in zip(hypotheses, start, strict=True)
    ]
    _recolour(stage, lanes, counted)
    under_way = lanes
    for k in range(rounds + further):
        gained = _round(stage, under_way, counted, steps)
        if worth is not None and k == 0:
            values = [worth(f.hypothesis, f.loglik) for f in _finish(stage, lanes, counted)]
            most = max(values)
            lanes = [x for x, v in zip(lanes, values, strict=True) if v >= most - reach]
            under_way = lanes
        elif k + 1 >= rounds:
            under_way = [x for x, g in zip(under_way, gained, strict=True) if g > _FAR]
        if not under_way:
            break
    return _finish(stage, lanes, counted)


def _round(stage: Stage, lanes: list[Lane], counted: np.ndarray, steps: int) -> list[float]:
    """Some steps of every lane and a new estimate of its colour; what the steps gained, in twice
    the log-likelihood."""
    before = []
    for lane in lanes:
        lane.cost = float(project(stage, lane, counted, lane.white_error[None])[0, 0])
        lane.cost += unlikely(stage, lane, counted, lane.hypothesis.theta)
        lane.settled = False
        before.append(lane.cost)
    for _ in range(steps):
        moving = [lane for lane in lanes if not lane.settled]
        if moving:
            _advance(stage, moving, counted)
    gained = [
        float(counted.sum() * np.log(cost / max(lane.cost, 1e-300)))
        for cost, lane in zip(before, lanes, strict=True)
    ]
    _recolour(stage, lanes, counted)
    return gained


def _begun(stage: Stage, h: Hypothesis) -> Hypothesis:
    """With a swing of each run where there is a periodic disturbance, and without where none."""
    number = swing.number_of(stage, h.active)
    if number is None:
        return h if h.swing is None else replace(h, swing=None)
    theta, both = h.theta.copy(), list(stage.slots[number].index[1:])
    own = np.zeros((len(stage.u), 2)) if h.swing is None else h.swing
    theta[both], own = 0.0, own + h.theta[both]
    return replace(h, theta=theta, swing=own)


def responses(stage: Stage, hypotheses: Sequence[Hypothesis]) -> Float[np.ndarray, "L R N"]:
    """What hypotheses answer to the commands."""
    y = stage.simulate(np.stack([h.theta for h in hypotheses]))
    for own, h in zip(y, hypotheses, strict=True):
        frequency = h.frequency(stage)
        if frequency is not None and h.swing is not None:
            own += h.swing @ swing.columns(stage, frequency)
    return bounded(stage, y)


def usable(stage: Stage) -> np.ndarray:
    """Samples whose innovations count. Before the first of a run there is no past, so its
    innovation is the residual itself; without them nothing would hold the states at the start."""
    return stage.mask


def _states(stage: Stage, h: Hypothesis) -> np.ndarray:
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


def bounded(stage: Stage, y: np.ndarray) -> np.ndarray:
    """Responses that an unstable trial made huge or not finite, cut to a size that loses."""
    huge = 1e4 * max(stage.scales.response, np.abs(stage.y).max())
    return np.clip(np.nan_to_num(y, nan=huge, posinf=huge, neginf=-huge), -huge, huge)


def residual(stage: Stage, y: np.ndarray) -> np.ndarray:
    return np.where(stage.mask, stage.y - y, 0.0)


def whitened(x: np.ndarray, lane: Lane, counted: np.ndarray) -> np.ndarray:
    return whiten(x[None], lane.colour[None])[0] * counted


def _variance(lane: Lane, counted: np.ndarray) -> float:
    """Of the innovations, as a lane stands."""
    return max(float(np.sum(lane.white_error**2)) / counted.sum(), 1e-300)


def _prior(stage: Stage, lane: Lane, counted: np.ndarray) -> float:
    """What holds the free states, in units of the innovations."""
    return _variance(lane, counted) / (FREE_STATE * stage.scales.response) ** 2


def pulled(stage: Stage, lane: Lane, counted: np.ndarray) -> Float[np.ndarray, " p"]:
    """What holds the free parameters that are believed to be small, likewise."""
    return _variance(lane, counted) * stage.ridge[lane.free]


def unlikely(stage: Stage, lane: Lane, counted: np.ndarray, theta: np.ndarray) -> float:
    """What that costs, likewise."""
    return _variance(lane, counted) * float(stage.ridge @ (theta - stage.off) ** 2)


def project(
    stage: Stage, lane: Lane, counted: np.ndarray, rows: Float[np.ndarray, "q R N"]
) -> Float[np.ndarray, "q q"]:
    """Products of white rows, what the best free states of each run explain taken out."""
    prior = _prior(stage, lane, counted) * np.eye(len(lane.white_states))
    gram = np.zeros((len(rows), len(rows)))
    for r, use in enumerate(counted):
        own, f = rows[:, r], lane.white_states * use
        across = own @ f.T
        gram += own @ own.T - across @ np.linalg.solve(f @ f.T + prior, across.T)
    return gram


def sensitivities(
    stage: Stage, hypotheses: Sequence[Hypothesis], y: Sequence[np.ndarray]
) -> list[Float[np.ndarray, "p R N"]]:
    """Differences of the response with respect to the free parameters, about the responses `y`."""
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
        (new - old) / size[:, None, None] for new, old, size in zip(moved, y, sizes, strict=True)
    ]


def _advance(stage: Stage, lanes: list[Lane], counted: np.ndarray) -> None:
    """One step of Levenberg-Marquardt of every lane: differences where the old ones no longer
    serve, then three dampings tried."""
    low, high = stage.bounds
    stale = []
    for lane in lanes:
        rough = any(stage.slots[number].rough for number in lane.hypothesis.active)
        if lane.drift > 0.0 and (rough or len(lanes) <= _FEW):
            lane.slopes = None
        if lane.slopes is None:
            stale.append(lane)
    _differ(stage, stale, counted)
    trials, scales = [], []
    for lane in lanes:
        assert lane.white_slopes is not None
        rows = np.concatenate([lane.white_error[None], lane.white_slopes])
        gram = project(stage, lane, counted, rows)
        theta, pull = lane.hypothesis.theta, pulled(stage, lane, counted)
        away = (theta - stage.off)[lane.free]
        normal, slope = gram[1:, 1:] + np.diag(pull), gram[1:, 0] - pull * away
        scale = np.sqrt(np.maximum(np.diag(normal), 1e-300))
        scales.append(scale)
        unit, rhs = normal / np.outer(scale, scale), slope / scale
        for factor in _DAMPINGS:
            step = np.linalg.solve(unit + lane.damping * factor * np.eye(len(unit)), rhs) / scale
            new = theta.copy()
            new[lane.free] = np.clip(theta[lane.free] + step, low[lane.free], high[lane.free])
            trials.append(replace(lane.hypothesis, theta=new))
    tried = len(_DAMPINGS)
    answers = responses(stage, trials).reshape(len(lanes), tried, *stage.y.shape)
    colours = np.stack([lane.colour for lane in lanes])
    errors = whiten(residual(stage, answers), colours) * counted
    for i, lane in enumerate(lanes):
        own = trials[tried * i : tried * (i + 1)]
        costs = np.diag(project(stage, lane, counted, errors[i]))
        costs = costs + [unlikely(stage, lane, counted, h.theta) for h in own]
        best = int(np.argmin(np.where(np.isfinite(costs), costs, np.inf)))
        serves = lane.drift < _HELPS
        if costs[best] < lane.cost:
            gained = (lane.cost - costs[best]) / lane.cost * counted.sum()
            theta = trials[tried * i + best].theta
            _move(stage, lane, scales[i], theta, answers[i, best], errors[i, best])
            lane.settled = bool(gained < _SETTLED) and serves
            lane.drift += gained
            lane.slopes = lane.slopes if serves or gained > _HELPS else None
            lane.damping = max(lane.damping * _DAMPINGS[best], 1e-9)
            lane.cost = float(costs[best])
        elif serves:
            lane.settled = lane.damping > 1e3
            lane.damping *= 300.0
        else:
            lane.slopes = None


def _differ(stage: Stage, lanes: list[Lane], counted: np.ndarray) -> None:
    """Take the slopes of lanes anew."""
    slopes = sensitivities(stage, [lane.hypothesis for lane in lanes], [lane.y for lane in lanes])
    for lane, J in zip(lanes, slopes, strict=True):
        lane.slopes, lane.drift = np.where(stage.mask, J, 0.0), 0.0
        lane.white_slopes = whitened(lane.slopes, lane, counted)


def _move(
    stage: Stage,
    lane: Lane,
    scale: np.ndarray,
    theta: np.ndarray,
    y: np.ndarray,
    white: np.ndarray,
) -> None:
    """Move a lane to where a step led, and correct its slopes along the step by what came of it."""
    assert lane.slopes is not None and lane.white_slopes is not None
    step = (theta - lane.hypothesis.theta)[lane.free]
    weight = step * scale**2
    along = (weight / max(float(step @ weight), 1e-300))[:, None, None]
    surprise = np.where(stage.mask, y - lane.y, 0.0) - np.tensordot(step, lane.slopes, axes=1)
    lane.slopes = lane.slopes + along * surprise
    surprise = lane.white_error - white - np.tensordot(step, lane.white_slopes, axes=1)
    lane.white_slopes = lane.white_slopes + along * surprise
    lane.y, lane.white_error = y, white
    lane.hypothesis = replace(lane.hypothesis, theta=theta)
    lane.states = _states(stage, lane.hypothesis)
    lane.white_states = whiten(lane.states.T[None], lane.colour[None])[0]


def _recolour(stage: Stage, lanes: list[Lane], counted: np.ndarray) -> None:
    """Estimate the colour of every lane's residual, free states taken out."""
    for lane in lanes:
        repaint(stage, lane, counted)
        _swung(stage, lane, counted)
    left = np.stack([residual(stage, with_states(stage, lane, counted)) for lane in lanes])
    colours = stage.noise.colours(left, stage.mask, lanes[0].colour.size)
    for lane, colour in zip(lanes, colours, strict=True):
        lane.colour = colour
        repaint(stage, lane, counted)


def _swung(stage: Stage, lane: Lane, counted: np.ndarray) -> None:
    """Give each run the swing that fits it best."""
    h, frequency = lane.hypothesis, lane.hypothesis.frequency(stage)
    if frequency is None or h.swing is None:
        return
    more = _free_states(stage, lane, counted)[:, -2:]
    lane.hypothesis = replace(h, swing=h.swing + more)
    lane.y = lane.y + more @ swing.columns(stage, frequency)
    lane.slopes = lane.white_slopes = None
    repaint(stage, lane, counted)


def repaint(stage: Stage, lane: Lane, counted: np.ndarray) -> None:
    """Whiten all of a lane by its colour."""
    lane.white_states = whiten(lane.states.T[None], lane.colour[None])[0]
    lane.white_error = whitened(residual(stage, lane.y), lane, counted)
    if lane.slopes is not None:
        lane.white_slopes = whitened(lane.slopes, lane, counted)


def with_states(stage: Stage, lane: Lane, counted: np.ndarray) -> Float[np.ndarray, "R N"]:
    """A lane's response with the free response of the states at the starts that fit best."""
    return lane.y + _free_states(stage, lane, counted) @ lane.states.T


def _free_states(stage: Stage, lane: Lane, counted: np.ndarray) -> Float[np.ndarray, "R n"]:
    """The states at the start of each run that fit best."""
    prior = _prior(stage, lane, counted) * np.eye(len(lane.white_states))
    found = []
    for r, use in enumerate(counted):
        f = lane.white_states * use
        found.append(np.linalg.solve(f @ f.T + prior, f @ lane.white_error[r]))
    return np.stack(found)


def _finish(stage: Stage, lanes: list[Lane], counted: np.ndarray) -> list[Refit]:
    found = []
    n = int(counted.sum())
    _differ(stage, [lane for lane in lanes if lane.slopes is None], counted)
    for lane in lanes:
        assert lane.white_slopes is not None
        y = with_states(stage, lane, counted)
        innovations = whitened(residual(stage, y), lane, counted)
        variance = max(float(np.sum(innovations**2)) / n, 1e-300)
        left = residual(stage, y)
        plain = max(float(np.sum(left**2)) / n, 1e-300)
        slow = 0.5 * n / (BEYOND * lane.colour.size) * float(np.log(plain))
        away = lane.hypothesis.theta - stage.off
        loglik = -0.5 * (n * float(np.log(variance)) + float(stage.ridge @ away**2)) - slow
        normal = project(stage, lane, counted, lane.white_slopes)
        covariance = inverse(normal + np.diag(pulled(stage, lane, counted))) * variance
        found.append(
            Refit(
                lane.hypothesis, loglik, y, lane.y, lane.states, lane.colour, variance, covariance
            )
        )
    return found
