"""Units: what a user may write in a configuration, and its factor to SI. Nothing below `data/`
knows any but SI."""

import math
import re
from typing import NamedTuple

from .errors import InputError, nearest


class Unit(NamedTuple):
    """A unit: the quantity that it measures and the number of SI units that one of it makes."""

    quantity: str
    to_si: float


STANDARD_GRAVITY = 9.80665
"""Standard acceleration of free fall, m/s² (CGPM 1901)."""

SI_SYMBOL = {
    "time": "s",
    "length": "m",
    "angle": "rad",
    "speed": "m/s",
    "angular rate": "rad/s",
    "acceleration": "m/s^2",
    "curvature": "1/m",
    "voltage": "V",
    "current": "A",
    "force": "N",
    "torque": "N*m",
    "pressure": "Pa",
    "temperature": "K",
    "pure number": "1",
}
"""The SI unit of every quantity."""

UNITS = {
    "s": Unit("time", 1.0),
    "ms": Unit("time", 1e-3),
    "us": Unit("time", 1e-6),
    "ns": Unit("time", 1e-9),
    "min": Unit("time", 60.0),
    "h": Unit("time", 3600.0),
    "m": Unit("length", 1.0),
    "cm": Unit("length", 1e-2),
    "mm": Unit("length", 1e-3),
    "km": Unit("length", 1e3),
    "rad": Unit("angle", 1.0),
    "mrad": Unit("angle", 1e-3),
    "deg": Unit("angle", math.pi / 180.0),
    "m/s": Unit("speed", 1.0),
    "cm/s": Unit("speed", 1e-2),
    "mm/s": Unit("speed", 1e-3),
    "km/h": Unit("speed", 1.0 / 3.6),
    "mph": Unit("speed", 0.44704),
    "rad/s": Unit("angular rate", 1.0),
    "mrad/s": Unit("angular rate", 1e-3),
    "deg/s": Unit("angular rate", math.pi / 180.0),
    "rpm": Unit("angular rate", math.pi / 30.0),
    "m/s^2": Unit("acceleration", 1.0),
    "g": Unit("acceleration", STANDARD_GRAVITY),
    "mg": Unit("acceleration", STANDARD_GRAVITY * 1e-3),
    "1/m": Unit("curvature", 1.0),
    "1/km": Unit("curvature", 1e-3),
    "V": Unit("voltage", 1.0),
    "mV": Unit("voltage", 1e-3),
    "A": Unit("current", 1.0),
    "mA": Unit("current", 1e-3),
    "N": Unit("force", 1.0),
    "N*m": Unit("torque", 1.0),
    "Pa": Unit("pressure", 1.0),
    "bar": Unit("pressure", 1e5),
    "K": Unit("temperature", 1.0),
    "1": Unit("pure number", 1.0),
    "%": Unit("pure number", 1e-2),
}
"""Every unit that a configuration may name."""

_SPELLINGS = {
    "m/s²": "m/s^2",
    "m/s2": "m/s^2",
    "m/s**2": "m/s^2",
    "kmh": "km/h",
    "kph": "km/h",
    "µs": "us",
    "°": "deg",
}
_SPELLINGS |= {
    "°/s": "deg/s",
    "degrees": "deg",
    "radians": "rad",
    "-": "1",
    "": "1",
    "Nm": "N*m",
    "1/min": "rpm",
}


def unit(name: str, *, source: str, place: str, quantities: tuple[str, ...] = ()) -> Unit:
    """Look a unit up.

    Args:
        name: as the user wrote it; usual other spellings (`m/s²`, `kmh`, `°`) are understood.
        source: the file that named it, for the error.
        place: the key that named it, for the error.
        quantities: the quantities that make sense there; any, if empty.

    Raises:
        InputError: there is no such unit, or it measures another quantity.
    """
    found = UNITS.get(_SPELLINGS.get(name, name))
    fitting = {
        word for word, known in UNITS.items() if not quantities or known.quantity in quantities
    }
    if found is None:
        raise InputError(source, place, f"unknown unit {name!r}", nearest(name, fitting, limit=40))
    if quantities and found.quantity not in quantities:
        wanted = " or ".join(quantities)
        raise InputError(
            source,
            place,
            f"wrong unit: {name!r} is of {found.quantity}, not of {wanted}",
            nearest(name, fitting),
        )
    return found


def bracketed(name: str) -> tuple[str, str] | None:
    """What stands before and in the brackets of a column such as `v [m/s]` or `v (m/s)`; None where
    there are none."""
    found = re.fullmatch(r"([^\[(]*\S)\s*(?:\[(.*)\]|\((.*)\))", name.strip())
    return None if found is None else (found[1], (found[2] or found[3] or "").strip())


def si_symbol(quantity: str) -> str:
    """The SI unit of a quantity, such as `rad/s` for `angular rate`."""
    return SI_SYMBOL[quantity]


def superscript(power: int) -> str:
    """A power of ten's exponent, such as `⁻³`."""
    return str(power).translate(str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹"))
