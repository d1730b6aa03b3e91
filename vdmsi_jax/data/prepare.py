"""From a table in SI to a `Record`: mend the rows, lay the grid, derive channels.

Nothing is mended in silence: every step that changes something adds a sentence to the record's
`repairs`.
"""

from collections.abc import Callable, Mapping, Sequence

import numpy as np

from ..config import CANONICAL, STEERING_CHANNELS, Config, PlantSpec, plants_among
from ..errors import InputError, nearest
from ..units import si_symbol
from .derive import Channels, derive
from .lattice import lattice_step
from .magnitude import refuse_absurd
from .mend import (
    USUAL_GAP,
    Raw,
    Rows,
    check_time,
    counted,
    cut_gaps,
    cut_warm_up,
    is_held,
    mend_missing,
    moment,
    period_of,
    select_rows,
    stretches,
    unwrap,
)
from .outliers import answering, standing_alone
from .record import Record, Segment
from .resample import Grid, hold, interpolate, make_grid, measured, rounded
from .unasked import unasked
from .undeclared import refuse_undeclared

_FINEST = 100  # samples that may be made of one row
_ROUNDING = 0.02  # how far the period of an uneven log may move to become a rounder number
_WIDEST = 0.5 * np.pi  # rad, that a wheel is turned
_LOOKED_AT = 3_000_000  # rows at the most, that are looked at for outliers: 5 s a million
_MANY = 0.7  # of the rows, that a log keeps whose cells are rarely empty
_BETWEEN_RUNS = 1.0  # s between runs whose clocks restarted


def prepare(raw: Raw, config: Config, windows: Mapping[str, float] | None = None) -> Record:
    """Make a record of a table.

    Args:
        raw: the table.
        config: its `[prepare]`, `[derive]`, `[vehicle]` and `[[plants]]` are used.
        windows: least lengths of parabolas, see `Record.windows`.

    Raises:
        InputError: the log is refused: too short, time that does not rise, missing cells, nothing
            left, units that the motion belies, or what the configuration asks for cannot be
            derived.
    """
    n = raw.t.size
    if n < 2:
        found = "a header and no rows" if n == 0 else "only one row"
        raise InputError(raw.source, "", f"the log has {found}", "give a log with many rows")
    for key in ("hold", "unwrap"):
        for name in getattr(config.prepare, key):
            if name not in raw.channels and name not in CANONICAL:
                problem = f"there is no channel {name!r}"
                mend = nearest(name, raw.channels)
                raise InputError(config.source, f"[prepare] {key}", problem, mend)
    new_run = np.zeros(n, dtype=bool)
    new_run[0] = True
    if raw.run is not None:
        new_run[1:] = raw.run[1:] != raw.run[:-1]
    rows = Rows(raw, np.arange(n), new_run, {}, [*raw.passed_by])
    if raw.keep is not None:
        select_rows(rows)
    check_time(rows, config)
    period = period_of(rows, config)
    gap = config.prepare.gap or USUAL_GAP * period
    unwrap(rows, config)
    mend_missing(rows, config, gap)
    cut_warm_up(rows, config)
    cut_gaps(rows, gap)
    for name, sharp in raw.sharp.items():
        if sharp[rows.index].any():
            rows.told.append(
                f"cut {name} in {counted(sharp[rows.index], 'row')} to the sharpest curvature that "
                f"the reference point can follow"
            )
    for name, values in raw.channels.items():
        place = f"column {raw.columns[name]!r}"
        refuse_absurd(raw.source, place, values[rows.index])
        if name in STEERING_CHANNELS and config.vehicle is not None:
            _refuse_degrees(raw.source, place, name, values[rows.index], config)
    return _assemble(rows, config, period, windows or {})


def _refuse_degrees(source: str, place: str, name: str, angles: np.ndarray, config: Config) -> None:
    """Refuse angles that no road wheel has."""
    usual = float(np.nanquantile(np.abs(angles), 0.99)) if np.isfinite(angles).any() else 0.0
    if usual > _WIDEST:
        problem = f"a steering angle of {usual:.3g} rad is more than a road wheel turns"
        degrees = f'say so if it is in degrees, [units] {name} = "deg"; '
        wheel = (
            f"make a steering wheel's angle, [columns] wheel = ..., that of the road wheels: "
            f'[derive] {name} = {{ expression = "wheel / 16", unit = "rad" }}'
        )
        mend = wheel if name in config.units else degrees + wheel
        raise InputError(source, place, problem, mend)


def _assemble(rows: Rows, config: Config, period: float, windows: Mapping[str, float]) -> Record:
    """Lay each piece on its grid, join them, and derive what follows from them."""
    raw = rows.raw
    pieces, grids, dt = _grids(rows, config, period)
    _tell_sampling(rows, grids, period, dt)
    absent = np.concatenate([grid.absent for grid in grids])
    values: dict[str, np.ndarray] = {}
    filled: dict[str, np.ndarray] = {}
    uneven = [at for at, grid in zip(pieces, grids, strict=True) if not grid.even]
    _leave_out_outliers(rows, config, uneven)
    for name in raw.channels:
        column, known, mask = raw.channels[name][rows.index], rows.known(name), absent
        if is_held(name, config):
            values[name] = _each(hold, grids, pieces, column)
        else:
            told = known | (config.prepare.missing == "hold")
            values[name] = _each(interpolate, grids, pieces, column, told)
        if name in rows.filled:
            mask = mask | ~_each(measured, grids, pieces, known)
        if mask.any():
            filled[name] = mask.copy()
    runs = [raw.name if raw.run is None else str(raw.run[rows.index[at.start]]) for at in pieces]
    t = _lay_out(grids, runs, dt, rows.told)
    units = {name: si_symbol(raw.quantities[name]) for name in values}
    edges = np.cumsum([0, *(grid.samples for grid in grids)]).tolist()
    segments = [
        Segment(start, stop, run)
        for start, stop, run in zip(edges[:-1], edges[1:], runs, strict=True)
    ]
    samples = [segment.samples for segment in segments]
    channels = Channels(values, filled, units, samples, dt, t, rows.told)
    derive(channels, config.derive, config.vehicle, source=config.source, log=raw.source)
    refuse_undeclared(channels, config, raw.columns, raw.source)
    more = unasked(channels, config, windows)
    derive(channels, more, config.vehicle, source=config.source, log=raw.source)
    return Record(
        name=raw.name,
        dt=dt,
        t=t,
        channels=channels.values,
        units=channels.units,
        segments=tuple(segments),
        repairs=tuple(rows.told),
        vehicle=config.vehicle,
        plants=_plants(config, channels.values),
        filled=channels.filled,
        steps=_steps(rows, config) if uneven else {},
        windows={name: how.window for name, how in more.items() if how.window is not None},
        file=raw.source,
    )


def _leave_out_outliers(rows: Rows, config: Config, pieces: Sequence[slice]) -> None:
    """Take what stands alone out of uneven pieces, before it is interpolated: that would make two
    or three samples of it that no longer stand alone."""
    raw, n = rows.raw, rows.index.size
    if n > _LOOKED_AT:
        return
    columns = {name: values[rows.index] for name, values in raw.channels.items()}
    known = {name: rows.known(name) for name in columns}
    inputs = {plant.input for plant in config.plants}
    commands = [name for name in columns if is_held(name, config) or name in inputs]
    pulses, held = np.zeros(n, dtype=bool), config.prepare.missing == "hold"
    for at in pieces:
        for name in commands:
            own = at.start + np.flatnonzero(known[name][at])
            if own.size:
                after = np.searchsorted(own, np.arange(at.start, at.stop), side="right") - 1
                told = answering([columns[name][own]], [slice(0, own.size)], own.size)
                pulses[at] |= told[np.maximum(after, 0)]
    for name, values in columns.items():
        if name in commands:
            continue
        bad = np.zeros(n, dtype=bool)
        for at in pieces:
            own = at.start + np.flatnonzero(known[name][at])
            if not own.size:
                continue
            alone = standing_alone(values[own], [slice(0, own.size)], ~pulses[own])
            bad[own[alone]] = True
            spoilt, kept = bad[at] if held else (bad | ~known[name])[at], own[~alone]
            here = np.arange(at.start, at.stop)[spoilt]
            if alone.any():
                values[here] = np.interp(rows.t[here], rows.t[kept], values[kept])
        if not bad.any():
            continue
        raw.channels[name] = raw.channels[name].copy()
        raw.channels[name][rows.index] = values
        rows.filled[name] = ~known[name] | bad
        rows.told.append(
            f"left out {counted(bad, 'sample')} of {name} far from those about, as outliers of a "
            f"sensor are, the first {moment(rows.t, int(np.argmax(bad)))}"
        )


def _steps(rows: Rows, config: Config) -> dict[str, float]:
    """Sizes of the steps in which measurements were logged."""
    found = {}
    for name, values in rows.raw.channels.items():
        own = values[rows.index[rows.known(name)]]
        step = None if is_held(name, config) else lattice_step(own)
        if step is not None:
            found[name] = step
    return found


def _each(
    on_grid: Callable, grids: list[Grid], pieces: list[slice], *columns: np.ndarray
) -> np.ndarray:
    """Columns piece by piece on their grids, joined."""
    pairs = zip(grids, pieces, strict=True)
    return np.concatenate([on_grid(grid, *(own[at] for own in columns)) for grid, at in pairs])


def _grids(rows: Rows, config: Config, period: float) -> tuple[list[slice], list[Grid], float]:
    """The pieces that are long enough, a grid for each, and the sample period of them all."""
    dt = config.prepare.dt or period
    if dt < period / _FINEST:
        problem = f"{dt:g} s is far below the {period:g} s between rows of {rows.raw.source}"
        raise InputError(config.source, "[prepare] dt", problem, f"give {period:g} s or more")
    pieces = [slice(first, last) for first, last in stretches(rows.fresh)]
    grids = [make_grid(rows.t[at], period, dt, config.prepare.jitter) for at in pieces]
    if config.prepare.dt is None and not all(grid.even for grid in grids):
        dt = rounded(period, _ROUNDING * period)
        grids = [make_grid(rows.t[at], period, dt, config.prepare.jitter) for at in pieces]
    enough = config.prepare.min_segment
    long = [k for k, grid in enumerate(grids) if grid.samples >= enough]
    if not long:
        problem = f"no stretch without a gap has the {enough} samples of {dt:g} s that are needed"
        mend = "give a longer log, or change [prepare] dt, gap or min_segment"
        kept = rows.index.size / rows.raw.t.size
        if config.prepare.missing == "gap" and kept < _MANY:
            several = "most" if kept < 0.5 else "many"
            mend = f'{several} rows lack a channel: set [prepare] missing = "interpolate"'
        raise InputError(rows.raw.source, "", problem, mend)
    if len(long) < len(grids):
        lost = rows.index.size - sum(grids[k].position.size for k in long)
        rows.told.append(
            f"left out {counted(len(grids) - len(long), 'piece')} between gaps with less than "
            f"{enough} samples ({counted(lost, 'row')})"
        )
    return [pieces[k] for k in long], [grids[k] for k in long], dt


def _tell_sampling(rows: Rows, grids: list[Grid], period: float, dt: float) -> None:
    uneven = [grid for grid in grids if not grid.even]
    if uneven:
        steps = np.concatenate([np.diff(grid.position) * grid.step for grid in uneven])
        rows.told.append(
            f"resampled {sum(grid.position.size for grid in uneven)} unevenly spaced rows (steps "
            f"of {steps.min():.3g} to {steps.max():.3g} s) to "
            f"{sum(grid.samples for grid in uneven)} samples at {dt:g} s: commands held, "
            f"their means over a sample taken, measurements interpolated"
        )
    if grids[0].every > 1:
        rows.told.append(
            f"thinned out from {period:g} to {dt:g} s: one of {grids[0].every} measurements taken, "
            f"of commands the means over a sample"
        )
    if absent := sum(int(grid.absent.sum()) for grid in grids):
        rows.told.append(
            f"filled in {counted(absent, 'sample')} for which the log has no row, and marked them "
            f"as not measured"
        )


def _lay_out(grids: list[Grid], runs: list[str], dt: float, told: list[str]) -> np.ndarray:
    """One strictly increasing time base; runs whose clock restarted are laid behind the run
    before."""
    parts, shift, moved = [], 0.0, 0
    for k, grid in enumerate(grids):
        start = grid.start + shift
        if k > 0 and runs[k] != runs[k - 1]:
            start = grid.start
            if start <= parts[-1][-1]:
                start, moved = parts[-1][-1] + dt + _BETWEEN_RUNS, moved + 1
            shift = start - grid.start
        parts.append(start + dt * np.arange(grid.samples))
    if moved:
        told.append(f"laid {counted(moved, 'run')} whose clock starts anew behind the run before")
    return np.concatenate(parts)


def _plants(config: Config, channels: Mapping[str, np.ndarray]) -> tuple[PlantSpec, ...]:
    """The plants that the configuration names, or those whose channels are there."""
    for plant in config.plants:
        for role in ("input", "output"):
            channel = getattr(plant, role)
            if channel not in channels:
                place, problem = f"[[plants]] {plant.name} {role}", f"no channel {channel!r}"
                mend = f"{nearest(channel, channels)}, or name its column: [columns] {channel}"
                raise InputError(config.source, place, problem, mend)
    return config.plants or plants_among(channels)
