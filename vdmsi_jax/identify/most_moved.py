"""Of a long log the stretches that tell most of a plant: those in which its command moves most."""

import numpy as np
from numpy.typing import NDArray

from vdmsi_jax.config import PlantSpec
from vdmsi_jax.data.record import Record
from vdmsi_jax.data.segment import Segment

_STRETCH = 2000  # samples


def most_moved(record: Record, plant: PlantSpec, most: int) -> tuple[Record, NDArray[np.int64]]:
    """Stretches of a record with about `most` samples in all, in their order, and their indices;
    the record itself where it has no more.

    Long stretches are taken where the whole is long, so that what is slow still shows in each.
    """
    if record.n <= most:
        return record, np.arange(record.n)
    length = max(_STRETCH, most // 50)
    stretches = [
        Segment(start, min(start + length, own.stop), own.run)
        for own in record.segments
        for start in range(own.start, own.stop, length)
    ]
    u = record[plant.input]
    moved = [float(np.var(u[part.samples])) * len(part) for part in stretches]
    chosen, total = [], 0
    for k in np.argsort(moved)[::-1]:
        if total + len(stretches[k]) > most and chosen:
            break
        chosen.append(stretches[k])
        total += len(stretches[k])
    chosen.sort(key=lambda part: part.start)
    index = np.concatenate([np.arange(part.start, part.stop) for part in chosen])
    return record.select(chosen), index
