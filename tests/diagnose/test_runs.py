"""Which runs, or parts of them, are fitted and which judge."""

import numpy as np
import pytest

from lasting_errors import DT
from vdmsi_jax.config import PlantSpec
from vdmsi_jax.data.record import Record
from vdmsi_jax.diagnose.prepare import stage_of
from vdmsi_jax.diagnose.signals.runs import lay_out


def record(name, n):
    return Record.from_arrays(dt=DT, name=name, v_cmd=np.ones(n), v=np.ones(n))


def test_a_single_log_is_judged_in_parts_that_lie_apart():
    held = lay_out([record("one", 1000)]).held()[0]
    assert held.mean() == pytest.approx(0.3)
    assert np.count_nonzero(np.diff(held.astype(int)) == 1) == 3
    assert not held[:200].any() and not held[-100:].any()


def test_of_three_logs_the_last_judges():
    runs = lay_out([record(str(k), 400) for k in range(3)])
    assert [bool(row.all()) for row in runs.held()] == [False, False, True]
    assert not runs.held()[:2].any()


def test_a_long_log_is_looked_at_in_stretches_that_span_it():
    runs = lay_out([record("hour", 180_000)])
    looked = sum(b - a for a, b in zip(runs.starts, runs.stops, strict=True))
    assert looked <= 15_000
    assert runs.starts[0] < 10_000 and runs.stops[-1] > 170_000


def test_a_change_in_every_run_is_looked_for_over_a_long_log_that_is_cut():
    rows, rng = 10_000, np.random.default_rng(1)
    logs = []
    for name in ("one", "two"):
        u = np.repeat(rng.uniform(1.0, 3.0, rows // 100), 100)
        logs.append(Record.from_arrays(dt=DT, name=name, v_cmd=u, v=u))
    stage = stage_of(lay_out(logs), PlantSpec("powertrain", "v_cmd", "v"))
    assert stage.mask.shape[1] < rows // 4  # stretches of it are looked at
    latest = {
        slot.effect.over: max(probe[0] for probe in slot.effect.probes(stage.scales))
        for slot in stage.slots
        if slot.cause == "regime_change"
    }
    assert 0.7 * rows * DT < latest["run"] < rows * DT
    way = np.asarray(stage.signals.distance)
    starts = np.array([np.sum(np.abs(u[:k])) * DT for k in lay_out(logs).starts])
    own = np.array(lay_out(logs).names) == "two"
    np.testing.assert_allclose(way[own, 0], starts[own])
    assert stage.scales.distance == pytest.approx(way.max(), rel=0.05)
