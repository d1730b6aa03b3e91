"""Logs in which next to nothing moves, and such without noise, as they are made up at first."""

import numpy as np
import pytest

import vdmsi_jax as vj
from vdmsi_jax.diagnose.actuator.hypothesis import Hypothesis, growth
from vdmsi_jax.diagnose.actuator.lanes import POLES
from vdmsi_jax.diagnose.actuator.starts import _steps
from vdmsi_jax.diagnose.prepare import stage_of
from vdmsi_jax.diagnose.search.judge import Scored, gain_of
from vdmsi_jax.diagnose.signals.runs import lay_out

SPEC = vj.PlantSpec("motor", "u", "y")


def stage_with(u: np.ndarray, y: np.ndarray):
    log = vj.Record.from_arrays(dt=0.05, name="log", u=u, y=y, plants=(SPEC,))
    return stage_of(lay_out([log]), SPEC)


def test_a_response_to_one_impulse_has_a_size():
    u = np.zeros(500)
    u[100] = 1.0
    scales = stage_with(u, 2.5 * u).scales
    assert scales.response == pytest.approx(2.5) and scales.command == pytest.approx(1.0)


def test_the_steps_that_are_tried_of_a_command_far_from_zero_have_an_end():
    u = 1e5 + np.where(np.arange(500) > 100, 1.0, 0.0)
    sizes = _steps(stage_with(u, u).scales)
    assert 100 < len(sizes) < 5000 and sizes[-1] > 0.2


def test_a_plant_out_of_all_bounds_grows_without_end():
    u = np.where(np.arange(500) > 100, 1.0, 0.0)
    stage = stage_with(u, u)
    theta = stage.off.copy()
    theta[[0, POLES]] = 1.0
    lost = theta.copy()
    lost[0] = np.nan
    sound, endless = growth(stage, [Hypothesis(1, 0, (), theta), Hypothesis(1, 0, (), lost)])
    assert sound <= 0.0 and endless == np.inf


def test_a_gain_whose_movement_is_all_in_one_block_is_known_to_its_own_size():
    y = np.where(np.arange(1000) == 500, 1.0, 0.0)[None]
    scored = Scored("y", y, 0.5 * y, 0.9 * y, np.zeros(1))
    gain = gain_of(scored, np.ones((1, 1000), bool), True, 0.02)
    assert gain.se == pytest.approx(gain.after - gain.before) and 0.0 < gain.se < np.inf


@pytest.mark.slow
def test_a_made_up_drive_straight_on_is_diagnosed():
    """Whose angle, yaw rate and heading are nothing at all, and without noise."""
    u = np.repeat(np.random.default_rng(0).uniform(0.5, 2.0, 20), 30)
    v = np.convolve(u, 0.1 * 0.9 ** np.arange(100))[: u.size]
    x, none = np.cumsum(v) * 0.05, np.zeros(u.size)
    drive = dict(v_cmd=u, delta_cmd=none, v=v, delta=none, r=none, x=x, y=none, psi=none)
    car = vj.VehicleGeometry(l_f=1.0, l_r=1.0)
    found = vj.diagnose(vj.Record.from_arrays(dt=0.05, name="run", vehicle=car, **drive))
    assert found.channels["v"].fit > 99.0
    assert all(np.isfinite(f.gain.se) for f in (*found.findings, *found.minor))
