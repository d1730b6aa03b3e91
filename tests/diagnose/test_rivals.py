"""What could stand in the place of a cause."""

import numpy as np

import vdmsi_jax as vj
from vdmsi_jax.diagnose import swing
from vdmsi_jax.diagnose.baseline import baselines
from vdmsi_jax.diagnose.found import MARGIN
from vdmsi_jax.diagnose.hypothesis import Hypothesis
from vdmsi_jax.diagnose.prepare import stage_of
from vdmsi_jax.diagnose.price import lack
from vdmsi_jax.diagnose.refit import refit
from vdmsi_jax.diagnose.rivals import findings_of, worths
from vdmsi_jax.diagnose.runs import lay_out
from vdmsi_jax.diagnose.starts import added, number_of

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
