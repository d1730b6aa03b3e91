"""NPZ files (`numpy.savez`) as tables. Objects in them are never unpickled."""

import zipfile
import zlib
from collections.abc import Collection
from pathlib import Path

import numpy as np

from ..errors import InputError
from .array_table import equal_columns
from .table import Table

_DAMAGED = (zipfile.BadZipFile, zlib.error, EOFError, OSError)
_ENCRYPTED = (RuntimeError, NotImplementedError)  # by a password, or packed in an unusual way


class NpzTable(Table):
    """An NPZ file of one-dimensional arrays.

    Raises:
        InputError: it is no NPZ file, or too large for the memory.
    """

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
        except (*_DAMAGED, *_ENCRYPTED, ValueError) as error:
            mend = "save it with numpy.savez(path, t=..., v=...)"
            raise InputError(str(path), "", f"is no NPZ file ({error})", mend) from None
        self._shapes = shapes
        self.names = list(shapes)
        self.rows = max((int(np.prod(shape)) for shape in shapes.values()), default=0)
        self.refuse_if_too_large()

    def read(self, *, numbers: Collection[str], texts: Collection[str]) -> dict[str, np.ndarray]:
        with np.load(self.path, allow_pickle=False) as archive:

            def load(name: str) -> np.ndarray:
                try:
                    return archive[name]  # reads the file
                except (*_DAMAGED, *_ENCRYPTED) as error:
                    problem = f"is damaged, or was not written by NumPy ({error})"
                    mend = "save it anew with numpy.savez(path, t=..., v=...)"
                    raise InputError(str(self.path), f"array {name!r}", problem, mend) from None

            columns = equal_columns(load, str(self.path), numbers, texts)
        self.rows = next(iter(columns.values())).size
        return columns

    def line(self, row: int) -> str:
        return f"sample {row}"
