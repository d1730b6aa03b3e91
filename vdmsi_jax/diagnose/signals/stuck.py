"""A speed that stays the same, to the last digit, while the pose says that the vehicle moves
otherwise: of a wheel sensor below its least speed, or of one that hangs."""

from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise

import numpy as np
from jaxtyping import Float

from ...data.record import Record
from .contradictions import Contradiction

_ROWS, _SECONDS, _LONGEST = 5, 0.4, 3.0  # samples and seconds that a speed stays the same, at the
# least, to be asked, and seconds over which noisy places are looked at, at the most
_MESSAGES = 5  # of a pose that is held between them, over which its speed is told, at the least
_OFF = 0.15  # of the largest speed, by which the pose moves otherwise
_NOISES = 6.0  # standard deviations of how far two noisy places are apart, likewise
_SHARE = 0.02  # of the samples, from which on they are no accident


def without_stuck_speed(records: Sequence[Record]) -> tuple[list[Record], list[Contradiction]]:
    """The records with such samples of the speed filled in, by how fast the pose moves, and marked
    as not measured; and what there is to say. Nothing changes where they are few."""
    if not all(name in record for record in records for name in ("v", "x", "y")):
        return list(records), []
    stuck = [_stuck(record) for record in records]
    many = sum(last - first for own in stuck for first, last, _ in own)
    share = many / sum(record.n for record in records)
    if share <= _SHARE:
        return list(records), []
    at = {float(r["v"][i]) for r, own in zip(records, stuck, strict=True) for i, _, _ in own}
    speeds = [moved for own in stuck for _, _, moved in own]
    mended = []
    for record, own in zip(records, stuck, strict=True):
        v, missing = record["v"].copy(), ~record.measured("v")
        if at == {0.0}:  # says so whenever it is slow
            missing |= v == 0.0
        for first, last, moved in own:
            v[first:last], missing[first:last] = moved, True
        channels, filled = {**record.channels, "v": v}, {**record.filled, "v": missing}
        mended.append(replace(record, channels=channels, filled=filled))
    stays = "0" if at == {0.0} else "the same"
    left = "all samples of 0" if at == {0.0} else "those"
    said = (
        f"v says {stays} to the last digit in {100.0 * share:.0f} % of the samples, while the pose "
        f"moves at {np.median(np.abs(speeds)):.2g} m/s there: {left} were left out of v."
    )
    return mended, [Contradiction("v", ("x", "y"), (), said)]


def _stuck(record: Record) -> list[tuple[int, int, float]]:
    """First sample, and the one after the last, of each stretch, and the speed of its pose, m/s."""
    v, asked = record["v"], record.measured("v")
    off = _OFF * float(np.abs(v).max())
    noise = float(np.nan_to_num(np.hypot(record.noise_std("x"), record.noise_std("y"))))
    seconds = float(np.clip(_NOISES * noise / max(off, 1e-9), _SECONDS, _LONGEST))
    width = max(_ROWS, round(seconds / record.dt), _MESSAGES * _held(record))
    seconds = width * record.dt
    off = max(off, _NOISES * noise / seconds)
    places = np.stack([record["x"], record["y"]])
    places = np.where(record.measured("x") & record.measured("y"), places, np.nan)
    found = []
    for segment in record.segments:
        edges = np.flatnonzero(np.diff(v[segment.samples], prepend=np.nan, append=np.nan) != 0.0)
        for first, last in pairwise((edges + segment.start).tolist()):
            if last - first <= width or not asked[first:last].all():
                continue
            ways = np.hypot(*np.diff(places[:, first:last:width], axis=1))
            ways = ways[np.isfinite(ways)]
            speed = float(np.median(ways)) / seconds if ways.size else np.nan
            more = speed - abs(v[first])
            if more > off or (more < -off and seconds < 1.25 * _SECONDS):  # a long chord is no arc
                found.append((first, last, float(np.copysign(speed, _way(v, first)))))
    return found


def _held(record: Record) -> int:
    """For how many samples a pose stays the same while the vehicle moves, as one does that was
    logged more often than it was measured."""
    moves = np.hypot(np.diff(record["x"]), np.diff(record["y"])) > 0.0
    apart = np.diff(np.flatnonzero(moves))
    return int(np.median(apart)) if apart.size else 1


def _way(v: Float[np.ndarray, " n"], first: int) -> float:
    """Which way the vehicle goes in a stretch: as it went before."""
    before = v[:first][v[:first] != 0.0]
    return float(before[-1]) if before.size else 1.0
