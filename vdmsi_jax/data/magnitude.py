"""Numbers that nothing measures: so large or so small that their squares leave double precision."""

import numpy as np
from jaxtyping import Float

from ..errors import InputError

_LARGEST, _SMALLEST = 1e50, 1e-50


def refuse_absurd(source: str, channel: str, values: Float[np.ndarray, " _"]) -> None:
    """Refuse a channel whose numbers are of a size that no unit makes sensible; gaps (NaN) pass.

    Raises:
        InputError: a number is beyond 1e50, or all that are not zero are within 1e-50.
    """
    sizes = np.abs(values[np.isfinite(values)])
    largest = float(sizes.max(initial=0.0))
    mend = "check its unit, and leave cells empty where nothing was measured"
    if largest > _LARGEST:
        problem = f"{largest:.3g} is larger than anything that is measured"
        raise InputError(source, channel, problem, mend)
    if 0.0 < largest < _SMALLEST:
        problem = f"no number in it is larger than {largest:.3g}"
        raise InputError(source, channel, problem, mend)
