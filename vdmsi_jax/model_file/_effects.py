"""Effects as JSON: their cause, form, parameters and constants, looked up in the registry."""

import dataclasses
import math
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from ..effects import AbstractEffect
from ..errors import InputError, nearest
from ..parameters import parameters

Registry = tuple[AbstractEffect, ...]


def documents(
    effects: Sequence[AbstractEffect],
    registry: Registry,
    name: str,
    channels: Sequence[str] | None = None,
) -> list[dict[str, Any]]:
    """Effects as a file holds them.

    Args:
        effects: to be written.
        registry: where they will be looked up; `name` is what it is called.
        channels: that they act on, where they are sensors'.

    Raises:
        ValueError: an effect is none of the registry's, or they do not stand in its order, in which
            they would be read.
    """
    kinds = [_kind(known) for known in registry]
    for effect in effects:
        if _kind(effect) not in kinds:
            problem = f"{type(effect).__name__} is none of vdmsi_jax.effects.{name}"
            raise ValueError(f"{problem}, and could not be read again; add it there")
    if in_order(effects, registry, channels) != list(range(len(effects))):
        what = "effects" if channels is None else "effects of each channel one after another,"
        raise ValueError(f"give the {what} in the order of vdmsi_jax.effects.{name}")
    told = [_document(effect) for effect in effects]
    if channels is None:
        return told
    return [{"channel": c, **effect} for c, effect in zip(channels, told, strict=True)]


def all_made(
    entries: Sequence["EffectEntry"],
    registry: Registry,
    place: str,
    channels: Collection[str] | None = None,
) -> list[AbstractEffect]:
    """The effects that a file tells, in the order in which they are told.

    Args:
        entries: as they were read.
        registry: where they are looked up.
        place: where they stand in the file.
        channels: that sensors may measure; `None` where the effects are no sensors'.

    Raises:
        InputError: an entry is no effect of the registry.
    """
    made = []
    for i, entry in enumerate(entries):
        at = f"{place} {i + 1}"
        made.append(entry.made(registry, at))
        if channels is None and entry.channel is not None:
            mend = "leave it out, or give the effect under sensors"
            raise InputError("", f"{at} channel", "only a sensor has a channel", mend)
        if channels is not None and entry.channel not in channels:
            given = "missing" if entry.channel is None else f"nothing measures {entry.channel!r}"
            raise InputError("", f"{at} channel", given, nearest(str(entry.channel), channels))
    return made


def in_order(
    effects: Sequence[AbstractEffect], registry: Registry, channels: Sequence[str] | None = None
) -> list[int]:
    """Numbers of the effects in the order in which they act, channel by channel."""
    kinds = [_kind(known) for known in registry]
    groups = [""] * len(effects) if channels is None else list(channels)
    return sorted(
        range(len(effects)),
        key=lambda i: (groups.index(groups[i]), kinds.index(_kind(effects[i]))),
    )


def _document(effect: AbstractEffect) -> dict[str, Any]:
    document: dict[str, Any] = {
        "cause": effect.cause,
        "parameters": {name: getattr(effect, name) for name in parameters(effect)},
    }
    more = {"form": _form(effect), "constants": {n: getattr(effect, n) for n in _constants(effect)}}
    return document | {key: value for key, value in more.items() if value}


def _form(effect: AbstractEffect) -> dict[str, Any]:
    """The fields that tell the forms of a cause apart."""
    fields = [f for f in dataclasses.fields(effect) if f.metadata.get("static")]
    return {field.name: getattr(effect, field.name) for field in fields}


def _constants(effect: AbstractEffect) -> list[str]:
    """The fields that are set once for a record."""
    known = {*parameters(effect), *_form(effect)}
    return [field.name for field in dataclasses.fields(effect) if field.name not in known]


def _kind(effect: AbstractEffect) -> tuple[type, dict[str, Any]]:
    return type(effect), _form(effect)


@dataclass(frozen=True)
class EffectEntry:
    """An effect as a file tells it."""

    cause: str
    parameters: Mapping[str, float | tuple[float, ...]] = field(default_factory=dict)
    form: Mapping[str, str] = field(default_factory=dict)
    constants: Mapping[str, float] = field(default_factory=dict)
    channel: str | None = None

    def made(self, registry: Registry, place: str) -> AbstractEffect:
        """The effect of the registry with these numbers.

        Raises:
            InputError: there is no such cause, form, parameter or constant, or a number is none
                that it may have; `place` tells where in the file.
        """
        off = self._off(registry, place)
        known = parameters(off)
        changed: dict[str, Any] = {}
        for name, value in self.parameters.items():
            at = f"{place} parameters {name}"
            if name not in known:
                problem = f"{self.cause} has no such parameter"
                raise InputError("", at, problem, nearest(name, known))
            about, values = known[name], np.asarray(value)
            if values.shape != np.shape(about.off):
                size = np.size(about.off) if np.ndim(about.off) else "one"
                raise InputError("", at, f"has {values.size} numbers", f"give {size}")
            if not np.isfinite(values).all():
                raise InputError("", at, "is not finite", f"give {about.doc}, {about.unit}")
            if not ((about.lower <= values) & (values <= about.upper)).all():
                span = f"{about.lower:g} to {about.upper:g}"
                raise InputError("", at, f"{value} is out of range", f"give a number from {span}")
            changed[name] = values
        for name, value in self.constants.items():
            at = f"{place} constants {name}"
            if name not in _constants(off):
                problem = f"{self.cause} has no such constant"
                raise InputError("", at, problem, nearest(name, _constants(off)))
            if not math.isfinite(value):
                raise InputError("", at, "is not finite", "write the file anew")
            changed[name] = value
        return dataclasses.replace(off, **changed)

    def _off(self, registry: Registry, place: str) -> AbstractEffect:
        """The effect of the registry that is meant; its usual form where none is told."""
        forms = [effect for effect in registry if effect.cause == self.cause]
        if not forms:
            problem = f"unknown cause {self.cause!r}"
            mend = nearest(self.cause, {effect.cause for effect in registry})
            raise InputError("", f"{place} cause", problem, mend)
        for name, value in self.form.items():
            at, allowed = f"{place} form {name}", _form(forms[0])
            if name not in allowed:
                raise InputError("", at, f"{self.cause} has no such form", nearest(name, allowed))
            allowed = {str(_form(effect)[name]) for effect in forms}
            if value not in allowed:
                raise InputError("", at, f"unknown value {value!r}", nearest(value, allowed))
        told = _form(type(forms[0])()) | dict(self.form)
        meant = [e for e in forms if all(_form(e)[n] == v for n, v in told.items())]
        if len(meant) != 1:
            problem = f"{self.cause} has {len(forms)} forms"
            mend = "give one of " + "; ".join(str(_form(effect)) for effect in forms)
            raise InputError("", f"{place} form", problem, mend)
        return meant[0]
