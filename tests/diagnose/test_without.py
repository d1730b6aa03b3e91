"""What a cause is told against: the model without it, unless the plain plant is much better."""

import numpy as np
import pytest

import vdmsi_jax as vj
from vdmsi_jax.diagnose.found import Finding, Search
from vdmsi_jax.diagnose.hypothesis import Hypothesis, Refit
from vdmsi_jax.diagnose.prepare import stage_of
from vdmsi_jax.diagnose.runs import lay_out
from vdmsi_jax.diagnose.verdict import _usable

PLANT = vj.PlantSpec("servo", "u", "y")
U = np.repeat(np.random.default_rng(1).uniform(-1.0, 1.0, 20), 20)
LOG = vj.Record.from_arrays(dt=0.02, name="run", plants=(PLANT,), u=U, y=np.roll(U, 3))
STAGE = stage_of(lay_out([LOG]), PLANT)
EVERYWHERE = np.ones_like(STAGE.mask)


def off_by(error: float) -> Refit:
    """A fit that is wrong by so much everywhere."""
    y = STAGE.y + error
    none = np.zeros(0)
    h = Hypothesis(1, 0, (), STAGE.off)
    return Refit(h, 0.0, y, y, np.zeros((y.shape[1], 1)), none, 1.0, np.zeros((0, 0)))


@pytest.mark.parametrize(
    ("cause", "less", "told"),
    [("backlash", 1.2, 1.2), ("backlash", 3.0, 1.0), ("offset", 3.0, 3.0), ("resonance", 3.0, 3.0)],
)
def test_a_model_that_errs_more_than_the_plain_plant_is_not_what_one_would_take(cause, less, told):
    number = [slot.cause for slot in STAGE.slots].index(cause)
    finding = Finding(number, 100.0, off_by(np.sqrt(less)))
    beside = Finding(0, 50.0, off_by(2.0))
    plain, final = off_by(1.0), off_by(0.1)
    search = Search(STAGE, plain, plain, final, (finding, beside), ())
    error = _usable(search, finding, EVERYWHERE).y - STAGE.y
    assert np.mean(error**2) == pytest.approx(told)
