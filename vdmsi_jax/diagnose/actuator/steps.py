"""Commands that act in steps: all sizes of a step, tried at once in the linear plant.

What rounding adds to a command repeats with every step, so the likelihood of a step is as ragged as
there are steps in the command's range: the few sizes that a screen simulates miss most, and so do
rows that are means of several of the log's own, each of which was rounded by itself. The answer of
a linear plant is one product of Fourier transforms, which makes hundreds of sizes cheap.
"""

from collections.abc import Callable

import numpy as np
from jaxtyping import Float

from .hypothesis import Refit
from .stage import Stage

_COARSEST, _FINEST = 4.0, 200.0  # steps in the command's range
_APART = 0.5  # of a turn over that range, between two steps that are tried
_CLOSER = 16  # sizes that are tried about the likeliest ones
_KEPT = 2  # of them, of either sign
_AT_ONCE = 64
_ROWS, _RUNS = 16_384, 4  # of the log's own rows of a run, and runs, that are looked at


def rounding(u: np.ndarray, step: np.ndarray, by: str) -> np.ndarray:
    """What rounding to a step, to the `nearest` or by `floor`, adds to a command."""
    to_whole = {"nearest": np.round, "floor": np.floor}[by]
    return to_whole(u / step) * step - u


def likely_steps(
    stage: Stage, at: Refit, pull: Callable[[np.ndarray], np.ndarray]
) -> dict[str, tuple[np.ndarray, Float[np.ndarray, "k R N"]]]:
    """The likeliest sizes of a step by either rounding, and by what the response is then another;
    nothing of a command that does not move.

    Args:
        stage: the data; `within` where its rows are means.
        at: the plant, without causes.
        pull: of directions (L, R, N), the square that each explains, with the sign of its share.
    """
    u = stage.u[..., None] if stage.within is None else stage.within
    u = u[:_RUNS, : max(_ROWS // u.shape[2], 1)]
    reach = float(np.ptp(u))
    if not reach > 0.0:
        return {}
    answers = _Answers(stage, at, u)

    def told(steps: np.ndarray, by: str) -> np.ndarray:
        parts = np.array_split(steps, -(-steps.size // _AT_ONCE))
        return np.concatenate([pull(answers.to(rounding_of(part, by))) for part in parts])

    def rounding_of(steps: np.ndarray, by: str) -> np.ndarray:
        return rounding(u[None], steps[:, None, None, None], by)

    turns = np.arange(_COARSEST, _FINEST, _APART) / reach
    signed = told(1.0 / turns, "nearest")
    found = {}
    # the first overtone of one rounding is that of the other with the sign turned
    for by, sign in (("nearest", 1.0), ("floor", -1.0)):
        near = turns[np.argsort(-sign * signed)[:_KEPT]]
        around = np.linspace(-_APART, _APART, _CLOSER) / reach
        steps = 1.0 / (near[:, None] + around).ravel()
        best = steps[np.argsort(-told(steps, by))[:_KEPT]]
        found[by] = (best, answers.to(rounding_of(best, by)))
    return found


class _Answers:
    """What a linear plant answers to additions to its command."""

    def __init__(self, stage: Stage, at: Refit, u: Float[np.ndarray, "some part E"]):
        self.shape, self.every = stage.u.shape, u.shape[2]
        self.rows = u.shape[1] * self.every
        taps = stage.impulse(at.hypothesis.theta, self.rows, self.every)
        self.size = 1 << (2 * self.rows - 1).bit_length()
        self.transfer = np.fft.rfft(taps, self.size)

    def to(self, added: Float[np.ndarray, "L some part E"]) -> Float[np.ndarray, "L R N"]:
        """At the first of the rows that each of the stage's is made of; nothing in runs, and ends
        of them, that are not looked at."""
        many, some, part, _ = added.shape
        flat = added.reshape(many, some, self.rows)
        answer = np.fft.irfft(np.fft.rfft(flat, self.size) * self.transfer, self.size)
        found = np.zeros((many, *self.shape))
        found[:, :some, :part] = answer[..., : self.rows : self.every]
        return found
