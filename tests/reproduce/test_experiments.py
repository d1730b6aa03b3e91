"""The experiments on the shipped logs: what the numbers mean, and that they hold."""

import dataclasses
import math

import numpy as np
import pytest

from vdmsi_jax.errors import InputError
from vdmsi_jax.metrics import Alignment, ate
from vdmsi_jax.models.bicycle import Bicycle
from vdmsi_jax.models.commands import Commands
from vdmsi_jax.models.vehicle import Vehicle
from vdmsi_jax.reproduce import COURSES, SHIPPED, TRIMS
from vdmsi_jax.reproduce.closed_loop import COLUMNS, DeadReckoning, judge, moved
from vdmsi_jax.reproduce.course import PAPER_SPEED, Pursuer, ramped, stepped
from vdmsi_jax.reproduce.logs import mixed, read_logs, read_run
from vdmsi_jax.reproduce.open_loop import gain
from vdmsi_jax.reproduce.published import TABLE_3
from vdmsi_jax.reproduce.vdm import Rule, vdm
from vdmsi_jax.simulate import Start
from vdmsi_jax.testbed import ROW, Car, Sighting

BEND, S_CURVE = COURSES
GEOMETRY = Car().dimensions.geometry


def test_the_published_improvements_follow_from_the_published_errors():
    said = {"bend": (72.88, 70.44, 72.07), "s_curve": (84.37, 78.05, 80.26)}
    for course, improved in said.items():
        rows = TABLE_3[course]
        for name, value in zip(("max", "mean", "rmse"), improved, strict=True):
            got = gain(rows["VDM"][name], rows["VDM-SI"][name])
            assert got == pytest.approx(value, abs=0.12)  # the rounding of the entries


def test_the_courses_are_the_papers():
    assert BEND.exit - BEND.entrance == pytest.approx(20.0 * math.pi / 2)
    assert S_CURVE.exit - S_CURVE.entrance == pytest.approx(15.0 * math.pi)
    poses = BEND.track.at(np.array([5.0, 30.0, 60.0]))
    np.testing.assert_allclose(BEND.progress(poses), [5.0, 30.0, 60.0], atol=0.02)
    np.testing.assert_allclose(BEND.deviation(poses), 0.0, atol=2e-3)  # a path of points
    assert pytest.approx(4.1667, abs=1e-4) == PAPER_SPEED == ramped(10_000) == stepped(100)
    assert ramped(0) == stepped(99) == 0.0


def test_mixed_driving_stays_below_the_courses_speed_and_a_planners_acceleration():
    v, delta = mixed(1)
    assert v.max() <= 4.2 and np.abs(np.diff(v)).max() <= 1.5 * ROW + 1e-12
    assert (mixed(1)[1] == delta).all() and (mixed(2)[1] != delta).any()


@pytest.mark.slow
def test_vdm_si_lowers_every_error_of_table_3(one):
    """By 70 % and more with all orders, which the slow test asks for."""
    for found in one.open_loop.values():
        vdm_errors, si = (found.estimates[m].ate for m in ("VDM", "VDM-SI"))
        assert all(gain(vdm_errors[name], si[name]) > 50.0 for name in si)


def test_without_sensors_vdm_si_lowers_the_error_by_sixty_percent_on_the_sound_car():
    for course in COURSES:
        at_exit = {}
        for key in ("vdm", "vdm_si"):
            path = SHIPPED / "sound" / f"closed_{course.name}.{key}.csv"
            run = judge(key, course, read_run(path))
            at_exit[key] = run.error[run.at_exit]
        assert gain(at_exit["vdm"], at_exit["vdm_si"]) > 60.0


@pytest.mark.slow
def test_table_3_is_the_error_metric_on_the_part_from_the_bend_on(one):
    for found in one.open_loop.values():
        own = found.estimates["VDM-SI"]
        direct = ate(found.measured, own.poses, Alignment.NONE)
        for name, value in own.ate.items():
            assert value == pytest.approx(float(direct[name]), rel=1e-9)
        assert own.error[0] == pytest.approx(0.0, abs=1e-12)
        assert found.course.progress(found.measured[:1])[0] == pytest.approx(20.0, abs=0.1)


@pytest.mark.slow
def test_the_rules_agree_where_the_command_does_not_jump_and_part_where_it_does(one):
    found = one.open_loop["bend"]
    smooth = found.rules["ramp"]
    assert smooth[Rule.DIFFERENCE] == pytest.approx(smooth[Rule.LIMITED_DIFFERENCE], rel=1e-6)
    jump = found.rules["step"]
    # 4.5 m/s² for one row is all that is left of a step
    assert jump[Rule.LIMITED_DIFFERENCE]["mean"] > 5.0 * jump[Rule.DIFFERENCE]["mean"]


def test_the_rules_on_a_step_are_what_they_say():
    rows, start = 301, Start(v=0.0)
    commands = Commands(np.where(np.arange(rows) >= 100, 4.5, 0.0), np.zeros(rows), ROW)
    way = {rule: float(vdm(rule, commands, GEOMETRY, start, 4.5).x[-1]) for rule in Rule}
    assert way[Rule.VELOCITY] == pytest.approx(9.0)  # 4.5 m/s for 2 s
    assert way[Rule.DIFFERENCE] == pytest.approx(9.0)
    assert way[Rule.RATE_LIMITED] == pytest.approx(9.0 - 0.5 * 4.5, abs=1e-6)
    assert way[Rule.LIMITED_DIFFERENCE] == pytest.approx(0.045 * 2.0)


def test_dead_reckoning_hears_every_command_and_starts_from_the_last_sighting():
    rows, vehicle = 400, Vehicle(Bicycle(1.75, 1.2))
    reckoning = DeadReckoning(vehicle, BEND, rows)
    before = Sighting(100, np.array([19.0, 0.1, 0.02]))
    commands = np.tile([4.0, 0.0], (120, 1))
    np.testing.assert_array_equal(reckoning(120, before, commands), before.pose)
    assert reckoning.cut is None
    there = Sighting(110, np.array([20.5, 0.1, 0.02]))
    pose = reckoning(120, there, commands)
    assert reckoning.cut == 110
    expected = there.pose + 0.4 * np.array([np.cos(0.02), np.sin(0.02), 0.0])
    np.testing.assert_allclose(pose, expected, atol=1e-9)
    nonsense = Sighting(130, np.array([99.0, 99.0, 9.0]))  # the sensor is cut
    later = reckoning(130, nonsense, np.tile([4.0, 0.0], (130, 1)))
    np.testing.assert_allclose(later - pose, pose - there.pose, atol=1e-9)


def test_moved_is_a_rigid_motion():
    origin, target = np.array([1.0, 2.0, 0.3]), np.array([-4.0, 0.5, 1.1])
    np.testing.assert_allclose(moved(origin, origin, target), target)
    ahead = origin + [np.cos(0.3), np.sin(0.3), 0.2]
    np.testing.assert_allclose(
        moved(ahead, origin, target), target + [np.cos(1.1), np.sin(1.1), 0.2], atol=1e-12
    )


def test_a_recorded_run_is_judged_by_distance():
    s = np.linspace(20.0, 60.0, 50)
    poses = BEND.track.at(s)
    columns = dict(zip(COLUMNS, [s - 20.0, *poses.T, *(poses + [0.3, 0.4, 0.0]).T], strict=True))
    run = judge("VDM", BEND, columns)
    np.testing.assert_allclose(run.error, 0.5)
    np.testing.assert_allclose(run.deviation, 0.0, atol=2e-3)
    assert s[run.at_exit] == pytest.approx(BEND.exit, abs=1.0)


def test_a_pursuer_looks_every_other_row():
    pursuer = Pursuer(BEND, GEOMETRY, limit=0.5, rows=10)
    seen = Sighting(0, np.array([5.0, 0.5, 0.0]))
    asked = [pursuer(k, seen)[1] for k in range(4)]
    assert asked[0] == asked[1] < 0.0 and asked[2] == asked[3]
    assert (pursuer.believed[:4] == seen.pose).all()


def test_missing_logs_are_refused_with_the_mend(tmp_path):
    with pytest.raises(InputError, match="vdmsi reproduce --engine"):
        read_logs(tmp_path)
    with pytest.raises(InputError, match="no such run"):
        read_run(tmp_path / "closed_bend.vdm.csv")
    (tmp_path / "bad.csv").write_text("t,x\n1,oops\n")
    with pytest.raises(InputError, match="record the run anew"):
        read_run(tmp_path / "bad.csv")


def test_the_shipped_logs_are_of_the_cars_that_are_stated():
    from vdmsi_jax.testbed import vehicle_toml

    for trim in TRIMS:
        assert (SHIPPED / trim.name / "vehicle.toml").read_text() == vehicle_toml(trim.car)
    assert dataclasses.asdict(TRIMS[0].car) == dataclasses.asdict(Car())
