"""What is wrong with the rows of a log: each kind of fault is refused or mended as the
configuration says, and told.

The steps work on `Rows`, the rows of a table that are left so far, in the order in which `prepare`
calls them.
"""

import contextlib
from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass, field

import numpy as np

from ..config import Config, Derivation
from ..errors import InputError
from ..units import UNITS
from .expressions import parse
from .resample import make_grid, sample_period

LONG_BEFORE = 1e6
"""Seconds from which a clock began before the log: epochs, weeks of a satellite."""

USUAL_GAP = 5.0
"""Sample periods that a hole may last, where the configuration says nothing."""

_MOST = 0.98  # of the rows, in which a channel is that was logged row by row
_MERGED = 0.2  # of a column's cells, from which more are empty than get lost
_SLOWEST, _FASTEST = (
    1.0,
    1e-4,
)  # s between rows of a vehicle's log, outside which the unit of time is doubted


@dataclass
class Raw:
    """The columns of a log, already in SI and named as channels, row by row as in the file.

    Attributes:
        name: what to call the log.
        source: the file, for errors.
        t: (N,) time, s.
        channels: name -> (N,), NaN where a cell is empty.
        quantities: name -> what it measures.
        columns: name -> column of the file, for errors.
        line: row -> where it stands in the file, in words.
        run: (N,) labels of runs, or None for a single one.
        keep: (N,) rows that were selected, or None for all.
        sharp: name -> (N,) true where a curvature was cut to the sharpest that can be driven.
        passed_by: sentences about columns that were not read, and look as if they should be.
    """

    name: str
    source: str
    t: np.ndarray
    channels: dict[str, np.ndarray]
    quantities: Mapping[str, str]
    columns: Mapping[str, str]
    line: Callable[[int], str]
    run: np.ndarray | None = None
    keep: np.ndarray | None = None
    sharp: Mapping[str, np.ndarray] = field(default_factory=dict)
    passed_by: tuple[str, ...] = ()


@dataclass
class Rows:
    """The rows that are left, and what was done to them so far.

    Attributes:
        raw: the table.
        index: (M,) rows of the table that are left.
        fresh: (M,) true where a new piece starts.
        filled: name -> (M,) true where a cell was filled in.
        told: sentences.
    """

    raw: Raw
    index: np.ndarray
    fresh: np.ndarray
    filled: dict[str, np.ndarray]
    told: list[str]

    @property
    def t(self) -> np.ndarray:
        return self.raw.t[self.index]

    def known(self, name: str) -> np.ndarray:
        """(M,) true where the cell of a channel was not filled in."""
        return ~self.filled.get(name, np.zeros(self.index.size, dtype=bool))

    def cut(self, drop: np.ndarray, *, gap: bool) -> None:
        """Leave rows out; with `gap`, what follows them starts a new piece."""
        keep = ~drop
        starts = np.cumsum(self.fresh | (drop & gap))
        self.fresh = np.diff(starts[keep], prepend=-1) > 0
        self.index = self.index[keep]
        self.filled = {name: mask[keep] for name, mask in self.filled.items()}


def select_rows(rows: Rows) -> None:
    """Leave out the rows that `[select]` does not choose; segments end at them."""
    drop = ~np.asarray(rows.raw.keep)
    if drop.all():
        mend = "loosen the expression"
        raise InputError(rows.raw.source, "[select] where", "no row is selected", mend)
    if drop.any():
        rows.cut(drop, gap=True)
        rows.told.append(
            f"left out {np.count_nonzero(drop)} of {drop.size} rows that [select] does not choose"
        )


def check_time(rows: Rows, config: Config) -> None:
    """Refuse or drop rows whose time stamp is missing, not later than the one before, or
    doubtful."""
    raw = rows.raw

    def place(k: int) -> str:
        return f"{raw.line(int(rows.index[k]))}, column {raw.columns['t']!r}"

    bad = ~np.isfinite(rows.t)
    if bad.any():
        k = int(np.flatnonzero(bad)[0])
        if config.prepare.missing == "refuse":
            mend = 'mend the cell, or set [prepare] missing = "gap"'
            raise InputError(raw.source, place(k), "the time is missing or not finite", mend)
        rows.told.append(f"left out {counted(bad, 'row')} without a time")
        rows.cut(bad, gap=True)
    step = np.diff(rows.t, prepend=-np.inf)
    back = ~rows.fresh & (step < 0.0)
    if back.any():
        k = int(np.flatnonzero(back)[0])
        problem = f"time runs backwards, by {-step[k]:.3g} s, {moment(rows.t, k - 1)}"
        mend = 'sort the rows, or name the column that tells runs apart: [columns] run = "..."'
        raise InputError(raw.source, place(k), problem, mend)
    twice = ~rows.fresh & (step == 0.0)
    if twice.any():
        k = int(np.flatnonzero(twice)[0])
        if config.prepare.duplicates == "refuse":
            many = counted(twice, "row")
            problem = f"its time, {moment(rows.t, k)}, stands there twice (as in {many})"
            mend = 'delete the rows, or set [prepare] duplicates = "drop"'
            raise InputError(raw.source, place(k), problem, mend)
        rows.told.append(
            f"left out {counted(twice, 'row')} with the time of the row before, the first "
            f"{moment(rows.t, k)}"
        )
        rows.cut(twice, gap=False)


def period_of(rows: Rows, config: Config) -> float:
    """The period of the log; refused where the unit of time must be wrong for a vehicle."""
    raw = rows.raw
    try:
        period = sample_period(rows.t, rows.fresh)
    except ValueError:
        problem, mend = "no two rows follow each other", "give a longer log"
        if raw.keep is not None:
            mend += ", or loosen [select] where"
        if raw.run is not None:
            mend += ", or name another column in [columns] run"
        raise InputError(raw.source, "", problem, mend) from None
    fastest = _fastest_of(rows, config)
    if fastest > period and not _is_even(rows, period, config):
        period = fastest
    is_vehicle = any(channel in config.canonical for channel in raw.channels)
    place = f"column {raw.columns['t']!r}"
    if is_vehicle and "t" not in config.units and period >= _SLOWEST:
        problem = f"rows are {period:g} s apart, too far to see an actuator"
        likely = next((u for u in ("ms", "us") if period * UNITS[u].to_si < _SLOWEST), "ns")
        mend = f'set [units] t = "{likely}" if that is its unit, or say t = "s" if it is in seconds'
        raise InputError(raw.source, place, problem, mend)
    if is_vehicle and "t" in config.units and period < _FASTEST:
        problem = f"rows are {period:g} s apart with [units] t = {config.units['t']!r}"
        raise InputError(
            raw.source, place, problem, "give the unit that the time column is written in"
        )
    return period


def _is_even(rows: Rows, period: float, config: Config) -> bool:
    """Whether the rows lie on a grid, some of which may lack."""
    pieces = (rows.t[first:last] for first, last in stretches(rows.fresh))
    return all(make_grid(t, period, period, config.prepare.jitter).even for t in pieces)


def _fastest_of(rows: Rows, config: Config) -> float:
    """The shortest period of a response, s, or where there is none of a channel: where messages of
    several rates were laid into one table, rows are much closer to each other, and none of the
    channels is in most of them. Zero where a channel is in nearly all."""
    periods: dict[str, float] = {}
    for name, values in rows.raw.channels.items():
        there = np.flatnonzero(np.isfinite(values[rows.index]))
        if there.size > _MOST * rows.index.size:
            return 0.0
        fresh = np.diff(np.cumsum(rows.fresh)[there], prepend=-1) > 0
        with contextlib.suppress(ValueError):
            periods[name] = sample_period(rows.t[there], fresh)
    responses = {"v", "delta", *(plant.output for plant in config.plants)}
    own = [period for name, period in periods.items() if name in responses]
    return min(own or periods.values(), default=0.0)


def unwrap(rows: Rows, config: Config) -> None:
    """Unwrap angles over the finite cells of each run."""
    raw = rows.raw
    for name in config.prepare.unwrap:
        if name not in raw.channels:
            continue
        values, jumps = raw.channels[name].copy(), 0
        for first, last in stretches(rows.fresh):
            index = rows.index[first:last]
            index = index[np.isfinite(values[index])]
            smooth = np.unwrap(values[index])
            jumps += np.count_nonzero(np.abs(np.diff(smooth - values[index])) > 1.0)
            values[index] = smooth
        if jumps:
            raw.channels[name] = values
            rows.told.append(f"unwrapped {name} at {counted(int(jumps), 'jump')}")


def mend_missing(rows: Rows, config: Config, gap: float) -> None:
    """Refuse, cut or fill cells that are empty or not finite, as `[prepare] missing` says."""
    raw, policy = rows.raw, config.prepare.missing
    lost, without = np.zeros(rows.index.size, dtype=bool), []
    filled_up_to = set()  # s, of holes
    for name, values in raw.channels.items():
        bad = ~np.isfinite(values[rows.index])
        if not bad.any():
            continue
        count, k = np.count_nonzero(bad), int(np.flatnonzero(bad)[0])
        if policy == "refuse":
            place = f"{raw.line(int(rows.index[k]))}, column {raw.columns[name]!r}"
            problem = f"the cell is empty or not finite ({count} such cells in the column)"
            mend = 'mend them, or set [prepare] missing = "gap", "hold" or "interpolate"'
            if count > _MERGED * bad.size:
                mend = (
                    "if messages of several rates were laid into one table, set [prepare] missing "
                    '= "interpolate" (commands are held) and duplicates = "drop"'
                )
            raise InputError(raw.source, place, problem, mend)
        if policy != "gap":
            held = policy == "hold" or is_held(name, config)
            own = gap if config.prepare.gap else max(gap, USUAL_GAP * _spacing(rows, ~bad))
            stay = _fill(rows, name, bad, held, own)
            if stay.any():
                filled_up_to.add(f"{own:.3g} s")
            filled = bad & ~stay
            if filled.any():
                how = "held" if held else "interpolated"
                rows.told.append(
                    f"filled in {counted(filled, 'missing cell')} of {name} ({how}), the first "
                    f"{moment(rows.t, int(np.argmax(filled)))}"
                )
            bad = stay
        if bad.any():
            without.append(name)
            lost |= bad
    if without:
        k = int(np.flatnonzero(lost)[0])
        spans = " and ".join(sorted(filled_up_to))
        rows.told.append(
            f"cut out {counted(lost, 'row')} without {' or '.join(without)}, the first "
            f"{moment(rows.t, k)}"
            + (f"; holes of up to {spans} are filled in, as [prepare] gap says" if spans else "")
        )
        rows.cut(lost, gap=True)


def _spacing(rows: Rows, good: np.ndarray) -> float:
    """Usual time between the cells that are there, s: a sensor may be slower than the log."""
    t = rows.t[good]
    return float(np.median(np.diff(t))) if t.size > 1 else 0.0


def _fill(rows: Rows, name: str, bad: np.ndarray, held: bool, gap: float) -> np.ndarray:
    """Fill short holes of a channel in place; returns the mask of what could not be filled."""
    values, t = rows.raw.channels[name].copy(), rows.t
    left = bad.copy()
    for first, last in stretches(rows.fresh):
        here = np.arange(first, last)
        good = here[~bad[first:last]]
        holes = here[bad[first:last]]
        if good.size == 0 or holes.size == 0:
            continue
        before = np.searchsorted(good, holes) - 1
        after = before + 1
        older = good[np.maximum(before, 0)]
        ends = after == good.size
        end = np.where(ends, t[holes[-1]], t[good[np.minimum(after, good.size - 1)]])
        short = (before >= 0) & (end - t[older] <= gap) & (held | ~ends)
        if held:
            fill = values[rows.index[older]]
        else:
            fill = np.interp(t[holes], t[good], values[rows.index[good]])
        values[rows.index[holes[short]]] = fill[short]
        left[holes[short]] = False
    rows.raw.channels[name] = values
    rows.filled[name] = bad & ~left
    return left


def cut_warm_up(rows: Rows, config: Config) -> None:
    warm_up, raw = config.prepare.warm_up, rows.raw
    if warm_up == 0.0 or not rows.index.size:
        return
    labels = raw.run[rows.index] if raw.run is not None else np.zeros(rows.index.size)
    start = np.concatenate([[True], labels[1:] != labels[:-1]])
    begin = rows.t[np.flatnonzero(start)][np.cumsum(start) - 1]
    drop = rows.t - begin < warm_up
    rows.told.append(f"cut off the first {warm_up:g} s of every run ({counted(drop, 'row')})")
    rows.cut(drop, gap=True)


def cut_gaps(rows: Rows, gap: float) -> None:
    step = np.diff(rows.t, prepend=np.nan)
    wide = ~rows.fresh & (step > gap)
    if wide.any():
        k = int(np.flatnonzero(wide)[0])
        rows.told.append(
            f"ended segments at {counted(wide, 'hole')} of more than {gap:g} s between rows: the "
            f"longest lasts {step[wide].max():.3g} s, the first begins {moment(rows.t, k - 1)}"
        )
        rows.fresh |= wide


def moment(t: np.ndarray, k: int) -> str:
    """When a row is: `at 12.3 s`, or where a log counts seconds from long before it, `12.3 s after
    its first row`."""
    if abs(t[0]) < LONG_BEFORE:
        return f"at {t[k]:g} s"
    return f"{t[k] - t[0]:g} s after its first row"


def counted(what: np.ndarray | int, noun: str) -> str:
    """How many, with the noun in its number: `1 row`, `3 rows`. A mask counts its true entries."""
    count = int(np.count_nonzero(what)) if isinstance(what, np.ndarray) else int(what)
    return f"{count} {noun}{'' if count == 1 else 's'}"


def stretches(fresh: np.ndarray) -> list[tuple[int, int]]:
    """First row and the row after the last of every piece."""
    edges = [*np.flatnonzero(fresh).tolist(), fresh.size]
    return list(zip(edges[:-1], edges[1:], strict=True))


def is_held(channel: str, config: Config) -> bool:
    """Whether a channel is a command, which keeps its value between rows: by its name, as the input
    of a plant that is no measurement of a vehicle, or as what a command is made of."""
    inputs = {plant.input for plant in config.plants} - set(config.canonical)

    def commands(name: str) -> bool:
        return name.endswith("_cmd") or name in config.prepare.hold or name in inputs

    if commands(channel):
        return True
    answers = {*config.canonical, *(plant.output for plant in config.plants)}
    made = [how for name, how in config.derive.items() if commands(name)]
    return channel not in answers and any(channel in _made_of(how, config.source) for how in made)


def _made_of(how: Derivation, source: str) -> Collection[str]:
    """The channels that a derived one is made of."""
    if how.expression is None:
        return {how.speed, how.steering, how.yaw_rate}
    return parse(how.expression, source=source, place="[derive]").names
