"""The plain plant at every order, and what a larger one would be."""

import math
from collections.abc import Sequence

import numpy as np

from ..actuator.hypothesis import Hypothesis, Refit, residual, responses
from ..actuator.lanes import POLES
from ..actuator.refit import refit
from ..actuator.stage import Stage
from ..actuator.starts import feeding, first_order, nested
from ..signals.colour import whiten
from .price import score

ORDERS = ((1, 0), (2, 0), (2, 1), (3, 0), (3, 1), (3, 2), (4, 0), (4, 1), (4, 2), (4, 3))
"""Orders that a baseline may have. The plant comes first: a missing pole must not be called a
delay. Where the command is seen in the row in which it is given, as many zeros as poles too."""
_AT_ONCE, _SURE = 0.05, 60.0  # share of the innovations that a step of the command explains in its
# own row, and the same in twice the log-likelihood, from which on a plant has a feed-through
_LARGE, _PASSES = 0.3, 0.5  # of the largest step, and of what passes of all steps, that passes of
# the large ones


def baselines(stage: Stage) -> dict[tuple[int, int], Refit]:
    """The plain plant at every order, each from its neighbours with less."""
    first = refit(stage, first_order(stage))
    grid = {(1, 0): max(first, key=lambda f: f.loglik)}
    for poles in range(2, POLES + 1):
        wanted = [order for order in ORDERS if order[0] == poles]
        starts = []
        for order in wanted:
            simpler = [f.hypothesis for key, f in grid.items() if key[0] == poles - 1]
            starts += [h for less in simpler for h in nested(stage, less) if order_of(h) == order]
        fits = best_of_each(refit(stage, closest(stage, starts)))
        grid |= {order_of(f.hypothesis): f for f in fits}
        for order in wanted:  # a zero more, from the same number of poles
            if (poles, order[1] - 1) in grid:
                below = grid[poles, order[1] - 1].hypothesis
                more = [h for h in nested(stage, below) if order_of(h) == order]
                known = [grid[order]] if order in grid else []
                again = best_of_each([*refit(stage, closest(stage, more)), *known])
                grid |= {order_of(f.hypothesis): f for f in again}
        best = max(grid.values(), key=lambda f: score(stage, f))
        if best.hypothesis.poles < poles:
            break
    if feeds_through(stage, best):
        starts = [feeding(stage, f.hypothesis) for f in grid.values()]
        fits = best_of_each(refit(stage, closest(stage, starts)))
        grid |= {order_of(f.hypothesis): f for f in fits}
    return grid


def feeds_through(stage: Stage, fit: Refit) -> bool:
    """Whether what a fit leaves moves with a step of the command in the row of the step itself,
    before which no plant without feed-through moves. Rows that are means of several see so much of
    any plant. A controller that makes the command of the row's noise looks the same, but works the
    other way than the plant at rest does, and not by large steps."""
    if stage.within is not None:
        return False
    step = np.diff(stage.u, axis=1, prepend=stage.u[:, :1])
    white = whiten(residual(stage, fit.y)[None], fit.colour[None])[0]
    x, y = step[stage.mask], white[stage.mask]
    share = float(x @ y) ** 2 / max(float((x @ x) * (y @ y)), 1e-300)
    large = np.abs(x) > _LARGE * np.abs(x).max(initial=0.0)
    passed = (x[large] @ y[large]) / max(float(x[large] @ x[large]), 1e-300)
    passes = passed * (x @ y) > _PASSES * (x @ y) ** 2 / max(float(x @ x), 1e-300)
    at_rest = fit.hypothesis.num[-1] / fit.hypothesis.den[-1]
    passes = passes and passed * at_rest > 0.0
    return bool(share > _AT_ONCE and share * x.size > _SURE and passes)


def grown(stage: Stage, fit: Refit) -> list[Refit]:
    """The same with more poles and zeros, for as long as they are worth their price."""
    found = []
    while True:
        starts = closest(stage, list(nested(stage, fit.hypothesis)), 1)
        better = max(refit(stage, starts), key=lambda f: score(stage, f), default=fit)
        if score(stage, better) <= score(stage, fit):
            return found
        found.append(better)
        fit = better


def closest(stage: Stage, starts: Sequence[Hypothesis], kept: int = 2) -> list[Hypothesis]:
    """The starts of each order whose responses come closest as they stand, gain left open."""
    if len(starts) <= kept:
        return list(starts)
    y = responses(stage, starts)[:, stage.mask]
    seen = stage.y[stage.mask]
    errors = np.sum((y - seen) ** 2, axis=1)
    picked: dict[tuple, list[int]] = {}
    for k in np.argsort(np.where(np.isfinite(errors), errors, np.inf)):
        own = picked.setdefault(starts[k].kind, [])
        if len(own) < kept:
            own.append(int(k))
    return [starts[k] for own in picked.values() for k in own]


def best_of_each(fits: Sequence[Refit]) -> list[Refit]:
    """The best fit of each order with each set of causes; those that failed are left out."""
    best: dict[tuple, Refit] = {}
    for f in fits:
        key = f.hypothesis.kind
        if math.isfinite(f.loglik) and (key not in best or f.loglik > best[key].loglik):
            best[key] = f
    return list(best.values())


def order_of(h: Hypothesis) -> tuple[int, int]:
    """Numbers of poles and zeros."""
    return h.poles, h.zeros
