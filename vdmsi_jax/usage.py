"""From the words of a command line to a call; what is wrong with them is said on one line."""

import contextlib
import functools
import inspect
import io
import re
import sys
from collections.abc import Callable, Mapping

import tyro

from .errors import InputError, nearest

Command = Callable[..., None]


def call_of(arguments: list[str], commands: Mapping[str, Command]) -> Callable[[], None]:
    """The call of a command that arguments ask for. What tyro says of a wrong usage comes in a box;
    it is put on one line.

    Raises:
        InputError: there is no such command or option, `--out` is missing, or a word is empty, as
            a variable of the shell is that was never set.
        SystemExit: they are wrong in another way, which standard error says, or ask for help.
    """
    for before, word in zip(["", *arguments], arguments, strict=False):
        if not word or re.fullmatch("--[a-z]+=", word):
            option = (word or before).rstrip("=")
            place = option if option.startswith("--") else ""
            mend = "give a file, a folder or a value"
            raise InputError(arguments[0] or "arguments", place, "an empty word", mend)
    said = io.StringIO()
    try:
        with contextlib.redirect_stderr(said):
            return tyro.extras.subcommand_cli_from_dict(
                {name: _delayed(command) for name, command in commands.items()},
                prog="vdmsi",
                description="Name what a simulation gets wrong; identify actuators; simulate. "
                "`vdmsi --version` tells the version.",
                args=arguments,
            )
    except SystemExit as leaving:
        if leaving.code and (why := _misused(arguments, commands)):
            raise why from None
        if leaving.code:
            lines = [line.strip("╭╮╰╯│─ \n") for line in said.getvalue().splitlines()]
            print("vdmsi:", "; ".join(filter(None, lines)), file=sys.stderr)
        raise


def _delayed(command: Command) -> Callable[..., Callable[[], None]]:
    """The command as a function that only takes its arguments, and returns the call."""

    @functools.wraps(command)
    def take(*args, **options):
        return functools.partial(command, *args, **options)

    return take


def _misused(arguments: list[str], commands: Mapping[str, Command]) -> InputError | None:
    """Why arguments that cannot be parsed are wrong, where it is a command or an option that there
    is not, --out that is missing, or what should be a number; None where it is another thing."""
    name, *given = arguments or [""]
    if name not in commands:
        if not name or name.startswith("-"):
            return None
        mend = nearest(name, commands)
        return InputError(name, "", "there is no such command", mend)
    parameters = inspect.signature(commands[name]).parameters.values()
    own = [p for p in parameters if p.kind is p.KEYWORD_ONLY]
    switches = [p.name for p in own if isinstance(p.default, bool)]
    options = [*(f"--{p.name}" for p in own), *(f"--no-{switch}" for switch in switches)]
    named = [word.partition("=")[0] for word in given if re.match(r"--?[a-zA-Z]", word)]
    for option in named:
        if option not in options:
            mend = nearest(option, options)
            return InputError(name, option, "there is no such option", mend)
    if "--out" not in named:
        return InputError(name, "--out", "is missing", "give --out DIR, to write to")
    numbers = {f"--{p.name}" for p in own if isinstance(p.default, float)}
    for word, following in zip(given, [*given[1:], ""], strict=True):
        option, joined, value = word.partition("=")
        told = value if joined else following
        if option in numbers and not _is_number(told):
            return InputError(name, option, f"{told!r} is no number", "give one")
    return None


def _is_number(told: str) -> bool:
    try:
        float(told)
    except ValueError:
        return False
    return True
