"""Pure pursuit: its geometry against arcs known exactly, and that it drives a bicycle along a
track."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from vdmsi_jax import scenarios
from vdmsi_jax.control import PurePursuit

WHEELBASE, L_R = 2.95, 1.2
LINE = np.array([[0.0, 0.0], [10.0, 0.0], [30.0, 0.0]])


def on_line(**options):
    return PurePursuit(LINE, WHEELBASE, **options)


def test_on_the_path_it_goes_straight():
    assert abs(float(on_line()(np.array([3.0, 0.0, 0.0]), 4.0))) < 1e-12


def test_the_goal_is_one_lookahead_away_on_the_path():
    goal = on_line().goal(np.array([8.0, 1.5]), 2.5)
    np.testing.assert_allclose(goal, [10.0, 0.0], atol=1e-9)  # 2² + 1.5² = 2.5²


def test_the_arc_is_tangent_to_the_body_and_meets_the_goal():
    pose, v, control = np.array([5.0, -1.0, 0.3]), 4.0, on_line(limit=1.5)
    curvature = np.tan(control(pose, v)) / WHEELBASE
    goal = np.asarray(control.goal(pose[:2], 2.8))
    centre = pose[:2] + np.array([-np.sin(pose[2]), np.cos(pose[2])]) / curvature
    np.testing.assert_allclose(np.hypot(*(goal - centre)), abs(1.0 / curvature), rtol=1e-12)


def test_the_lookahead_grows_with_speed_from_its_least():
    pose = np.array([5.0, 1.0, 0.0])
    slow, slower, fast = (float(on_line()(pose, v)) for v in (1.0, 0.0, 8.0))
    assert slow == slower < fast < 0.0


def test_a_pose_of_the_centre_of_gravity_is_taken_to_the_rear_axle():
    rear = np.array([4.0, 0.5, 0.2])
    cog = rear + L_R * np.array([np.cos(0.2), np.sin(0.2), 0.0])
    there = on_line(rear_to_reference=L_R)(cog, 4.0)
    assert float(there) == pytest.approx(float(on_line()(rear, 4.0)), abs=1e-12)


def test_far_away_it_aims_at_the_nearest_point_and_beyond_the_end_it_goes_on():
    np.testing.assert_allclose(on_line().goal(np.array([12.0, 9.0]), 2.5), [12.0, 0.0], atol=1e-9)
    np.testing.assert_allclose(on_line().goal(np.array([40.0, 0.0]), 2.5), [42.5, 0.0], atol=1e-9)


def test_the_angle_is_limited():
    assert float(on_line(limit=0.4)(np.array([5.0, 2.0, 0.0]), 0.0)) == pytest.approx(-0.4)


def test_progress_is_distance_and_deviation():
    along, left = on_line().progress(np.array([12.0, -0.5]))
    assert (float(along), float(left)) == (12.0, -0.5)


def test_a_path_of_one_point_is_refused():
    with pytest.raises(ValueError, match="2 or more"):
        PurePursuit(np.zeros((1, 2)), WHEELBASE)


@pytest.mark.parametrize("track", [scenarios.bend(), scenarios.s_curve()], ids=["bend", "s_curve"])
def test_a_bicycle_stays_on_the_papers_tracks_and_the_loop_is_jitted_and_differentiable(track):
    path = track.at(np.linspace(0.0, track.length, 400))[:, :2]

    @eqx.filter_jit
    def worst(lookahead_time):
        control = PurePursuit(path, WHEELBASE, L_R, lookahead_time)
        v, dt = scenarios.PAPER_SPEED, 0.02

        def step(pose, _):
            delta = control(pose, v)
            beta = jnp.arctan(L_R / WHEELBASE * jnp.tan(delta))
            rate = jnp.stack(
                [jnp.cos(pose[2] + beta), jnp.sin(pose[2] + beta), jnp.sin(beta) / L_R]
            )
            rear = pose[:2] - L_R * jnp.stack([jnp.cos(pose[2]), jnp.sin(pose[2])])
            return pose + dt * v * rate, control.progress(rear)[1]

        rows = int(track.length / v / dt)
        return jnp.max(jnp.abs(jax.lax.scan(step, jnp.array([L_R, 0.0, 0.0]), length=rows)[1]))

    # A pure pursuit cuts corners by about lookahead² / (8 radius); 2.9 m here.
    assert float(worst(0.7)) < 0.2
    assert np.isfinite(jax.grad(worst)(0.7))
