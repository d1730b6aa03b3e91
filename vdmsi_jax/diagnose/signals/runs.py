"""Records side by side: what is looked at, how fast, and what is held out."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float

from ...data.record import Record
from ...data.segment import Segment
from ...errors import InputError
from .held_out import judges, parts

_LONGEST = 6000  # samples of a run that are simulated at once; longer ones are cut
_SHORTEST = 40  # samples of a run that is looked at
_MOST = 15_000  # samples that are looked at; of more, stretches spread over all of them are
_STRETCH = 2000  # samples of such a stretch
_MOST_RUNS = 24  # that are looked at
_ROW = 0.02  # s, between rows of a vehicle's record


@dataclass(frozen=True, eq=False)
class Runs:
    """Stretches of records side by side.

    Attributes:
        names: of the runs that they belong to.
        records, starts, stops: where each comes from.
        since: time of each one's first sample since its run began, s.
        judged: of each, the stretches (first, stop) that are held out.
        length: of the longest.
        dt: sample period, s.
    """

    names: tuple[str, ...]
    records: tuple[Record, ...]
    starts: tuple[int, ...]
    stops: tuple[int, ...]
    since: tuple[float, ...]
    judged: tuple[tuple[tuple[int, int], ...], ...]
    dt: float

    @property
    def length(self) -> int:
        """Samples of the longest."""
        return max(b - a for a, b in zip(self.starts, self.stops, strict=True))

    @property
    def longest(self) -> float:
        """Duration of the longest, s."""
        return self.length * self.dt

    @property
    def lasting(self) -> float:
        """How long the longest of the runs that they belong to lasts, as far as they reach, s."""
        ends = zip(self.since, self.starts, self.stops, strict=True)
        return max(since + (stop - start) * self.dt for since, start, stop in ends)

    def channel(self, name: str) -> Float[np.ndarray, "R N"]:
        """A channel, padded by its last value; zeros where a record lacks it."""
        return np.stack(
            [self._padded(r[name] if name in r else np.zeros(r.n), i) for i, r in self._each()]
        )

    def within(self, name: str) -> Float[np.ndarray, "R N k"] | None:
        """A command inside each row, padded likewise; None where rows are the logs' own."""
        if not all(name in r.within for r in self.records):
            return None
        return np.stack([self._padded(r.within[name], i) for i, r in self._each()])

    def seen(self, name: str) -> np.ndarray:
        """(R, N) whether the channel was measured there."""
        rows = []
        for i, record in self._each():
            row = np.zeros(self.length, bool)
            n = self.stops[i] - self.starts[i]
            if name in record:
                row[:n] = record.measured(name)[self.starts[i] : self.stops[i]]
            rows.append(row)
        return np.stack(rows)

    def held(self) -> np.ndarray:
        """(R, N) whether a sample is held out."""
        held = np.zeros((len(self.records), self.length), bool)
        for row, spans in zip(held, self.judged, strict=True):
            for first, stop in spans:
                row[first:stop] = True
        return held

    def whole(self) -> bool:
        """Whether whole records are held out."""
        return any(not spans for spans in self.judged) and any(self.judged)

    @property
    def begins(self) -> tuple[tuple[str, float], ...]:
        """Of each, the run that it belongs to, and how far into that it begins, s."""
        return tuple(zip(self.names, self.since, strict=True))

    def judging(self) -> list[str]:
        """Names of the runs of which some is held out."""
        names = [r for r, spans in zip(self.names, self.judged, strict=True) if spans]
        return list(dict.fromkeys(names))

    def time(self) -> Float[np.ndarray, "R N"]:
        """(R, N) time since the start of the run, s."""
        return np.asarray(self.since)[:, None] + self.dt * np.arange(self.length)

    def travelled(self) -> Float[np.ndarray, "R N"]:
        """(R, N) way since the start of the run, m."""
        ways = {record: record.travelled() for record in set(self.records)}
        return np.stack([self._padded(ways[record], i) for i, record in self._each()])

    def _each(self):
        return enumerate(self.records)

    def _padded(self, values: np.ndarray, i: int) -> np.ndarray:
        own = values[self.starts[i] : self.stops[i]]
        more = ((0, self.length - len(own)), *((0, 0),) * (own.ndim - 1))
        return np.pad(own, more, mode="edge")


def slower(record: Record) -> Record:
    """A vehicle's record at about 50 Hz, where it was sampled faster: commands are averaged over
    the longer rows, measurements are those at their beginning. A plant that is no vehicle's is left
    as it is, since its time scale is unknown.

    Raises:
        InputError: no stretch is as long as one of the longer rows.
    """
    every = round(_ROW / record.dt)
    if record.vehicle is None or every < 2:
        return record
    if all(len(own) < every for own in record.segments):
        problem = f"no stretch without a gap has {every} samples"
        raise InputError(record.source, "length", problem, "leave it out, or mend its gaps")
    parts, index, start = [], [], 0
    for own in record.segments:
        rows = len(own) // every
        if rows:
            index.append(own.start + every * np.arange(rows))
            parts.append(Segment(start, start + rows, own.run))
            start += rows
    at = np.concatenate(index)

    def inside(values: np.ndarray) -> np.ndarray:
        return values[at[:, None] + np.arange(every)]

    commands = {plant.input for plant in record.plants} & set(record.channels)
    commands |= {name for name in record.channels if name.endswith("_cmd")}
    return replace(
        record,
        dt=record.dt * every,
        t=record.t[at],
        channels={
            name: inside(values).mean(axis=1) if name in commands else values[at]
            for name, values in record.channels.items()
        },
        filled={name: mask[at] for name, mask in record.filled.items()},
        segments=tuple(parts),
        within={name: inside(record[name]) for name in commands},
    )


def lay_out(records: Sequence[Record], whole: bool = True, others: bool = False) -> Runs:
    """Put the segments of records side by side and choose what is held out: a third of the records,
    or, where none can judge the others or whole ones shall not, three tenths of each segment that
    lie apart, since its end may show another regime; `others`, where the usual ones shall not.

    Raises:
        InputError: every stretch is too short.
    """
    pieces = []
    many = sum(len(s) for r in records for s in r.segments) > _MOST
    at_once = _STRETCH if many else _LONGEST
    for record in records:
        for segment in record.segments:
            count = -(-len(segment) // at_once)
            edges = np.linspace(segment.start, segment.stop, count + 1).astype(int)
            first = next(s.start for s in record.segments if s.run == segment.run)
            for a, b in zip(edges[:-1].tolist(), edges[1:].tolist(), strict=True):
                pieces.append((segment.run, record, a, b, float(record.t[a] - record.t[first])))
    longest = max(p[3] - p[2] for p in pieces)
    long = [p for p in pieces if p[3] - p[2] >= max(_SHORTEST, longest // 20)]
    if not long:
        problem = f"the longest stretch without a gap has {longest} samples"
        mend = f"give logs of {_SHORTEST} or more, or mend their gaps"
        raise InputError(", ".join(r.source for r in records), "length", problem, mend)
    most = min(_MOST_RUNS, _MOST // (longest if many else 1))
    if len(long) > most:
        picked = np.unique(np.linspace(0, len(long) - 1, most).astype(int))
        long = [long[i] for i in picked]
    kept = [record for record in records if any(p[1] is record for p in long)]
    judging = judges(kept) if whole else None
    if judging is None:
        spans = parts([(r, a, b) for _, r, a, b, _ in long], others)
    else:
        judge = [any(p[1] is kept[k] for k in judging) for p in long]
        spans = [((0, p[3] - p[2]),) if own else () for p, own in zip(long, judge, strict=True)]
    long = [(*piece, own) for piece, own in zip(long, spans, strict=True)]
    columns = zip(*long, strict=True)
    return Runs(*map(tuple, columns), dt=records[0].dt)
