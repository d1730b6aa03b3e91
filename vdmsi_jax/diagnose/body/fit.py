"""Fits of the body, the road and the sensors: Levenberg-Marquardt of many hypotheses at once."""

from collections.abc import Collection, Sequence
from dataclasses import replace
from functools import partial

import numpy as np
from jaxtyping import Float

from ...threads import each
from ..signals.chain import regress
from ..signals.windows import BLOCK, block_sums, widening
from .body import CAUSES, INDEX, LAGS, LANES, NUISANCE, Body
from .lane import BodyFit, BodyLane

Start = tuple[tuple[int, ...], np.ndarray]
"""Of a fit: the causes that are on, and the parameters."""

_MOST = 5.0  # of a parameter of the body, in its unit
_STEP = 1e-3
_STEPS = 3  # of Levenberg-Marquardt at one colour
_DAMPINGS = (1e-3, 1.0, 1e2)  # times a lane's own, that are tried at each
_STUCK = 10.0  # damping from which on a lane rests where no step helps
_SETTLED = 0.05  # gain of twice the log-likelihood by a step after which a lane rests


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
