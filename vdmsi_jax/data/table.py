"""The two file formats, CSV and NPZ, as tables of named columns, and the refusal of files that are
none.

A table first tells its column names and how many rows it expects, so that what is too large is
refused before it is read. The way in is the fast one; which line and column was at fault is looked
for only once something failed.
"""

import csv
import itertools
import os
import zipfile
from abc import ABC, abstractmethod
from collections.abc import Collection, Iterator
from pathlib import Path

import numpy as np

from ..errors import InputError

BYTES_PER_SAMPLE = 500
"""What one sample costs on its whole way, estimated: reading, resampling and the identification of
a few plants."""

MEMORY_SHARE = 0.5
"""How much of the memory that is free now one log may need."""

_CHUNK = 20_000
_SNIFF = 1 << 16


def available_memory() -> int:
    """Bytes that this process may still take: what the system has free, or less where a control
    group says so."""
    free = os.sysconf("SC_AVPHYS_PAGES") * os.sysconf("SC_PAGE_SIZE")
    try:
        lines = Path("/proc/meminfo").read_text().splitlines()
        free = next(
            int(line.split()[1]) * 1024 for line in lines if line.startswith("MemAvailable")
        )
    except (OSError, StopIteration):
        pass
    try:
        group = Path("/sys/fs/cgroup")
        limit = (group / "memory.max").read_text().strip()
        if limit != "max":
            free = min(free, int(limit) - int((group / "memory.current").read_text()))
    except (OSError, ValueError):
        pass
    return free


class Table(ABC):
    """A file of named columns of equal length.

    Attributes:
        path: the file.
        names: its columns, in order.
        rows: how many rows it has; an estimate until `read` was called.
    """

    path: Path
    names: list[str]
    rows: int

    @abstractmethod
    def read(self, *, numbers: Collection[str], texts: Collection[str]) -> dict[str, np.ndarray]:
        """The columns asked for: `numbers` as float64 with NaN for empty cells, `texts` as strings.

        Raises:
            InputError: a cell is no number, or the file is damaged.
        """

    @abstractmethod
    def line(self, row: int) -> str:
        """Where a row (from 0) stands in the file, in a user's words."""

    def _refuse_if_too_large(self) -> None:
        need, free = self.rows * BYTES_PER_SAMPLE, available_memory()
        if need > MEMORY_SHARE * free:
            problem = (
                f"about {self.rows:,} rows would take {need / 1e9:.1f} GB at {BYTES_PER_SAMPLE} "
                f"bytes a row; {free / 1e9:.1f} GB are free, of which a log may take {MEMORY_SHARE:.0%}"
            )
            raise InputError(
                str(self.path),
                "size",
                problem,
                "cut the log into shorter ones or thin its rows out",
            )


def open_table(path: Path) -> Table:
    """Open a log by its suffix: `.npz` is NPZ, all else is read as CSV.

    Raises:
        InputError: it is not there, is a folder, cannot be read, is empty, is no table, or is too
            large for the memory.
    """
    if path.is_dir():
        raise InputError(str(path), "", "is a folder", "give a CSV or NPZ file in it")
    if not path.exists():
        raise InputError(str(path), "", "there is no such file", "check the path of the log")
    if not path.is_file():
        raise InputError(str(path), "", "is no regular file", "give a CSV or NPZ file")
    try:
        if path.stat().st_size == 0:
            raise InputError(
                str(path), "", "the file is empty", "give a header and at least two rows"
            )
        return _NpzTable(path) if path.suffix.lower() == ".npz" else _CsvTable(path)
    except OSError as error:
        raise InputError(
            str(path), "", f"cannot be read ({error.strerror or error})", "check the file"
        ) from None


class _CsvTable(Table):
    def __init__(self, path: Path):
        self.path = path
        with path.open("rb") as file:
            head = file.read(_SNIFF)
        if b"\0" in head:
            raise InputError(
                str(path), "", "is a binary file", "give CSV text, or an NPZ file named .npz"
            )
        try:
            head.decode("utf-8-sig")
        except UnicodeDecodeError as error:
            if error.start < len(head) - 4:
                mend = "save the log as UTF-8 CSV text"
                raise InputError(
                    str(path), f"byte {error.start}", "is no UTF-8 text", mend
                ) from None
        first = next(
            (line for line in head.decode("utf-8-sig", "replace").splitlines() if _is_row(line)), ""
        )
        self._delimiter = max(",;\t", key=first.count)
        self._header_line, header = next(self._lines(), (1, []))
        self.names = [name.strip() for name in header]
        if not any(self.names):
            raise InputError(
                str(path), "", "there is no header", "name the columns in the first line"
            )
        for name in self.names:
            if self.names.count(name) > 1 and name:
                raise InputError(
                    str(path), "header", f"two columns are named {name!r}", "rename one of them"
                )
        lines = max(head.count(b"\n") - self._header_line, 1)
        per_row = max((len(head) - len(first)) / lines, 2.0)
        self.rows = int(path.stat().st_size / per_row)
        self._refuse_if_too_large()

    def read(self, *, numbers: Collection[str], texts: Collection[str]) -> dict[str, np.ndarray]:
        columns = None if texts else self._read_fast(sorted(numbers))
        if columns is None:
            columns = self._read_any(numbers, texts)
        self.rows = next(iter(columns.values())).size
        return columns

    def line(self, row: int) -> str:
        number = next(itertools.islice(self._lines(), row + 1, None))[0]
        return f"line {number}"

    def _lines(self) -> Iterator[tuple[int, list[str]]]:
        """Line number and cells of the header and of every row; blank lines and comments are passed
        over."""
        with self.path.open(newline="", encoding="utf-8-sig", errors="replace") as file:
            reader = csv.reader(file, delimiter=self._delimiter, skipinitialspace=True)
            for cells in reader:
                if cells and not cells[0].startswith("#") and any(cells):
                    yield reader.line_num, cells

    def _read_fast(self, names: list[str]) -> dict[str, np.ndarray] | None:
        """The columns by numpy's parser in C, or None where the file is not as regular as that
        needs."""
        with self.path.open("rb") as file:
            separators = sum(
                block.count(self._delimiter.encode())
                for block in iter(lambda: file.read(1 << 22), b"")
            )
        try:
            values = np.loadtxt(
                self.path,
                delimiter=self._delimiter,
                skiprows=self._header_line,
                usecols=[self.names.index(name) for name in names],
                comments="#",
                quotechar='"',
                ndmin=2,
                encoding="utf-8-sig",
            )
        except ValueError:
            return None
        if separators != (len(values) + 1) * (len(self.names) - 1):
            return None
        return {name: np.ascontiguousarray(values[:, i]) for i, name in enumerate(names)}

    def _read_any(self, numbers: Collection[str], texts: Collection[str]) -> dict[str, np.ndarray]:
        """The columns cell by cell: texts, empty cells, quotes; and the line and column of what is
        wrong."""
        width = len(self.names)
        parts: dict[str, list[np.ndarray]] = {name: [] for name in (*numbers, *texts)}
        rows = self._lines()
        next(rows)
        while chunk := list(itertools.islice(rows, _CHUNK)):
            for number, cells in chunk:
                if len(cells) != width:
                    problem = f"has {len(cells)} cells, the header has {width}"
                    raise InputError(
                        str(self.path), f"line {number}", problem, "mend or delete the line"
                    )
            columns = dict(
                zip(self.names, zip(*(cells for _, cells in chunk), strict=True), strict=True)
            )
            for name in texts:
                parts[name].append(np.array([cell.strip() for cell in columns[name]], dtype=str))
            for name in numbers:
                try:
                    parts[name].append(np.array([float(cell or "nan") for cell in columns[name]]))
                except ValueError:
                    self._refuse_text(name, columns[name], [number for number, _ in chunk])
        return {name: np.concatenate(part) if part else np.empty(0) for name, part in parts.items()}

    def _refuse_text(self, name: str, cells: tuple[str, ...], lines: list[int]) -> None:
        for number, cell in zip(lines, cells, strict=True):
            try:
                float(cell or "nan")
            except ValueError:
                hint = (
                    "write numbers with a decimal point"
                    if "," in cell
                    else "mend the cell, or leave it empty"
                )
                raise InputError(
                    str(self.path),
                    f"line {number}, column {name!r}",
                    f"{cell!r} is no number",
                    hint,
                ) from None


def _is_row(line: str) -> bool:
    return bool(line.strip()) and not line.startswith("#")


class _NpzTable(Table):
    def __init__(self, path: Path):
        self.path = path
        try:
            shapes = {}
            with zipfile.ZipFile(path) as archive:
                for entry in archive.namelist():
                    with archive.open(entry) as file:
                        version = np.lib.format.read_magic(file)
                        read_header = (
                            np.lib.format.read_array_header_1_0
                            if version == (1, 0)
                            else np.lib.format.read_array_header_2_0
                        )
                        shapes[entry.removesuffix(".npy")] = read_header(file)[0]
        except (zipfile.BadZipFile, ValueError) as error:
            mend = "save it with numpy.savez(path, t=..., v=...)"
            raise InputError(str(path), "", f"is no NPZ file ({error})", mend) from None
        self._shapes = shapes
        self.names = list(shapes)
        self.rows = max((int(np.prod(shape)) for shape in shapes.values()), default=0)
        self._refuse_if_too_large()

    def read(self, *, numbers: Collection[str], texts: Collection[str]) -> dict[str, np.ndarray]:
        columns = {}
        with np.load(self.path, allow_pickle=False) as archive:
            for name in (*numbers, *texts):
                try:
                    columns[name] = archive[name].astype(np.float64 if name in numbers else str)
                except (ValueError, TypeError) as error:
                    raise InputError(
                        str(self.path),
                        f"array {name!r}",
                        f"cannot be read as numbers ({error})",
                        "save plain numbers",
                    ) from None
                if columns[name].ndim != 1:
                    shape = columns[name].shape
                    raise InputError(
                        str(self.path),
                        f"array {name!r}",
                        f"has the shape {shape}",
                        "save one-dimensional arrays",
                    )
        first = next(iter(columns))
        for name, values in columns.items():
            if values.size != columns[first].size:
                problem = f"has {values.size} samples, {first!r} has {columns[first].size}"
                raise InputError(
                    str(self.path), f"array {name!r}", problem, "save arrays of equal length"
                )
        self.rows = columns[first].size
        return columns

    def line(self, row: int) -> str:
        return f"sample {row}"
