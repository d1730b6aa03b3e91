"""The search over one pair of signals: where each order starts, and how orders help each other.

Every order starts from equation-error fits, is refined, and is started again from its neighbours
with one zero or one pole less, until no order gains: so FIT never falls where orders nest. At last
orders start at other delays and from neighbours with more.
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from vdmsi_jax.identify.denominators import equal_poles, with_a_pole_less, with_pole
from vdmsi_jax.identify.equation_error import equation_error
from vdmsi_jax.identify.layout import Samples
from vdmsi_jax.identify.pairs import promising_pairs
from vdmsi_jax.identify.refine import Candidate, Judged, judge, refine
from vdmsi_jax.identify.response import N_MAX, Details, Order, detail
from vdmsi_jax.programs import Kept
from vdmsi_jax.threads import each

_CUTOFFS = (1.0, 4.0)  # of the first filters, in units of the pole of the best first-order fit
_NEW_POLES = (0.5, 5.0)  # where a nested start puts its extra pole, in the same units
_FASTEST = (20.0, 200.0)  # or, times the sampling period, where it acts at once
_NEW_PAIRS = (1.8, 4.0)  # and a lightly damped pair of poles, near the sampling frequency
_LINES = 12  # and so many where the residual has lines
_STARTS, _AGAIN = 5, 2  # how many of an order's candidates are refined, and from a known point
_PROMISING = 1.01  # residual, relative to the order's best, of a start that is worth refining
_ROUNDS = 12
_GAIN = 1e-4  # relative fall of the residual for which an order's neighbours start again from it
_LANES = 10  # candidates simulated side by side: their signals fit the cache
_SHORT = 50_000  # samples, up to which idle lanes cost less than another program to compile
_DELAYS = 20  # of the grid over the delay
_APART = 0.25  # samples between delays that are two
_NEAR = 1.0  # samples to the next delay known, beyond which all orders start anew
_ROOM = 1.05  # the same as `_PROMISING` of an order that is far behind a larger one
_FEWER_LINES = 3  # where pairs have been tried before
_MEMORY = 4e8  # bytes of signals that a batch may hold


@dataclass(frozen=True)
class Point:
    """The best found for one order: `a` ascending in scaled time, delay in samples."""

    order: tuple[int, int]
    a: np.ndarray
    d: float
    cost: float = np.inf
    scale: np.ndarray | None = None
    converged: bool = False


class Search:
    """All orders over one pair of signals, in batches of one size that share compiled programs.

    **Arguments:**

    - `orders`: pairs of numbers of poles and zeros, zeros not exceeding poles.
    - `longest_delay`: in samples; None where there is no delay to find.
    - `offset`: whether the output has an offset to find.
    """

    def __init__(
        self,
        samples: Samples,
        orders: Iterable[tuple[int, int]],
        *,
        longest_delay: float | None,
        offset: bool,
    ):
        self.samples, self.orders = samples, list(orders)
        self.longest = jnp.asarray(longest_delay or 0.0, float)
        self.has_delay, self.offset = longest_delay is not None, offset
        self.lanes = _fitting_lanes(samples, _LANES)
        _compile(samples, self.lanes, _detailed_at_once(samples, len(self.orders)))

    def run(self, delays: Sequence[float]) -> dict[tuple[int, int], Point]:
        """The best found for every order, from starts at `delays` (in samples, the best first)."""
        if self.has_delay:
            delays = list(dict.fromkeys([*delays[:2], *self._look_over(delays)]))
        starts = [
            Point(order, equal_poles(cutoff, order[0]), delay)
            for delay in delays
            for cutoff in (_CUTOFFS if delay == delays[0] else _CUTOFFS[-1:])
            for order in self.orders
        ]
        return self._settle(
            self._improve({}, self._run("equation_error", starts)), lines=_LINES, most=_STARTS
        )

    def _look_over(
        self, delays: Sequence[float], cutoffs: Sequence[float] = _CUTOFFS
    ) -> list[float]:
        """The best delays of an order of some freedom, on a grid up to the longest of `delays`.

        The loss over the delay has several minima, and a first-order response takes for delay what
        is lag of a higher order.
        """
        freedom = [order for order in self.orders if order[1] <= 1 and order[0] <= 3]
        order = max(freedom or self.orders[:1])
        grid = np.linspace(0.0, min(1.2 * max(delays) + 2, float(self.longest)), _DELAYS)
        starts = [Point(order, equal_poles(c, order[0]), d) for c in cutoffs for d in grid]
        judged = self._run("judge", self._run("equation_error", starts))
        return [p.d for p in sorted(judged, key=lambda point: point.cost)[:2]]

    def settle(self, points: Iterable[Point]) -> dict[tuple[int, int], Point]:
        """The best found for every order, from one point of each, which is near it."""
        return self._settle(self._improve({}, list(points)), lines=0, most=_AGAIN)

    def look_elsewhere(
        self, points: Iterable[Point], delays: Sequence[float]
    ) -> dict[tuple[int, int], Point]:
        """The best found for every order, also far from the one point of each that is known.

        The loss over the delay has several minima, and which is the least differs between samples,
        and between the ways to it. So orders start at the delays of each other with their own
        poles, from neighbours with more, with a pair of poles more, and anew at `delays` (in
        samples, the best first) and those that these samples show, where none is near. Such starts
        cost a simulation each; refined are those that are better than what is known.
        """
        best = {point.order: point for point in points}
        unfinished = {order for order, point in best.items() if not point.converged}
        known = [point.d for point in best.values()]
        looked = [*delays[:2], *self._look_over(delays, _CUTOFFS[-1:])]
        anew = [
            Point(order, equal_poles(_CUTOFFS[-1], order[0]), delay)
            for delay in _apart([*known, *looked], _NEAR)
            if delay not in known
            for order in self.orders
        ]
        starts = self._run("equation_error", anew)
        starts += self._with_pairs(best, set(best), _FEWER_LINES)
        changed = set(best)
        for _ in range(_ROUNDS):
            before = best
            starts += self._from_larger(best, changed) + self._at_delays(best, changed)
            room = self._room(best)
            best = self._improve(best, starts, most=_AGAIN, promising=room, again=unfinished)
            changed = {o for o in self.orders if best[o].cost < before[o].cost * (1 - _GAIN)}
            if not changed:
                break
            starts, unfinished = self._nested(best, changed, _FEWER_LINES), changed
        return {o: replace(p, converged=o not in changed) for o, p in best.items()}

    def polish(self, points: Iterable[Point]) -> dict[tuple[int, int], Point]:
        """The best of every order next to one point of each, which a search on a part of these
        samples found. Orders start from each other again only where one is worse than one that it
        contains, as where a pole that grew little over that part grows much over all."""
        best, changed = self._improve({}, list(points)), set(self.orders)
        for _ in range(_ROUNDS):
            before, fallen = best, {o for o in self.orders if self._fallen(best, o)}
            starts = [p for p in self._nested(best, set(self.orders), 0) if p.order in fallen]
            best = self._improve(best, starts, most=_AGAIN, again=changed - fallen)
            changed = {o for o in self.orders if best[o].cost < before[o].cost * (1 - _GAIN)}
            if not changed:
                break
        return {o: replace(p, converged=o not in changed) for o, p in best.items()}

    def _fallen(self, best: dict[tuple[int, int], Point], order: tuple[int, int]) -> bool:
        """Whether an order is worse than one that it contains."""
        n, m = order
        inside = [best[o].cost for o in ((n, m - 1), (n - 1, m - 1), (n - 1, m)) if o in best]
        return bool(best[order].cost > (1.0 + _GAIN) * min(inside, default=np.inf))

    def _settle(
        self, best: dict[tuple[int, int], Point], *, lines: int, most: int
    ) -> dict[tuple[int, int], Point]:
        """Refine every order, and from the `most` promising of its neighbours, until none gains;
        with a pair of poles at so many `lines` of what they leave."""
        changed = set(self.orders)
        for _ in range(_ROUNDS):
            before = best
            starts = self._nested(best, changed, lines)
            best = self._improve(best, starts, most=most, again=changed)
            changed = {o for o in self.orders if best[o].cost < before[o].cost * (1 - _GAIN)}
            if not changed:
                break
        return {o: replace(p, converged=o not in changed) for o, p in best.items()}

    def _improve(
        self,
        best: dict[tuple[int, int], Point],
        candidates: list[Point],
        *,
        most: int = _STARTS,
        promising: Mapping[tuple[int, int], float] | None = None,
        again: Iterable[tuple[int, int]] = (),
    ) -> dict[tuple[int, int], Point]:
        """Refine the `most` promising candidates of each order, the orders `again` also from their
        best, and keep the better. A candidate is `promising` up to so many times the residual of
        the best."""
        judged = [
            point
            for point in self._run("judge", candidates)
            if point.order not in best
            or point.cost < best[point.order].cost * (promising or {}).get(point.order, _PROMISING)
        ]
        judged = sorted(judged + [best[o] for o in again], key=lambda point: point.cost)
        chosen: list[Point] = []
        for order in self.orders:
            chosen += _distinct([p for p in judged if p.order == order])[:most]
        best = dict(best)
        for point in judged + self._run("refine", chosen):
            if point.order not in best or point.cost < best[point.order].cost:
                best[point.order] = point
        return best

    def _nested(
        self, best: dict[tuple[int, int], Point], changed: set[tuple[int, int]], lines: int
    ) -> list[Point]:
        """Starts of each order from its neighbours with less that have changed."""
        new_poles = (*_NEW_POLES, *(pole / float(self.samples.dt) for pole in _FASTEST))
        candidates = []
        for n, m in self.orders:
            if (n, m - 1) in changed:
                candidates.append(Point((n, m), best[n, m - 1].a, best[n, m - 1].d))
            if n == m and self.has_delay and (n, m) in changed:
                # a feed-through makes the loss step from sample to sample, with no slope to follow
                point = best[n, m]
                candidates += [Point((n, m), point.a, max(point.d + by, 0.0)) for by in (-1.0, 1.0)]
            for smaller in ((n - 1, m), (n - 1, m - 1)):
                if smaller in changed:
                    point = best[smaller]
                    # without its feed-through a plant answers a sample later
                    sooner = 1.0 if smaller == (m, m) and self.has_delay else 0.0
                    delay = max(point.d - sooner, 0.0)
                    candidates += [
                        Point((n, m), with_pole(point.a, n - 1, p), delay) for p in new_poles
                    ]
        return candidates + self._with_pairs(best, changed, lines)

    def _room(self, best: dict[tuple[int, int], Point]) -> dict[tuple[int, int], float]:
        """How much worse than the best of each order a start may be: as much as that is worse than
        a neighbour with more, where it may have been passed by."""
        room = {}
        for n, m in self.orders:
            around = [best[o].cost for o in ((n, m + 1), (n + 1, m)) if o in best]
            room[n, m] = float(np.clip(best[n, m].cost / min(around, default=np.inf), 1.0, _ROOM))
        return room

    def _from_larger(
        self, best: dict[tuple[int, int], Point], changed: set[tuple[int, int]]
    ) -> list[Point]:
        """Starts of each order from its neighbours with more that have changed: without the leading
        coefficient of the numerator, or without a pole, whose lag is left out or becomes delay."""
        longest = float(self.longest)
        starts = []
        for n, m in self.orders:
            if (n, m + 1) in changed:
                starts.append(Point((n, m), best[n, m + 1].a, best[n, m + 1].d))
            for larger in ((n + 1, m), (n + 1, m + 1)):
                if larger in changed:
                    point = best[larger]
                    for a, lag in with_a_pole_less(point.a, n + 1):
                        late = min(point.d + lag / float(self.samples.dt), longest)
                        starts += [Point((n, m), a, d) for d in dict.fromkeys((point.d, late))]
        return starts

    def _at_delays(
        self, best: dict[tuple[int, int], Point], changed: set[tuple[int, int]]
    ) -> list[Point]:
        """Starts of each order with its own poles at the delays of those that have changed."""
        delays = _apart([best[order].d for order in changed], _APART)
        return [
            Point(order, known.a, delay)
            for order, known in best.items()
            for delay in delays
            if abs(delay - known.d) > _APART
        ]

    def _with_pairs(
        self, best: dict[tuple[int, int], Point], changed: set[tuple[int, int]], lines: int
    ) -> list[Point]:
        """Starts from orders with two poles less, or two poles and two zeros, that have changed."""
        dt = float(self.samples.dt)
        fixed = [complex(-0.05 * w, w) / dt for w in _NEW_PAIRS]
        links = [
            (best[n - 2, m - zeros], zeros)
            for n, m in self.orders
            for zeros in (0, 2)
            if (n - 2, m - zeros) in changed
        ]
        if not links or not lines:
            return [_paired(point, zeros, p) for point, zeros in links for p in fixed]
        points = list({p.order: p for p, _ in links}.values())
        ones = jnp.ones(self.samples.n_segments, self.samples.u.dtype)
        details = simulate_points(
            self.samples, ones, points, delay=self.has_delay, offset=self.offset
        )
        known = dict(zip((p.order for p in points), details, strict=True))
        u, y, weight = (
            np.asarray(x).reshape(-1) for x in (self.samples.u, self.samples.y, self.samples.weight)
        )
        starts = []
        for point, zeros in links:
            own, (n, m) = known[point.order], point.order
            num, den = np.asarray(own.beta)[m::-1], np.append(1.0, point.a[:n][::-1])
            left = (y - own.predicted.reshape(-1)) * weight
            pairs = promising_pairs(u, left, dt, num, den, zeros, lines if n > 1 else 1)
            starts += [_paired(point, zeros, p) for p in (*fixed, *pairs)]
        return starts

    def _run(self, name: str, points: list[Point]) -> list[Point]:
        """What a program makes of all points, in batches that run side by side."""
        parts = [points[k : k + self.lanes] for k in range(0, len(points), self.lanes)]
        batches = []
        for part in parts:
            padded = part + part[-1:] * (self.lanes - len(part))
            start, order = _stack(padded, delay=self.has_delay, offset=self.offset)
            batches.append((start if name == "refine" else start.candidate, order))

        def run(batch: tuple[tuple[Any, Order], list[Point]]) -> list[Point]:
            stacked, part = batch
            return _unstack(_PROGRAMS[name](*stacked, self.samples, self.longest), part)

        return sum(each(run, list(zip(batches, parts, strict=True))), [])


def simulate_points(
    samples: Samples, fitted: Array, points: Sequence[Point], *, delay: bool, offset: bool
) -> list[Details]:
    """`detail` of each point, as NumPy arrays, a few at a time where the record is long."""
    lanes = _detailed_at_once(samples, len(points))
    found = []
    for first in range(0, len(points), lanes):
        part = list(points[first : first + lanes])
        start, order = _stack(part + part[-1:] * (lanes - len(part)), delay=delay, offset=offset)
        out = jax.tree.map(np.asarray, _PROGRAMS["detail"](start.candidate, order, samples, fitted))
        found += [jax.tree.map(lambda leaf, i=i: leaf[i], out) for i in range(len(part))]
    return found


def _detailed_at_once(samples: Samples, points: int) -> int:
    return _fitting_lanes(samples, 1 if points == 1 and samples.u.size > _SHORT else _LANES)


def _fitting_lanes(samples: Samples, wanted: int) -> int:
    return int(np.clip(_MEMORY / (30 * 8 * samples.u.size), 1, wanted))


def _stack(points: Sequence[Point], *, delay: bool, offset: bool) -> tuple[Judged, Order]:
    scale = [np.ones(N_MAX + 1) if p.scale is None else p.scale for p in points]
    real = jnp.zeros(()).dtype
    candidate = Candidate(
        jnp.asarray(np.stack([p.a for p in points]), real),
        jnp.asarray(np.array([p.d for p in points]), real),
    )
    cost = jnp.asarray(np.array([p.cost for p in points]), real)
    order = Order(
        jnp.asarray(np.array([p.order[0] for p in points])),
        jnp.asarray(np.array([p.order[1] for p in points])),
        jnp.full(len(points), delay),
        jnp.full(len(points), offset),
    )
    return Judged(candidate, cost, jnp.asarray(np.stack(scale), real)), order


def _unstack(out: Judged | Candidate, points: Sequence[Point]) -> list[Point]:
    judged = out if isinstance(out, Judged) else None
    candidate = out.candidate if isinstance(out, Judged) else out
    a, d = np.asarray(candidate.a), np.asarray(candidate.d)
    if judged is None:
        return [Point(p.order, a[i], float(d[i])) for i, p in enumerate(points)]
    cost, scale = np.asarray(judged.cost), np.asarray(judged.scale)
    return [
        Point(p.order, a[i], float(d[i]), float(cost[i]), scale[i]) for i, p in enumerate(points)
    ]


def _distinct(points: list[Point]) -> list[Point]:
    """Leave out points whose cost says that they are an earlier one again."""
    kept: list[Point] = []
    for point in points:
        if all(abs(point.cost - other.cost) > 1e-6 * other.cost for other in kept):
            kept.append(point)
    return kept


def _paired(point: Point, zeros: int, pole: complex) -> Point:
    """A point with a pole and its conjugate more, and so many zeros."""
    n, m = point.order
    pair = [abs(pole) ** 2, -2.0 * pole.real, 1.0]
    a = np.convolve(np.append(point.a[:n], 1.0), pair)[: n + 2]
    return Point((n + 2, m + zeros), np.pad(a, (0, N_MAX - n - 2)), point.d)


def _apart(delays: Iterable[float], least: float) -> list[float]:
    """Those delays that lie `least` or more from all before them."""
    kept: list[float] = []
    for delay in delays:
        if all(abs(delay - other) >= least for other in kept):
            kept.append(delay)
    return kept


def _refined(points: Judged, orders: Order, samples: Samples, longest: Array) -> Judged:
    return jax.vmap(lambda p, o: refine(p, o, samples, longest))(points, orders)


def _fitted(points: Candidate, orders: Order, samples: Samples, longest: Array) -> Candidate:
    return jax.vmap(lambda p, o: equation_error(p, o, samples))(points, orders)


def _judged(points: Candidate, orders: Order, samples: Samples, longest: Array) -> Judged:
    return jax.vmap(lambda p, o: judge(p, o, samples, longest))(points, orders)


def _detailed(points: Candidate, orders: Order, samples: Samples, fitted: Array) -> Details:
    return jax.vmap(lambda p, o: detail(p.a, p.d, o, samples, fitted))(points, orders)


_PROGRAMS: dict[str, Kept] = {
    "refine": Kept(_refined),
    "equation_error": Kept(_fitted),
    "judge": Kept(_judged),
    "detail": Kept(_detailed),
}


def _compile(samples: Samples, lanes: int, detailed: int) -> None:
    """Have the programs of a search ready, made side by side; `detailed` lanes of the last."""
    some = [Point((1, 0), np.zeros(N_MAX), 0.0)]
    start, order = _stack(some * lanes, delay=True, offset=True)
    finished, orders = _stack(some * detailed, delay=True, offset=True)
    longest, segments = jnp.zeros(()), jnp.ones(samples.n_segments, samples.u.dtype)
    given = {
        "refine": (start, order, samples, longest),
        "equation_error": (start.candidate, order, samples, longest),
        "judge": (start.candidate, order, samples, longest),
        "detail": (finished.candidate, orders, samples, segments),
    }
    each(lambda one: _PROGRAMS[one[0]].compile(*one[1]), list(given.items()))
