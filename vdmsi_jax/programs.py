"""Compiled programs: how they are compiled, how many a process may hold, and who compiles them."""

import os
import threading
from collections.abc import Hashable, Iterator
from contextlib import contextmanager
from pathlib import Path

import jax
import jaxlib

_FLAG = "xla_cpu_use_fusion_emitters"
_MAPS, _LIMIT = Path("/proc/self/maps"), Path("/proc/sys/vm/max_map_count")
_SHARE = 0.5


def compile_quickly() -> None:
    """Let XLA compile for a CPU in the older of its two ways, unless `XLA_FLAGS` says otherwise.

    It takes 0.8 of the time for a whole diagnosis, and its programs are as fast (jaxlib 0.10.2).
    Has no effect once JAX has begun to compute. A flag that XLA does not know ends the process, so
    that it is told only to those that were seen to know it (0.10.2, 0.11.2, 0.12.0).
    """
    flags = os.environ.get("XLA_FLAGS", "")
    if _FLAG not in flags and jaxlib.version.__version_info__ < (0, 13):
        os.environ["XLA_FLAGS"] = f"{flags} --{_FLAG}=false".strip()


def make_room() -> None:
    """Forget all compiled programs where they have taken half of the memory maps that Linux lets a
    process have.

    A program takes hundreds of them, every new length of a log compiles new ones, and a process
    without maps left ends with a segmentation fault: after some fifty logs of different lengths.
    What is used again is compiled again, or read from the compilation cache. Does nothing on other
    systems.
    """
    try:
        limit, held = int(_LIMIT.read_text()), _MAPS.read_bytes().count(b"\n")
    except (OSError, ValueError):
        return
    if held > _SHARE * limit:
        jax.clear_caches()
        _compiled.clear()


_compiled: set[Hashable] = set()
_compiling = threading.Lock()


@contextmanager
def compiled_once(key: Hashable) -> Iterator[None]:
    """Let one thread call a program for the first time, and those that come meanwhile wait for it,
    who would all trace and compile it.

    Args:
        key: what tells the program and the shapes that it takes apart from others.
    """
    if key in _compiled:
        yield
        return
    with _compiling:
        yield
        _compiled.add(key)
