"""Ways to run the command line, and a configuration of a few orders."""

import os
import subprocess
import sys

import jax
import pytest

from vdmsi_jax.cli import main

FEW_ORDERS = """
[vehicle]
l_f = 1.75
l_r = 1.20

[identify]
poles = [1, 2]
zeros = [0, 1, 2]
"""


@pytest.fixture(scope="session")
def cache(tmp_path_factory):
    """Compiled programs of these tests, so that only the first of them compiles."""
    return tmp_path_factory.mktemp("cache")


@pytest.fixture(scope="session")
def vdmsi(cache):
    """Run the command in a process of its own; `first` is executed before it is imported, `then`
    after it, before it ends."""

    def run(*arguments, first="", then=""):
        program = f"""
import sys
{first}
from vdmsi_jax.cli import main
try:
    main({[str(a) for a in arguments]!r})
finally:
    {then or "pass"}
"""
        environment = os.environ | {"XDG_CACHE_HOME": str(cache), "COLUMNS": "200"}
        environment.pop("JAX_COMPILATION_CACHE_DIR", None)
        return subprocess.run(
            [sys.executable, "-c", program],
            capture_output=True,
            text=True,
            env=environment,
            stdin=subprocess.DEVNULL,
        )

    return run


@pytest.fixture
def here(capsys):
    """Run the command in this process, which has compiled much of it already."""
    kept = jax.config.jax_persistent_cache_min_compile_time_secs

    def run(*arguments):
        code = 0
        try:
            main([str(a) for a in arguments])
        except SystemExit as left:
            code = left.code
        return subprocess.CompletedProcess(arguments, code, *capsys.readouterr())

    yield run
    jax.config.update("jax_persistent_cache_min_compile_time_secs", kept)


@pytest.fixture(scope="module")
def settings(tmp_path_factory):
    path = tmp_path_factory.mktemp("config") / "vehicle.toml"
    path.write_text(FEW_ORDERS)
    return path
