"""Which logs, or parts of them, judge what the others were fitted to: those whose commands the
others cover.

What a fit has not seen it cannot tell: a plant that was identified on a slow slalom says nothing of
steps, and its errors there would be called structure.
"""

from collections.abc import Sequence
from itertools import combinations

import numpy as np
from jaxtyping import Float

from ...data.record import Record

_COVERED = 0.03  # of a band's energy, or of the time at a size, that the logs of the fit must have
_NEW = 0.3  # share of the commands from which on they are another kind of driving
_IDLE = 0.05  # of the energy of the others' commands, below which a log judges nothing
_BINS = 20  # of the range of commands; one covers its neighbours, too
_FEW = 6  # logs, of which every choice is looked at
_BLOCKS, _JUDGING = 10, (2, 5, 8)  # parts of a single run, and which of them are held out
_SHIFTS = (0, -1, 1)  # by which others are
_QUIET = 0.1  # of what a command moves, below which what judges shows nothing of its plant


def judges(records: Sequence[Record]) -> set[int] | None:
    """Numbers of the logs that are held out, a third of several: the last ones, unless the others
    do not cover their commands or they hardly have any, and another choice is better. None where no
    whole log can judge: there is but one, or each is of a kind of its own."""
    count = len(records)
    if count < 2:
        return None
    held = max(1, round(count / 3))
    last = tuple(range(count - held, count))
    if count <= _FEW:
        choices = [last, *(c for c in combinations(range(count), held) if c != last)]
    else:
        choices = [last, *(tuple(range(k, k + held)) for k in range(0, count - held, held))]
    channels = sorted(driving(records))
    described = [{c: _described(r, c) for c in channels if c in r} for r in records]
    looked = [[_compared(described, c, own) for c in channels] for own in choices]
    news = [max((new for new, _ in each), default=0.0) for each in looked]
    lively = [min((share for _, share in each), default=1.0) for each in looked]
    fit = [k for k, own in enumerate(news) if own <= _NEW and lively[k] >= _IDLE]
    if 0 in fit or (not fit and news[0] <= _NEW):
        return set(last)
    return set(choices[min(fit, key=lambda k: news[k])]) if fit else None


def parts(
    pieces: Sequence[tuple[Record, int, int]], others: bool
) -> list[tuple[tuple[int, int], ...]]:
    """Of each piece (record, first sample, stop) the stretches that are held out, counted from its
    first: three tenths that lie apart, since its end may show another regime. The same of each,
    unless the commands of some channel rest there and move elsewhere. `others`: where those shall
    not."""
    records = list(dict.fromkeys(record for record, _, _ in pieces))
    channels = [c for c in sorted(driving(records)) if all(c in r for r in records)]
    edges = [np.linspace(0, b - a, _BLOCKS + 1).astype(int) for _, a, b in pieces]
    moves = np.zeros((len(channels), len(pieces), _BLOCKS))
    for k, channel in enumerate(channels):
        for i, (record, a, b) in enumerate(pieces):
            steps = np.abs(np.diff(record[channel][a:b], prepend=record[channel][a]))
            moves[k, i] = np.add.reduceat(steps, edges[i][:-1])
    moves /= np.maximum(moves.sum(axis=(1, 2), keepdims=True), 1e-300)

    def balance(shifts: Sequence[int]) -> float:
        held = [moves[:, i, np.add(_JUDGING, s)].sum(axis=1) for i, s in enumerate(shifts)]
        share = np.sum(held, axis=0)[moves.any(axis=(1, 2))]
        return float(np.min(np.minimum(share, 0.5 * (1.0 - share)), initial=1.0))

    shifts = [0] * len(pieces)
    if balance(shifts) < _QUIET:
        for i in range(len(pieces)):
            tried = [[*shifts[:i], s, *shifts[i + 1 :]] for s in _SHIFTS]
            shifts = max(tried, key=balance)
    shifts = [_SHIFTS[(_SHIFTS.index(s) + 1) % len(_SHIFTS)] if others else s for s in shifts]
    return [
        tuple((int(own[j + s]), int(own[j + s + 1])) for j in _JUDGING)
        for own, s in zip(edges, shifts, strict=True)
    ]


def driving(records: Sequence[Record]) -> set[str]:
    """The channels that tell how a log was driven: commands, and of a vehicle speed and angle where
    no command of theirs was logged."""
    plants = [p for r in records for p in r.plants if p.input in r]
    found = {p.input for p in plants}
    if all(r.vehicle is not None for r in records):
        moved = {"v", "delta"} - {p.output for p in plants}
        found |= {c for c in moved if all(c in r for r in records)}
    return found


def _described(record: Record, channel: str) -> tuple[Float[np.ndarray, " bands"], np.ndarray, int]:
    """Of a command: the energy of its changes in octaves, a step's the same in each; its values;
    its number of samples."""
    octaves = np.zeros(_octave(np.array([0.5 / record.dt]))[0] + 1)
    values = [record[channel][s.start : s.stop] for s in record.segments]
    for u in values:
        power = np.abs(np.fft.rfft((u - u.mean()) * np.hanning(len(u)))) ** 2
        f = np.fft.rfftfreq(len(u), record.dt)[1:]
        np.add.at(octaves, _octave(f), power[1:] * f / len(u))
    u = np.concatenate(values)
    return octaves, u, len(u)


def _octave(f: np.ndarray) -> np.ndarray:
    """Number of the octave of a frequency, those below 1/16 Hz in one."""
    return np.maximum(np.floor(np.log2(f * 16.0)).astype(int) + 1, 0)


def _compared(
    described: Sequence[dict], channel: str, held: tuple[int, ...]
) -> tuple[float, float]:
    """Share of the held-out commands that the others do not cover, in frequency or in range; and
    how lively they are, against the others."""
    own = [d[channel] for i, d in enumerate(described) if i in held and channel in d]
    rest = [d[channel] for i, d in enumerate(described) if i not in held and channel in d]
    if not own or not rest:
        return 0.0, 1.0
    energies = [np.sum([d[0] for d in part], axis=0) for part in (own, rest)]
    here, there = (e / sum(d[2] for d in p) for e, p in zip(energies, (own, rest), strict=True))
    changes = max(float(here.sum()), 1e-300)
    new = float(here[there < _COVERED * here].sum()) / changes
    values, seen = (np.concatenate([d[1] for d in part]) for part in (own, rest))
    edges = np.histogram_bin_edges(np.concatenate([values, seen]), _BINS)
    shares = [np.histogram(x, edges)[0] / x.size for x in (values, seen)]
    near, met = (np.convolve(x, np.ones(3), "same") for x in shares)
    outside = float(shares[0][met < _COVERED * near].sum())
    return max(new, outside), changes / max(float(there.sum()), 1e-300)
