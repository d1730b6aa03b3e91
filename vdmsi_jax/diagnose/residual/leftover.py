"""What a model leaves of a channel, in the words of a diagnosis: a kind of error without a name,
what one colour takes for noise, and a cause that other data refute."""

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from ...data.record import Record
from ..answer.result import Unexplained
from ..search.search import lasts
from ..signals.colour import unsteadiness
from ..signals.unexplained import PUZZLING, SMALL, extent
from .families import HYSTERESIS, PACE
from .regression import Explained

LOUD = 100.0
"""Of twice the log-likelihood, from which a cause that fails on other data is told."""

SEEN = 0.005
"""Of the squared error, from which on it is."""

_COMES_AND_GOES = 10.0  # `unsteadiness`, from which on an error is no noise: 173 channels of clean
# logs had up to 2.6, measured vehicles, whose noise goes with their speed, 8.6, a machine that runs
# up 50
_COLOURFUL = 0.02, 0.1  # of a response's spread, such an error beside no cause and beside some
_ROUNDED = 0.25  # of a squared error, that is a rounding's
_OF_ITSELF = {HYSTERESIS: PUZZLING, PACE: 0.1}  # share of what is left, from which on these are no
# form of a play, friction or limit of a rate: of 2800 hunted drives no such name was right


def of_a_kind(
    channel: str,
    kind: Explained | None,
    causes: Sequence[str],
    e: np.ndarray,
    y: np.ndarray,
    use: np.ndarray,
) -> list[Unexplained]:
    """What a kind explains of an error in a response: told as the form of a cause that was found
    where it is of its kind, and as small where it is that beside the response."""
    if kind is None:
        return []
    words, on = f"{kind.family.words} would explain it", kind.family.depends_on
    size = float(np.sqrt(kind.share * np.mean(e[use] ** 2))) / extent(y[use])
    known = [c for c in causes if c in (kind.family.causes or ())]
    if kind.share > _OF_ITSELF.get(kind.family.words, 1.0):
        known = []
    if known:
        words = f"{known[0]} has another form; {words}"
    if size < SMALL:
        words += f"; {100.0 * size:.1f} % of the response's spread"
    if known or size < SMALL:
        return [Unexplained(channel, kind.share, on, (), words, size=size, of_form=bool(known))]
    puzzling = kind.share > PUZZLING and not (causes and kind.by_fit_alone)
    family = kind.family.words
    return [Unexplained(channel, kind.share, on, (), words, puzzling=puzzling, kind=family)]


def taken_for_noise(
    channel: str,
    e: np.ndarray,
    white: np.ndarray,
    y: np.ndarray,
    use: np.ndarray,
    beside: bool,
    most: float = math.inf,
) -> list[Unexplained]:
    """An error that one estimated colour takes for noise, and is none: it is `most` of a response
    and lasts, and a model that tells so little of a response has not told why; or it is large,
    `beside` a cause or none, and its frequencies come and go."""
    error, variance = float(np.mean(e[use] ** 2)), float(np.mean(white[use] ** 2))
    size = math.sqrt(error) / extent(y[use])
    if size >= most and lasts(error, variance, y[use]):
        how = "which lasts"
    elif size >= _COLOURFUL[beside] and unsteadiness(white, use) >= _COMES_AND_GOES:
        how = "whose frequencies change"
    else:
        return []
    words = f"an error of {100.0 * size:.0f} % of the response's spread, {how}"
    return [Unexplained(channel, 1.0 - variance / error, ("t",), (), words, puzzling=True)]


def steps_of(records: Sequence[Record], channel: str) -> list[float]:
    """Sizes of the steps in which a channel was logged, of the records where it was in some."""
    return [s for r in records if channel in r and (s := r.step(channel)) is not None]


def is_rounding(steps: Sequence[float], e: np.ndarray) -> bool:
    """Whether much of an error may be the rounding of what is logged in some `steps`, whose
    frequencies go with the signal's speed."""
    return max(steps, default=0.0) ** 2 / 12.0 > _ROUNDED * float(np.mean(e**2))


def puzzles(left: Sequence[Unexplained]) -> bool:
    return any(u.puzzling and u.fraction > PUZZLING for u in left)


def refuted(label: str, channel: str, fraction: float, size: float = math.inf) -> Unexplained:
    """A cause that explains what was fitted and fails on what was held out; told as small where all
    that it explains is that beside the response."""
    words = f"{label} would explain the data fitted, and fails on the data held out"
    left = Unexplained(channel, fraction, ("run",), (), words, puzzling=fraction > PUZZLING)
    return replace(left, size=size) if size < SMALL else left
