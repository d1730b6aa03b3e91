"""What a cause is told against: the model without it, unless the plain plant is much better."""

from dataclasses import replace

import numpy as np
import pytest

import vdmsi_jax as vj
from vdmsi_jax.diagnose.actuator.hypothesis import Hypothesis, Refit
from vdmsi_jax.diagnose.actuator.lanes import POLES
from vdmsi_jax.diagnose.findings import budget
from vdmsi_jax.diagnose.findings.naming import Named
from vdmsi_jax.diagnose.prepare import stage_of
from vdmsi_jax.diagnose.search.found import PlantFinding, Search
from vdmsi_jax.diagnose.signals.runs import lay_out

PLANT = vj.PlantSpec("servo", "u", "y")
U = np.repeat(np.random.default_rng(1).uniform(-1.0, 1.0, 20), 20)
LOG = vj.Record.from_arrays(dt=0.02, name="run", plants=(PLANT,), u=U, y=np.roll(U, 3))
STAGE = stage_of(lay_out([LOG]), PLANT)


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
    finding = PlantFinding(number, 100.0, off_by(np.sqrt(less)))
    beside = PlantFinding(0, 50.0, off_by(2.0))
    plain, final = off_by(1.0), off_by(0.1)
    search = Search(STAGE, plain, plain, final, (finding, beside))
    error = search.usable_without(finding).y - STAGE.y
    assert np.mean(error**2) == pytest.approx(told)


@pytest.mark.parametrize(("lasts", "told"), [(2.0, 3.0), (0.2, 1.0)])
def test_a_mode_that_outlasts_the_runs_tells_a_drift_by_another_name(lasts, told):
    """In times of the run."""
    slow = 1.0 / (lasts * STAGE.u.size * STAGE.dt * STAGE.pace)
    theta = STAGE.off.copy()
    theta[:2] = np.poly([-1.0, -slow])[1:]
    theta[POLES : POLES + 2] = 1.0, 1.2 * slow
    plain = replace(off_by(1.0), hypothesis=Hypothesis(2, 1, (), theta))
    number = [slot.cause for slot in STAGE.slots].index("gain_drift")
    finding = PlantFinding(number, 100.0, off_by(np.sqrt(3.0)))
    search = Search(STAGE, plain, plain, off_by(0.1), (finding,))
    error = search.usable_without(finding).y - STAGE.y
    assert np.mean(error**2) == pytest.approx(told)


@pytest.mark.parametrize("alone", [3.0, 1e6, np.nan])
def test_who_is_missed_so_much_that_the_model_runs_away_takes_no_more_than_all(alone, monkeypatch):
    """Of two causes the second is of no use without the first."""
    plain, final = off_by(1.0), off_by(0.1)
    findings = tuple(PlantFinding(number, 100.0, plain) for number in range(2))
    search = Search(STAGE, plain, plain, final, findings)
    errors = {(0,): 0.5, (1,): alone, (): 2.0}

    def only(_, kept):
        return final.y if len(kept) == 2 else STAGE.y + errors[kept]

    monkeypatch.setattr(budget, "only", only)
    causes = [
        Named(cause, "plant", None, "", {}, 1.0, 1, (), search, finding)
        for cause, finding in zip(("first", "second"), findings, strict=True)
    ]
    parts = budget.of_channel("y", "V", search, causes).parts
    assert parts["first (plant)"] == pytest.approx(0.75 + 0.5 * 0.24)
    assert parts["second (plant)"] == pytest.approx(0.5 * 0.24)


def leaving(error: np.ndarray, structure: float = 0.0):
    """The budget of a servo without causes of whose two logs this is left; the second judges."""
    logs = [
        vj.Record.from_arrays(dt=0.02, name=f"run_{k}", plants=(PLANT,), u=np.tile(U, 8)[:3000],
                              y=np.roll(np.tile(U, 8)[:3000], 3) + k)
        for k in range(2)
    ]  # fmt: skip
    stage = stage_of(lay_out(logs), PLANT)
    assert stage.held_out[1].sum() > 2900
    y = stage.y - error
    h = Hypothesis(1, 0, (), stage.off)
    none = np.zeros(0)
    fit = Refit(h, 0.0, y, y, np.zeros((y.shape[1], 1)), none, 1.0, np.zeros((0, 0)))
    search = Search(stage, fit, fit, fit, ())
    return budget.of_channel("y", "V", search, (), structure)


def noise(second: float, memory: float = 0.98) -> np.ndarray:
    """Noise of two logs that lasts for a second, in the second log so many times as large."""
    e = np.random.default_rng(2).standard_normal((2, 3000))
    for k in range(1, e.shape[1]):
        e[:, k] += memory * e[:, k - 1]
    return e / np.sqrt(np.mean(e**2, axis=1, keepdims=True)) * np.array([[1.0], [second]])


def test_noise_that_lasts_is_by_chance_larger_in_one_log_than_in_another():
    told = leaving(noise(1.1))
    assert told.unexplained == 0.0 and told.noise == pytest.approx(told.total)
    told = leaving(noise(2.0))
    assert told.noise == pytest.approx(1.0, rel=1e-3)
    assert told.unexplained == pytest.approx(3.0, rel=1e-3)


def test_structure_is_no_noise_though_all_of_it_was_there_in_the_fit():
    told = leaving(noise(1.0), structure=0.4)
    assert told.unexplained == pytest.approx(0.4 * told.total)
