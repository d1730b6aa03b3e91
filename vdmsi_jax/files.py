"""Writing results: whole or not at all, and JSON that every parser takes."""

import hashlib
import json
import math
import os
import secrets
import tempfile
from collections.abc import Mapping
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from .errors import InputError


def output_folder(path: str | os.PathLike[str]) -> Path:
    """The folder `path`, made if it is not there.

    Raises:
        InputError: it cannot be made or written to.
    """
    path = Path(path)
    try:
        path.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=path):
            pass
    except OSError as error:
        reason = (error.strerror or str(error)).lower()
        raise InputError(str(path), "--out", reason, "name a folder that can be written") from None
    return path


def in_a_file_name(name: str) -> str:
    """A log's name, which may have its folder's before it, as part of the name of a file."""
    return name.replace("/", ".")


def write_text(path: str | Path, text: str) -> Path:
    """Write a text file (UTF-8) as `write_bytes` does."""
    return write_bytes(path, text.encode())


def write_bytes(path: str | Path, content: bytes) -> Path:
    """Write a file so that a reader or a crash sees the old file or the whole new one.

    The content goes to a temporary file in the same folder, to the disk, and then takes the name in
    one step of the file system.

    Raises:
        InputError: the folder is not there.
    """
    path = Path(path)
    if not path.parent.is_dir():
        problem = f"there is no folder {path.parent}"
        raise InputError(str(path), "", problem, "make it, or name another one")
    temporary = path.parent / f".{path.name}.{secrets.token_hex(4)}"
    binary = getattr(os, "O_BINARY", 0)  # of Windows
    handle = os.open(temporary, os.O_WRONLY | os.O_CREAT | os.O_EXCL | binary, 0o666)
    try:
        with os.fdopen(handle, "wb") as file:
            file.write(content)
            file.flush()
            os.fsync(file.fileno())
        os.replace(temporary, path)
    except BaseException as why:
        os.unlink(temporary)
        if isinstance(why, OSError):
            why.filename = why.filename or str(path)  # a full disk does not say whose
        raise
    return path


@cache
def sources() -> str:
    """A digest of the code of this package, of which results that are kept depend."""
    code = sorted(Path(__file__).parent.rglob("*.py"))
    return hashlib.sha256(b"".join(path.read_bytes() for path in code)).hexdigest()


def write_json(path: str | Path, value: Any) -> Path:
    """Write `plain(value)` as strict JSON, atomically."""
    text = json.dumps(plain(value), indent=1, allow_nan=False, ensure_ascii=False)
    return write_text(path, text + "\n")


def read_json(path: str | Path) -> Any:
    """Read a JSON file.

    Raises:
        InputError: it is not there, cannot be read, or is no JSON (with line and column).
    """
    try:
        return json.loads(Path(path).read_text(encoding="utf-8"))
    except FileNotFoundError:
        raise InputError(
            str(path), "", "there is no such file", "give the path of a file"
        ) from None
    except json.JSONDecodeError as error:
        place = f"line {error.lineno}, column {error.colno}"
        raise InputError(str(path), place, f"no JSON: {error.msg}", "write the file anew") from None
    except (OSError, ValueError, RecursionError) as error:  # too deep, or with absurd numbers
        raise InputError(str(path), "", f"cannot be read ({error})", "give a JSON file") from None


def plain(value: Any) -> Any:
    """What JSON can hold of a result: arrays become lists, complex numbers `[re, im]`, and what is
    not finite becomes None, since JSON has no word for it."""
    if isinstance(value, Mapping):
        return {str(key): plain(item) for key, item in value.items()}
    if isinstance(value, str | bool | int | None):
        return value
    if isinstance(value, list | tuple):
        return [plain(item) for item in value]
    array = np.asarray(value)
    if array.ndim:
        return [plain(item) for item in array]
    scalar = array.item()
    if isinstance(scalar, complex):
        return [plain(scalar.real), plain(scalar.imag)]
    if isinstance(scalar, float):
        return scalar if math.isfinite(scalar) else None
    return scalar
