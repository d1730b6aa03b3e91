"""The error budget: who is responsible for how much, in whatever order the causes are put in."""

from collections.abc import Callable, Sequence

import numpy as np
from jaxtyping import Bool, Float

from ..answer.result import Budget
from ..body.fit import residual, with_only
from ..body.lane import BodyFit
from ..body.search import BodySearch, judges_of
from ..search.found import Search
from ..search.judge import shapley
from ..signals.windows import block_sums, blocks_in
from .naming import Named
from .road import Road, only

_CHANCE = 2.0  # standard errors, by blocks, that an error may be larger where it was not fitted


def of_channel(
    name: str, unit: str, search: Search, causes: Sequence[Named], structure: float = 0.0
) -> Budget:
    """The squared error of an actuator's response on the data held out.

    Args:
        name, unit: of the response.
        search: what was found.
        causes: those that are sure.
        structure: share of what the final model leaves that is no noise.
    """
    stage = search.stage
    numbers = {c.label: c.finding.number for c in causes if c.finding is not None}

    def left(kept: frozenset[str]) -> np.ndarray:
        return stage.y - only(search, tuple(numbers[k] for k in kept))

    both = stage.y - search.baseline.y, stage.y - search.final.y
    masks = stage.mask, search.judges
    return _of_squares((name, unit), list(numbers), both, left, masks, stage.dt, structure)


def of_turning(bodily: BodySearch, causes: Sequence[Named], structure: float = 0.0) -> Budget:
    """The squared error of the yaw rate at the measured speed and angle, likewise: what the body,
    the road and the sensors do to it."""
    body, fitted = bodily.body, bodily.body.mask["r"]
    use, _ = judges_of(body, "r")
    numbers = {c.label: c.body.number for c in causes if c.body is not None}

    def left(fit: BodyFit) -> np.ndarray:
        return residual(body, fit, "r", fitted | use)

    def of_some(kept: frozenset[str]) -> np.ndarray:
        return left(with_only(body, bodily.final, {numbers[k] for k in kept}))

    both = left(bodily.plain), left(bodily.final)
    told = "r", "rad/s"
    return _of_squares(told, list(numbers), both, of_some, (fitted, use), body.dt, structure)


def _of_squares(
    told: tuple[str, str],
    labels: Sequence[str],
    both: tuple[Float[np.ndarray, "R N"], Float[np.ndarray, "R N"]],
    left: Callable[[frozenset[str]], Float[np.ndarray, "R N"]],
    masks: tuple[Bool[np.ndarray, "R N"], Bool[np.ndarray, "R N"]],
    dt: float,
    structure: float,
) -> Budget:
    """Of the errors of the baseline and the final model, and of that with some of its causes."""
    name, unit = told
    fitted, use = masks

    def error(e: np.ndarray) -> float:
        return float(np.mean(e[use] ** 2))

    total, rest = map(error, both)
    noise = min(_noise(both[1] ** 2, fitted, use, dt), (1.0 - structure) * rest)
    worths = shapley(labels, lambda kept: _at_least(total, error(left(kept))))
    parts = _scaled(worths, total - rest)
    squared = f"({unit})^2" if "/" in unit else f"{unit}^2"
    return Budget(name, squared, total, parts, noise, total - sum(parts.values()) - noise)


def of_path(road: Road, causes: Sequence[Named]) -> Budget:
    """The mean translation error on the held-out drive."""
    by_label = {c.label: c for c in causes}
    total, rest = road.baseline_mean, road.extended_mean

    def worth(kept: frozenset[str]) -> float:
        return _at_least(total, road.with_only([by_label[k] for k in kept]))

    parts = _scaled(shapley(list(by_label), worth), total - rest)
    noise = min(road.floor(), rest)
    return Budget("translation", "m", total, parts, noise, total - sum(parts.values()) - noise)


def _noise(
    squared: Float[np.ndarray, "R N"],
    fitted: Bool[np.ndarray, "R N"],
    held: Bool[np.ndarray, "R N"],
    dt: float,
) -> float:
    """How much of the squared error of data held out is noise: as much as where the model was
    fitted, and all of it where it is no more than chance makes of noise that lasts."""
    told, seen = squared[fitted], squared[held]
    blocks = [block_sums(x, blocks_in(x.size, dt)) for x in (told, seen)]
    spread = sum(
        float(np.var(b, ddof=1)) * b.size / x.size**2
        for b, x in zip(blocks, (told, seen), strict=True)
    )
    before, rest = float(np.mean(told)), float(np.mean(seen))
    return rest if rest - before < _CHANCE * np.sqrt(spread) else before


def _at_least(total: float, error: float) -> float:
    """Worth of some of the causes: where the others are missed so much that the model errs more
    than the baseline, or does not end, one has the baseline still."""
    return -float(np.fmin(error, total))


def _scaled(parts: dict[str, float], whole: float) -> dict[str, float]:
    """The same shares of what the baseline, which was refitted without the causes, loses; where
    that or what they take together is no loss, what they miss of it is split evenly."""
    total = sum(parts.values())
    if min(total, whole) > 0.0:
        return {name: value * whole / total for name, value in parts.items()}
    return {name: value + (whole - total) / len(parts) for name, value in parts.items()}
