"""Outliers of a sensor: samples that stand alone, far from those about them."""

from collections.abc import Iterable, Sequence
from dataclasses import replace

import numpy as np
from jaxtyping import Bool, Float, Shaped

from .record import Record

_ABOUT = 4  # samples before and behind, whose median is what a sample is held against
_SPREADS = 8.0  # standard deviations of usual samples, from which on one is far,
_BEYOND = 3.0  # and times what all but the rare ones stay below
_AMONG = 2.0  # times what those about it are off their own median
_BESIDE = [0, 2, 6, 8]
_CUBIC = np.array([-1.0, 4.0, 4.0, -1.0]) / 6.0  # through samples two and four away, at the middle
_CORNER = 0.3  # of how far a sample is off its way, within which it goes on from one side of it
_FOREMOST = 0.3  # of the largest nearby, below which a sample is off since that one is
_LONGEST = 3  # samples in a row that are still alone: one that was resampled is two or three
_RARE = 0.02  # of the samples; what is more frequent is no accident
_BEGINS = 5.0  # times the steps that follow, from which on a step away from the first samples parts
# them from the rest
_ANSWERS = 5  # samples behind a pulse of a command, that answer it


def without_outliers(record: Record) -> tuple[Record, dict[str, int]]:
    """The record with the outliers of what was measured filled in and marked as such, and how many
    there were by channel. What follows a command that stands out likewise is none.

    Source: Hampel, The influence curve and its role in robust estimation (1974); Pearson, Outliers
    in process modeling and identification (2002).
    """
    inputs = {plant.input for plant in record.plants} | {"v_cmd", "delta_cmd"}
    pieces = [segment.samples for segment in record.segments]
    commands = [record[name] for name in inputs & set(record.channels)]
    pulses = answering(commands, pieces, record.n)
    channels, filled, counts = dict(record.channels), dict(record.filled), {}
    for name in record.channels:
        if name in inputs:
            continue
        values = np.unwrap(record[name]) if name == "psi" else record[name]
        alone = standing_alone(values, pieces, record.measured(name) & ~pulses)
        if alone.any():
            channels[name] = values.copy()
            for piece in pieces:
                at, bad = np.arange(piece.start, piece.stop), alone[piece]
                if bad.any() and not bad.all():
                    channels[name][at[bad]] = np.interp(at[bad], at[~bad], values[at[~bad]])
            filled[name] = ~record.measured(name) | alone
            counts[name] = int(alone.sum())
    return (replace(record, channels=channels, filled=filled), counts) if counts else (record, {})


def answering(
    commands: Iterable[Float[np.ndarray, " n"]], pieces: Sequence[slice], n: int
) -> Bool[np.ndarray, " n"]:
    """Samples at which a command stands out, or did a little before: what a response does then may
    be its answer."""
    pulses = np.zeros(n, bool)
    for values in commands:
        for piece in pieces:
            far = _far(values[piece])
            pulses[piece] |= np.convolve(far, np.ones(_ANSWERS + 1))[: far.size] > 0
    return pulses


def standing_alone(
    values: Float[np.ndarray, " n"], pieces: Sequence[slice], asked: Bool[np.ndarray, " n"]
) -> Bool[np.ndarray, " n"]:
    """Outliers among the samples that are asked; none where they are too many for accidents."""
    alone = np.zeros(values.size, bool)
    for piece in pieces:
        own = values[piece]
        usual = _step(own)
        far = _far(own, usual) & ~_turning(own)
        # between two outliers a signal steps back and forth as well
        far |= _there_and_back(own, usual) & ~_about(far).any(axis=1)
        alone[piece] = _short(far)
        alone[piece.start : piece.start + _stale(own)] = True
    alone &= asked
    return alone if alone.sum() <= _RARE * values.size else np.zeros_like(alone)


def _far(x: Float[np.ndarray, " n"], usual: float = 0.0) -> Bool[np.ndarray, " n"]:
    """Samples farther than usual from the median of those about them, and from where these lead
    smoothly: the first is blind to edges, the second to bends."""
    if x.size <= 2 * _ABOUT:
        return np.zeros(x.size, bool)
    about = _about(x)
    off_middle, off_way = x - np.median(about, axis=1), x - about[:, _BESIDE] @ _CUBIC
    size = np.abs(off_middle)
    foremost = size > _FOREMOST * _about(size).max(axis=1)  # those beside one are off by little
    rare = _RARE  # an outlier is the neighbour of four samples, too, that seem off their way
    far = _stands_out(off_middle, rare, usual) & _stands_out(off_way, 5.0 * rare, usual)
    far[:_ABOUT] = far[-_ABOUT:] = False  # a run may begin and end in the middle of anything
    return far & foremost


def _there_and_back(x: Float[np.ndarray, " n"], usual: float) -> Bool[np.ndarray, " n"]:
    """Samples to which a signal steps and from which it steps back, by much more than its way ever
    bends else: on a slope, the median of those about them is no measure."""
    if x.size <= 2 * _ABOUT:
        return np.zeros(x.size, bool)
    steps = np.diff(x, prepend=x[:1], append=x[-1:])
    steps -= np.median(_about(steps), axis=1)
    there, back = steps[:-1], steps[1:]
    size = np.where(there * back < 0.0, np.minimum(np.abs(there), np.abs(back)), 0.0)
    tail = _BEYOND * np.quantile(np.abs(steps), 1.0 - 2.0 * _RARE)  # an outlier has two steps
    found = size > max(float(tail), usual)
    found[:_ABOUT] = found[-_ABOUT:] = False
    return found


def _stale(x: Float[np.ndarray, " n"]) -> int:
    """How many samples stand before a signal begins, away from which it steps at once and goes on
    smoothly: a message of before, or what a sensor says until it has measured. A plant would be
    taken to have rested there."""
    steps = np.abs(np.diff(x))
    if steps.size <= 2 * _ABOUT + _LONGEST:
        return 0
    far = _stands_out(steps, _RARE, 0.0)
    for k in range(_LONGEST):
        if far[k] and steps[k] > _BEGINS * steps[k + 1 : k + 1 + 2 * _ABOUT].max():
            return k + 1
    return 0


def _turning(x: Float[np.ndarray, " n"]) -> Bool[np.ndarray, " n"]:
    """Samples of a response that turns sharply: a straight way leads to them or goes on from them,
    or they are off by no more than those about them move."""
    if x.size <= 2 * _ABOUT:
        return np.zeros(x.size, bool)
    about = _about(x)
    middle = np.median(about, axis=1)
    moves = np.median(np.abs(about - middle[:, None]), axis=1)
    found = np.abs(x - middle) < _AMONG * moves
    near = _CORNER * np.abs(x - about[:, _BESIDE] @ _CUBIC)
    steps = np.arange(1.0, _ABOUT + 1.0)
    ways = np.stack([np.ones(_ABOUT), steps], axis=1)
    fit = np.linalg.pinv(ways)
    for side in (about[:, _ABOUT - 1 :: -1], about[:, _ABOUT + 1 :]):
        way = side @ fit.T  # where it leads, and its slope
        off_side = np.abs(side - way @ ways.T).max(axis=1)
        found |= (np.abs(x - way[:, 0]) < near) & (off_side < near)
    return found


def _about(x: Shaped[np.ndarray, " n"]) -> Shaped[np.ndarray, "n 9"]:
    """Each sample among those before and behind, the ends repeated."""
    padded = np.pad(x, _ABOUT, mode="edge")
    return np.lib.stride_tricks.sliding_window_view(padded, 2 * _ABOUT + 1)


def _step(x: Float[np.ndarray, " n"]) -> float:
    """By what a signal usually moves, where it does: of a coarse one, the step of its counter."""
    steps = np.abs(np.diff(x))
    return float(_BEYOND * np.median(steps[steps > 0.0])) if np.any(steps) else 0.0


def _stands_out(away: Float[np.ndarray, " n"], rare: float, usual: float) -> Bool[np.ndarray, " n"]:
    """Where something is far beyond its usual size, and beyond one that is `usual` anyway."""
    size = np.abs(away)
    spread, tail = _SPREADS * 1.4826 * np.median(size), _BEYOND * np.quantile(size, 1.0 - rare)
    return size > max(spread, tail, usual)


def _short(far: Bool[np.ndarray, " n"]) -> Bool[np.ndarray, " n"]:
    """Those in rows that are short."""
    edges = np.diff(np.concatenate([[False], far, [False]]).astype(np.int8))
    kept = far.copy()
    for first, stop in zip(np.flatnonzero(edges == 1), np.flatnonzero(edges == -1), strict=True):
        if stop - first > _LONGEST:
            kept[first:stop] = False
    return kept
