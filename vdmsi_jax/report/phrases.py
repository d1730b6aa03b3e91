"""Sizes, shares and gains as a report says them."""

import math

from ..diagnose.answer.result import Gain
from ..plots.style import pretty_unit
from .text import number


def with_unit(value: float, unit: str, digits: int = 4) -> str:
    """A number and its unit; a dash for what is not there."""
    shown = number(value, digits)
    return shown if shown == "–" or unit in ("", "1") else f"{shown} {pretty_unit(unit)}"


def metres(value: float) -> str:
    """A length with three significant digits, zeros among them."""
    if 1e-3 < abs(value) < 1e3:
        return f"{value:#.3g}".rstrip(".") + " m"
    return with_unit(value, "m", 3)


def share(value: float) -> str:
    """A part of one, in percent."""
    return f"{100.0 * value:.1f} %".replace("-", "−") if math.isfinite(value) else "–"


def points(gain: Gain, error: bool = True) -> str:
    """How much FIT a cause is worth, with its standard error where that is known."""
    rise = f"{gain.after - gain.before:+.2f}".replace("-", "−")
    return rise + (f" ± {number(gain.se, 2)}" if error and math.isfinite(gain.se) else "")


def capital(text: str) -> str:
    """With a capital letter at its beginning."""
    return text[:1].upper() + text[1:]


def ended(text: str) -> str:
    """With a full stop at its end."""
    return text if text.endswith((".", "!", "?")) else f"{text}."
