"""The process of a command: how JAX and Python work in it, and how it ends."""

import gc
import os
import sys
import threading
from contextlib import suppress
from importlib import import_module
from pathlib import Path
from typing import NoReturn

_OBJECTS, _YOUNG, _OLD = 50_000, 20, 50  # made since, after which garbage is looked for


def prepare(cache: bool) -> None:
    """Ask JAX for float64, for the CPU unless `JAX_PLATFORMS` names a device, for the cache of
    compiled programs, and for those to be compiled quickly; and Python to look for garbage seldom.

    A command fits a few logs one after the other, in which an accelerator has little to do at once:
    identify took 2 to 3 and diagnose 5 times as long on an H200 as on the CPU beside it.
    """
    import jax

    from .programs import compile_quickly

    compile_quickly()
    jax.config.update("jax_enable_x64", True)
    if not os.environ.get("JAX_PLATFORMS"):
        jax.config.update("jax_platforms", "cpu")
    if not cache:
        jax.config.update("jax_enable_compilation_cache", False)
    elif "JAX_COMPILATION_CACHE_DIR" not in os.environ:
        caches = Path(os.environ.get("XDG_CACHE_HOME") or "~/.cache").expanduser()
        jax.config.update("jax_compilation_cache_dir", str(caches / "vdmsi_jax" / "xla"))
    # Small programs, too: a run compiles over a hundred, and reading one is ten times faster.
    jax.config.update("jax_persistent_cache_min_compile_time_secs", 0.0)
    gc.set_threshold(_OBJECTS, _YOUNG, _OLD)  # tracing makes many objects, and hardly a cycle


def ahead(module: str) -> None:
    """Import a module that is needed later, beside other work: half a second with matplotlib. That
    work must not import what it imports."""
    threading.Thread(target=import_module, args=(module,), daemon=True).start()


def leave(code: int) -> NoReturn:
    """End this process, without taking apart what it held: half a second, after JAX has compiled.
    Whatever was written is closed by then."""
    for stream in (sys.stdout, sys.stderr):
        with suppress(OSError, ValueError):  # who read it has gone
            stream.flush()
    os._exit(code)
