"""Quantised measurements: values that all lie on a lattice."""

import numpy as np
from jaxtyping import Float

FEWEST = 4
"""Distinct values, below which they lie on some lattice anyway."""

_FEWER = 0.35  # distinct values per sample, above which there is no lattice to speak of
_OFF = 0.05  # of a step, that a value may lie off the lattice


def lattice_step(values: Float[np.ndarray, " N"]) -> float | None:
    """The step of the lattice on which the values lie; None if they lie on none.

    Values that are merely written with few digits lie on one, too: whether the step matters is for
    the caller to judge, by the noise.
    """
    distinct = np.unique(values)
    if not FEWEST <= distinct.size <= _FEWER * values.size:
        return None
    gaps = np.diff(distinct)
    gaps = gaps[gaps > 1e-9 * np.ptp(distinct)]  # what rounding in the file has split
    if gaps.size < 3:
        return None
    step = float(np.median(gaps[gaps < 1.5 * np.quantile(gaps, 0.2)]))
    for _ in range(3):
        number = np.round((distinct - distinct[0]) / step)
        slope, start = np.polyfit(number, distinct, 1)
        step = float(slope)
    off = np.abs(distinct - start - number * step) / step
    return step if np.quantile(off, 0.98) < _OFF else None
