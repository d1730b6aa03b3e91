"""A grid of orders over many logs, kept cell by cell so that it goes on where it was stopped.

A cell is one plant of one log with all its orders, since these are fitted together. Its file says
what it was made from; where that has changed, the cell is made anew.
"""

import functools
import hashlib
import json
from collections.abc import Sequence
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any

from .config import DEFAULT_PLANTS, Config, IdentifyOptions, PlantSpec, load_config
from .data.datasets import find_log
from .data.read import config_of, plants_in, read_log
from .data.record import Record
from .errors import InputError, nearest
from .files import output_folder, read_json, sources, write_json

CELL = "vdmsi.sweep-cell/1"
SWEEP = "vdmsi.sweep/1"

_LONGEST_NAME = 150  # bytes of a file's name, of which file systems take some 250
_MARK = 10  # digits of a fingerprint that tell two files apart


@dataclass(frozen=True)
class Cell:
    """One plant of one log.

    Attributes:
        log, config: the files to read.
        plant: what to identify.
        options: how; with them the orders.
        key: fingerprint of all that the result depends on.
        file: where the result is kept.
    """

    log: Path
    config: Path | None
    plant: PlantSpec
    options: IdentifyOptions
    key: str
    file: Path

    @property
    def name(self) -> str:
        return f"{self.log_name} {self.plant.name}"

    @property
    def log_name(self) -> str:
        """The log with its folder."""
        return f"{self.log.resolve().parent.name}/{self.log.name}"

    def kept(self) -> dict[str, Any] | None:
        """The result of an earlier run, if it was made from the same input."""
        if not self.file.is_file():
            return None
        try:
            document = read_json(self.file)
        except InputError:
            return None
        own = isinstance(document, dict) and document.get("key") == self.key
        whole = own and {"orders", "chosen", "chosen_by_bic"} <= document.keys()
        return document if whole else None

    def finish(self) -> dict[str, Any]:
        """The cell's result, identified and kept if it was not yet.

        A log that is refused is told in the result, under `refused`, and not kept.
        """
        kept = self.kept()
        if kept is not None:
            return kept
        from .identify import identify
        from .identify.document import plant_document

        head = {"schema": CELL, "key": self.key, "log": self.log.name, "plant": self.plant.name}
        try:
            content = _content(self.log, self.config)
            if _fingerprint(content, self.plant, self.options) != self.key:
                problem = "has changed since the sweep was planned, or its configuration has"
                raise InputError(str(self.log), "", problem, "run the sweep again")
            record = _read(self.log, self.config, content)
            grid = identify(record, self.plant, options=self.options)
        except InputError as refused:
            return head | {"refused": str(refused)}
        except OSError as why:
            return head | {"refused": f"{self.log}: cannot be read ({why.strerror})"}
        document = head | plant_document(grid)
        write_json(self.file, document)
        return document


def plan(config: str | Path, out: str | Path) -> list[Cell]:
    """The cells of a sweep, in the order of the file.

    Args:
        config: a TOML file with a `[sweep]` table; its `[identify]` says which orders, that of each
            log's configuration where it says nothing.
        out: folder of the results.

    Raises:
        InputError: a file is missing or refused, or a plant is named that the log's configuration
            does not have.
    """
    sweep = load_config(config)
    if sweep.sweep is None:
        mend = 'add runs = [{ log = "run.csv", config = "vehicle.toml" }, ...]'
        raise InputError(sweep.source, "[sweep]", "missing", mend)
    _of_logs(sweep)
    beside = Path(config).parent
    folder, cells = output_folder(Path(out) / "cells"), []
    for i, run in enumerate(sweep.sweep.runs, start=1):
        place = f"[sweep] runs {i}"
        try:
            log = find_log(run.log, beside)
        except InputError as why:
            problem = f"{why.problem} as {run.log}"
            raise InputError(sweep.source, f"{place} log", problem, why.mend) from None
        own = config_of(log, None if run.config is None else beside / run.config)
        options = sweep.identify or own.identify or IdentifyOptions()
        plants = {p.name: p for p in _plants_of(log, own)}
        content = _content(log, own.path)
        for name in run.plants or plants:
            if name not in plants:
                problem = f"there is no plant {name!r}"
                raise InputError(sweep.source, f"{place} plants", problem, nearest(name, plants))
            key = _fingerprint(content, plants[name], options)
            file = folder / _file_name(f"{log.resolve().parent.name}.{log.stem}.{name}", key)
            if any(file == cell.file and key != cell.key for cell in cells):
                file = file.with_name(f"{file.stem}.{key[:_MARK]}.json")
            cells.append(Cell(log, own.path, plants[name], options, key, file))
    return cells


def _of_logs(sweep: Config) -> None:
    """Refuse tables that belong into the configuration of a log."""
    none, own = Config(), {"identify", "sweep", "path"}
    for name in (f.name for f in fields(Config) if f.name not in own):
        if getattr(sweep, name) != getattr(none, name):
            mend = 'put it into a file of its own, and name that as `config = "..."` of the runs'
            raise InputError(sweep.source, f"[{name}]", "is not read for the logs of a sweep", mend)


def summarise(cells: Sequence[Cell], results: Sequence[dict[str, Any]]) -> list[dict[str, Any]]:
    """One row per cell: the chosen order and its scores, or why there is none."""
    rows = []
    for cell, result in zip(cells, results, strict=True):
        row = {"log": cell.log_name, "plant": cell.plant.name}
        if "refused" in result:
            rows.append(row | {"refused": result["refused"]})
            continue
        fit = result["orders"][result["chosen"]]
        scores = {name: fit.get(name) for name in ("fit", "held_out_fit", "mse", "delay", "status")}
        rows.append(
            row | {"chosen": result["chosen"], "chosen_by_bic": result["chosen_by_bic"]} | scores
        )
    return rows


@functools.lru_cache(maxsize=2)
def _read(log: Path, config: Path | None, digest: str) -> Record:
    """The record of a log and its configuration, whose content is told by the digest."""
    return read_log(log, config)


def _file_name(name: str, key: str) -> str:
    """What the file of a cell may be called: without what parts folders, and short enough."""
    name = name.replace("/", "%2F")
    if len(name.encode()) > _LONGEST_NAME:
        name = f"{name.encode()[:_LONGEST_NAME].decode(errors='ignore')}.{key[:_MARK]}"
    return f"{name}.json"


def _plants_of(log: Path, config: Config) -> tuple[PlantSpec, ...]:
    """The plants that a log has; the usual ones of one that its cells will refuse."""
    try:
        return plants_in(log, config)
    except InputError:
        return config.plants or DEFAULT_PLANTS


def _fingerprint(content: str, plant: PlantSpec, options: IdentifyOptions) -> str:
    """Of all that a result depends on, this package's code among it."""
    made_by = (repr(plant), repr(options), sources(), content)
    return hashlib.sha256(json.dumps(made_by).encode()).hexdigest()


def _content(*paths: Path | None) -> str:
    """A digest of what files hold."""
    read = (b"" if path is None else path.read_bytes() for path in paths)
    return hashlib.sha256(b"".join(hashlib.sha256(part).digest() for part in read)).hexdigest()
