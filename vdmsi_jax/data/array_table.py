"""Named arrays in memory as tables: a mapping of them, or the columns of a data frame."""

from collections.abc import Callable, Collection, Iterable, Mapping
from pathlib import Path
from typing import Any, Protocol, runtime_checkable

import numpy as np
from numpy.typing import ArrayLike

from ..errors import InputError
from .table import Table


@runtime_checkable
class Frame(Protocol):
    """A data frame, of pandas or of another library: it has columns by their names."""

    @property
    def columns(self) -> Iterable[Any]: ...

    def __getitem__(self, name: Any, /) -> Any: ...


Arrays = Mapping[str, ArrayLike] | Frame
"""A log in memory."""


class ArrayTable(Table):
    """One-dimensional arrays by name. Of a frame its columns count, not its index.

    Args:
        arrays: a mapping, such as a dictionary or what `numpy.load` makes of an NPZ file, or a
            frame.
        name: what errors call them.

    Raises:
        InputError: it is neither.
    """

    def __init__(self, arrays: Any, name: str):
        if not isinstance(arrays, Mapping | Frame):
            problem = f"a {type(arrays).__name__} is no log"
            raise InputError(name, "", problem, "give a file, a mapping of arrays or a data frame")
        self.path = Path(name)
        names = arrays if isinstance(arrays, Mapping) else arrays.columns
        self._arrays, self._keys = arrays, {str(key): key for key in names}
        self.names, self.rows = list(self._keys), 0

    def read(self, *, numbers: Collection[str], texts: Collection[str]) -> dict[str, np.ndarray]:
        def load(name: str) -> np.ndarray:
            return np.asarray(self._arrays[self._keys[name]])

        columns = equal_columns(load, str(self.path), numbers, texts)
        self.rows = next(iter(columns.values())).size
        return columns

    def line(self, row: int) -> str:
        return f"sample {row}"


def equal_columns(
    load: Callable[[str], np.ndarray], source: str, numbers: Collection[str], texts: Collection[str]
) -> dict[str, np.ndarray]:
    """Arrays as columns of one length: `numbers` as float64, `texts` as strings.

    Args:
        load: name -> array.
        source: what errors call the log.
        numbers, texts: names of the arrays.

    Raises:
        InputError: an array is of other things than numbers, is not one-dimensional, or is of
            another length than the others.
    """
    columns = {}
    for name in (*numbers, *texts):
        place = f"array {name!r}"
        try:
            values = load(name)
            if np.iscomplexobj(values):
                raise TypeError("they are complex")
            if name in numbers and values.dtype.kind in "mM":
                raise TypeError("they are dates")
            columns[name] = values.astype(np.float64 if name in numbers else str)
        except InputError:
            raise
        except (ValueError, TypeError) as error:
            problem = f"cannot be read as numbers ({error})"
            raise InputError(source, place, problem, "save plain numbers") from None
        if columns[name].ndim != 1:
            problem = f"has the shape {columns[name].shape}"
            raise InputError(source, place, problem, "save one-dimensional arrays")
    first = next(iter(columns))
    for name, values in columns.items():
        if values.size != columns[first].size:
            problem = f"has {values.size} samples, {first!r} has {columns[first].size}"
            raise InputError(source, f"array {name!r}", problem, "save arrays of equal length")
    return columns
