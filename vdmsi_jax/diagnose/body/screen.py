"""What each cause of the body would gain, by one step from a fit."""

from collections.abc import Sequence

import numpy as np

from ...threads import each
from ..signals.colour import whiten
from .body import CAUSES, INDEX, Body
from .fit import bounds, slopes
from .lane import BodyFit, BodyLane

_LAGGING = ("sensor_lag", "sensor_delay")


def may_join(number: int, at: BodyFit) -> bool:
    """Whether a cause is not on, nor another form of one that is: a vehicle has one offset, and a
    sensor is late by a lag or by a delay."""
    late = [CAUSES[k].channel for k in at.active if CAUSES[k].cause in _LAGGING]
    own = CAUSES[number]
    on = {CAUSES[k].told for k in at.active}
    return own.told not in on and not (own.cause in _LAGGING and own.channel in late)


def screen_body(body: Body, at: BodyFit) -> list[tuple[float, int, np.ndarray]]:
    """Predicted gain of every cause that is not on, with the parameters to start a refit from, the
    best first: one step from the fit, the colours estimated anew."""
    lane = BodyLane.of(body, at)
    low, high = bounds(body)
    inner = [i for i in body.nuisance if low[i] < lane.theta[i] < high[i]]
    kept = [*inner, *(i for i in lane.free if i not in body.nuisance)]
    causes = [k for k in body.allowed if may_join(k, at)]
    free = [*kept, *(i for k in causes for i in INDEX[k])]
    parts = _Parts(lane, slopes(body, [lane], [free])[0])
    gains = each(lambda k: parts.predict([free.index(i) for i in (*kept, *INDEX[k])]), causes)
    found = []
    for k, (gain, step) in zip(causes, gains, strict=True):
        own, index = [*kept, *INDEX[k]], list(INDEX[k])
        theta = at.theta.copy()
        theta[own] += step
        bounded = np.clip(theta, low, high)
        fine = np.allclose(bounded[index], theta[index]) and bool(np.any(bounded[index] != 0.0))
        found.append((gain if fine else 0.0, k, bounded))
    return sorted(found, key=lambda f: -f[0])


class _Parts:
    """The equations of a lane for many slopes at once, of which a step takes some."""

    def __init__(self, lane: BodyLane, slopes: Sequence[dict[str, np.ndarray]]):
        self.lane, self.count = lane, len(slopes)
        self.normal, self.slope, self.stacks = lane.equations(slopes)
        self.plain, self.push = np.eye(len(self.slope)), np.zeros_like(self.slope)
        k = self.count  # the chain's shares stay as they are in the plain ones
        self.plain[:k, :k] = 0.0
        for c, (rows, _) in self.stacks.items():
            seen = rows[: 1 + k, lane.body.counted[c]]
            gram = seen @ seen.T / max(float(np.mean(seen[0] ** 2)), 1e-300)
            self.plain[:k, :k] += gram[1:, 1:]
            self.push[:k] += gram[1:, 0]

    def predict(self, own: Sequence[int]) -> tuple[float, np.ndarray]:
        """Gain of twice the log-likelihood by the best linear step of some of the parameters, and
        the step: that of the noise's colour as it stands, or that of plain least squares, since the
        colour of what lacks a cause has taken a part of it, and nearly all of one that is slow."""
        body = self.lane.body
        used = [*own, *range(self.count, len(self.slope))]
        best = (-np.inf, np.zeros(len(own)))
        for matrix, target in ((self.normal, self.slope), (self.plain, self.push)):
            part = matrix[np.ix_(used, used)]
            scale = np.sqrt(np.where(np.diag(part) > 0, np.diag(part), 1.0))
            unit = part / np.outer(scale, scale) + 1e-8 * np.eye(len(scale))
            step = np.zeros(len(self.slope))
            step[used] = np.linalg.solve(unit, target[used] / scale) / scale
            gain = 0.0
            for c, (rows, where) in self.stacks.items():
                counted, taken = body.counted[c], np.flatnonzero(step[where])
                shares = step[np.array(where)[taken]]
                rest = rows[0] - np.tensordot(shares, rows[1 + taken], 1)
                colour = body.colour(c, rest, repeated=False)
                variance = float(np.mean(whiten(rest[None], colour[None])[0][counted] ** 2))
                lost = self.lane.variance[c] / max(variance, 1e-300)
                gain += counted.sum() * float(np.log(lost))
            best = max(best, (gain, step[list(own)]), key=lambda pair: pair[0])
        return best
