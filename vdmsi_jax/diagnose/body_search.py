"""The search for causes in the body, the road and the sensors: likelihood over all its channels."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float

from .body import CAUSES, CHANNELS, NUISANCE_LAG, TAPS, Body
from .colour import autoregression, filter_length, whiten
from .search import CAUSE_COST, MARGIN, PARAMETER_COST

_STEP = 1e-3
_MOST = 7
_REFITTED = 5  # candidates of a screen that are refitted


@dataclass(frozen=True, eq=False)
class BodyFit:
    """A hypothesis about the body at its optimum.

    Attributes:
        active: numbers of the causes that are on.
        theta: parameters.
        loglik: over all channels.
        logliks: by channel.
        predicted: by channel, (runs, N); `left` the residual after the chain rule.
        colour, variance: by channel.
        free: numbers of the free parameters; `covariance` theirs.
    """

    active: tuple[int, ...]
    theta: Float[np.ndarray, " P"]
    loglik: float
    logliks: dict[str, float]
    predicted: dict[str, np.ndarray]
    left: dict[str, np.ndarray]
    colour: dict[str, np.ndarray]
    variance: dict[str, float]
    free: tuple[int, ...]
    covariance: Float[np.ndarray, "p p"]


@dataclass(frozen=True)
class BodyFinding:
    """A cause, what it is worth in twice the log-likelihood, the model without it, and what was
    tried in its place with what it lacks."""

    number: int
    gain: float
    less: BodyFit
    others: tuple[tuple[int, float], ...]
    promised: float

    @property
    def rivals(self) -> tuple[int, ...]:
        """The causes that explain the data as well."""
        return tuple(k for k, lack in self.others if lack < MARGIN)


@dataclass(frozen=True, eq=False)
class BodySearch:
    """What was found in the body."""

    body: Body
    plain: BodyFit
    final: BodyFit
    findings: tuple[BodyFinding, ...]


def price(active: Sequence[int]) -> float:
    """As in the actuators' search."""
    return float(sum(CAUSE_COST + PARAMETER_COST * CAUSES[i].weight for i in active))


def search_body(body: Body) -> BodySearch:
    """Find the causes that the body's channels support, as the actuators' search does."""
    plain = now = fit_body(body, [()])[0]
    while len(now.active) < _MOST:
        promising = [s for s in screen_body(body, now) if s[0] > 8.0][:_REFITTED]
        if not promising:
            break
        fits = refit_body(body, [(tuple(sorted({*now.active, k})), t) for _, k, t in promising])
        best = max(fits, key=lambda f: 2 * f.loglik - price(f.active))
        if 2 * best.loglik - price(best.active) <= 2 * now.loglik - price(now.active):
            break
        now = best
    while now.active:
        less = fit_body(body, [tuple(k for k in now.active if k != i) for i in now.active], now)
        best = max(less, key=lambda f: 2 * f.loglik - price(f.active))
        if 2 * best.loglik - price(best.active) < 2 * now.loglik - price(now.active):
            break
        now = best
    return BodySearch(body, plain, now, _findings(body, now))


def screen_body(body: Body, at: BodyFit) -> list[tuple[float, int, np.ndarray]]:
    """Predicted gain of every cause that is not on, with the parameters to start a refit from, the
    best first: one step from the fit, the colours estimated anew."""
    lane = _Lane.of(body, at)
    bound = lane.theta[0] <= 0.0 or lane.theta[0] >= NUISANCE_LAG
    kept = lane.free[1:] if bound else lane.free
    causes = [k for k in body.allowed if k not in at.active]
    free = [*kept, *(i for k in causes for i in body.index[k])]
    sizes = {i: _STEP * (0.1 if i else 0.02) for i in free}
    shifted = []
    for i in free:
        theta = at.theta.copy()
        theta[i] += sizes[i]
        shifted.append(theta)
    before = lane.left(lane.y)
    moved = {
        i: {c: (before[c] - e) / sizes[i] for c, e in lane.left(y).items()}
        for i, y in zip(free, _answers(body, shifted), strict=True)
    }
    X = chain(body, lane.y, lane.raw(lane.y))
    found = []
    for k in causes:
        own = [*kept, *body.index[k]]
        gain, step = _predict(body, lane, before, {i: moved[i] for i in own}, X)
        theta = at.theta.copy()
        theta[own] += step
        bounded = _within(body, (*at.active, k), theta.copy())
        index = list(body.index[k])
        fine = np.allclose(bounded[index], theta[index]) and bool(np.any(bounded[index] != 0.0))
        found.append((gain if fine else 0.0, k, bounded))
    return sorted(found, key=lambda f: -f[0])


def _predict(body: Body, lane: "_Lane", left, moved, X) -> tuple[float, np.ndarray]:
    """Gain of twice the log-likelihood by the best linear step, and the step."""
    k, columns = len(moved), sum(len(x) for x in X.values())
    normal, slope, at = np.zeros((k + columns, k + columns)), np.zeros(k + columns), k
    stacks = {}
    for c, e in left.items():
        rows = np.concatenate([e[None], np.stack([m[c] for m in moved.values()]), X[c]])
        stacks[c] = (rows, [*range(k), *range(at, at + len(X[c]))])
        mask = body.mask[c]
        w = whiten(rows[None], lane.colour[c][None])[0][:, mask] / np.sqrt(lane.variance[c])
        gram = w @ w.T
        normal[np.ix_(stacks[c][1], stacks[c][1])] += gram[1:, 1:]
        slope[stacks[c][1]] += gram[1:, 0]
        at += len(X[c])
    own = np.diag(normal).copy()
    scale = np.sqrt(np.where(own > 0, own, 1.0))
    unit = normal / np.outer(scale, scale) + 1e-8 * np.eye(len(scale))
    move = np.linalg.solve(unit, slope / scale) / scale
    gain = 0.0
    for c, (rows, where) in stacks.items():
        mask = body.mask[c]
        rest = rows[0] - np.tensordot(move[where], rows[1:], 1)
        colour = autoregression(rest[None], mask, len(lane.colour[c]))
        variance = float(np.mean(whiten(rest[None], colour)[0][mask] ** 2))
        gain += mask.sum() * float(np.log(lane.variance[c] / max(variance, 1e-300)))
    return gain, move[:k]


def _findings(body: Body, now: BodyFit) -> tuple[BodyFinding, ...]:
    found = []
    for i in now.active:
        rest = tuple(k for k in now.active if k != i)
        less = fit_body(body, [rest], now)[0]
        gain = 2 * (now.loglik - less.loglik)
        screened = screen_body(body, less)
        promised = next((g for g, k, _ in screened if k == i), 0.0)
        close = [s for s in screened if s[1] != i and s[0] > 0.3 * gain][:_REFITTED]
        fits = refit_body(body, [(tuple(sorted((*rest, k))), t) for _, k, t in close])
        others = [
            (k, 2 * (now.loglik - f.loglik) + 2 * (CAUSES[k].weight - CAUSES[i].weight))
            for (_, k, _), f in zip(close, fits, strict=True)
        ]
        found.append(
            BodyFinding(i, gain, less, tuple(sorted(others, key=lambda o: o[1])), promised)
        )
    return tuple(sorted(found, key=lambda f: -f.gain))


def fit_body(
    body: Body, actives: Sequence[tuple[int, ...]], start: BodyFit | None = None
) -> list[BodyFit]:
    """Fit hypotheses, started from another's parameters."""
    size = 1 + sum(len(c.names) for c in CAUSES)
    starts = []
    for active in actives:
        theta = np.zeros(size)
        theta[0] = 0.5 * NUISANCE_LAG if start is None else start.theta[0]
        if start is not None:
            for k in (k for k in start.active if k in active):
                theta[list(body.index[k])] = start.theta[list(body.index[k])]
        starts.append((tuple(active), theta))
    return refit_body(body, starts)


def refit_body(
    body: Body, starts: Sequence[tuple[tuple[int, ...], np.ndarray]], rounds: int = 2
) -> list[BodyFit]:
    """Fit hypotheses from their starts, each with its own colours."""
    if not starts:
        return []
    lanes = [_Lane(body, active, theta) for active, theta in starts]
    for lane, y in zip(lanes, _answers(body, [lane.theta for lane in lanes]), strict=True):
        lane.y = y
    for _ in range(rounds):
        for lane in lanes:
            lane.recolour()
        for _ in range(2):
            _step(body, lanes)
    for lane in lanes:
        lane.recolour()
    return [lane.finish() for lane in lanes]


def _answers(body: Body, thetas: Sequence[np.ndarray]) -> list[dict[str, np.ndarray]]:
    y = body.simulate(np.stack(thetas))
    return [{c: y[c][i] for c in y} for i in range(len(thetas))]


class _Lane:
    """A hypothesis on its way."""

    def __init__(self, body: Body, active: tuple[int, ...], theta: np.ndarray):
        self.body, self.active, self.theta = body, active, theta
        self.free = (0, *(i for k in active for i in body.index[k]))
        self.y: dict[str, np.ndarray] = {}
        self.colour: dict[str, np.ndarray] = {}
        self.variance: dict[str, float] = {}
        self.shares: dict[str, np.ndarray] = {}
        self.normal = np.eye(len(self.free))

    @classmethod
    def of(cls, body: Body, fit: BodyFit) -> "_Lane":
        """A lane at a fit."""
        lane = cls(body, fit.active, fit.theta)
        lane.y, lane.colour = fit.predicted, dict(fit.colour)
        lane.recolour()
        return lane

    def raw(self, y: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
        body = self.body
        return {c: np.where(body.mask[c], body.measured[c] - y[c], 0.0) for c in y}

    def left(self, y: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
        """Residuals after the chain rule, its shares as they stand."""
        e = self.raw(y)
        return {
            c: np.where(self.body.mask[c], e[c] - np.tensordot(self.shares[c], X, 1), 0.0)
            for c, X in chain(self.body, y, e).items()
        }

    def recolour(self) -> None:
        e = self.raw(self.y)
        for c, X in chain(self.body, self.y, e).items():
            mask = self.body.mask[c]
            order = filter_length(self.body.dt, int(mask.sum()))
            colour = self.colour.get(c, np.zeros(order))
            for _ in range(2):
                w = whiten(np.concatenate([e[c][None], X])[None], colour[None])[0][:, mask]
                self.shares[c] = _regress(w[1:], w[0])
                left = np.where(mask, e[c] - np.tensordot(self.shares[c], X, 1), 0.0)
                colour = autoregression(left[None], mask, order)[0]
            self.colour[c] = colour
            self.variance[c] = float(np.mean(whiten(left[None], colour[None])[0][mask] ** 2))

    def cost(self, y: dict[str, np.ndarray]) -> float:
        left = self.left(y)
        return sum(
            float(np.sum(whiten(e[None], self.colour[c][None])[0][self.body.mask[c]] ** 2))
            / self.variance[c]
            for c, e in left.items()
        )

    def finish(self) -> BodyFit:
        n = {c: int(self.body.mask[c].sum()) for c in self.y}
        logliks = {c: -0.5 * n[c] * float(np.log(max(self.variance[c], 1e-300))) for c in self.y}
        scale = np.sqrt(np.maximum(np.diag(self.normal), 1e-300))
        unit = self.normal / np.outer(scale, scale) + 1e-12 * np.eye(len(scale))
        covariance = np.linalg.inv(unit) / np.outer(scale, scale)
        return BodyFit(
            self.active, self.theta, sum(logliks.values()), logliks, self.y, self.left(self.y),
            self.colour, self.variance, self.free, covariance,
        )  # fmt: skip


def _regress(X: np.ndarray, e: np.ndarray) -> np.ndarray:
    """Least-squares shares of the rows of `X` in `e`; none for rows that are zero."""
    size = np.sqrt(np.mean(X**2, axis=1))
    scale = np.where(size > 0, size, 1.0)
    gram = (X / scale[:, None]) @ (X / scale[:, None]).T
    ridge = 1e-8 * X.shape[1] * np.eye(len(X))
    return np.linalg.solve(gram + ridge, (X / scale[:, None]) @ e) / scale


def chain(body: Body, y: dict[str, np.ndarray], e: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
    """By channel, what the residuals upstream of it may pass on, (columns, runs, N)."""
    by_angle = body.v / float(body.bicycle.wheelbase) * body.ddelta
    by_speed = np.tan(body.delta) / float(body.bicycle.wheelbase) * body.dv
    turn = e["r"] if "r" in e else by_angle + by_speed
    w = body.window * body.dt
    found = {
        "r": [*_taps(by_angle), *_taps(by_speed)],
        "psi": [_summed(body, turn), _summed(body, by_angle), _summed(body, by_speed)],
        "forward": [_summed(body, body.dv)],
        "aside": [
            0.5 * w * body.v * _summed(body, turn),
            0.5 * w * body.v * _summed(body, by_angle),
            _summed(body, body.v * body.ddelta),
        ],
    }
    kept = {}
    for c in CHANNELS:
        if c in y:
            kept[c] = np.where(body.mask[c], np.stack(found[c]), 0.0)
    return kept


def _taps(x: np.ndarray) -> list[np.ndarray]:
    return [np.roll(x, k, axis=1) for k in range(-TAPS, TAPS + 1)]


def _summed(body: Body, x: np.ndarray) -> np.ndarray:
    total = np.concatenate([np.zeros((len(x), 1)), np.cumsum(x, axis=1)], axis=1) * body.dt
    n = x.shape[1]
    return total[:, np.minimum(np.arange(n) + body.window, n)] - total[:, :n]


def _step(body: Body, lanes: list[_Lane]) -> None:
    """One Gauss-Newton step of every lane, whole or in parts."""
    shifted, owners = [], []
    for lane in lanes:
        for i in lane.free:
            theta = lane.theta.copy()
            theta[i] += _STEP * (0.1 if i else 0.02)
            shifted.append(theta)
            owners.append(lane)
    answers = iter(_answers(body, shifted))
    trials = []
    for lane in lanes:
        left = lane.left(lane.y)
        X = chain(body, lane.y, lane.raw(lane.y))
        k, columns = len(lane.free), sum(len(x) for x in X.values())
        normal, slope = np.zeros((k + columns, k + columns)), np.zeros(k + columns)
        moved = [lane.left(next(answers)) for _ in lane.free]
        sizes = [_STEP * (0.1 if i else 0.02) for i in lane.free]
        at = k
        for c, e in left.items():
            mask = body.mask[c]
            J = np.stack([(e - m[c]) / s for m, s in zip(moved, sizes, strict=True)])
            rows = np.concatenate([e[None], J, X[c]])
            w = whiten(rows[None], lane.colour[c][None])[0][:, mask] / np.sqrt(lane.variance[c])
            where = [*range(k), *range(at, at + len(X[c]))]
            gram = w @ w.T
            normal[np.ix_(where, where)] += gram[1:, 1:]
            slope[where] += gram[1:, 0]
            at += len(X[c])
        own = np.diag(normal[k:, k:])
        inner = normal[k:, k:] + np.diag(np.where(own > 0, 1e-8 * own, 1.0))
        fold = np.linalg.solve(inner, normal[k:, :k])
        lane.normal = normal[:k, :k] - normal[:k, k:] @ fold
        push = slope[:k] - fold.T @ slope[k:]
        scale = np.sqrt(np.maximum(np.diag(lane.normal), 1e-300))
        unit = lane.normal / np.outer(scale, scale) + 1e-6 * np.eye(k)
        move = np.linalg.solve(unit, push / scale) / scale
        for part in (1.0, 0.25):
            theta = lane.theta.copy()
            theta[list(lane.free)] += part * move
            trials.append(_within(body, lane.active, theta))
    tried = _answers(body, trials)
    for i, lane in enumerate(lanes):
        options = [(lane.cost(lane.y), lane.theta, lane.y)]
        options += [(lane.cost(tried[j]), trials[j], tried[j]) for j in (2 * i, 2 * i + 1)]
        options = [o for o in options if np.isfinite(o[0])] or options[:1]
        _, lane.theta, lane.y = min(options, key=lambda o: o[0])


def _within(body: Body, active: Sequence[int], theta: np.ndarray) -> np.ndarray:
    theta[0] = np.clip(theta[0], 0.0, NUISANCE_LAG)
    for k in active:
        index = list(body.index[k])
        theta[index] = np.clip(theta[index], CAUSES[k].lower, 5.0)
    return theta


def at_fixed(found: BodySearch, number: int, value: float) -> float:
    """What a cause at a given value lacks, in twice the log-likelihood, against the final fit."""
    lane = _Lane.of(found.body, found.final)
    theta = found.final.theta.copy()
    theta[found.body.index[number][0]] = value
    lane.theta, lane.y = theta, _answers(found.body, [theta])[0]
    lane.recolour()
    return 2.0 * (found.final.loglik - lane.finish().loglik)


def residual(body: Body, fit: BodyFit, channel: str, use: np.ndarray) -> Float[np.ndarray, "R N"]:
    """What a fit leaves of a channel after the chain rule, over any samples, by the shares that the
    fit has found."""
    lane = _Lane.of(body, fit)
    e = {c: body.measured[c] - fit.predicted[c] for c in fit.predicted}
    whole = {c: np.ones_like(body.mask[c]) for c in body.mask}
    X = chain(replace(body, mask=whole), fit.predicted, e)[channel]
    return np.where(use, e[channel] - np.tensordot(lane.shares[channel], X, 1), 0.0)
