"""What the paper's steering model may have been fitting."""

import jax.numpy as jnp
import numpy as np
import pytest

from vdmsi_jax.models.transfer_function import TransferFunction
from vdmsi_jax.reproduce.steering_model import (
    AMPLITUDE,
    DEN,
    FAULTS,
    NUM,
    PAPER_DT,
    Fault,
    absorb,
    absorbed,
    explanations,
    paper_zero,
)

SEEDS = 6
BY_NAME = {fault.name: fault for fault in FAULTS}


def test_the_papers_model_creeps_back_through_its_angle():
    """Anchors: plateau 0.910, zero at +0.0212, 0.173 rad after half a minute at 0.52 rad."""
    paper = TransferFunction(NUM, DEN)
    held = np.asarray(paper.simulate(np.full(3001, AMPLITUDE), PAPER_DT, jnp.zeros(2)).y)
    assert abs(held[100] / AMPLITUDE - 0.910) < 0.02
    assert abs(held[-1] - 0.173) < 0.002
    assert abs(paper_zero() - 0.0212) < 1e-4


def test_the_fit_finds_the_papers_model_where_it_is_the_truth():
    """A fault that makes the paper's model of the fast steering: an integral taken away from it."""
    leak = -NUM[-1] / DEN[1]

    def act(y, u, t, size):
        return y - size * PAPER_DT * (jnp.cumsum(u) - u)

    found = absorb(Fault("leak", "1/s", (leak,), act), leak, "to both sides", seeds=SEEDS)
    assert abs(found.slow_zero.median - paper_zero()) < 0.003
    assert abs(found.slow_pole.median) < 1e-3
    assert found.fit_p2z2.median > 96.0


def test_a_drifting_sensor_makes_it_and_an_offset_does_not():
    drift = absorb(BY_NAME["drift of the sensor"], -0.0058, "to one side", seeds=SEEDS)
    assert drift.looks_like_the_paper
    assert abs(drift.slow_zero.median - paper_zero()) < 0.005
    assert drift.fit_p2z2.median > drift.fit_p1z1.median + 20.0
    offset = absorb(BY_NAME["offset"], -0.03, "to one side", seeds=SEEDS)
    assert not offset.looks_like_the_paper
    assert offset.fit_p1z1_offset.median > offset.fit_p2z2.median + 1.0
    sound = absorb(BY_NAME["no fault"], 0.0, "to one side", seeds=SEEDS)
    assert not sound.chooses_p2z2 and not sound.looks_like_the_paper


@pytest.mark.slow
def test_explanations_are_sought_among_all_faults():
    found = explanations(absorbed(seeds=SEEDS), seeds=SEEDS)
    assert "drift of the sensor" in {row.fault for row in found}
    assert {row.excitation for row in found} == {"to one side"}
    for row in found:
        assert abs(row.slow_zero.median - paper_zero()) < 0.006
