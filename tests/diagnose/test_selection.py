"""Which of two explanations is told."""

from dataclasses import replace

import numpy as np
import pytest

import vdmsi_jax as vj
from vdmsi_jax.diagnose.actuator.hypothesis import Hypothesis, Refit
from vdmsi_jax.diagnose.actuator.refit import refit
from vdmsi_jax.diagnose.actuator.starts import delayed
from vdmsi_jax.diagnose.prepare import stage_of
from vdmsi_jax.diagnose.search.baseline import baselines
from vdmsi_jax.diagnose.search.elimination import _swings, eliminate, is_late
from vdmsi_jax.diagnose.search.selection import _passed_by
from vdmsi_jax.diagnose.signals.runs import lay_out

PLANT, DT, LAG = vj.PlantSpec("servo", "u", "y"), 0.02, 0.3


def made(run: int, late: int) -> vj.Record:
    """One lag of held commands that come some samples late, with noise."""
    rng = np.random.default_rng(run)
    u = np.repeat(rng.uniform(-1.0, 1.0, 20), 40)
    come = np.concatenate([np.full(late, u[0]), u[: len(u) - late]])
    y, keep = np.empty(len(u)), np.exp(-DT / LAG)
    y[0] = come[0]
    for k in range(1, len(u)):
        y[k] = keep * y[k - 1] + (1.0 - keep) * come[k - 1]
    y += 0.02 * rng.standard_normal(len(u))
    return vj.Record.from_arrays(dt=DT, name=f"{run}", plants=(PLANT,), u=u, y=y)


def fitted(late: int) -> tuple:
    """A stage, the lag with a delay, and three lags without one."""
    stage = stage_of(lay_out([made(run, late) for run in range(2)]), PLANT)
    number = next(i for i, slot in enumerate(stage.slots) if slot.cause == "transport_delay")
    grid = baselines(stage)
    theta = grid[1, 0].hypothesis.theta.copy()
    theta[list(stage.slots[number].index)] = 0.06
    return stage, refit(stage, [Hypothesis(1, 0, (number,), theta)])[0], grid[3, 0]


@pytest.fixture(scope="module")
def of_a_late_command():
    return fitted(late=4)


def test_a_smaller_plant_with_a_delay_that_is_likelier_is_told(of_a_late_command):
    stage, delay, poles = of_a_late_command
    assert is_late(stage, delay, poles, {})
    seen = {f.hypothesis.kind: f for f in (delay, poles)}
    assert eliminate(stage, delay, seen).hypothesis.kind == delay.hypothesis.kind


def test_only_lightly_damped_poles_about_a_mode_are_told_by_its_name(of_a_late_command):
    """Lags that a cause replaces, and a mode elsewhere, are none."""
    stage, _, lags = of_a_late_command

    def swings(frequency: float, damping: float) -> bool:
        size = frequency / stage.pace
        theta = lags.hypothesis.theta.copy()
        theta[:4] = np.poly([-1.0, *np.roots([1.0, 2.0 * damping * size, size**2])])[
            1:
        ].tolist() + [0.0]
        return _swings(stage, Hypothesis(3, 0, (), theta), 9.0)

    assert not _swings(stage, lags.hypothesis, 9.0)
    assert swings(9.0, 0.05) and swings(12.0, 0.2)
    assert not swings(9.0, 0.6) and not swings(30.0, 0.05)


def test_what_is_no_likelier_is_not(of_a_late_command):
    stage, delay, poles = of_a_late_command
    assert not is_late(stage, replace(delay, loglik=poles.loglik + 1.0), poles, {})
    assert not is_late(stage, poles, delay, {})


def test_a_larger_plant_with_a_delay_pays_its_price(of_a_late_command):
    stage, delay, poles = of_a_late_command
    larger: Refit = replace(delay, hypothesis=replace(delay.hypothesis, poles=3, zeros=1))
    assert not is_late(stage, larger, poles, {})


def test_a_long_delay_has_a_start_near_it():
    late = 50
    stage = stage_of(lay_out([made(run, late) for run in range(2)]), PLANT)
    starts = delayed(stage, baselines(stage)[1, 0])
    found = [h.theta[stage.slots[h.active[0]].index[0]] for h in starts]
    assert min(abs(np.log(value / (late * DT))) for value in found) < np.log(1.3)


def test_a_plainer_form_of_the_first_cause_is_followed_too():
    """A valve's dead zone: what its finer form has beside may be the next cause's."""
    runs = [made(run, late=0) for run in range(2)]
    dead = [replace(r, channels=r.channels | {"u": r["u"] + 0.2 * np.sign(r["u"])}) for r in runs]
    stage = stage_of(lay_out(dead), PLANT)
    plain = baselines(stage)[1, 0]
    late, plainer = (
        next(i for i, slot in enumerate(stage.slots) if slot.names == names)
        for names in (("half_width", "before"), ("half_width",))
    )
    starts = []
    for number, values in ((late, (0.2, 0.005)), (plainer, (0.2,))):
        theta = plain.hypothesis.theta.copy()
        theta[list(stage.slots[number].index)] = values
        starts.append(Hypothesis(1, 0, (number,), theta))
    fine, rough = refit(stage, starts)
    assert _passed_by(stage, plain, fine, [plain, fine, rough]) == [rough]
    assert _passed_by(stage, plain, rough, [plain, fine, rough]) == []
