"""`Segment`, a stretch of a record without a gap, and how segments are parted for training and for
judging."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

from ..errors import InputError

_SHORTEST_BLOCK = 50  # samples, below which a held-out block says too little


@dataclass(frozen=True)
class Segment:
    """A stretch of a record that is evenly sampled and without a gap.

    Attributes:
        start: index of its first sample.
        stop: index after its last sample.
        run: the run that it belongs to; runs start anew, segments of one run are parted by gaps
            only.
    """

    start: int
    stop: int
    run: str = ""

    def __len__(self) -> int:
        return max(self.stop - self.start, 0)

    @property
    def samples(self) -> slice:
        """Its place in the arrays of the record."""
        return slice(self.start, self.stop)


def split_blocks(
    segments: Sequence[Segment], held_out: float, blocks: int, name: str
) -> tuple[list[Segment], list[Segment]]:
    """Cut each segment in equal parts and hold out the end of each.

    Args:
        segments: what to part.
        held_out: share that is held out.
        blocks: parts of a segment; fewer where a held-out block would have less than 50 samples,
            and none where not even one would.
        name: of the record, for the error.

    Returns:
        What may be seen, and what is held out.

    Raises:
        InputError: no segment is long enough to hold out a block.
    """
    seen, hidden = [], []
    for segment in segments:
        parts = min(blocks, int(len(segment) * held_out) // _SHORTEST_BLOCK)
        if parts == 0:
            seen.append(segment)
        for part in range(parts):
            start = segment.start + len(segment) * part // parts
            stop = segment.start + len(segment) * (part + 1) // parts
            cut = stop - round(held_out * (stop - start))
            seen.append(Segment(start, cut, segment.run))
            hidden.append(Segment(cut, stop, segment.run))
    if not hidden:
        need = math.ceil(_SHORTEST_BLOCK / held_out)
        problem = f"no segment has the {need} samples to hold out a block of {held_out:g}"
        mend = "give a longer log, or set [identify] held_out = 0"
        raise InputError(name, "held_out", problem, mend)
    if not any(map(len, seen)):
        problem = f"a share of {held_out:g} leaves nothing to fit"
        raise InputError(name, "held_out", problem, "set a smaller [identify] held_out")
    return seen, hidden


def split_runs(
    segments: Sequence[Segment], held_out: float, name: str
) -> tuple[list[Segment], list[Segment]]:
    """Hold out whole runs, spread evenly, the last one among them; at least one, and never all.

    Args:
        segments: what to part.
        held_out: share of the runs that is held out.
        name: of the record, for the error.

    Returns:
        What may be seen, and what is held out.

    Raises:
        InputError: there is only one run.
    """
    runs = list(dict.fromkeys(segment.run for segment in segments))
    if len(runs) < 2:
        mend = 'split by "blocks", or give more logs'
        raise InputError(name, "split", "there is only one run", mend)
    count = min(max(round(held_out * len(runs)), 1), len(runs) - 1)
    chosen = {runs[(k + 1) * len(runs) // count - 1] for k in range(count)}
    hidden = [segment for segment in segments if segment.run in chosen]
    return [segment for segment in segments if segment.run not in chosen], hidden
