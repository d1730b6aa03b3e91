"""What could stand in the place of a cause."""

from dataclasses import replace

import numpy as np
import pytest

import vdmsi_jax as vj
from vdmsi_jax.diagnose.actuator import swing
from vdmsi_jax.diagnose.actuator.hypothesis import Hypothesis
from vdmsi_jax.diagnose.actuator.refit import refit
from vdmsi_jax.diagnose.actuator.starts import added, number_of
from vdmsi_jax.diagnose.prepare import stage_of
from vdmsi_jax.diagnose.search.baseline import baselines
from vdmsi_jax.diagnose.search.found import MARGIN, PlantFinding
from vdmsi_jax.diagnose.search.price import lack
from vdmsi_jax.diagnose.search.rivals import _may_bend, _twin, _undying, findings_of, worths
from vdmsi_jax.diagnose.signals.runs import lay_out

PLANT, DT, LAG, BIAS = vj.PlantSpec("servo", "u", "y"), 0.02, 0.3, 0.2


def made(run: int) -> vj.Record:
    """One lag of held commands that are off by a bias, with noise."""
    rng = np.random.default_rng(run)
    u = np.repeat(rng.uniform(-1.0, 1.0, 20), 40)
    y, keep = np.full(len(u), u[0] + BIAS), np.exp(-DT / LAG)
    for k in range(1, len(u)):
        y[k] = keep * y[k - 1] + (1.0 - keep) * (u[k - 1] + BIAS)
    y += 0.02 * rng.standard_normal(len(u))
    return vj.Record.from_arrays(dt=DT, name=f"{run}", plants=(PLANT,), u=u, y=y)


def test_what_hardly_swings_does_not_stand_in_for_an_offset():
    """A level of each run's own explains whatever a level of all runs does."""
    stage = stage_of(lay_out([made(run) for run in range(2)]), PLANT)
    grid = baselines(stage)
    plain = grid[1, 0].hypothesis
    offset, swings = (number_of(stage, cause) for cause in ("offset", swing.CAUSE))
    (now,) = refit(stage, [added(stage, plain, offset, BIAS)])
    theta = now.hypothesis.theta.copy()
    theta[list(stage.slots[offset].index)] = 0.0
    theta[stage.slots[swings].index[0]] = 0.1 / stage.scales.duration
    (drifting,) = refit(stage, [Hypothesis(1, 0, (swings,), theta, np.full((2, 2), BIAS))])
    assert lack(stage, now, drifting) < MARGIN
    seen = {f.hypothesis.kind: f for f in (*grid.values(), now, drifting)}
    (found,), other = findings_of(stage, worths(stage, now), now, seen)
    assert swings not in dict(found.others)
    assert other is None or swings not in other.hypothesis.active


@pytest.mark.parametrize(
    ("lacks", "beside", "told"), [(10.0, 5.0, True), (260.0, 5.0, False), (10.0, 90.0, False)]
)
def test_a_play_that_mends_a_friction_says_that_it_may_be_one(lacks, beside, told):
    stage = stage_of(lay_out([made(run) for run in range(2)]), PLANT)
    (plain,) = refit(stage, [baselines(stage)[1, 0].hypothesis])
    friction, play = (number_of(stage, c) for c in ("coulomb_friction", "backlash"))
    other = next(k for k in stage.allowed if stage.slots[k].cause == "backlash" and k != play)

    def alike(gain: float, *active: int):
        h = replace(plain.hypothesis, active=tuple(sorted(active)))
        return replace(plain, hypothesis=h, loglik=plain.loglik + 0.5 * gain)

    rubs, plays = alike(500.0, friction), alike(500.0 - lacks, play)
    final = alike(500.0 + beside, friction, other)
    seen = {f.hypothesis.kind: f for f in (plain, rubs, plays, final)}
    both = [PlantFinding(friction, 500.0, alike(0.0, other)), PlantFinding(other, beside, rubs)]

    twin = _twin(stage, both[0], both, final, seen)

    assert (twin is not None) is told
    if twin is not None:
        assert twin == (play, pytest.approx(lack(stage, rubs, plays)))


@pytest.mark.parametrize(
    ("limit", "corner", "lacks", "gain", "told"),
    [
        (2.0, 0.02, 300.0, 500.0, True),  # which no command reaches
        (0.5, 0.02, 10.0, 500.0, False),
        (0.5, 0.45, 10.0, 50.0, True),
        (0.5, 0.45, 300.0, 500.0, False),
        (0.5, 0.45, 175.0, 2255.0, True),  # a concave map, which no formula meets exactly
    ],
)
def test_a_limit_with_a_wide_corner_may_be_a_bend(limit, corner, lacks, gain, told):
    stage = stage_of(lay_out([made(run) for run in range(2)]), PLANT)
    (plain,) = refit(stage, [baselines(stage)[1, 0].hypothesis])
    number, sharp = (
        next(
            k
            for k in stage.allowed
            if stage.slots[k].cause == "saturation"
            if getattr(stage.slots[k].effect, "at", "") == at
        )
        for at in ("corner", "command")
    )
    theta = plain.hypothesis.theta.copy()
    theta[list(stage.slots[number].index)] = 1.0 / limit, 1.0 / limit, corner
    fit = replace(plain, hypothesis=replace(plain.hypothesis, active=(number,), theta=theta))
    assert _may_bend(stage, fit, number, lacks, gain) is told
    assert not _may_bend(stage, fit, sharp, lacks, gain)


@pytest.mark.parametrize(("damping", "undying"), [(0.005, True), (0.02, False)])
def test_a_mode_with_as_little_damping_as_it_may_have_may_be_a_line(damping, undying):
    stage = stage_of(lay_out([made(run) for run in range(2)]), PLANT)
    plain = baselines(stage)[1, 0]
    number = number_of(stage, "resonance")
    told = added(stage, plain.hypothesis, number, 1.0 / stage.scales.duration)
    theta = told.theta.copy()
    slot = stage.slots[number]
    theta[slot.index[slot.names.index("damping")]] = damping
    fit = replace(plain, hypothesis=replace(told, theta=theta))
    assert _undying(stage, fit, number) is undying
    assert not _undying(stage, fit, number_of(stage, "offset"))
