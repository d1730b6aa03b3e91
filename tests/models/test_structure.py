"""The paper's own steering model is the case that the notes are made for."""

import numpy as np
import pytest

from vdmsi_jax.models.structure import Kind, plateau_gain, structure_notes
from vdmsi_jax.models.transfer_function import TransferFunction

STEERING = TransferFunction([0.47, 23.15, -0.49], [1.0, 25.44, 1.7e-7])


def kinds(model, duration=30.0):
    return {note.kind for note in structure_notes(model, duration=duration)}


def test_paper_steering_is_seen_through():
    assert kinds(STEERING) == {Kind.SLOW_PAIR, Kind.NEAR_INTEGRATOR, Kind.NON_MINIMUM_PHASE}
    np.testing.assert_allclose(plateau_gain(STEERING, duration=30.0), 0.910, atol=5e-4)
    pair = next(n for n in structure_notes(STEERING, duration=30.0) if n.kind is Kind.SLOW_PAIR)
    assert pair.pole is not None and pair.zero is not None
    assert abs(pair.pole) < 1e-8 and abs(pair.zero - 0.0212) < 1e-4
    assert "drift" in pair.message


def test_sound_plants_are_left_alone():
    assert kinds(TransferFunction([0.0631, 2.21, 143.90], [1.0, 18.15, 143.20])) == set()
    lead = TransferFunction([1.0, 3.0], np.poly([-1.0, -100.0]))  # a real lead, nothing cancels
    assert kinds(lead) == set()
    np.testing.assert_allclose(plateau_gain(lead, duration=30.0), lead.dc_gain())


@pytest.mark.parametrize(
    ("num", "den", "kind"),
    [
        (np.poly([-5.1]), np.poly([-5.0, -20.0]), Kind.NEAR_CANCELLATION),
        (
            np.poly([-5.1 + 3j, -5.1 - 3j]).real,
            np.poly([-5 + 3j, -5 - 3j, -9]).real,
            Kind.NEAR_CANCELLATION,
        ),
        ([1.0], np.poly([-1e-4, -20.0]), Kind.NEAR_INTEGRATOR),
        ([1.0], [1.0, 0.0], Kind.NEAR_INTEGRATOR),
        ([1.0], np.poly([0.3, -20.0]), Kind.UNSTABLE),
        ([-1.0, 40.0], np.poly([-10.0, -20.0]), Kind.NON_MINIMUM_PHASE),
    ],
)
def test_each_oddity_is_named_alone(num, den, kind):
    assert kinds(TransferFunction(num, den)) == {kind}


def test_an_integrator_of_a_short_record_is_a_lag_of_a_long_one():
    lag = TransferFunction([1.0], [1.0, 0.01])
    assert Kind.NEAR_INTEGRATOR in kinds(lag, duration=5.0)
    assert kinds(lag, duration=500.0) == set()


def test_duration_must_be_positive():
    with pytest.raises(ValueError, match="duration"):
        structure_notes(STEERING, duration=0.0)
