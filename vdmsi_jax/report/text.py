"""Numbers, units and formulas as a reader expects them."""

import math
import re
from html import escape

import numpy as np

from ..units import superscript


def number(value: float, digits: int = 4) -> str:
    """`digits` significant ones, without trailing noise; a dash for what is not there."""
    if value is None or not math.isfinite(value):
        return "–"
    text = f"{value:.{digits}g}"
    if "e" in text:
        mantissa, exponent = text.split("e")
        text = f"{mantissa}·10{superscript(int(exponent))}"
    return text.replace("-", "−")


def typeset(text: str) -> str:
    """A sentence of a result with its powers raised: `2.7e-05 s^2/m^2` is `2.7·10⁻⁵ s²/m²`."""
    text = re.sub(r"(?<=\d)e([+-]\d+)", lambda e: f"·10{superscript(int(e[1]))}", text)
    return re.sub(r"\^(\d)", lambda power: superscript(int(power[1])), text)


def percent(value: float) -> str:
    """A FIT with two decimals."""
    return f"{value:.2f} %".replace("-", "−") if math.isfinite(value) else "–"


def root(value: complex) -> str:
    """A pole or zero; of a conjugate pair, both."""
    if abs(value.imag) < 1e-9 * max(abs(value), 1e-12):
        return number(value.real)
    return f"{number(value.real)} ± {number(abs(value.imag))}j"


def roots(values: np.ndarray) -> str:
    """All poles or zeros, each conjugate pair once, the slowest first."""
    upper = [v for v in values if v.imag >= 0.0]
    return ", ".join(root(v) for v in sorted(upper, key=abs)) or "none"


def polynomial(coefficients: np.ndarray) -> str:
    """HTML of a polynomial in s, descending powers."""
    degree, text = len(coefficients) - 1, ""
    for k, value in enumerate(coefficients):
        power = degree - k
        sign = ("−" if value < 0 else "") if not text else (" − " if value < 0 else " + ")
        size = "" if abs(value) == 1.0 and power else escape(number(abs(value)))
        letter = "" if power == 0 else "<i>s</i>" + (f"<sup>{power}</sup>" if power > 1 else "")
        text += sign + size + ("&thinsp;" if size and letter else "") + letter
    return text
