"""The one exception for input that the toolkit refuses, and the helpers that name the nearest right
word."""

import dataclasses
import difflib
from collections.abc import Iterable
from typing import Any, Literal, Union, get_args, get_origin

_LONGEST = 40  # letters of a word that is listed


class InputError(ValueError):
    """Input that is refused, told in one line that a user can act on.

    It is raised for what a user gave (a log, a configuration, an option) and never for a mistake
    inside the toolkit. The command line prints it on standard error and ends with exit code 2.

    Attributes:
        source: what was read: a file, or the name of the object that a Python user built.
        place: where in it: a line and column of a log, a key of a configuration, a channel.
        problem: what is wrong there.
        mend: what the user can do about it.
    """

    def __init__(self, source: str, place: str, problem: str, mend: str):
        self.source, self.place, self.problem, self.mend = (
            " ".join(str(part).split()) for part in (source, place, problem, mend)
        )
        where = f"{self.source}: {self.place}" if self.place else self.source
        super().__init__(f"{where}: {self.problem}; {self.mend}")

    def __reduce__(self):
        return type(self), (self.source, self.place, self.problem, self.mend)

    def within(self, source: str, place: str) -> "InputError":
        """The same error, told of the file `source` and the table `place` that held the value."""
        return InputError(source, f"{place} {self.place}".strip(), self.problem, self.mend)


def nearest(name: str, allowed: Iterable[str], limit: int = 16) -> str:
    """Advice for a word that is none of `allowed`: the nearest right one first, then what else
    there is.

    Args:
        name: the word that was given.
        allowed: the words that would be right.
        limit: how many of them are listed at most.

    Returns:
        A clause for `InputError.mend`, such as "did you mean 'units'? Allowed: columns, sign,
        units".
    """
    words = sorted(allowed)
    if not words:
        return "nothing is allowed here"
    listed = ", ".join(map(_short, words[:limit])) + (
        f" and {len(words) - limit} more" if len(words) > limit else ""
    )
    lowered = {word.lower(): word for word in words}
    close = difflib.get_close_matches(name.lower(), lowered, n=1, cutoff=0.5)
    return (
        f"did you mean {lowered[close[0]]!r}? Allowed: {listed}" if close else f"allowed: {listed}"
    )


def require(fine: bool, owner: object, field: str, problem: str, mend: str) -> None:
    """Refuse the field of a dataclass unless it is fine."""
    if not fine:
        raise InputError(type(owner).__name__, field, problem, mend)


def refuse_unknown_words(owner: Any) -> None:
    """Hold the fields of a dataclass that are annotated by a `Literal`, or nothing, to its words.

    Raises:
        InputError: one of them is none of these.
    """
    for field in dataclasses.fields(owner):
        word = getattr(owner, field.name)
        kinds = get_args(field.type) if get_origin(field.type) is Union else (field.type,)
        words = [word for kind in kinds if get_origin(kind) is Literal for word in get_args(kind)]
        if words and word not in words and not (word is None and type(None) in kinds):
            mend = nearest(str(word), words)
            raise InputError(type(owner).__name__, field.name, f"unknown value {word!r}", mend)


def _short(word: str) -> str:
    return word if len(word) <= _LONGEST else f"{word[: _LONGEST - 1]}…"
