"""Long logs: what is looked at of them, and that it is enough."""

import importlib

import numpy as np
import pytest

import known_plants as known
from vdmsi_jax.config import PlantSpec
from vdmsi_jax.data.record import Record
from vdmsi_jax.identify import identify
from vdmsi_jax.identify.document import identify_document
from vdmsi_jax.identify.most_moved import most_moved

DT, N = 0.01, 12_000
PLANT = PlantSpec("plant", "u", "y")
TRUTH = known.Truth((60.0, 400.0), (1.0, 28.0, 400.0))


def log(seed: int = 0) -> Record:
    """Two minutes of steps, in which the command stands still for a third of the time."""
    u = known.steps(N, 40, seed=seed)
    u[3000:7000] = u[3000]
    y = known.response(TRUTH, u, DT) + known.white(N, 0.05, seed=seed + 1)
    return Record.from_arrays(dt=DT, name="long", plants=(PLANT,), u=u, y=y)


def test_the_stretches_in_which_the_command_moves_are_taken():
    record = log()
    assert most_moved(record, PLANT, N)[0] is record
    part, index = most_moved(record, PLANT, 8000)
    assert part.n == len(index) == 8000
    assert np.all(np.diff(index) > 0) and not np.isin(np.arange(4000, 6000), index).any()
    np.testing.assert_array_equal(part["u"], record["u"][index])


@pytest.fixture
def short(monkeypatch):
    """As if these logs were long."""
    orders = importlib.import_module("vdmsi_jax.identify.orders")
    monkeypatch.setattr(orders, "_LOOKED", 4000)
    return importlib.import_module("vdmsi_jax.identify.identify"), monkeypatch


def test_a_search_on_a_part_settles_on_the_whole(short):
    options = {"poles": (1, 2, 3), "zeros": (0, 1), "delay": False}
    quick = identify(log(), "plant", **options)
    fit = quick["P2Z1"]
    assert quick.record.n == len(fit.predicted) == N
    for name, value in zip(("b1", "b0", "a1", "a0"), TRUTH.parameters, strict=True):
        assert abs(fit.value(name) - value) < 4.0 * fit.std[name]
    assert quick["P1Z0"].fit < quick["P2Z0"].fit < fit.fit <= quick["P3Z1"].fit + 1e-9
    clean = known.response(TRUTH, log()["u"], DT)
    assert fit.mse == pytest.approx(np.mean((log()["y"] - clean) ** 2), rel=1e-3)


def test_of_a_very_long_log_a_part_is_looked_at_and_told(short):
    module, monkeypatch = short
    monkeypatch.setattr(module, "_MOST", 8000)
    grid = identify(log(), "plant", poles=(2,), zeros=(1,), delay=False)
    assert grid.record.n == 8000
    assert grid.note.startswith("identified on 8000 of 12000 samples, in the 4 stretches")
    assert f"plant: {grid.note}" in identify_document({"plant": grid}, [log()])["repairs"]
    for name, value in zip(("b1", "b0", "a1", "a0"), TRUTH.parameters, strict=True):
        assert abs(grid["P2Z1"].value(name) - value) < 4.0 * grid["P2Z1"].std[name]
