"""From a file or arrays to a `Record`: formats, names, units and signs end here. Below this door
all is SI.

`read_log` is the whole way: find the columns that the configuration asks for, refuse what cannot be
read before it fills the memory, turn units into SI, and hand the table to `prepare`, which makes
evenly sampled segments of it.
"""

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from itertools import count
from os import PathLike
from pathlib import Path

import numpy as np

from ..config import (
    CANONICAL,
    DEFAULT_PLANTS,
    STEERING_CHANNELS,
    Config,
    IdentifyOptions,
    PlantSpec,
    allowed_quantities,
    load_config,
    plants_among,
)
from ..errors import InputError, nearest
from ..files import in_a_file_name
from ..units import UNITS, Unit, bracketed, si_symbol, unit
from .array_table import Arrays, ArrayTable, Frame
from .csv_table import CsvTable
from .derive import sharpest_curvature, steering_from_curvature
from .expressions import Expression, parse
from .mend import Raw
from .npz_table import NpzTable
from .prepare import prepare
from .record import Record
from .session import in_session
from .table import Table

_CONFIG_NAMES = ("vehicle.toml",)


Log = str | PathLike[str] | Arrays
"""A log: a file, or arrays by name."""

_IN_MEMORY = "arrays"  # what a log without a file is called


def read_log(
    path: Log, config: str | Path | Config | None = None, *, name: str | None = None
) -> Record:
    """Read one log.

    Args:
        path: a CSV file (with a header; comma, semicolon or tab), an NPZ file of one-dimensional
            arrays, or such arrays themselves with their time `t`: a mapping of names to them, or a
            data frame, whose columns they are. The canonical header needs no configuration.
        config: a TOML file or what `load_config` made of it. Without one, a TOML file of the log's
            name beside it, or a `vehicle.toml` in its folder, is taken; without those, and of
            arrays, the canonical header is expected.
        name: what reports and pictures call it; without one the file's, or `arrays`.

    Returns:
        The record: SI units, evenly sampled segments, every repair told.

    Raises:
        InputError: the log or its configuration is refused; the message names the file, the line or
            key, and the mend.
    """
    record = _read(path, config_of(path, config), {})
    return record if name is None else record.renamed(name)


def _read(log: Log, config: Config, windows: Mapping[str, float]) -> Record:
    """`read_log`, with the least lengths of parabolas that make channels of the pose."""
    where = _where(config)
    table = _open_table(log)
    path = table.path
    config = _with_its_plant(config, table.names)
    columns = _columns(config, table.names, path)
    run = columns.pop("run", None)
    numbers, texts = set(columns.values()), set[str]()
    if where is not None:
        _check_where(where, columns, table.names, path)
        numbers, texts = numbers | (set(where.names) - set(where.texts)), set(where.texts)
    if run is not None and run not in numbers:
        texts.add(run)
    read = table.read(numbers=numbers, texts=texts)
    logged = {channel: _to_si(channel, read[name], config) for channel, name in columns.items()}
    channels = {channel: _as_angle(channel, x, config) for channel, x in logged.items()}
    raw = Raw(
        name=path.stem,
        source=str(path),
        t=channels.pop("t"),
        channels=channels,
        quantities={channel: _quantity(channel, config) for channel in channels},
        run=None if run is None else _labels(read[run]),
        keep=None if where is None else np.broadcast_to(where(read), table.rows).astype(bool),
        columns=columns,
        line=table.line,
        sharp={
            channel: np.abs(logged[channel]) > sharpest_curvature(config.vehicle)
            for channel in channels
            if _is_curvature(channel, config) and config.vehicle is not None
        },
        passed_by=tuple(_passed_by(table.names, columns)),
    )
    record = prepare(raw, config, windows)
    return replace(record, file="") if isinstance(table, ArrayTable) else record


def read_logs(
    paths: Sequence[Log], config: str | Path | Config | None = None, *, in_step: bool = True
) -> list[Record]:
    """Read several logs of one vehicle with one configuration.

    Args:
        paths: the files or arrays, at least one; see `read_log`.
        config: as in `read_log`.
        in_step: bring all to one sample period, as what is fitted to several asks for.

    Returns:
        A record for each log, with different names: the file's (`arrays` where there is none), with
        its folder's before it where two are alike, and a number behind where these are, too. All
        have one sample period: that of `[prepare] dt`, or else the longest of the logs' own, if
        `in_step`. What is made of the pose where nobody asked is made alike then.

    Raises:
        InputError: a log or the configuration is refused, or no file is given.
    """
    if isinstance(paths, str | PathLike | Mapping | Frame):
        named = str(paths) if isinstance(paths, str | PathLike) else _IN_MEMORY
        raise InputError(named, "", "is a single log", "give a list of logs, or take read_log")
    paths = list(paths)
    if not paths:
        raise InputError("logs", "", "no log is given", "give at least one file")
    _refuse_topics(paths, config)
    records = [read_log(path, config) for path in paths]
    if in_step:
        records = _in_step(records, paths, config)
    folders = [
        Path(path).resolve().parent.name if isinstance(path, str | PathLike) else ""
        for path in paths
    ]
    names = _told_apart([record.name for record in records], folders)
    return in_session([r.renamed(name) for r, name in zip(records, names, strict=True)])


def _refuse_topics(logs: Sequence[Log], config: str | Path | Config | None) -> None:
    """Refuse a file that lacks a column which another one has: it may be a topic of one drive."""
    first, *others = (config_of(log, config) for log in logs)
    wanted = set(first.columns.values())
    if not wanted or not others or any(own.source != first.source for own in others):
        return
    tables = [_open_table(log) for log in logs]
    there = [(table.path, wanted & set(table.names)) for table in tables]
    for file, own in there:
        lacks = sorted(set.union(*(names for _, names in there)) - own)
        if lacks:
            other = next(file for file, names in there if lacks[0] in names)
            problem = f"is missing, and stands in {other}"
            mend = (
                "give logs with the same columns; topics of one drive go into one table, a row for "
                'each stamp, with [prepare] missing = "interpolate", duplicates = "drop"'
            )
            raise InputError(str(file), f"column {lacks[0]!r}", problem, mend)


def _told_apart(names: Sequence[str], folders: Sequence[str]) -> list[str]:
    """Different names, as parts of file names, too: with the folder where two are alike, and a
    number where those are, too."""
    longer = [
        f"{folder}/{name}" if folder and names.count(name) > 1 else name
        for name, folder in zip(names, folders, strict=True)
    ]
    plain = [in_a_file_name(name) for name in longer]
    taken, made = set(plain), list[str]()
    for name, own in zip(longer, plain, strict=True):
        if plain.count(own) > 1:
            numbered = (f"{name}-{k}" for k in count(1))
            name = next(other for other in numbered if in_a_file_name(other) not in taken)
            taken.add(in_a_file_name(name))
        made.append(name)
    return made


def _in_step(
    records: Sequence[Record], logs: Sequence[Log], config: str | Path | Config | None
) -> list[Record]:
    """The records with the longest of their sample periods and of the parabolas that make channels
    of the pose: those of other ones are read anew. Logs with uneven stamps hardly ever agree by
    themselves, and neither does what noise asks of a parabola."""
    dt = max(record.dt for record in records)
    windows: dict[str, float] = {}
    for record in records:
        for name, window in record.windows.items():
            windows[name] = max(window, windows.get(name, 0.0))

    def agrees(record: Record) -> bool:
        longest = [np.isclose(own, windows[name]) for name, own in record.windows.items()]
        return bool(np.isclose(record.dt, dt, rtol=1e-9) and all(longest))

    def again(log: Log) -> Record:
        own = config_of(log, config)
        return _read(log, replace(own, prepare=replace(own.prepare, dt=dt)), windows)

    return [
        record if agrees(record) else again(log) for record, log in zip(records, logs, strict=True)
    ]


def _open_table(log: Log) -> Table:
    """Open a log: arrays as they are, a file by its suffix: `.npz` is NPZ, all else is read as CSV.

    Raises:
        InputError: it is not there, is a folder, cannot be read, is empty, is no table, or is too
            large for the memory.
    """
    if not isinstance(log, str | PathLike):
        return ArrayTable(log, _IN_MEMORY)
    path = Path(log)
    if path.is_dir():
        raise InputError(str(path), "", "is a folder", "give a CSV or NPZ file in it")
    if not path.exists():
        raise InputError(str(path), "", "there is no such file", "check the path of the log")
    if not path.is_file():
        raise InputError(str(path), "", "is no regular file", "give a CSV or NPZ file")
    try:
        if path.stat().st_size == 0:
            mend = "give a header and many rows"
            raise InputError(str(path), "", "the file is empty", mend)
        return NpzTable(path) if path.suffix.lower() == ".npz" else CsvTable(path)
    except OSError as error:
        problem = f"cannot be read ({error.strerror or error})"
        raise InputError(str(path), "", problem, "check the file") from None


def config_of(path: Log, config: str | Path | Config | None = None) -> Config:
    """The configuration by which `read_log` reads a log: the one given, or that beside the log.

    Raises:
        InputError: the configuration is refused.
    """
    if isinstance(config, Config):
        return config
    if config is None and isinstance(path, str | PathLike):
        path = Path(path)
        if not path.name:
            raise InputError(str(path), "", "is no file", "name a log")
        candidates = (path.with_suffix(".toml"), *(path.parent / name for name in _CONFIG_NAMES))
        config = next((candidate for candidate in candidates if candidate.is_file()), None)
    if not isinstance(config, str | PathLike | None):
        mend = "give a TOML file, or Config(...) with these values"
        raise InputError("config", "", f"{type(config).__name__} is no configuration", mend)
    return load_config(config)


def options_of(paths: Sequence[str | Path], config: Config | None = None) -> IdentifyOptions | None:
    """How logs that are identified together are to be identified, by their configurations.

    Raises:
        InputError: a configuration is refused, or two of them want different things.
    """
    first, *others = (config_of(path, config) for path in paths)
    for own in others:
        if own.identify != first.identify:
            problem = f"asks for other things than that of {first.source}"
            raise InputError(own.source, "[identify]", problem, "give one by --config FILE")
    return first.identify


def plants_in(path: Path, config: Config) -> tuple[PlantSpec, ...]:
    """The plants that a log has by its header: those of its configuration, else those whose
    channels are there or may be made of a pose.

    Raises:
        InputError: the log cannot be opened, or is no table.
    """
    if config.plants:
        return config.plants
    there = _said(config, _open_table(path).names)
    by_pose = {"x", "y", "psi"} <= there
    return (() if by_pose else plants_among(there)) or DEFAULT_PLANTS


def _said(config: Config, names: Sequence[str]) -> set[str]:
    """The channels that a header and a configuration name."""
    return {*map(_without_unit, names), *names, *config.columns, *config.derive}


def _without_unit(name: str) -> str:
    """A column's name without the unit in brackets behind it."""
    return (bracketed(name) or (name, ""))[0]


def _with_its_plant(config: Config, names: Sequence[str]) -> Config:
    """The configuration with the plant of a log that is no vehicle's, where it names none."""
    single = tuple(p for p in plants_among(_said(config, names)) if p not in DEFAULT_PLANTS)
    return config if config.plants or not single else replace(config, plants=single)


def _columns(config: Config, names: Sequence[str], path: Path) -> dict[str, str]:
    """Which column of the file each channel is: those that the configuration names, and canonical
    ones by their name, behind which their unit may stand in brackets."""
    for channel, name in config.columns.items():
        if name not in names:
            place = f"[columns] {channel}" if config.path else f"column {name}"
            problem = f"is missing ({config.source}, {place})"
            raise InputError(str(path), f"column {name!r}", problem, nearest(name, names))
    plain = [*CANONICAL, *(c for p in config.plants for c in p.channels)]
    columns = {channel: channel for channel in plain if channel in names} | dict(config.columns)
    for channel, name in config.columns.items():
        _, written = bracketed(name) or ("", "")
        if channel not in config.units and _speaks_of(written, _unit(channel, config)):
            _check_written(channel, written, name, config, path)
    taken = list(config.columns.values())
    run = config.columns.get("run")
    if run is not None and (taken.count(run) > 1 or run == config.columns.get("t", "t")):
        problem = f"{run!r} is the column of another channel, too"
        mend = "name the column that tells the runs apart"
        raise InputError(config.source, "[columns] run", problem, mend)
    columns = {c: n for c, n in columns.items() if c in config.columns or n not in taken}
    for name in names:
        channel, written = bracketed(name) or ("", "")
        if channel in plain and channel not in columns and name not in taken:
            _check_written(channel, written, name, config, path)
            columns[channel] = name
    if "t" not in columns:
        mend = f'name the time column with [columns] t = "..."; {nearest("t", names)}'
        raise InputError(str(path), "column 't'", "is missing", mend)
    if len(columns) < 2 + ("run" in columns):
        problem = f"has none of the columns {', '.join(CANONICAL)}"
        mend = f"name channels in [columns]; {nearest('v', names)}"
        raise InputError(str(path), "header", problem, mend)
    return columns


def _passed_by(names: Sequence[str], columns: Mapping[str, str]) -> Iterator[str]:
    """Columns that are nearly called as a channel that the log lacks."""

    def letters(name: str) -> str:
        return re.sub("[^a-z0-9]", "", _without_unit(name).lower())

    lacking = {letters(channel): channel for channel in CANONICAL if channel not in columns}
    for name in names:
        channel = lacking.get(letters(name))
        if channel is not None and name not in columns.values():
            yield f"passed by the column {name!r}, which [columns] {channel} = {name!r} would read"


def _speaks_of(written: str, own: Unit) -> bool:
    """Whether what stands in brackets is a unit of the channel's quantity: it may be anything."""
    return written in UNITS and UNITS[written].quantity == own.quantity


def _check_written(channel: str, written: str, name: str, config: Config, path: Path) -> None:
    """Refuse a column that says to be in another unit than the channel is read in."""
    own = _unit(channel, config)
    try:
        fits = unit(written, source=str(path), place=name) == own
    except InputError:
        fits = False
    if not fits:
        said = config.units.get(channel) or si_symbol(own.quantity)
        place, problem = f"column {name!r}", f"says {written!r}, and {channel} is read in {said}"
        mend = f'set [columns] {channel} = "{name}" and its unit, [units] {channel} = "..."'
        raise InputError(str(path), place, problem, mend)


def _where(config: Config) -> Expression | None:
    """The expression of `[select]`, if there is one."""
    if config.select.where is None:
        return None
    return parse(config.select.where, source=config.source, place="[select] where")


def _check_where(
    where: Expression, columns: Mapping[str, str], names: Sequence[str], path: Path
) -> None:
    """Refuse an expression over columns that the log has not, or has as numbers."""
    for name in where.names:
        if name not in names:
            problem = f"{name!r} in {where.text!r} is no column of {path}"
            raise InputError(where.source, where.place, problem, nearest(name, names))
    for name in where.texts:
        if name in columns.values():
            problem = f"{name!r} is compared with a text, but it is a channel and thus a number"
            raise InputError(where.source, where.place, problem, "compare it with a number")


def _labels(run: np.ndarray) -> np.ndarray:
    """Labels of runs: texts as they are, numbers without needless digits."""
    if run.dtype.kind != "f":
        return run
    values, index = np.unique(run, return_inverse=True)
    return np.array([f"{value:.15g}" for value in values])[index]


def _unit(channel: str, config: Config):
    """The unit that a channel is logged in: as declared, or the SI unit of a canonical channel, or
    a pure number."""
    canonical = config.canonical
    default = si_symbol(canonical[channel]) if channel in canonical else "1"
    quantities = allowed_quantities(channel, canonical)
    name = config.units.get(channel, default)
    return unit(name, source=config.source, place=f"[units] {channel}", quantities=quantities)


def _quantity(channel: str, config: Config) -> str:
    """What a channel measures once it is in SI: canonical ones what they always do."""
    return config.canonical.get(channel) or _unit(channel, config).quantity


def _to_si(channel: str, values: np.ndarray, config: Config) -> np.ndarray:
    """Unit and sign."""
    factor = _unit(channel, config).to_si * config.sign.get(channel, 1.0)
    return values if factor == 1.0 else values * factor


def _is_curvature(channel: str, config: Config) -> bool:
    return channel in STEERING_CHANNELS and _unit(channel, config).quantity == "curvature"


def _as_angle(channel: str, values: np.ndarray, config: Config) -> np.ndarray:
    """A steering channel that was logged as curvature as road-wheel angle; others as they are."""
    if not _is_curvature(channel, config):
        return values
    if config.vehicle is None:
        problem = "a curvature needs the wheelbase to become an angle"
        mend = "give [vehicle] l_f and l_r"
        raise InputError(config.source, f"[units] {channel}", problem, mend)
    return steering_from_curvature(values, config.vehicle)
