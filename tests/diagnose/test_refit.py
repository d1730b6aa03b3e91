"""What a stage remembers of the starts that were refitted, and where the way of a fit ends."""

from dataclasses import replace

import numpy as np
import pytest

import vdmsi_jax as vj
from vdmsi_jax.diagnose.actuator.hypothesis import Hypothesis
from vdmsi_jax.diagnose.actuator.refit import at_rest, refit
from vdmsi_jax.diagnose.actuator.stage import Stage
from vdmsi_jax.diagnose.prepare import stage_of
from vdmsi_jax.diagnose.signals.noise import OwnNoise
from vdmsi_jax.diagnose.signals.runs import lay_out

PLANT, DT, LAG = vj.PlantSpec("servo", "u", "y"), 0.02, 0.3


@pytest.fixture
def stage():
    rng = np.random.default_rng(1)
    u = np.repeat(rng.uniform(-1.0, 1.0, 20), 40)
    y, keep = np.zeros(len(u)), np.exp(-DT / LAG)
    for k in range(1, len(u)):
        y[k] = keep * y[k - 1] + (1.0 - keep) * u[k - 1]
    y += 0.02 * rng.standard_normal(len(u))
    log = vj.Record.from_arrays(dt=DT, name="run", plants=(PLANT,), u=u, y=y)
    return stage_of(lay_out([log]), PLANT)


@pytest.fixture
def calls(monkeypatch):
    made, simulate = [], Stage.simulate

    def counted(self, theta):
        made.append(len(theta))
        return simulate(self, theta)

    monkeypatch.setattr(Stage, "simulate", counted)
    return made


def lag(stage: Stage, seconds: float, gain: float = 1.0) -> Hypothesis:
    theta = stage.off.copy()
    theta[0] = 1.0 / (seconds * stage.pace)
    theta[4] = gain * theta[0]
    return Hypothesis(1, 0, (), theta)


def test_what_was_refitted_is_not_refitted_again_whatever_is_barred(stage, calls):
    first = refit(stage, [lag(stage, 0.1), lag(stage, 1.0)])
    calls.clear()
    again = refit(stage.but({0}), [lag(stage, 1.0), lag(stage, 0.1)])
    assert not calls
    assert [id(f) for f in again] == [id(f) for f in reversed(first)]


def test_other_noise_or_other_runs_know_nothing_of_it(stage, calls):
    refit(stage, [lag(stage, 0.1)])
    calls.clear()
    refit(replace(stage, noise=OwnNoise()), [lag(stage, 0.1)])
    assert calls


def test_what_was_given_up_is_taken_up_where_what_was_better_is_gone(stage, calls):
    """Worth is a matter of the call: here it is the gain that a start has after a round."""

    def worth(h, _):
        return float(h.theta[4])

    near, far = lag(stage, 0.3), lag(stage, 100.0, gain=-1e-6)
    both = refit(stage, [near, far], rounds=1, further=0, worth=worth, reach=1e-9)
    assert len(both) == 1
    calls.clear()
    assert len(refit(stage, [near, far], rounds=1, further=0, worth=worth, reach=1e-9)) == 1
    assert not calls
    (other,) = refit(stage, [far], rounds=1, further=0, worth=worth, reach=1e-9)
    assert calls
    assert other is not both[0]


def test_a_model_at_rest_is_the_same_wherever_its_way_began(stage):
    """One step from each start leaves them apart."""
    left = refit(stage, [lag(stage, 0.1), lag(stage, 2.0)], rounds=1, steps=1, further=0)
    near, far = (at_rest(stage, f) for f in left)
    assert left[0].loglik - left[1].loglik > 10.0
    assert near.loglik == pytest.approx(far.loglik, abs=0.1)
    np.testing.assert_allclose(near.hypothesis.theta, far.hypothesis.theta, rtol=1e-3)


def test_a_model_at_rest_stays_as_it_is(stage):
    (fit,) = refit(stage, [lag(stage, 0.3)])
    rested = at_rest(stage, fit)
    assert rested.loglik >= fit.loglik
    assert at_rest(stage, rested).loglik == pytest.approx(rested.loglik, abs=0.1)
