"""What a cause is worth on data that no fit has seen."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import combinations
from math import factorial

import numpy as np
from jaxtyping import Bool, Float

from ..actuator.hypothesis import Refit
from ..actuator.stage import Stage
from ..answer.result import Gain
from ..signals.colour import whiten
from ..signals.windows import BLOCK, block_sums, blocks_in, slow_part

_STEADY, _VERY_STEADY = 2.0, 3.0  # standard errors by blocks
_MUCH, _MOST, NEARLY_ALL = 0.25, 0.5, 0.85  # share of the squared error
_USUAL = 0.7  # share of the blocks that get better
_FAST = 0.5  # share of a change in what is not slow
_BLOCKS = 60  # stretches of a channel, at the most, that are asked one by one
_FAINT = 0.25  # of what it does where it was fitted, below which data held out hardly show a cause


@dataclass(frozen=True, eq=False)
class Scored:
    """A channel with and without a cause.

    Attributes:
        channel: its name.
        y: (runs, N) measured.
        before, after: (runs, N) simulated without and with the cause.
        colour: whitening filter of the model with it.
        memory: of what makes the errors, s: a slow plant keeps what disturbs it.
    """

    channel: str
    y: Float[np.ndarray, "R N"]
    before: Float[np.ndarray, "R N"]
    after: Float[np.ndarray, "R N"]
    colour: Float[np.ndarray, " order"]
    memory: float = BLOCK

    @classmethod
    def of_stage(cls, stage: Stage, before: Refit, after: Refit) -> "Scored":
        """The response of a stage, by two models of it. Its standard errors are those that the
        search's thresholds are for, which are too small for a slow plant."""
        return cls("", stage.y, before.y, after.y, after.colour)

    def taken(self, use: Bool[np.ndarray, "R N"]) -> float:
        """Share of the squared error that the cause takes away."""
        before, after = (np.mean((self.y - y)[use] ** 2) for y in (self.before, self.after))
        return 1.0 - float(after) / max(float(before), 1e-300)

    def parts(self, use: Bool[np.ndarray, "R N"], dt: float) -> Float[np.ndarray, " blocks"]:
        """The same, block by block."""
        blocks = blocks_in(int(use.sum()), dt, _BLOCKS, self.memory)
        before, after = (
            np.maximum(block_sums((self.y - y)[use] ** 2, blocks), 1e-300)
            for y in (self.before, self.after)
        )
        return 1.0 - after / before

    def faint(self, fitted: Bool[np.ndarray, "R N"], held_out: Bool[np.ndarray, "R N"]) -> bool:
        """Whether the cause takes most of the error where it was fitted, and the data held out
        hardly show it: it does little there."""
        there, here = (np.mean((self.after - self.before)[u] ** 2) for u in (fitted, held_out))
        return bool(here < _FAINT * there) and self.taken(fitted) > _MOST

    def fast(self, use: Bool[np.ndarray, "R N"], dt: float) -> float:
        """Share of what the cause changes that is faster than a slow error."""
        change = np.where(use, self.after - self.before, 0.0)
        rest = change - slow_part(change, dt)
        return float(np.sum(rest[use] ** 2)) / max(float(np.sum(change**2)), 1e-300)


@dataclass(frozen=True)
class Trial:
    """What a cause is worth on data held out.

    Attributes:
        gain: in the channel that it is worth most in.
        predicted: the same as the screen had promised it; None where it had not.
        worth: twice the log-likelihood over all channels.
        steady: that in its standard errors by blocks; a wrong form gains here and loses there.
        fast, faint: see `Scored`.
    """

    gain: Gain
    predicted: Gain | None
    worth: float
    steady: float
    fast: float
    faint: bool = False

    def believed(self, share: float, puzzling: bool, disturbed: bool = False) -> bool:
        """Whether a cause that takes this share of the squared error is named: where much is left
        that nothing explains, which is slow, a name must take nearly all, or take much or something
        of most blocks and hold from block to block, or take most by what it does fast. Where a
        disturbance is left, it must take most, or hold from block to block. Data that hardly show
        it may not tell it from block to block."""
        plain = self.gain.sureness
        if puzzling:
            sharp = self.fast > _FAST and share > _MOST and plain > _VERY_STEADY
            lasting = self.steady > _VERY_STEADY and (share > _MUCH or self.gain.typical > 0.0)
            return sharp or share > NEARLY_ALL or lasting
        much = _MOST if disturbed else _MUCH
        return share > much or max(self.steady, plain) > _STEADY or (self.faint and not disturbed)


def fit_percent(y: np.ndarray, error: np.ndarray) -> float:
    """FIT, eq. (3), percent."""
    spread = float(np.sqrt(np.sum((y - y.mean()) ** 2)))
    return 100.0 * (1.0 - float(np.sqrt(np.sum(error**2))) / max(spread, 1e-300))


def gain_of(scored: Scored, use: Bool[np.ndarray, "R N"], held_out: bool, dt: float) -> Gain:
    """FIT and squared error before and after, with the standard error of the difference of FIT by
    leaving out blocks."""
    y = scored.y[use]
    before, after = (scored.y - scored.before)[use], (scored.y - scored.after)[use]
    fits = fit_percent(y, before), fit_percent(y, after)
    blocks = blocks_in(int(use.sum()), dt, _BLOCKS, scored.memory)
    label = np.arange(y.size) * blocks // y.size
    kept = [label != b for b in range(blocks)]
    if all(np.ptp(y[k]) > 0.0 for k in kept):
        rises = np.array([fit_percent(y[k], after[k]) - fit_percent(y[k], before[k]) for k in kept])
        se = float(np.sqrt((blocks - 1) / blocks * np.sum((rises - rises.mean()) ** 2)))
    else:  # all that moves is in one block
        se = abs(fits[1] - fits[0])
    mse = float(np.mean(before**2)), float(np.mean(after**2))
    parts = scored.parts(use, dt)
    typical = float(np.median(parts)) if np.mean(parts > 0.0) >= _USUAL else 0.0
    return Gain(scored.channel, *fits, se, *mse, held_out=held_out, typical=typical)


def confirmed(scored: Scored, use: Bool[np.ndarray, "R N"], dt: float) -> tuple[float, float]:
    """Twice the log-likelihood that the cause gains on data that no fit has seen, and its variance
    by blocks."""
    squares = []
    for simulated in (scored.before, scored.after):
        e = np.where(use, scored.y - simulated, 0.0)
        squares.append(whiten(e[None], scored.colour[None])[0][use] ** 2)
    before, after = (max(float(np.mean(s)), 1e-300) for s in squares)
    blocks = blocks_in(int(use.sum()), dt)  # of innovations, which remember nothing
    parts = block_sums((squares[0] - squares[1]) / after, blocks)
    return float(use.sum()) * float(np.log(before / after)), float(parts.var(ddof=1) * parts.size)


def shapley(players: Sequence[str], worth: Callable[[frozenset[str]], float]) -> dict[str, float]:
    """Shapley values: the mean over all orders of what each adds to a coalition.

    Args:
        players: names.
        worth: of a frozenset of names.

    Source: Shapley, A value for n-person games (1953).
    """
    n, values = len(players), {}
    known = {}

    def of(coalition):
        if coalition not in known:
            known[coalition] = worth(coalition)
        return known[coalition]

    for player in players:
        others = [p for p in players if p != player]
        total = 0.0
        for size in range(n):
            weight = factorial(size) * factorial(n - size - 1) / factorial(n)
            for group in combinations(others, size):
                coalition = frozenset(group)
                total += weight * (of(coalition | {player}) - of(coalition))
        values[player] = total
    return values
