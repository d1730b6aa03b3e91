"""What every test shares: double precision, and the measured logs where they are at hand."""

import os
from pathlib import Path

import jax
import jaxtyping
import pytest

jax.config.update("jax_enable_x64", True)


LONGEST = (
    *("test_notebooks", "test_results", "test_usage", "test_sweep", "test_plants", "test_simulate"),
    *("test_hunt", "test_recovery", "test_diagnose", "test_extended_plant"),
    *("test_extended_vehicle", "test_floors"),
)
"""Files that take a minute or more. They come first, so that no worker is left with one at last;
xdist must be told not to sort them otherwise (`--no-loadscope-reorder`)."""


def pytest_sessionstart() -> None:
    """Compile as the command line does: a test takes more time for that than for all else."""
    from vdmsi_jax.programs import compile_quickly  # not before annotations are checked

    compile_quickly()


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Sort the longest files to the front."""
    rank = {name: place for place, name in enumerate(LONGEST)}
    items.sort(key=lambda item: rank.get(item.path.stem, len(LONGEST)))


@pytest.fixture(scope="session")
def shared_data() -> Path:
    """The folder of the measured logs; the test is skipped where it is absent."""
    beside = Path(__file__).resolve().parents[2] / "shared" / "data"
    folder = Path(os.environ.get("VDMSI_DATA") or beside)
    if not folder.is_dir():
        pytest.skip(f"the measured logs are not at {folder}; VDMSI_DATA may name their folder")
    return folder


@pytest.fixture
def unchecked():
    """Annotations are not executed, as for users; else they refuse a wrong word or type before the
    code that is tested does."""
    jaxtyping.config.update("jaxtyping_disable", True)
    yield
    jaxtyping.config.update("jaxtyping_disable", False)
