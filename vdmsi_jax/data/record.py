"""`Record`, the one noun for data: what a log became once it was read, in SI, evenly sampled, and
without holes."""

import types
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import PurePath
from typing import Any, Literal

import numpy as np
from jaxtyping import Bool, Float

from ..config import PlantSpec, VehicleGeometry, canonical_of, plants_among
from ..errors import InputError, nearest
from ..geometry import refuse_no_geometry
from .arrays import as_channels, as_period, si_units
from .lattice import lattice_step
from .noise import white_noise_std
from .segment import Segment, split_blocks, split_runs

_BETWEEN_RECORDS = 1.0  # s of time between joined records


@dataclass(frozen=True, eq=False)
class Record:
    """Named channels on one time base, in SI, finite everywhere, in evenly sampled segments.

    A record does not change: its arrays are read-only, and what cuts or joins records returns a new
    one. `read_log` makes one of a file, `Record.from_arrays` one of arrays.

    Attributes:
        name: what it is called in reports, usually the file's name.
        dt: sample period inside the segments, s.
        t: (N,) time, s, strictly increasing; jumps only between segments. Runs that restarted their
            clocks lie one after another.
        channels: name -> (N,) float64.
        units: name -> SI unit, `1` for pure numbers.
        segments: cover the samples 0 to N in order.
        repairs: what was done to the log on the way, a sentence each.
        vehicle: geometry, if it is a vehicle's log.
        plants: which channel answers to which.
        filled: name -> (N,) mask of the samples that were filled in and not measured; a channel
            without one has none.
        steps: name -> size of the steps in which a measurement was logged, where resampling has
            smoothed them.
        windows: name -> length of the parabola that made it of the pose, s, where nobody asked.
        within: name -> (N, k) what a command was inside each row, where a record was made slower.
        session: time at which it begins of the session that it is a part of, s; zero where it
            stands alone.
        file: path of the file that it was read from; empty where there is none.
    """

    name: str
    dt: float
    t: Float[np.ndarray, " N"]
    channels: Mapping[str, Float[np.ndarray, " N"]]
    units: Mapping[str, str]
    segments: tuple[Segment, ...]
    repairs: tuple[str, ...] = ()
    vehicle: VehicleGeometry | None = None
    plants: tuple[PlantSpec, ...] = ()
    filled: Mapping[str, Bool[np.ndarray, " N"]] = field(default_factory=dict)
    steps: Mapping[str, float] = field(default_factory=dict)
    windows: Mapping[str, float] = field(default_factory=dict)
    within: Mapping[str, Float[np.ndarray, "N k"]] = field(default_factory=dict)
    session: float = 0.0
    file: str = ""

    def __post_init__(self):
        object.__setattr__(self, "t", _frozen(self.t, np.float64))
        every = (("channels", np.float64), ("filled", np.bool_), ("within", np.float64))
        for name, dtype in every:
            arrays = {key: _frozen(values, dtype) for key, values in getattr(self, name).items()}
            object.__setattr__(self, name, types.MappingProxyType(arrays))
        for name in ("units", "steps", "windows"):
            plain = types.MappingProxyType(dict(getattr(self, name)))
            object.__setattr__(self, name, plain)
        edges = [0, *(segment.stop for segment in self.segments)]
        assert edges[-1] == self.n and [segment.start for segment in self.segments] == edges[:-1]
        assert all(
            values.shape == (self.n,) for values in (*self.channels.values(), *self.filled.values())
        )

    def __repr__(self) -> str:
        many = "" if len(self.segments) == 1 else f" in {len(self.segments)} segments"
        samples = f"{self.n} samples of {self.dt:g} s{many}"
        return f"<Record {self.name}: {samples}: {', '.join(self.channels)}>"

    def __reduce__(self):
        plain = (
            dict(self.channels),
            dict(self.units),
            self.segments,
            self.repairs,
            self.vehicle,
            self.plants,
        )
        own = (
            self.name,
            self.dt,
            self.t,
            *plain,
            dict(self.filled),
            dict(self.steps),
            dict(self.windows),
            dict(self.within),
            self.session,
            self.file,
        )
        return type(self), own

    @classmethod
    def from_arrays(
        cls,
        *,
        dt: float,
        name: str = "record",
        t0: float = 0.0,
        vehicle: VehicleGeometry | None = None,
        plants: PlantSpec | Sequence[PlantSpec] = (),
        units: Mapping[str, str] | None = None,
        **channels,
    ) -> "Record":
        """Make a record of arrays that are evenly sampled and in SI already. `read_log` takes
        arrays that have a time, gaps, other units, or samples that are missing.

        Args:
            dt: sample period, s.
            name: what to call it.
            t0: time of the first sample, s.
            vehicle: geometry, if it is a vehicle's log.
            plants: which channel answers to which, one or several; the paper's two actuators as
                far as their channels are there, if empty.
            units: SI units of channels that are not canonical, for labels only.
            **channels: name -> (N,) samples.

        Raises:
            InputError: no channel or sample, a channel that is not one-dimensional or not finite,
                lengths that differ, a plant without its channels, a vehicle that is no geometry,
                or a canonical channel in another unit.
        """
        period = as_period(name, dt)
        if "t" in channels:
            mend = "give dt and t0 instead, or a mapping with t and arrays to read_log"
            raise InputError(name, "t", "time is no channel", mend)
        refuse_no_geometry(vehicle, name)
        arrays = as_channels(name, channels)
        given = (plants,) if isinstance(plants, PlantSpec) else tuple(plants)
        for channel in (channel for plant in given for channel in plant.channels):
            if channel not in arrays:
                problem = "there is no such channel, which a plant has"
                raise InputError(name, f"channel {channel}", problem, nearest(channel, arrays))
        fitting = given or plants_among(arrays)
        si = si_units(name, arrays, canonical_of(fitting, vehicle), units or {})
        n = next(iter(arrays.values())).size
        time = t0 + period * np.arange(n)
        return cls(name, period, time, arrays, si, (Segment(0, n, name),), (), vehicle, fitting)

    def __getitem__(self, channel: str) -> Float[np.ndarray, " N"]:
        """The samples of a channel (`t` included). Raises InputError with the nearest name if there
        is none."""
        if not isinstance(channel, str):
            mend = "give a channel's name; record.between(t0, t1) is a part of the record"
            raise InputError(self.source, f"channel {channel}", "is no name", mend)
        if channel == "t":
            return self.t
        try:
            return self.channels[channel]
        except KeyError:
            mend = nearest(channel, self.channels)
            raise InputError(
                self.source, f"channel {channel}", "there is no such channel", mend
            ) from None

    def __len__(self) -> int:
        return self.n

    def __iter__(self) -> Iterator[str]:
        """The names of the channels."""
        return iter(self.channels)

    def _ipython_key_completions_(self) -> list[str]:
        return ["t", *self.channels]

    def __contains__(self, channel: object) -> bool:
        return channel == "t" or channel in self.channels

    @property
    def n(self) -> int:
        """Number of samples, over all segments."""
        return self.t.size

    @property
    def duration(self) -> float:
        """Time that the samples cover, gaps left out, s."""
        return self.n * self.dt

    @property
    def runs(self) -> tuple[str, ...]:
        """The runs in order."""
        return tuple(dict.fromkeys(segment.run for segment in self.segments))

    @property
    def source(self) -> str:
        """What errors call it: the file's path, or its name where there is none."""
        return self.file or self.name

    @property
    def log(self) -> str:
        """What result files call it: its name with the file's suffix, such as `run_3.csv`."""
        return self.name + PurePath(self.file).suffix

    def plant(self, name: str) -> PlantSpec:
        """The plant of that name. Raises InputError with the nearest name if there is none."""
        if not isinstance(name, str):
            mend = 'give its name, such as "steering", or PlantSpec(name, input, output)'
            raise InputError(self.source, f"plant {name!r}", "is no plant's name", mend)
        for plant in self.plants:
            if plant.name == name:
                return plant
        mend = (
            nearest(name, [plant.name for plant in self.plants])
            + "; [[plants]] of the configuration adds one"
        )
        raise InputError(self.source, f"plant {name}", "there is no such plant", mend)

    def renamed(self, name: str) -> "Record":
        """The record under another name; a run that bore the old one bears the new one."""
        segments = tuple(
            replace(own, run=name) if own.run == self.name else own for own in self.segments
        )
        return replace(self, name=name, segments=segments)

    def measured(self, channel: str) -> Bool[np.ndarray, " N"]:
        """Mask of the samples that carry a measurement and were not filled in; fits should use only
        these."""
        values = self[channel]
        return (
            ~self.filled[channel] if channel in self.filled else np.ones(values.shape, dtype=bool)
        )

    def travelled(self) -> Float[np.ndarray, " N"]:
        """Way since the start of each sample's run, m: by the measured speed, else the commanded
        one, and through gaps at the speed before them. Zeros where there is neither."""
        way = np.zeros(self.n)
        v = next((np.abs(self[name]) for name in ("v", "v_cmd") if name in self), way)
        for run in self.runs:
            own = [segment for segment in self.segments if segment.run == run]
            rows = np.concatenate([np.arange(part.start, part.stop) for part in own])
            way[rows[1:]] = np.cumsum(v[rows[:-1]] * np.diff(self.t[rows]))
        return way

    def pieces(self, channel: str) -> list[Float[np.ndarray, " _"]]:
        """The channel's samples segment by segment."""
        values = self[channel]
        return [values[segment.samples] for segment in self.segments]

    def noise_std(self, channel: str) -> float:
        """Standard deviation of the white noise on a channel, blind to its smooth motion (see
        `white_noise_std`)."""
        return white_noise_std(self.pieces(channel))

    def step(self, channel: str) -> float | None:
        """Size of the steps in which a channel was measured; None if it was in none."""
        return self.steps.get(channel) or lattice_step(self[channel])

    def select(self, segments: Iterable[Segment]) -> "Record":
        """A record of some stretches of this one, in the order given.

        Args:
            segments: stretches, each inside one segment of this record; none may be empty.

        Raises:
            InputError: no stretch is given.
        """
        chosen = [segment for segment in segments if len(segment) > 0]
        if not chosen:
            raise InputError(
                self.source, "", "nothing is left of the record", "choose a longer stretch"
            )
        for part in chosen:
            if not any(own.start <= part.start < part.stop <= own.stop for own in self.segments):
                problem = f"samples {part.start} to {part.stop} lie in no single segment"
                raise InputError(self.source, "", problem, "choose parts of record.segments")
        index = np.concatenate([np.arange(segment.start, segment.stop) for segment in chosen])
        edges = np.cumsum([0, *map(len, chosen)])
        return replace(
            self,
            t=self.t[index],
            channels={name: values[index] for name, values in self.channels.items()},
            filled={name: mask[index] for name, mask in self.filled.items()},
            within={name: values[index] for name, values in self.within.items()},
            segments=tuple(
                Segment(int(start), int(stop), segment.run)
                for start, stop, segment in zip(edges[:-1], edges[1:], chosen, strict=True)
            ),
        )

    def between(self, t0: float, t1: float) -> "Record":
        """The part with t0 <= t < t1, s. Raises InputError if no sample lies there."""
        rounding = 1e-6 * self.dt
        first, last = np.searchsorted(self.t, [t0 - rounding, t1 - rounding])
        return self.select(
            replace(
                segment, start=max(segment.start, int(first)), stop=min(segment.stop, int(last))
            )
            for segment in self.segments
        )

    def without_warm_up(self, seconds: float) -> "Record":
        """The record without the first `seconds` of every segment, where filters and unknown states
        settle."""
        skip = int(np.ceil(seconds / self.dt - 1e-9))
        return self.select(
            replace(segment, start=segment.start + skip) for segment in self.segments
        )

    def split(
        self, held_out: float = 0.25, by: Literal["blocks", "run"] = "blocks", blocks: int = 2
    ) -> tuple["Record", "Record"]:
        """Part the record into what fits may see and what is held out to judge them.

        Args:
            held_out: share of the samples (or of the runs) that is held out, between 0 and 1.
            by: `blocks` cuts every segment in equal parts and holds out the end of each, so that
                both halves see the whole of the experiment and samples that are neighbours (whose
                noise is not independent) stay together; `run` holds out whole runs, spread evenly,
                the last one among them.
            blocks: how many parts a segment is cut in; fewer where a held-out block would have less
                than 50 samples, and a segment in which not one such block fits goes to training
                whole.

        Returns:
            The training record and the held-out record.

        Raises:
            InputError: the share is out of range, `by` is neither, there is only one run, or the
                segments are too short to hold out blocks.
        """
        if not 0.0 < held_out < 1.0:
            raise InputError(
                self.source, "held_out", f"{held_out} is no share", "give a number between 0 and 1"
            )
        if by not in ("blocks", "run"):
            mend = nearest(str(by), ("blocks", "run"))
            raise InputError(self.source, "by", f"unknown value {by!r}", mend)
        if by == "run":
            seen, hidden = split_runs(self.segments, held_out, self.source)
        else:
            seen, hidden = split_blocks(self.segments, held_out, blocks, self.source)
        return self.select(seen), self.select(hidden)

    @staticmethod
    def concatenate(records: Sequence["Record"], name: str | None = None) -> "Record":
        """Join records of one vehicle, sampled alike, into one whose runs they are.

        Only channels that all of them have are kept. Time goes on from one record to the next with
        a gap of one second. Runs are named `record` or `record/run`; a record whose name was there
        before gets a number behind it.

        Raises:
            InputError: no record is given, they differ in sample period or vehicle, or they have no
                channel in common.
        """
        if not records:
            raise InputError("records", "", "there is no record to join", "give at least one")
        first = records[0]
        for record in records:
            if not np.isclose(record.dt, first.dt, rtol=1e-9):
                problem = f"sampled every {record.dt:g} s, but {first.log} every {first.dt:g} s"
                mend = "set the same [prepare] dt for all logs"
                raise InputError(record.source, "dt", problem, mend)
            if record.vehicle != first.vehicle:
                problem = f"is another vehicle than that of {first.log}"
                raise InputError(record.source, "vehicle", problem, "give logs of one vehicle")
        common = [name for name in first.channels if all(name in record for record in records)]
        if not common:
            mend = "give logs with the same channels"
            raise InputError(first.source, "channels", "the records share none", mend)
        segments: list[Segment] = []
        times: list[np.ndarray] = []
        offset = 0
        for label, record in zip(_labels(records), records, strict=True):
            for own in record.segments:
                run = label if own.run in ("", record.name) else f"{label}/{own.run}"
                segments.append(Segment(own.start + offset, own.stop + offset, run))
            after = times[-1][-1] + first.dt + _BETWEEN_RECORDS if times else record.t[0]
            times.append(record.t - record.t[0] + after)
            offset += record.n
        holes = [name for name in common if any(name in record.filled for record in records)]
        return Record(
            name=name or first.name,
            dt=first.dt,
            t=np.concatenate(times),
            channels={k: np.concatenate([record[k] for record in records]) for k in common},
            units={k: first.units[k] for k in common},
            segments=tuple(segments),
            repairs=tuple(
                f"{record.name}: {told}" for record in records for told in record.repairs
            ),
            vehicle=first.vehicle,
            plants=tuple(p for p in first.plants if p.input in common and p.output in common),
            filled={k: np.concatenate([~record.measured(k) for record in records]) for k in holes},
            steps={k: own for k, own in first.steps.items() if k in common},
            file="" if name else first.file,
        )


def records_of(given: Record | Iterable[Record]) -> list[Record]:
    """One record or several, as a list.

    Raises:
        InputError: one of them is no record, as the path of a log is.
    """
    alone = isinstance(given, Record | str) or not isinstance(given, Iterable)
    several: list[Any] = [given] if alone else list(given)
    for one in several:
        if not isinstance(one, Record):
            mend = "give records, as read_log and read_logs make them"
            raise InputError("records", "", f"{type(one).__name__} is no record", mend)
    return several


def _labels(records: Sequence[Record]) -> list[str]:
    """The names of the records, numbered where they repeat."""
    names = [record.name for record in records]
    repeats = [names[:k].count(name) for k, name in enumerate(names)]
    return [f"{n} {k + 1}" if k else n for n, k in zip(names, repeats, strict=True)]


def _frozen(values, dtype) -> np.ndarray:
    """A read-only array; a copy, unless nobody can write to it already."""
    array = np.asarray(values, dtype=dtype)
    if array.flags.writeable or not _owned(array):
        array = array.copy()
        array.flags.writeable = False
    return array


def _owned(array: Any) -> bool:
    """Whether all that an array is a view of is read-only."""
    while isinstance(array, np.ndarray) and not array.flags.writeable:
        array = array.base
    return array is None
