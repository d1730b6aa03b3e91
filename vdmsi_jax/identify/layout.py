"""Samples of one input-output pair laid out for compiled code: blocks, segments, scaled units."""

from dataclasses import dataclass

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int
from numpy.typing import NDArray

from vdmsi_jax.config import PlantSpec
from vdmsi_jax.data.record import Record
from vdmsi_jax.identify.result import Floats

_BLOCK = 128  # sums over blocks of this size stay in the cache


class Samples(eqx.Module):
    """One input-output pair on a uniform time base, in normalised units.

    Segments stand one behind the other, each padded to whole blocks, so that sums over a segment
    are sums over its blocks and a log of any number of gaps costs no more than its samples.

    **Attributes:** (`k` blocks of `m` samples)

    - `u`, `y` `(k, m)`: input and output, divided by their scales.
    - `weight` `(k, m)`: 1 where a sample has a say, 0 elsewhere and for padding.
    - `first` `(k,)`: which blocks begin a segment.
    - `origin` `(k,)`: flat index of the first sample of the segment that a block belongs to.
    - `segment` `(k,)`: number of that segment.
    - `dt`: sampling period in units of the scale of time.
    - `longest`: number of samples of the longest segment.
    """

    u: Float[Array, "k m"]
    y: Float[Array, "k m"]
    weight: Float[Array, "k m"]
    first: Bool[Array, " k"]
    origin: Int[Array, " k"]
    segment: Int[Array, " k"]
    dt: Float[Array, ""]
    longest: Float[Array, ""]
    n_segments: int = eqx.field(static=True)


@dataclass(frozen=True)
class Scale:
    """What input, output (in their units) and time (in s) are divided by.

    Time is scaled so that the poles of interest are of order one; the output so that its deviation,
    summed over the record, is one.
    """

    u: float
    y: float
    time: float
    dt: float

    def to_units(self, n: int, m: int) -> Floats:
        """Factors from scaled parameters (b, a descending, delay, offset) to units."""
        b = self.y / self.u * self.time ** (np.arange(m, -1, -1) - float(n))
        a = self.time ** (np.arange(n - 1, -1, -1) - float(n))
        return np.concatenate([b, a, [self.dt, self.y]])


def lay_out(
    record: Record, plant: PlantSpec, scale: Scale, counts: NDArray[np.bool_]
) -> tuple[Samples, NDArray[np.int64]]:
    """Lay out a record for the compiled programs of this package; `counts` (n,) tells the samples
    that have a say.

    **Returns:** the samples, and for each the index `(k, m)` in the record (-1 for padding).
    """
    indices = [np.arange(segment.start, segment.stop) for segment in record.segments]
    blocks = np.array([-(-len(index) // _BLOCK) for index in indices])
    total = _rounded(int(blocks.sum()))
    blocks[-1] += total - blocks.sum()
    where = np.full((total, _BLOCK), -1)
    begin = np.cumsum(blocks) - blocks
    for at, index in zip(begin, indices, strict=True):
        where.reshape(-1)[at * _BLOCK : at * _BLOCK + len(index)] = index

    def gather(channel: str, by: float) -> Array:
        return jnp.asarray(np.where(where < 0, 0.0, record[channel][where] / by))

    samples = Samples(
        u=gather(plant.input, scale.u),
        y=gather(plant.output, scale.y),
        weight=jnp.asarray(((where >= 0) & counts[where]).astype(float)),
        first=jnp.asarray(np.isin(np.arange(total), begin)),
        origin=jnp.asarray(np.repeat(begin * _BLOCK, blocks)),
        segment=jnp.asarray(np.repeat(np.arange(len(indices)), blocks)),
        dt=jnp.asarray(record.dt / scale.time),
        longest=jnp.asarray(float(max(len(index) for index in indices))),
        n_segments=_rounded(len(indices)),
    )
    return samples, where


def _rounded(count: int) -> int:
    """The next of a few sizes, at most an eighth larger, so that logs share compiled programs."""
    step = 1 << max(count.bit_length() - 4, 0)
    return -(-count // step) * step
