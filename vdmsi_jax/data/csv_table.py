"""CSV files as tables: fast where they are regular, cell by cell where they are not.

The way in is numpy's parser in C. Only where that fails, or where texts are wanted, the file is
read cell by cell, which also finds the line and column that are at fault.
"""

import csv
import itertools
import warnings
from collections.abc import Collection, Iterator
from pathlib import Path

import numpy as np

from ..errors import InputError
from .table import Table

_CHUNK = 20_000  # rows that are turned into numbers at once
_SNIFF = 1 << 16  # bytes that are looked at first
_BLOCK = 1 << 22  # bytes whose separators are counted at once


class CsvTable(Table):
    """A CSV file with a header. Comma, semicolon or tab part the cells, whichever the header has
    most. A comment right before numbers, with as many cells, is the header (`numpy.savetxt`).

    Raises:
        InputError: binary, no UTF-8, no header, two columns of one name, or too large for the
            memory.
    """

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
        self._header_line, header = self._header()
        self.names = [name.strip() for name in header]
        if not any(self.names) or all(map(_is_number, self.names)):
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
        self.refuse_if_too_large()

    def read(self, *, numbers: Collection[str], texts: Collection[str]) -> dict[str, np.ndarray]:
        columns = None if texts else self._read_fast(sorted(numbers))
        if columns is None:
            columns = self._read_any(numbers, texts)
        self.rows = next(iter(columns.values())).size
        return columns

    def line(self, row: int) -> str:
        number = next(itertools.islice(self._lines(), row + 1, None))[0]
        return f"line {number}"

    def _header(self) -> tuple[int, list[str]]:
        """Line number and cells of the header; cells of the first row where there is none."""
        line, above = 1, [""]
        for number, cells in self._records():
            if not cells[0].startswith("#"):
                numbers = all(not cell or _is_number(cell) for cell in cells)
                if numbers and len(cells) == len(above) > 1:
                    return line, [above[0].lstrip("# "), *above[1:]]
                return number, cells
            line, above = number, cells
        return line, []

    def _lines(self) -> Iterator[tuple[int, list[str]]]:
        """Line number and cells of the header and of every row; blank lines and comments are passed
        over."""
        yield self._header_line, self.names
        for number, cells in self._records():
            if number > self._header_line and not cells[0].startswith("#"):
                yield number, cells

    def _records(self) -> Iterator[tuple[int, list[str]]]:
        """Line number and cells of whatever is not blank."""
        with self.path.open(newline="", encoding="utf-8-sig", errors="replace") as file:
            reader = csv.reader(file, delimiter=self._delimiter, skipinitialspace=True)
            try:
                for cells in reader:
                    if cells and cells != [""]:
                        yield reader.line_num, cells
            except csv.Error as error:
                place, problem = f"line {reader.line_num}", f"is damaged ({error})"
                raise InputError(str(self.path), place, problem, "mend the file") from None

    def _read_fast(self, names: list[str]) -> dict[str, np.ndarray] | None:
        """The columns by numpy's parser in C, or None where the file is not as regular as that
        needs."""
        try:
            with warnings.catch_warnings(action="ignore"):  # about a file without rows
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
        if self._full_lines() != len(values) + 1:  # the header is one
            return None
        return {name: np.ascontiguousarray(values[:, i]) for i, name in enumerate(names)}

    def _full_lines(self) -> int | None:
        """How many lines have as many separators as the header; None where one has others than
        that or none, as a comment may have."""
        full, carried = 0, np.zeros(0, np.uint8)
        with self.path.open("rb") as file:
            for block in iter(lambda: file.read(_BLOCK), b""):
                carried = np.concatenate([carried, np.frombuffer(block, np.uint8)])
                ends = np.flatnonzero(carried == ord("\n"))
                if not len(ends):
                    continue
                told = np.diff(np.cumsum(carried == ord(self._delimiter))[ends], prepend=0)
                if not np.isin(told, (0, len(self.names) - 1)).all():
                    return None
                full += int(np.count_nonzero(told))
                carried = carried[ends[-1] + 1 :]
        last = int(np.count_nonzero(carried == ord(self._delimiter)))
        return full + bool(last) if last in (0, len(self.names) - 1) else None

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
                    parts[name].append(np.array([_number(cell or "nan") for cell in columns[name]]))
                except ValueError:
                    self._refuse_text(name, columns[name], [number for number, _ in chunk])
        return {name: np.concatenate(part) if part else np.empty(0) for name, part in parts.items()}

    def _refuse_text(self, name: str, cells: tuple[str, ...], lines: list[int]) -> None:
        for number, cell in zip(lines, cells, strict=True):
            if cell and not _is_number(cell):
                mend = 'mend the cell, or empty it and set [prepare] missing = "gap"'
                if "," in cell:
                    mend = "write numbers with a decimal point"
                place = f"line {number}, column {name!r}"
                raise InputError(str(self.path), place, f"{cell!r} is no number", mend)


def _number(cell: str) -> float:
    """A cell's number. What only Python takes for one, such as `1_000`, is refused as numpy's
    parser does."""
    if "_" in cell or not cell.isascii():
        raise ValueError(cell)
    return float(cell)


def _is_number(cell: str) -> bool:
    try:
        _number(cell)
    except ValueError:
        return False
    return True


def _is_row(line: str) -> bool:
    return bool(line.strip()) and not line.startswith("#")
