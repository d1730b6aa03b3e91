"""What each cause of the body would gain, by one step from a fit."""

from collections.abc import Sequence

import numpy as np

from .body import CAUSES, INDEX, Body
from .body_fit import BodyFit, Lane, bounds, slopes
from .colour import whiten

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
    lane = Lane.of(body, at)
    low, high = bounds(body)
    inner = [i for i in body.nuisance if low[i] < lane.theta[i] < high[i]]
    kept = [*inner, *(i for i in lane.free if i not in body.nuisance)]
    causes = [k for k in body.allowed if may_join(k, at)]
    free = [*kept, *(i for k in causes for i in INDEX[k])]
    columns = dict(zip(free, slopes(body, [lane], [free])[0], strict=True))
    found = []
    for k in causes:
        own = [*kept, *INDEX[k]]
        gain, step = _predict(body, lane, [columns[i] for i in own])
        theta = at.theta.copy()
        theta[own] += step
        bounded = np.clip(theta, low, high)
        index = list(INDEX[k])
        fine = np.allclose(bounded[index], theta[index]) and bool(np.any(bounded[index] != 0.0))
        found.append((gain if fine else 0.0, k, bounded))
    return sorted(found, key=lambda f: -f[0])


def _predict(body: Body, lane: Lane, slopes: Sequence[dict]) -> tuple[float, np.ndarray]:
    """Gain of twice the log-likelihood by the best linear step, and the step: that of the noise's
    colour as it stands, or that of plain least squares, since the colour of what lacks a cause has
    taken a part of it, and nearly all of one that is slow."""
    normal, slope, stacks = lane.equations(slopes)
    k = len(slopes)
    plain, push = np.eye(len(slope)), np.zeros_like(slope)  # the chain's shares as they stand
    plain[:k, :k] = 0.0
    for c, (rows, _) in stacks.items():
        seen = rows[: 1 + k, body.counted[c]]
        gram = seen @ seen.T / max(float(np.mean(seen[0] ** 2)), 1e-300)
        plain[:k, :k] += gram[1:, 1:]
        push[:k] += gram[1:, 0]
    best = (-np.inf, np.zeros(k))
    for matrix, target in ((normal, slope), (plain, push)):
        own = np.diag(matrix).copy()
        scale = np.sqrt(np.where(own > 0, own, 1.0))
        unit = matrix / np.outer(scale, scale) + 1e-8 * np.eye(len(scale))
        move = np.linalg.solve(unit, target / scale) / scale
        gain = 0.0
        for c, (rows, where) in stacks.items():
            counted = body.counted[c]
            rest = rows[0] - np.tensordot(move[where], rows[1:], 1)
            colour = body.colour(c, rest, repeated=False)
            variance = float(np.mean(whiten(rest[None], colour[None])[0][counted] ** 2))
            gain += counted.sum() * float(np.log(lane.variance[c] / max(variance, 1e-300)))
        best = max(best, (gain, move[:k]), key=lambda pair: pair[0])
    return best
