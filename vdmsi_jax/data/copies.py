"""Logs that were given twice."""

from collections.abc import Sequence

import numpy as np

from .record import Record


def without_copies(records: Sequence[Record]) -> tuple[list[Record], list[str]]:
    """The records without copies, whose noise is no noise beside their originals' and which teach
    nothing that those do not, and what is left out."""
    kept: list[Record] = []
    told = []
    for record in records:
        same = next((other for other in kept if _same(record, other)), None)
        if same is None:
            kept.append(record)
        else:
            told.append(f"{record.log} holds what {same.log} holds and was left out.")
    return kept, told


def _same(one: Record, other: Record) -> bool:
    """Whether two records hold the same numbers."""
    alike = one.n == other.n and one.channels.keys() == other.channels.keys()
    return alike and all(np.array_equal(one[c], other[c]) for c in one.channels)
