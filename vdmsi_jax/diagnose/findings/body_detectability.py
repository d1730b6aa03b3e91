"""What logs could have shown of the body, the road and the sensors, as `detectability` says it of
the actuators."""

import math
from dataclasses import replace
from itertools import product

import numpy as np
from jaxtyping import Float

from ..answer.result import Detectable
from ..body.body import CAUSES, INDEX
from ..body.fit import bounds, slopes
from ..body.lane import BodyLane
from ..body.screen import may_join
from ..body.search import BodySearch
from .detectability import ALIKE, SURE, open_about

_HALVINGS = 30  # of the logarithm of the range in which a size is sought
_UNSEEN = 1e-6  # non-centrality, of all the room that a parameter has
_LEAST = 1e-9  # of the largest size, where that range begins


def detectable_in_body(found: BodySearch) -> list[Detectable]:
    """Every cause of the body that is not on: its first parameter at the smallest size that these
    logs would have shown, and the causes whose effects look alike.

    What parameters that are free anyway can do of a cause is not seen of it; those of `NUISANCE`,
    of which every vehicle has a little, as far as their bounds let them.
    """
    body, at = replace(found.body, refuted=()), found.final
    causes = [k for k in body.allowed if may_join(k, at)]
    own = [INDEX[k][0] for k in causes]
    usual, other = list(body.nuisance), [i for i in at.free if i not in body.nuisance]
    lane = BodyLane.of(body, at)
    normal, _, _ = lane.equations(slopes(body, [lane], [[*own, *usual, *other]])[0])
    normal = _less(normal, len(own) + len(usual))
    n, (low, high) = len(own), bounds(body)
    room = low[usual] - at.theta[usual], high[usual] - at.theta[usual]
    hidden = _Hidden(normal[n:, n:], *room)
    sizes, ways = [], np.zeros((n, len(normal)))
    for i, most in enumerate(high[own]):
        size = _smallest(hidden, normal[n:, i], float(normal[i, i]), most)
        told = size if math.isfinite(size) else most
        sizes.append(size)
        ways[i, i], ways[i, n:] = told, -hidden.taken(told * normal[n:, i])[0]
    products = ways @ normal @ ways.T
    scale = np.sqrt(np.maximum(np.diag(products), 1e-300))
    cosines = np.abs(products) / np.outer(scale, scale)
    best: dict[tuple, Detectable] = {}
    for i, (k, size) in enumerate(zip(causes, sizes, strict=True)):
        cause, seen = CAUSES[k], math.isfinite(size)
        others = [CAUSES[causes[j]].cause for j in np.flatnonzero(cosines[i] > ALIKE)]
        names, hint = open_about(cause.effect, others, seen)
        first, unit = cause.names[0], cause.units[0]
        new = Detectable(cause.cause, cause.where, first, size, unit, names, hint, cause.channel)
        if cause.told not in best or size < best[cause.told].smallest:
            best[cause.told] = new
    return list(best.values())


def _less(normal: Float[np.ndarray, "p p"], kept: int) -> Float[np.ndarray, "k k"]:
    """Normal equations of the first parameters alone, once the others are at their best."""
    scale = np.sqrt(np.maximum(np.diag(normal)[kept:], 1e-300))
    inner = normal[kept:, kept:] / np.outer(scale, scale) + 1e-10 * np.eye(len(scale))
    across = normal[kept:, :kept] / scale[:, None]
    return normal[:kept, :kept] - across.T @ np.linalg.solve(inner, across)


class _Hidden:
    """What parameters within bounds take of an effect: least squares in a box, as the best of the
    optima with some of them held at a bound that lie inside."""

    def __init__(
        self,
        normal: Float[np.ndarray, "m m"],
        low: Float[np.ndarray, " m"],
        high: Float[np.ndarray, " m"],
    ):
        m = len(low)
        self._normal, self._low, self._high = normal, low, high
        gains, rests = [], []
        nearly = np.diag(_UNSEEN / (high - low) ** 2)  # for those that the logs do not excite
        for sides in product((-1, 0, 1), repeat=m):
            side = np.array(sides, int)
            free, rest = side == 0, np.where(side < 0, low, np.where(side > 0, high, 0.0))
            gain, own = np.zeros((m, m)), np.ix_(free, free)
            gain[own] = np.linalg.inv(normal[own] + nearly[own])
            gains.append(gain)
            rests.append(rest - gain @ normal @ rest)
        self._gains, self._rests = np.stack(gains), np.stack(rests)

    def taken(self, across: Float[np.ndarray, " m"]) -> tuple[Float[np.ndarray, " m"], float]:
        """Where the parameters go, and what they take of the sum of squares."""
        at = self._gains @ across + self._rests
        slack = 1e-9 * (self._high - self._low)
        inside = np.all((at >= self._low - slack) & (at <= self._high + slack), axis=1)
        value = 2.0 * at @ across - np.sum(at @ self._normal * at, axis=1)
        best = int(np.argmax(np.where(inside, value, -np.inf)))
        return at[best], float(value[best])


def _smallest(hidden: _Hidden, across: Float[np.ndarray, " m"], own: float, most: float) -> float:
    """The size of a cause at which its non-centrality is `SURE`; infinite where none up to `most`
    has it."""

    def seen(size: float) -> float:
        return size**2 * own - hidden.taken(size * across)[1]

    if seen(most) < SURE:
        return math.inf
    low, high = _LEAST * most, most
    for _ in range(_HALVINGS):
        middle = math.sqrt(low * high)
        low, high = (low, middle) if seen(middle) >= SURE else (middle, high)
    return high
