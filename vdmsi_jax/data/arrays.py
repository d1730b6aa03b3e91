"""What arrays have to be to become channels of a record."""

from collections.abc import Mapping
from typing import Any

import numpy as np
from jaxtyping import Float

from ..errors import InputError
from ..units import si_symbol
from .magnitude import refuse_absurd

_IN_SI = "in SI, or a mapping with t and arrays to read_log, whose configuration has [units]"


def as_channels(name: str, given: Mapping[str, Any]) -> dict[str, Float[np.ndarray, " N"]]:
    """Arrays of the record `name` as float64.

    Raises:
        InputError: there is none, one is not one-dimensional, or holds what is no finite number,
            lengths differ, or there are less than two samples.
    """
    if not given:
        mend = "give arrays by name, such as v_cmd=..., v=..."
        raise InputError(name, "channels", "there are none", mend)
    arrays = {key: _as_numbers(name, key, values) for key, values in given.items()}
    first, n = next((key, values.size) for key, values in arrays.items())
    for key, values in arrays.items():
        if values.ndim != 1:
            problem = f"has the shape {values.shape}"
            raise InputError(name, key, problem, "give a one-dimensional array")
        if values.size != n:
            problem = f"has {values.size} samples, {first} has {n}"
            raise InputError(name, key, problem, "give equal lengths")
        if not np.isfinite(values).all():
            bad = int(np.flatnonzero(~np.isfinite(values))[0])
            place, problem = f"{key}, sample {bad}", f"{values[bad]} is not finite"
            mend = "repair it, or cut it out, as read_log does of a mapping with t and arrays"
            raise InputError(name, place, problem, mend)
        refuse_absurd(name, key, values)
    if n < 2:
        raise InputError(name, "channels", f"there are {n} samples", "give at least two")
    return arrays


def as_period(name: str, dt: Any) -> float:
    """A sample period of the record `name`, s; an array with one number is one, too.

    Raises:
        InputError: it is no number, or not more than zero.
    """
    try:
        period = float(np.asarray(dt, dtype=np.float64).item())
    except (TypeError, ValueError):
        period = np.nan
    if isinstance(dt, str) or not (np.isfinite(period) and period > 0.0):
        problem, mend = f"{dt!r} is no sample period", "give seconds, more than zero"
        raise InputError(name, "dt", problem, mend)
    return period


def si_units(
    name: str, arrays: Mapping[str, Any], canonical: Mapping[str, str], given: Mapping[str, str]
) -> dict[str, str]:
    """The SI unit of each channel of the record `name`.

    Args:
        name: of the record.
        arrays: its channels.
        canonical: what some of them measure.
        given: units of the others; 1 if none is given.

    Raises:
        InputError: another unit is given for a canonical one.
    """
    si = {key: given.get(key, "1") for key in arrays}
    si |= {key: si_symbol(quantity) for key, quantity in canonical.items() if key in arrays}
    for key, unit in given.items():
        if unit != si.get(key, unit):
            raise InputError(name, f"units {key}", f"{unit} is not {si[key]}", f"give it {_IN_SI}")
    return si


def _as_numbers(name: str, key: str, values: Any) -> np.ndarray:
    array = np.asarray(values)
    if np.iscomplexobj(array):
        mend = "give its real and imaginary part as channels of their own"
        raise InputError(name, key, "is complex", mend)
    try:
        return np.asarray(array, dtype=np.float64)
    except (TypeError, ValueError) as why:
        raise InputError(name, key, f"holds what is no number ({why})", "give numbers") from None
