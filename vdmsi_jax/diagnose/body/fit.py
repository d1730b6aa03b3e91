"""Fits of the body, the road and the sensors: likelihood over all channels, by the chain rule."""

from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from jaxtyping import Float

from ...threads import each
from ..signals.chain import regress
from ..signals.colour import whiten
from ..signals.windows import BLOCK, block_sums, inverse, widening
from .body import CAUSES, INDEX, LAGS, LANES, NUISANCE, Body

Start = tuple[tuple[int, ...], np.ndarray]
"""Of a fit: the causes that are on, and the parameters."""

_MOST = 5.0  # of a parameter of the body, in its unit
_STEP = 1e-3
_STEPS = 3  # of Levenberg-Marquardt at one colour
_DAMPINGS = (1e-3, 1.0, 1e2)  # times a lane's own, that are tried at each
_STUCK = 10.0  # damping from which on a lane rests where no step helps
_SETTLED = 0.05  # gain of twice the log-likelihood by a step after which a lane rests


@dataclass(frozen=True, eq=False)
class BodyFit:
    """A hypothesis about the body at its optimum.

    Attributes:
        active: numbers of the causes that are on.
        theta: parameters.
        loglik: over all channels.
        predicted: by channel, (runs, N); `left` the residual after the chain rule.
        colour, variance, shares: by channel, of its innovations and of the chain rule.
        free: numbers of the free parameters; `covariance` theirs.
    """

    active: tuple[int, ...]
    theta: Float[np.ndarray, " P"]
    loglik: float
    predicted: dict[str, np.ndarray]
    left: dict[str, np.ndarray]
    colour: dict[str, np.ndarray]
    variance: dict[str, float]
    shares: dict[str, np.ndarray]
    free: tuple[int, ...]
    covariance: Float[np.ndarray, "p p"]


def fit_body(
    body: Body, actives: Sequence[tuple[int, ...]], start: BodyFit | None = None
) -> list[BodyFit]:
    """Fit hypotheses, started from another's parameters."""
    low, high = bounds(body)
    starts = []
    for active in actives:
        theta = np.zeros(low.size)
        theta[: len(LAGS)] = 0.25 * high[: len(LAGS)]
        if start is not None:
            kept = [
                *body.nuisance,
                *(i for k in start.active if k in active for i in INDEX[k]),
            ]
            theta[kept] = start.theta[kept]
        starts.append((tuple(active), theta))
    return refit_body(body, starts)


def refit_body(
    body: Body,
    starts: Sequence[Start],
    rounds: int = 1,
    steps: int = _STEPS,
) -> list[BodyFit]:
    """Fit hypotheses from their starts, each with its own colours, which are estimated anew
    `rounds` times on the way, each time for so many `steps`."""
    if not starts:
        return []
    lanes = [BodyLane(body, active, theta) for active, theta in starts]
    for lane, y in zip(lanes, _answers(body, [lane.theta for lane in lanes]), strict=True):
        lane.y = y
    for _ in range(rounds):
        each(BodyLane.recolour, lanes)
        moving = lanes
        for _ in range(steps):
            moving = _step(body, moving)
    each(BodyLane.recolour, lanes)
    return each(BodyLane.finish, lanes)


def polished(body: Body, fits: Sequence[BodyFit]) -> list[BodyFit]:
    """Fits, gone on with under their own colours."""
    lanes = each(partial(BodyLane.of, body), fits)
    moving = lanes
    for _ in range(_STEPS):
        moving = _step(body, moving)
    each(BodyLane.recolour, lanes)
    return each(BodyLane.finish, lanes)


def logliks_at(
    body: Body, fit: BodyFit, thetas: Float[np.ndarray, "L P"]
) -> Float[np.ndarray, " L"]:
    """Log-likelihoods of a fit at other parameters, its colours estimated anew."""
    at = BodyLane(body, fit.active, fit.theta)
    at.colour = dict(fit.colour)
    for c in at.colour:
        at.still(c)

    def of(some: Float[np.ndarray, "l P"]) -> list[float]:
        found, y = [], body.simulate(some)
        for i, theta in enumerate(some):
            lane = at.elsewhere(theta, {c: y[c][i] for c in y})
            lane.recolour()
            found.append(lane.loglik)
        return found

    return np.array(sum(each(of, _in_programs(thetas)), []))


def theta_of(fit: BodyFit, kept: Collection[int]) -> Float[np.ndarray, " P"]:
    """The parameters of a fit with only some of its causes on."""
    theta = fit.theta.copy()
    for k in fit.active:
        if k not in kept:
            theta[list(INDEX[k])] = 0.0
    return theta


def with_only(body: Body, fit: BodyFit, kept: Collection[int]) -> BodyFit:
    """A fit with only some of its causes on, and nothing refitted."""
    if set(fit.active) <= set(kept):
        return fit
    theta = theta_of(fit, kept)
    return replace(fit, theta=theta, predicted=_answers(body, [theta])[0])


def _answers(body: Body, thetas: Sequence[np.ndarray]) -> list[dict[str, np.ndarray]]:
    if not thetas:
        return []
    every = each(body.simulate, _in_programs(np.stack(thetas)))
    return [{c: y[c][i] for c in y} for y in every for i in range(len(next(iter(y.values()))))]


def _in_programs(thetas: Float[np.ndarray, "L P"]) -> list[Float[np.ndarray, "l P"]]:
    """As many vectors as a compiled program takes, and the next."""
    return [thetas[at : at + LANES] for at in range(0, len(thetas), LANES)]


def bounds(body: Body) -> tuple[np.ndarray, np.ndarray]:
    low = [b[0] for b in NUISANCE.values()]
    high = [b[1] for b in NUISANCE.values()]
    for cause in CAUSES:
        low += cause.lower
        high += [_MOST] * len(cause.names)
    return np.array(low), np.array(high)


class BodyLane:
    """A hypothesis on its way.

    Attributes:
        body, active, theta: the hypothesis; `free` its free parameters.
        y: response by channel.
        colour, variance, shares: of each channel's innovations, and of the chain rule.
    """

    def __init__(self, body: Body, active: tuple[int, ...], theta: np.ndarray):
        self.body, self.active, self.theta = body, active, theta
        self.free = (*body.nuisance, *(i for k in active for i in INDEX[k]))
        self.y: dict[str, np.ndarray] = {}
        self.colour: dict[str, np.ndarray] = {}
        self.variance: dict[str, float] = {}
        self.shares: dict[str, np.ndarray] = {}
        self.normal = np.eye(len(self.free))
        self.damping = 1e-3
        self._value: float | None = None
        self._still: dict[str, np.ndarray] = {}

    @classmethod
    def of(cls, body: Body, fit: BodyFit) -> "BodyLane":
        """A lane at a fit."""
        lane = cls(body, fit.active, fit.theta)
        lane.y, lane.colour = fit.predicted, dict(fit.colour)
        lane.recolour()
        return lane

    def elsewhere(self, theta: np.ndarray, y: dict[str, np.ndarray]) -> "BodyLane":
        """A lane at other parameters that begins with the colours of this one."""
        lane = BodyLane(self.body, self.active, theta)
        lane.y, lane.colour, lane._still = y, dict(self.colour), dict(self._still)
        return lane

    def raw(self, y: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
        """Residuals."""
        body = self.body
        return {c: np.where(body.mask[c], body.measured[c] - y[c], 0.0) for c in y}

    def to(self, theta: np.ndarray, y: dict[str, np.ndarray], value: float) -> None:
        """Move to other parameters, whose response and its cost are known."""
        self.theta, self.y, self._value = theta, y, value

    def left(self) -> dict[str, np.ndarray]:
        """Residuals after the chain rule, its shares as they stand."""
        e = self.raw(self.y)
        columns = self.body.chain.columns(e)
        return {c: e[c] - np.tensordot(self.shares[c], X, 1) for c, X in columns.items()}

    def recolour(self) -> None:
        """Estimate shares and colours anew."""
        e = self.raw(self.y)
        moving = self.body.chain.moving(e)
        for c in e:
            rows = np.concatenate([e[c][None], moving[c]]) if c in moving else e[c][None]
            X = np.concatenate([rows[1:], self.body.chain.still[c]])
            new = c not in self.colour
            if new:
                self.colour[c] = np.zeros(self.body.order[c])
            for _ in range(2 if new else 1):
                w = np.concatenate([self.white(c, rows), self.still(c)])
                self.shares[c] = regress(w[1:], w[0])
                left = e[c] - np.tensordot(self.shares[c], X, 1)
                self.colour[c] = self.body.colour(c, left)
                self._still.pop(c, None)
            self.variance[c] = float(np.mean(self.white(c, left[None]) ** 2))
        self._value = None

    def cost(self, y: dict[str, np.ndarray]) -> float:
        """Sum of squares of the innovations at the best shares of the chain rule, under the colours
        as they stand, in their variances."""
        e = self.raw(y)
        moving, total = self.body.chain.moving(e), 0.0
        for c in e:
            rows = np.concatenate([e[c][None], moving[c]]) if c in moving else e[c][None]
            w = self.white(c, rows)
            X = np.concatenate([w[1:], self.still(c)])
            rest = w[0] - regress(X, w[0]) @ X
            total += float(rest @ rest) / self.variance[c]
        return total

    @property
    def value(self) -> float:
        """The cost of the response."""
        if self._value is None:
            self._value = self.cost(self.y)
        return self._value

    def still(self, channel: str) -> np.ndarray:
        """What no hypothesis changes of a channel's chain rule, after its whitening filter."""
        if channel not in self._still:
            self._still[channel] = self.white(channel, self.body.chain.still[channel])
        return self._still[channel]

    def white(self, channel: str, rows: np.ndarray) -> np.ndarray:
        """Rows of a channel after its whitening filter, where they count."""
        counted, colour = self.body.counted[channel], self.colour[channel]
        if not colour.any():
            return rows[:, counted]
        return whiten(rows[None], colour[None])[0][:, counted]

    def passed(self, moved: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
        """A change of the responses as the residuals after the chain rule see it."""
        body = self.body
        moved = {c: np.where(body.mask[c], d, 0.0) for c, d in moved.items()}
        taken = body.chain.moving(moved)
        for c, X in taken.items():
            moved[c] = moved[c] - np.tensordot(self.shares[c][: len(X)], X, 1)
        return moved

    def equations(self, slopes: Sequence[dict]) -> tuple[np.ndarray, np.ndarray, dict]:
        """Normal equations for parameters with these slopes and for the shares of the chain rule
        together; and by channel the rows that made them with their numbers."""
        e = self.raw(self.y)
        X, left = self.body.chain.columns(e), self.left()
        k = len(slopes)
        size = k + sum(len(x) for x in X.values())
        normal, slope, at, stacks = np.zeros((size, size)), np.zeros(size), k, {}
        for c, rest in left.items():
            rows = np.concatenate([rest[None], *(s[c][None] for s in slopes), X[c]])
            where = [*range(k), *range(at, at + len(X[c]))]
            stacks[c] = (rows, where)
            moving = len(X[c]) - len(self.still(c))
            w = np.concatenate([self.white(c, rows[: 1 + k + moving]), self.still(c)])
            gram = w @ w.T / self.variance[c]
            normal[np.ix_(where, where)] += gram[1:, 1:]
            slope[where] += gram[1:, 0]
            at += len(X[c])
        return normal, slope, stacks

    @property
    def loglik(self) -> float:
        """Over all channels."""
        return -0.5 * sum(
            int(self.body.counted[c].sum()) * float(np.log(max(self.variance[c], 1e-300)))
            for c in self.y
        )

    def finish(self) -> BodyFit:
        """The fit as it stands."""
        return BodyFit(
            self.active, self.theta, self.loglik, self.y, self.left(),
            self.colour, self.variance, self.shares, self.free, inverse(self.normal),
        )  # fmt: skip


def robust(body: Body, fit: BodyFit) -> BodyFit:
    """A fit whose covariance is widened where blocks of the data disagree by more than noise
    allows, as `outcome` does it for actuators."""
    lane = BodyLane.of(body, fit)
    low, high = bounds(body)
    inner = [k for k, i in enumerate(fit.free) if low[i] < fit.theta[i] < high[i]]
    if not inner:  # all of them held at their bounds
        return fit
    own = slopes(body, [lane], [[fit.free[k] for k in inner]])[0]
    scores, columns = [], body.chain.columns(lane.raw(lane.y))
    for c, rest in lane.left().items():
        w = lane.white(c, np.concatenate([rest[None], *(s[c][None] for s in own)]))
        X = lane.white(c, columns[c])
        clean = w[1:] - np.stack([regress(X, row) for row in w[1:]]) @ X
        blocks = max(1, int(w.shape[1] * body.dt / BLOCK))
        scores.append(block_sums(clean * w[0] / lane.variance[c], blocks))
    factors = np.ones(len(fit.free))
    own_covariance = fit.covariance[np.ix_(inner, inner)]
    factors[inner] = widening(own_covariance, np.concatenate(scores, axis=1))
    return replace(fit, covariance=fit.covariance * np.outer(factors, factors))


def slopes(
    body: Body, lanes: Sequence[BodyLane], free: Sequence[Sequence[int]]
) -> list[list[dict[str, np.ndarray]]]:
    """Differences of every lane's responses by some of its parameters, as its residuals see
    them."""
    shifted = []
    for lane, numbers in zip(lanes, free, strict=True):
        for i in numbers:
            theta = lane.theta.copy()
            theta[i] += _size(i)
            shifted.append(theta)
    answers = iter(_answers(body, shifted))
    found = []
    for lane, numbers in zip(lanes, free, strict=True):
        own = []
        for i in numbers:
            y = next(answers)
            own.append(lane.passed({c: (y[c] - lane.y[c]) / _size(i) for c in y}))
        found.append(own)
    return found


def _size(i: int) -> float:
    """Of the difference by a parameter."""
    return _STEP * (0.1 if i else 0.02)


def _step(body: Body, lanes: Sequence[BodyLane]) -> list[BodyLane]:
    """One Levenberg-Marquardt step of every lane; those that still move."""
    if not lanes:
        return []
    found = slopes(body, lanes, [lane.free for lane in lanes])
    trials = sum(each(_trials, list(zip(lanes, found, strict=True))), [])
    tried = _answers(body, trials)
    moved, many = [], len(_DAMPINGS)
    owners = [lane for lane in lanes for _ in _DAMPINGS]
    every = each(lambda pair: pair[0].cost(pair[1]), list(zip(owners, tried, strict=True)))
    for i, lane in enumerate(lanes):
        costs = every[many * i : many * (i + 1)]
        best = int(np.argmin(np.where(np.isfinite(costs), costs, np.inf)))
        if costs[best] < lane.value:
            if lane.value - costs[best] > _SETTLED:
                moved.append(lane)
            lane.damping = max(lane.damping * _DAMPINGS[best], 1e-6)
            j = many * i + best
            lane.to(trials[j], tried[j], costs[best])
        elif lane.damping < _STUCK:
            lane.damping *= 1e3
            moved.append(lane)
    return moved


def _trials(of: tuple[BodyLane, list[dict[str, np.ndarray]]]) -> list[np.ndarray]:
    """The parameters that a lane tries next, one for each damping, from its slopes."""
    lane, own = of
    low, high = bounds(lane.body)
    k = len(lane.free)
    normal, slope, _ = lane.equations(own)
    shares = np.diag(normal[k:, k:])
    inner = normal[k:, k:] + np.diag(np.where(shares > 0, 1e-8 * shares, 1.0))
    fold = np.linalg.solve(inner, normal[k:, :k])
    lane.normal = normal[:k, :k] - normal[:k, k:] @ fold
    push = slope[:k] - fold.T @ slope[k:]
    scale = np.sqrt(np.maximum(np.diag(lane.normal), 1e-300))
    unit, free = lane.normal / np.outer(scale, scale), list(lane.free)
    room = [(b[free] - lane.theta[free]) * scale for b in (low, high)]
    trials = []
    for factor in _DAMPINGS:
        move = _inside(unit + lane.damping * factor * np.eye(k), push / scale, *room)
        theta = lane.theta.copy()
        theta[free] += move / scale
        trials.append(np.clip(theta, low, high))
    return trials


def _inside(normal: np.ndarray, slope: np.ndarray, low: np.ndarray, high: np.ndarray) -> np.ndarray:
    """The step of normal equations within bounds: what would leave them is held there, and the
    others step without it."""
    step, held = np.zeros(len(slope)), np.zeros(len(slope), bool)
    for _ in range(len(slope)):
        free = ~held
        rhs = slope[free] - normal[np.ix_(free, held)] @ step[held]
        step[free] = np.linalg.solve(normal[np.ix_(free, free)], rhs)
        out = free & ((step < low) | (step > high))
        if not out.any():
            break
        step[out] = np.clip(step[out], low[out], high[out])
        held |= out
        if held.all():
            break
    return step


def residual(body: Body, fit: BodyFit, channel: str, use: np.ndarray) -> Float[np.ndarray, "R N"]:
    """What a fit leaves of a channel after the chain rule, over any samples, by the shares that the
    fit has found."""
    above = {c for c in ("r", channel) if c in fit.predicted}
    e = {c: body.measured[c] - fit.predicted[c] for c in above}
    X = body.everywhere.columns(e)[channel]
    return np.where(use, e[channel] - np.tensordot(fit.shares[channel], X, 1), 0.0)
