"""Is there structure left? Tests on what a model leaves that need no hypothesis.

Is the energy of short windows beyond what their spread allows (drop-outs, knocks)? Is the error on
data held out larger than on those fitted? Is a slow error large beside the response? What kind of
error it is, where it is of one that has no name in the library, `regression` asks.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from jaxtyping import Bool, Float

from ...data.noise import white_noise_std
from ..answer.result import Unexplained
from .disturbance import apart, scores
from .windows import slow_part

BURSTS = "energy of short windows"
"""The test that drop-outs and knocks fail."""
WORSE = "the error on data held out is larger"
"""What is said of data that are not as those fitted."""
_WORTH = 0.01  # share of the innovations' variance below which bursts are not spoken of
_SHARP = (4.5, 1.6)  # of white windows: spreads of the logarithm of energy, and its least excess
_BROAD = (8.0, 3.0)  # of coloured ones, whose energies differ more
_KNOWN = (3.0, 1.6)  # of those where some are known to be
_WORSE = 1.6  # innovations on data held out, beside those fitted; runs differ in noise by 1.5
PUZZLING = 0.2
"""Share of the squared error, from which on what is left casts doubt on what was found beside."""
LARGE = 0.05
"""Slow error, of a response's spread, that is told where it was fitted."""
LARGE_HELD_OUT = 0.08
"""The same where it was not fitted."""
_SUBTLE = 0.025  # the same, below which it casts no doubt on a name
_HUGE = 0.3  # the same, from which on it is told whatever it looks like
_GOES_ALONG, _RARE = 4.5, 4.0  # `disturbance.scores`, from which on a large one is the model's:
_SURELY = 6.5  # disturbances of 60 blind cases had up to 4.3 and 3.8, other kinds 5 to 21
_LOPSIDED = 4.5  # the same of one that goes to one side: clean logs of seven exams had up to 2.8 in
# 173 channels, brakes, jams, spins and freezes 6 to 17
_EVEN, _APART_AT_ALL = 1.5, 0.1  # below which nothing hints at another thing than a disturbance
_LONG = 50.0  # time constants, that are looked at to say so
_APART = 0.25  # of a slow error, from which on its means set runs apart: of clean exams up to 0.09,
# of changes between runs and of lasting efforts 0.26 to 0.55
SMALL = 0.012
"""An error that is surely the model's, of a response's spread, below which it changes no verdict:
causes outside the library, made up of a size that is worth telling, leave 0.015 and more."""
FAITHFUL = 0.005
"""Error of every kind, of a response's spread, up to which a model is true to it: logs without
noise leave nothing but the rounding of the integration, which surely goes with what is asked."""
_OF_LEVEL = 0.25  # of the largest response, which counts as spread where it is larger
_BESIDE = 1.2  # innovations
_BEGINS, _BEGUN, _BEGINNING = 2.0, 5.0, 0.25  # s, time constants, and at most so much of a run, in
# which an error may be what a plant was doing before
_WINDOW = 0.5  # s
_OUTLIERS = 0.2  # of the samples, that may stand out in a window and the two beside it
_LASTS = 2.5  # times the usual error without these, which an event has; or, where it is shorter,
_KNOCKS, _OF_KNOCKS = 10.0, 0.1  # times what the medians of five samples usually are, and share


def events(
    channel: str,
    residual: Float[np.ndarray, "R N"],
    innovations: Float[np.ndarray, "R N"],
    known: Bool[np.ndarray, "R N"],
    runs: tuple[tuple[str, float], ...],
    dt: float,
    sure: bool = False,
) -> list[Unexplained]:
    """The test for drop-outs, jumps and knocks alone; see `structure`. Where it is `sure` that
    there are some, weaker ones are among them."""
    bursts = _bursts(innovations, residual, known, runs, dt, *_SHARP)
    bursts = bursts or _bursts(residual, residual, known, runs, dt, *_BROAD)
    bursts = (sure and _bursts(residual, residual, known, runs, dt, *_KNOWN)) or bursts
    if bursts is None:
        return []
    share, when = bursts
    return [Unexplained(channel, share, ("t",), when, BURSTS, kind=BURSTS)]


def structure(
    channel: str,
    residual: Float[np.ndarray, "R N"],
    innovations: Float[np.ndarray, "R N"],
    mask: Bool[np.ndarray, "R N"],
    held_out: Bool[np.ndarray, "R N"],
    runs: tuple[tuple[str, float], ...],
    dt: float,
) -> list[Unexplained]:
    """What is left in a channel, by the two tests that ask for no kind; empty if nothing is.

    Args:
        channel: its name.
        residual: what the model leaves; slow structure shows in it.
        innovations: the same whitened; fast structure shows in it.
        mask: samples that were fitted; `held_out`: those that were not.
        runs: of each row the name of its run, and how far into that it begins, s.
        dt: sample period, s.
    """
    found = events(channel, residual, innovations, mask | held_out, runs, dt)
    worse = _worse(innovations, residual, mask, held_out, dt)
    if worse is not None:
        found.append(Unexplained(channel, worse, ("run",), (), WORSE, kind=WORSE))
    return found


def slow_error(
    channel: str,
    residual: Float[np.ndarray, "R N"],
    innovations: Float[np.ndarray, "R N"],
    response: Float[np.ndarray, "R N"],
    asked: Float[np.ndarray, "k R N"],
    masks: tuple[Bool[np.ndarray, "R N"], Bool[np.ndarray, "R N"]],
    dt: float,
    noise: float = 0.0,
    moving: Bool[np.ndarray, "R N"] | bool = True,
    time_constant: float = 0.0,
    ground: bool = False,
) -> Unexplained | None:
    """A slow error that is large beside the response: noise with a colour can imitate anything that
    is slow, so no innovation shows it, and its size is what tells it. One that neither goes with
    what is asked, nor comes in events, nor goes to one side, nor sets runs apart is told as steady:
    wind and rough ground are.

    Args:
        channel: its name.
        residual: what the model leaves; `innovations`: the same whitened.
        response: what was measured.
        asked: `disturbance.demands`, or none.
        masks: samples that were fitted, and those that were not.
        dt: sample period, s.
        noise: standard deviation of what is slow and known to be noise.
        moving: where a vehicle moves: while it stands, wind and rough ground do nothing, and they
            would seem to go with what is asked.
        time_constant: of the plant, s: few of them hint at nothing, whatever makes the error, and
            a small error of the first few of a run is what went on before.
        ground: whether rough ground goes with what is asked, too, as it does where the yaw rate is
            concerned, so that only events tell.
    """
    known = masks[0] | masks[1]
    begun = known & _begun(known, max(_BEGINS, _BEGUN * time_constant) / dt)
    scored = None
    for use, least in zip(masks, (LARGE, LARGE_HELD_OUT), strict=True):
        if not use.any():
            continue
        slow = slow_part(np.where(use, residual, 0.0), dt)[use]
        whole = float(np.sqrt(np.mean(slow**2)))
        fast = float(np.sqrt(np.mean(innovations[use] ** 2)))
        spread = extent(response[use])
        if whole < SMALL * spread:
            continue
        scored = scored or scores(residual, asked, known & moving, dt)
        lopsided = scored.to_a_side > _LOPSIDED  # as no noise is, whatever repeats say of it
        repeated = 0.0 if lopsided else noise
        size = float(np.sqrt(max(whole**2 - repeated**2, 0.0)))
        if size < max(SMALL * spread, repeated):
            continue
        along = 0.0 if ground else scored.along
        large = size > max(least * spread, _BESIDE * fast)
        if not large and max(along, scored.rare) < _SURELY:
            continue
        if not large:  # nor by what went on before the runs
            since = scores(residual, asked, begun & moving, dt)
            if max(0.0 if ground else since.along, since.rare) < _SURELY:
                continue
        parted = apart(residual, known, dt)
        made = along > _GOES_ALONG or scored.rare > _RARE or lopsided or parted > _APART
        share = min(size**2 / max(float(np.mean(residual[use] ** 2)), 1e-300), 1.0)
        size /= spread
        words = f"a slow error of {100.0 * size:.0f} % of the response's spread"
        words += ", to one side" * lopsided
        steady = not made and (ground or not len(asked) or size < _HUGE)
        puzzling = not steady and size > _SUBTLE
        long = bool(known.sum() * dt > _LONG * time_constant)
        even = steady and long and len(asked) > 0
        even = even and max(scored.along, scored.rare) < _EVEN and parted < _APART_AT_ALL
        return Unexplained(
            channel, share, ("t",), (), words, puzzling, size, steady=steady, even=even
        )
    return None


def _begun(known: Bool[np.ndarray, "R N"], rows: float) -> Bool[np.ndarray, "R N"]:
    """Where more than so many rows of a run are past, or so much of it that most is left."""
    past = np.cumsum(known, axis=1)
    return past > np.minimum(rows, _BEGINNING * past[:, -1:])


def slow_sizes(
    residual: Float[np.ndarray, "R N"],
    response: Float[np.ndarray, "R N"],
    masks: tuple[Bool[np.ndarray, "R N"], Bool[np.ndarray, "R N"]],
    dt: float,
) -> tuple[float, float]:
    """Slow error of a response's spread, on data fitted and held out; zero where there are none."""
    sizes = []
    for use in masks:
        slow = slow_part(np.where(use, residual, 0.0), dt)[use]
        sizes.append(float(np.sqrt(np.mean(slow**2))) / extent(response[use]) if use.any() else 0.0)
    return sizes[0], sizes[1]


def beside_response(
    found: Sequence[Unexplained],
    residual: Float[np.ndarray, "R N"],
    response: Float[np.ndarray, "R N"],
    use: Bool[np.ndarray, "R N"],
) -> list[Unexplained]:
    """What was found in an error, told as small where all of the error is that beside the response:
    it changes no verdict then."""
    size = float(np.sqrt(np.mean(residual[use] ** 2))) / extent(response[use]) if use.any() else 0.0
    if size > FAITHFUL:
        return list(found)
    return [replace(u, size=min(u.size, size), puzzling=False) for u in found]


def extent(values: Float[np.ndarray, " n"]) -> float:
    """Spread of a response, or a part of its level where it hardly moves."""
    return max(float(np.std(values)), _OF_LEVEL * float(np.abs(values).max()), 1e-300)


def _bursts(e, residual, known, runs, dt, spreads: float, least: float):
    """Windows whose energy is beyond the spread of the others, and the error with it: a sample or
    two that stand alone are outliers of a sensor."""
    length = max(4, round(_WINDOW / dt))
    energies, nearby, places = [], [], []
    for r, (row, use) in enumerate(zip(e, known, strict=True)):
        for start in range(0, len(row) - length + 1, length):
            if use[start : start + length].all():
                energies.append(float(np.mean(row[start : start + length] ** 2)))
                nearby.append(residual[r, max(0, start - length) : start + 2 * length])
                places.append((r, start))
    if len(energies) < 20:
        return None
    values = np.array(energies)
    logs = np.log(np.maximum(values, 1e-300))
    middle = np.median(logs)
    spread = max(1.4826 * float(np.median(np.abs(logs - middle))), np.sqrt(2.0 / length))
    wild = logs > middle + max(spreads * spread, least)
    if not wild.any():
        return None
    around, medians = (np.array([of(e) for e in nearby]) for of in (_usual, _of_medians))
    lasts = around > _LASTS * np.median(around)
    wild = np.flatnonzero(wild & (lasts | (medians > _KNOCKS * np.median(medians))))
    if wild.size == 0:
        return None
    excess = float(np.sum(values[wild] - np.median(values)) / np.sum(values))
    if excess < _OF_KNOCKS and not lasts[wild].any():
        return None
    order = wild[np.argsort(-values[wild])][:5]
    when = []
    for row, start in (places[k] for k in order):
        name, since = runs[row]
        when.append((name, since + start * dt, since + (start + length) * dt))
    return (excess, tuple(when)) if excess > 2 * _WORTH else None


def _usual(e: np.ndarray) -> float:
    """Mean square without the largest."""
    squares = np.sort(e**2)
    return float(np.mean(squares[: len(squares) - round(_OUTLIERS * len(squares))]))


def _of_medians(e: np.ndarray) -> float:
    """Mean square of the medians of five samples, which one or two do not move."""
    running = np.lib.stride_tricks.sliding_window_view(e, min(5, len(e)))
    return float(np.mean(np.median(running, axis=-1) ** 2))


def _worse(e, residual, mask, held_out, dt):
    """Share of the innovations' variance on data held out that is more than on data fitted, and
    more than what the sensor is noisier there, as the differences of samples tell."""
    settled = held_out.copy()
    settled[:, : round(_BEGINS / dt)] = False
    if settled.sum() < 200 or mask.sum() < 200:
        return None
    e = e - slow_part(np.where(mask | held_out, e, 0.0), dt)  # `slow_error` tells the rest
    ratio = float(np.mean(e[settled] ** 2) / np.mean(e[mask] ** 2))
    there, here = (
        white_noise_std([row[own] for row, own in zip(residual, use, strict=True) if own.any()])
        for use in (mask, settled)
    )
    if here > there > 0.0:
        ratio /= (here / there) ** 2
    return 1.0 - 1.0 / ratio if ratio > _WORSE else None
