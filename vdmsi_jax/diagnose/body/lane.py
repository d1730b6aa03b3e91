"""A hypothesis about the body on its way to its optimum, and there: likelihood over all channels,
by the chain rule."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from ..signals.chain import regress
from ..signals.colour import whiten
from ..signals.windows import inverse
from .body import INDEX, Body

_NO_NOISE = 1e-200  # variance at the least: of logs that were made up, and stand still


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
            self.variance[c] = max(float(np.mean(self.white(c, left[None]) ** 2)), _NO_NOISE)
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
            int(self.body.counted[c].sum()) * float(np.log(self.variance[c])) for c in self.y
        )

    def finish(self) -> BodyFit:
        """The fit as it stands."""
        return BodyFit(
            self.active, self.theta, self.loglik, self.y, self.left(),
            self.colour, self.variance, self.shares, self.free, inverse(self.normal),
        )  # fmt: skip
