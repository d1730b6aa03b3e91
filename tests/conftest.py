"""What every test shares: double precision, and the measured logs where they are at hand."""

import os
from pathlib import Path

import jax
import pytest

jax.config.update("jax_enable_x64", True)


@pytest.fixture(scope="session")
def shared_data() -> Path:
    """The folder of the measured logs; the test is skipped where it is absent."""
    beside = Path(__file__).resolve().parents[2] / "shared" / "data"
    folder = Path(os.environ.get("VDMSI_DATA") or beside)
    if not folder.is_dir():
        pytest.skip(f"the measured logs are not at {folder}; VDMSI_DATA may name their folder")
    return folder
