"""What every file format offers to the reader: named columns, and how large they are before they
are read."""

import os
from abc import ABC, abstractmethod
from collections.abc import Collection
from pathlib import Path

import numpy as np

from ..errors import InputError

BYTES_PER_SAMPLE = 500
"""What one sample costs on its whole way, estimated: reading, resampling and the identification of
a few plants."""

MEMORY_SHARE = 0.5
"""How much of the memory that is free now one log may need."""


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

    def refuse_if_too_large(self) -> None:
        need, free = self.rows * BYTES_PER_SAMPLE, available_memory()
        if need > MEMORY_SHARE * free:
            problem = (
                f"about {self.rows:,} rows would take {need / 1e9:.1f} GB ({BYTES_PER_SAMPLE} "
                f"bytes each); {free / 1e9:.1f} GB are free, and a log may take {MEMORY_SHARE:.0%}"
            )
            raise InputError(
                str(self.path),
                "size",
                problem,
                "cut the log into shorter ones or thin its rows out",
            )
