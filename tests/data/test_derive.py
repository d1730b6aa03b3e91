"""Derived channels against the bicycle they come from, simulated here with other formulas."""

import numpy as np
import pytest

from small_logs import write_csv
from vdmsi_jax.config import Config, Derivation, VehicleGeometry
from vdmsi_jax.data import read_log
from vdmsi_jax.data.derive import (
    differentiate,
    steering_from_curvature,
    steering_from_yaw_rate,
    yaw_rate_from_steering,
)
from vdmsi_jax.errors import InputError

VEHICLES = [
    VehicleGeometry(1.75, 1.20),
    VehicleGeometry(1.75, 1.20, "rear_axle"),
    VehicleGeometry(0.08, 0.07, "sensor", 0.05),
    VehicleGeometry(1.0, 1.5, "sensor", -2.0),  # behind the rear axle
]


def no_slip(vehicle, rear_speed, delta):
    """Velocity of the reference point of a rigid body whose rear axle rolls straight ahead.

    Returns speed along the course (signed by direction of travel) and yaw rate.
    """
    yaw_rate = rear_speed * np.tan(delta) / (vehicle.l_f + vehicle.l_r)
    ahead = {"cog": vehicle.l_r, "rear_axle": 0.0}.get(
        vehicle.reference_point, vehicle.l_r + (vehicle.lever_arm or 0.0)
    )
    velocity = rear_speed + 1j * ahead * yaw_rate
    return np.sign(rear_speed) * np.abs(velocity), yaw_rate


@pytest.mark.parametrize("vehicle", VEHICLES, ids=lambda v: f"{v.reference_point} {v.lever_arm}")
@pytest.mark.parametrize("direction", [1.0, -1.0])
def test_the_angle_comes_back_from_the_motion(vehicle, direction):
    delta = np.linspace(-0.6, 0.6, 101)
    speed, yaw_rate = no_slip(vehicle, direction * 2.0, delta)
    found, known = steering_from_yaw_rate(yaw_rate, speed, vehicle, min_speed=0.1)
    assert known.all()
    np.testing.assert_allclose(found, delta, atol=1e-12)
    np.testing.assert_allclose(yaw_rate_from_steering(speed, delta, vehicle), yaw_rate, atol=1e-12)
    np.testing.assert_allclose(
        steering_from_curvature(yaw_rate / speed, vehicle), delta, atol=1e-12
    )


def test_the_paper_s_equation_at_the_centre_of_gravity():
    """Eq. (1): r = v sin(β)/l_r with β = atan(l_r tan δ / (l_f + l_r))."""
    vehicle, v, delta = VehicleGeometry(1.75, 1.2), 5.0, 0.3
    beta = np.arctan(1.2 / 2.95 * np.tan(delta))
    found = yaw_rate_from_steering(np.array([v]), np.array([delta]), vehicle)
    assert found[0] == pytest.approx(v / 1.2 * np.sin(beta), rel=1e-14)


def test_what_the_reference_point_is_matters():
    """Taking the rear axle's log for the centre of gravity's is a false angle, not a rounding
    error."""
    rear = VehicleGeometry(1.75, 1.2, "rear_axle")
    speed, yaw_rate = no_slip(rear, 5.0, np.array([0.5]))
    wrong, _ = steering_from_yaw_rate(yaw_rate, speed, VehicleGeometry(1.75, 1.2), 0.1)
    assert wrong[0] - 0.5 > 0.005


def log_of(tmp_path, columns, vehicle=None, **rules):
    path = write_csv(tmp_path / "run.csv", columns)
    derive = {name: Derivation(**how) for name, how in rules.items()}
    return read_log(path, Config(vehicle=vehicle, derive=derive))


def test_the_angle_is_not_told_at_low_speed(tmp_path):
    t = 0.01 * np.arange(400)
    vehicle = VehicleGeometry(0.1, 0.1)
    rear = 2.0 * np.cos(np.pi * t / 2)
    delta = 0.2 + 0.05 * t
    v, r = no_slip(vehicle, rear, delta)
    r = r + np.where(np.abs(v) < 0.3, 3.0, 0.0)  # what a sensor says at a stop is worth nothing
    how = {"rule": "steering_from_yaw_rate", "min_speed": 0.3}
    log = log_of(tmp_path, {"t": t, "v": v, "r": r}, vehicle, delta=how)
    slow = np.abs(v) < 0.3
    np.testing.assert_array_equal(log.measured("delta"), ~slow)
    np.testing.assert_allclose(log["delta"], delta, atol=1e-3)  # interpolated over the stop
    assert log.measured("v").all() and log.units["delta"] == "rad"
    assert f"interpolated delta in {slow.sum()} of 400 samples" in log.repairs[0]


def test_an_angle_needs_speed_somewhere(tmp_path):
    columns = {"t": 0.01 * np.arange(50), "v": np.full(50, 0.1), "r": np.zeros(50)}
    with pytest.raises(InputError, match="never reaches min_speed"):
        log_of(
            tmp_path, columns, VehicleGeometry(1.0, 1.0), delta={"rule": "steering_from_yaw_rate"}
        )


@pytest.mark.parametrize("direction", [1.0, -1.0])
@pytest.mark.parametrize("window", [0.04, 0.4])
def test_speed_and_yaw_rate_from_the_pose(tmp_path, direction, window):
    """A circle of 2 m at 1.5 m/s, forward and in reverse. A parabola cuts it short, which is put
    right; at both ends it looks to one side only."""
    t = 0.01 * np.arange(600)
    turn = direction * 0.75
    psi = 0.4 + turn * t
    x, y = 2.0 * np.sin(psi), -2.0 * np.cos(psi)
    wrapped = (psi + np.pi) % (2 * np.pi) - np.pi
    rules = {"v": "speed_from_pose", "r": "yaw_rate_from_heading"}
    rules = {name: {"rule": rule, "window": window} for name, rule in rules.items()}
    log = log_of(tmp_path, {"t": t, "x": x, "y": y, "psi": wrapped}, **rules)
    ends, told = round(50 * window), log.measured("v")
    assert told[ends:-ends].all() and not told[:ends].any() and not told[-ends:].any()
    np.testing.assert_allclose(log["v"][told], direction * 1.5, rtol=1e-6)
    np.testing.assert_allclose(log["r"], turn, rtol=1e-9)


def test_the_noise_of_a_pose_does_not_add_to_the_speed_of_a_vehicle(tmp_path):
    """A mean speed of 0.2 m/s, told by positions with noise of 2 mm at 100 Hz, over 50 ms."""
    t = 0.01 * np.arange(6000)
    x, y = 0.002 * np.random.default_rng(0).standard_normal((2, t.size))
    rules = {"v": {"rule": "speed_from_pose", "window": 0.04}}
    columns = {"t": t, "x": 0.2 * t + x, "y": y, "psi": np.zeros(t.size)}
    assert log_of(tmp_path, columns, **rules)["v"].mean() > 0.21
    vehicle = VehicleGeometry(0.5, 0.5)
    assert log_of(tmp_path, columns, vehicle, **rules)["v"].mean() == pytest.approx(0.2, rel=2e-3)


def test_acceleration_from_speed(tmp_path):
    t = 0.01 * np.arange(500)
    log = log_of(tmp_path, {"t": t, "v": np.sin(2 * t)}, a={"rule": "acceleration_from_speed"})
    np.testing.assert_allclose(log["a"], 2 * np.cos(2 * t), atol=2e-3)
    assert log.units["a"] == "m/s^2"


@pytest.mark.parametrize("samples", [3, 5, 9])
def test_slopes_of_parabolas_are_exact(samples):
    t = 0.1 * np.arange(40)
    np.testing.assert_allclose(differentiate(2 - t + 3 * t**2, 0.1, samples), 6 * t - 1, atol=1e-10)


@pytest.mark.parametrize("n", [1, 2, 3, 4, 6])
def test_slopes_of_few_samples(n):
    slope = differentiate(2.0 * np.arange(n), 0.5, 7)
    np.testing.assert_allclose(slope, 4.0 if n > 1 else 0.0, atol=1e-12)


def test_wider_windows_let_less_noise_through():
    noise = np.random.default_rng(0).standard_normal(5000)
    spread = [differentiate(noise, 0.01, samples).std() for samples in (3, 5, 9, 21)]
    assert spread == sorted(spread, reverse=True)
    # least squares: variance σ²/(h² Σ k²), here Σ k² = 60 for k = -4 ... 4
    assert spread[2] == pytest.approx(1 / (0.01 * np.sqrt(60)), rel=0.05)


def test_slopes_do_not_look_across_gaps(tmp_path):
    t = np.r_[0.01 * np.arange(100), 10 + 0.01 * np.arange(100)]
    columns = {"t": t, "v": np.r_[t[:100], 50 - t[100:]]}
    log = log_of(tmp_path, columns, a={"rule": "acceleration_from_speed"})
    np.testing.assert_allclose(log["a"], np.repeat([1.0, -1.0], 100), atol=1e-9)


def test_expressions_and_chains(tmp_path):
    t = 0.01 * np.arange(100)
    columns = {"t": t, "v": 1 + t, "v_cmd": 2 + 0 * t}
    rules = {
        "ratio": {"expression": "100 * v / v_cmd", "unit": "%"},
        "twice": {"expression": "2 * ratio", "unit": "1"},
        "level": {"expression": "3", "unit": "km/h"},
    }
    log = log_of(tmp_path, columns, **rules)
    np.testing.assert_allclose(log["twice"], 1 + t)
    np.testing.assert_allclose(log["level"], 3 / 3.6)
    assert log.units["level"] == "m/s"


def test_what_was_filled_in_stays_marked(tmp_path):
    t = np.delete(0.01 * np.arange(100), [50])
    log = log_of(
        tmp_path, {"t": t, "v": t, "v_cmd": t}, e={"expression": "v_cmd - v", "unit": "m/s"}
    )
    assert np.flatnonzero(~log.measured("e")).tolist() == [50]


def test_replacing_a_column_is_told(tmp_path):
    t = 0.01 * np.arange(100)
    log = log_of(tmp_path, {"t": t, "v": t, "a": 7 + 0 * t}, a={"rule": "acceleration_from_speed"})
    np.testing.assert_allclose(log["a"], 1.0, atol=1e-9)
    assert "derived a in place of its column in the log" in log.repairs
