"""Parameters of effects: scalars with a value that switches the effect off, exactly; and numbers as
arrays."""

import dataclasses
import inspect
import math
from collections.abc import Iterable, Mapping
from typing import Any

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array


def floats(x: Any) -> Array:
    """Numbers as JAX's own floats: whole ones would have no derivative, and those of Python, which
    are weakly typed, would compile anew."""
    return jnp.asarray(x, float)


@dataclasses.dataclass(frozen=True)
class Parameter:
    """What is known of a parameter beside its value.

    Attributes:
        unit: its unit; `command` and `response` stand for the units of the plant's two channels,
            `1/command` for an inverse one, and so on.
        doc: what it means.
        off: the value at which the effect is exactly the identity.
        lower, upper: bounds of a fit; an open one where a signed continuation has a meaning, so
            that "off" lies inside and a wrong sign refutes the cause.
        spread: standard deviation about off that it is believed to have before any data are seen;
            infinite where nothing is.
        shown: what a report tells instead of the value, where that is its inverse (a limit is
            fitted as 1/limit, since the limit itself is infinite when it is off).
    """

    unit: str
    doc: str
    off: float | tuple[float, ...] = 0.0
    lower: float = -math.inf
    upper: float = math.inf
    spread: float = math.inf
    shown: str = "value"

    def tell(self, value: float, std: float) -> tuple[float, float]:
        """Value and standard deviation as they are told."""
        if self.shown != "inverse":
            return value, std
        if value == 0.0:
            return math.inf, math.inf
        return 1.0 / value, std / value**2

    def describe(self, name: str) -> str:
        """A line for the docstring of an effect that has it."""
        sizes = sorted(set(self.off)) if isinstance(self.off, tuple) else [self.off]
        off = ", ".join(f"{size:g}" for size in sizes)
        inverse = "; `of` takes the limit itself" if self.shown == "inverse" else ""
        return f"{name} ({self.unit}): {self.doc}, {off} by default{inverse}."


def parameter(unit: str, doc: str, **more: Any) -> Any:
    """A field of an effect that is a parameter; its default is "off"."""
    known = Parameter(unit, doc, **more)
    return eqx.field(
        default_factory=lambda: jnp.asarray(known.off, float),
        converter=lambda value: jnp.asarray(value, float),
        metadata={"parameter": known},
    )


def parameters(effect: Any) -> dict[str, Parameter]:
    """The parameters of an effect (or of its class) by name, in the order of its fields."""
    return {
        field.name: field.metadata["parameter"]
        for field in dataclasses.fields(effect)
        if "parameter" in field.metadata
    }


def described(doc: str, fields: Mapping[str, Any]) -> str:
    """The docstring of an effect with a line for each of its parameters at the head of its
    attributes."""
    text = inspect.cleandoc(doc)
    known = {name: field.metadata.get("parameter") for name, field in fields.items()}
    lines = [f"    {own.describe(name)}" for name, own in known.items() if own is not None]
    if not lines:
        return text
    told = "\n".join(["Attributes:", *lines])
    head, attributes, tail = text.partition("Attributes:")
    return f"{head}{told}{tail}" if attributes else f"{text}\n\n{told}"


def with_values(effect: Any, values: Iterable[Any]) -> Any:
    """An effect with other values of its parameters, in the order of its fields."""
    for name, value in zip(parameters(effect), values, strict=True):
        effect = eqx.tree_at(lambda e, name=name: getattr(e, name), effect, value)
    return effect
