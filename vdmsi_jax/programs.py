"""Compiled programs: how they are compiled, how many a process may hold, and who compiles them."""

import contextlib
import hashlib
import os
import pickle
import sys
import threading
from collections.abc import Callable, Hashable
from dataclasses import dataclass
from functools import cache
from importlib.metadata import version
from importlib.util import find_spec
from pathlib import Path
from typing import Any, Generic, NamedTuple, TypeVar

import jax
import jaxlib
import numpy as np
from jax import export

from .files import sources, write_bytes

R = TypeVar("R")

_FLAG = "xla_cpu_use_fusion_emitters"
_MAPS, _LIMIT = Path("/proc/self/maps"), Path("/proc/sys/vm/max_map_count")
_SHARE = 0.5
_SETTINGS: Any = jax.config  # whose attributes no type checker knows
_UNGUARANTEED = [  # to be the same in other versions of jaxlib, for which programs are not kept
    export.DisabledSafetyCheck.custom_call(f"lapack_{kind}ormqr_ffi") for kind in "sd"
]


def compile_quickly() -> None:
    """Let XLA compile for a CPU in the older of its two ways, unless `XLA_FLAGS` says otherwise.

    It takes 0.8 of the time for a whole diagnosis, and its programs are as fast (jaxlib 0.10.2).
    Has no effect once JAX has begun to compute. A flag that XLA does not know ends the process, so
    that it is told only to those that were seen to know it (jaxlib 0.10.0 to 0.11.2, not 0.12.0),
    and not where JAX has a plugin for another device, which brings an XLA of its own: that of CUDA
    knows no flags of CPUs, and ended the process even under `JAX_PLATFORMS=cpu` (0.11.2).
    """
    flags = os.environ.get("XLA_FLAGS", "")
    known = jaxlib.version.__version_info__ < (0, 12) and find_spec("jax_plugins") is None
    if known and _FLAG not in flags:
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
        for kept in _every:
            kept.forget()


@jax.tree_util.register_static
@dataclass(frozen=True)
class Static:
    """An argument that a program is made for; its `repr` has to tell all that it is."""

    value: Any


class Kept(Generic[R]):
    """A function of pytrees of arrays whose programs, one for the shapes that it meets, outlive the
    process.

    JAX's compilation cache spares a later process the compiler, but not tracing and lowering, which
    were half of the time of `vdmsi identify`. So what is lowered is kept as well (`jax.export`),
    beside that cache, where there is one, under a key of all that may change it: the sources of
    this package, shapes and static parts of the arguments, versions and settings. Of threads that
    ask for the same program one makes it.

    **Arguments:**

    - `function`: of a module, since its files are told by its name. It takes its arguments by
      position; what is static of them stands in their treedefs, as the static fields of a module
      do, and `Static`.
    """

    def __init__(self, function: Callable[..., R]):
        self.function = function
        self._programs: dict[Hashable, _Program] = {}
        self._making = threading.Lock()
        _every.append(self)

    def __call__(self, *args: Any) -> R:
        """What the function returns."""
        leaves, tree = jax.tree.flatten(args)
        return self._program(leaves, tree)(leaves)

    def compile(self, *args: Any) -> None:
        """Have the program ready for arguments like these, in which `jax.ShapeDtypeStruct`s may
        stand for arrays."""
        self._program(*jax.tree.flatten(args))

    def forget(self) -> None:
        """Let go of all programs; those that are called again are made again."""
        self._programs = {}

    def _program(self, leaves: list[Any], tree: Any) -> "_Program":
        key = tree, tuple((leaf.shape, leaf.dtype) for leaf in leaves)
        program = self._programs.get(key)
        if program is None:
            double = any(np.dtype(leaf.dtype).itemsize == 8 for leaf in leaves)
            with self._making, jax.enable_x64(double):  # which is a thread's own, unlike arrays
                program = self._programs.get(key) or self._made(*key)
                self._programs[key] = program
        return program

    def _made(self, tree: Any, shapes: tuple) -> "_Program":
        """From its file, or from the function, which then leaves one."""
        name = f"{self.function.__module__}.{self.function.__qualname__}"
        file = _file(name, repr((tree, shapes)))
        structs = [jax.ShapeDtypeStruct(*shape) for shape in shapes]

        def compiled(call: Callable) -> jax.stages.Compiled:
            return jax.jit(call).lower(structs).compile()

        kept = None
        if file is not None and file.exists():
            with contextlib.suppress(Exception):  # what cannot be read is written anew
                lowered, result = pickle.loads(file.read_bytes())
                kept = export.deserialize(bytearray(lowered)).call, result
        if kept is not None:
            return _Program(compiled(kept[0]), kept[1])
        results = []

        def flat(leaves):
            out, result = jax.tree.flatten(self.function(*jax.tree.unflatten(tree, leaves)))
            results.append(jax.tree.unflatten(result, range(len(out))))
            return out

        if file is not None:
            # not every operation can be exported, nor every folder written to
            with contextlib.suppress(ValueError, NotImplementedError, OSError):
                exported = export.export(jax.jit(flat), disabled_checks=_UNGUARANTEED)(structs)
                file.parent.mkdir(parents=True, exist_ok=True)
                write_bytes(file, pickle.dumps((bytes(exported.serialize()), results[0])))
                return _Program(compiled(exported.call), results[0])
        return _Program(compiled(flat), results[0])


class _Program(NamedTuple):
    """What takes and gives leaves, and what its result looks like, with their numbers in place of
    leaves."""

    run: jax.stages.Compiled
    result: Any

    def __call__(self, leaves: list[Any]) -> Any:
        return jax.tree.unflatten(jax.tree.structure(self.result), self.run(leaves))


_every: list[Kept] = []


def _file(name: str, arguments: str) -> Path | None:
    """Where a program is kept; None where no compilation cache is in use."""
    folder = _SETTINGS.jax_compilation_cache_dir
    if not folder or "://" in folder or not _SETTINGS.jax_enable_compilation_cache:
        return None
    told = (_surroundings(), jax.default_backend(), _SETTINGS.jax_enable_x64, name, arguments)
    key = hashlib.sha256(repr(told).encode()).hexdigest()
    return Path(folder) / "programs" / f"{name}-{key[:32]}"


@cache
def _surroundings() -> tuple[str, ...]:
    """The sources of this package, and the versions of what they are traced with."""
    libraries = ("jax", "jaxlib", "equinox", "lineax", "optimistix")
    return sources(), sys.version, *(version(name) for name in libraries)
