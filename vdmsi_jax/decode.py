"""From a TOML table to a frozen dataclass, strictly: what is not understood is refused and never
ignored.

The dataclass is the schema. A field's annotation says what its key may hold: `str`, `bool`, `int`,
`float`, `Literal`, `X | None`, `tuple[X, ...]`, `Mapping[str, X]`, or another dataclass; a field
without a default must be given. A dataclass that checks more raises `InputError` with its field as
the place in `__post_init__`, which is told here with the file and the table around it. Every table
of the project is decoded by `decode`, so a new one is a dataclass and nothing else.
"""

import dataclasses
import tomllib
import types
import typing
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Literal, TypeVar, cast

from .errors import InputError, nearest

T = TypeVar("T")

_LARGEST = 2**53  # whole number that a float holds exactly

_WORDS: dict[type, str] = {
    str: "a text",
    bool: "true or false",
    int: "a whole number",
    float: "a number",
}


def load_toml(path: Path) -> dict[str, Any]:
    """Read a TOML file.

    Raises:
        InputError: the file is not there, cannot be read, or is no TOML (with line and column).
    """
    try:
        return tomllib.loads(path.read_text(encoding="utf-8-sig"))
    except FileNotFoundError:
        raise InputError(
            str(path), "", "there is no such file", "give the path of a TOML configuration"
        ) from None
    except OSError as error:
        problem = "is a folder" if path.is_dir() else f"cannot be read ({error.strerror or error})"
        raise InputError(str(path), "", problem, "give a TOML file") from None
    except UnicodeDecodeError:
        raise InputError(str(path), "", "is no UTF-8 text", "give a TOML file") from None
    except RecursionError:
        raise InputError(
            str(path), "", "tables lie too deep in each other", "mend the file"
        ) from None
    except tomllib.TOMLDecodeError as error:
        problem, _, place = str(error).rstrip(")").partition(" (at ")
        raise InputError(str(path), place, f"no valid TOML: {problem}", "mend the line") from None


def decode(cls: type[T], table: Mapping[str, Any], *, source: str, place: str = "") -> T:
    """Make the dataclass `cls` of a TOML table.

    Args:
        cls: a dataclass. Fields with the metadata `toml=False` are no keys. If it has a class
            attribute `shorthand`, a bare value stands for a table with that key only.
        table: what `tomllib` read.
        source: the file, for errors.
        place: the table's name as the user knows it (`[vehicle]`), for errors.

    Raises:
        InputError: unknown key (with the nearest right one), missing key, wrong type, or a value
            that `cls` refuses.
    """
    hints = typing.get_type_hints(cls)
    fields = {f.name: f for f in dataclasses.fields(cast(Any, cls)) if f.metadata.get("toml", True)}
    for key in table:
        if key not in fields:
            kind = "table" if isinstance(table[key], dict) and not place else "key"
            raise InputError(
                source, _join(place, key), f"unknown {kind} {key!r}", nearest(key, fields)
            )
    for name, field in fields.items():
        required = (
            field.default is dataclasses.MISSING and field.default_factory is dataclasses.MISSING
        )
        if required and name not in table:
            raise InputError(
                source, _join(place, name), "missing", f"give {name} = {_describe(hints[name])}"
            )
    values = {
        key: _value(hints[key], given, source, _join(place, key)) for key, given in table.items()
    }
    try:
        return cls(**values)
    except InputError as error:
        raise error.within(source, place) from None


def _join(place: str, key: str) -> str:
    """Name a key the way a user finds it: `[table] key`, and `[key]` at the top."""
    return f"{place} {key}" if place else f"[{key}]"


def _value(hint: Any, given: Any, source: str, place: str) -> Any:
    """Check one value against its annotation and turn it into what the dataclass holds."""
    origin, arguments = typing.get_origin(hint), typing.get_args(hint)
    if origin in (typing.Union, types.UnionType):
        fitting = [member for member in arguments if _fits(member, given)]
        if fitting:
            return _value(fitting[0], given, source, place)
    elif _fits(hint, given):
        if origin is tuple:
            return tuple(
                _value(arguments[0], item, source, f"{place} {i + 1}")
                for i, item in enumerate(given)
            )
        if origin is not None and issubclass(_as_type(origin), Mapping):
            return {
                key: _value(arguments[1], item, source, f"{place} {key}")
                for key, item in given.items()
            }
        if dataclasses.is_dataclass(hint):
            table = given if isinstance(given, dict) else {cast(Any, hint).shorthand: given}
            return decode(_as_type(hint), table, source=source, place=place)
        return _number(hint, given, source, place) if hint in (int, float) else given
    if origin is Literal and isinstance(given, str):
        raise InputError(
            source, place, f"unknown value {given!r}", nearest(given, map(str, arguments))
        )
    listed = origin is tuple and dataclasses.is_dataclass(arguments[0])
    mend = f"begin each of them by [{place}]" if listed else f"give {_describe(hint)}"
    raise InputError(source, place, f"{_show(given)} is not {_describe(hint)}", mend)


def _number(hint: type, given: float | int, source: str, place: str) -> float | int:
    """A number, unless it is none (`nan`) or has more digits than arithmetic holds."""
    absurd = isinstance(given, int) and abs(given) > _LARGEST
    if absurd or given != given:
        problem = "a number of absurd size" if absurd else "nan is not finite"
        raise InputError(source, place, problem, f"give {_describe(hint)}")
    return hint(given)


def _as_type(hint: Any) -> type:
    return hint if isinstance(hint, type) else object


def _fits(hint: Any, given: Any) -> bool:
    """Whether a TOML value has the type that the annotation asks for (its parts are checked
    later)."""
    origin, arguments = typing.get_origin(hint), typing.get_args(hint)
    if origin is Literal:
        return any(given == choice and type(given) is type(choice) for choice in arguments)
    if origin is tuple:
        return isinstance(given, list)
    if origin is not None and issubclass(_as_type(origin), Mapping):
        return isinstance(given, dict)
    if dataclasses.is_dataclass(hint):
        return isinstance(given, dict) or (hasattr(hint, "shorthand") and isinstance(given, str))
    if hint is float:
        return isinstance(given, (int, float)) and not isinstance(given, bool)
    if hint is int:
        return isinstance(given, int) and not isinstance(given, bool)
    return hint is Any or (isinstance(hint, type) and isinstance(given, hint))


def _describe(hint: Any) -> str:
    """What an annotation asks for, in a user's words."""
    origin, arguments = typing.get_origin(hint), typing.get_args(hint)
    if origin in (typing.Union, types.UnionType):
        return " or ".join(_describe(member) for member in arguments if member is not type(None))
    if origin is Literal:
        return " or ".join(repr(choice) for choice in arguments)
    if origin is tuple:
        return f"a list of {_describe(arguments[0]).removeprefix('a ')}s"
    if origin is not None or dataclasses.is_dataclass(hint):
        return "a table"
    return _WORDS.get(hint, getattr(hint, "__name__", str(hint)))


def _show(given: Any) -> str:
    return "a table" if isinstance(given, dict) else repr(given)
