"""Logs of one session: what ages or breaks in one of them stays so in those that follow."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from .record import Record

_APART = 10.0  # times all that was driven, beyond which clocks tell of several sessions


def in_session(records: Sequence[Record]) -> list[Record]:
    """The records, told when in the session each of them began: by their own clocks where those go
    on from one to the next, else one after another as they are given."""
    if len(records) < 2:
        return list(records)
    first = np.array([float(r.t[0]) for r in records])
    last = np.array([float(r.t[-1]) for r in records])
    driven = np.array([r.duration for r in records])
    goes_on = bool(np.all(first[1:] > last[:-1])) and last[-1] - first[0] < _APART * driven.sum()
    begun = first - first[0] if goes_on else np.cumsum(driven) - driven
    return [replace(r, session=float(t)) for r, t in zip(records, begun, strict=True)]
