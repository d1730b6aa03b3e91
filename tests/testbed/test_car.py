"""The test vehicle: what it is made of, and that each physical switch does what it is called."""

import math
import sys
from dataclasses import replace

import numpy as np
import pytest

from vdmsi_jax.errors import InputError
from vdmsi_jax.models.bicycle import Bicycle
from vdmsi_jax.testbed import (
    ROW,
    UNITS,
    Car,
    Causes,
    Controllers,
    Dimensions,
    PoseSensor,
    drive,
    replay,
)
from vdmsi_jax.testbed.mjcf import knuckle_polynomial

V, R, DELTA = 3, 4, 5  # columns of the truth


def driven(causes=None, *, v=2.0, delta=0.0, duration=6.0, car=None):
    """A drive at constant commands, from rest; the steering is asked for after a second."""
    pytest.importorskip("mujoco")
    car = replace(car or Car(), causes=causes or Causes())
    rows = round(duration / ROW) + 1
    angle = np.where(np.arange(rows) * ROW >= 1.0, delta, 0.0)
    return drive(car, replay(np.full(rows, v), angle), duration=duration, seed=0)


def test_every_number_has_a_unit():
    for part in (Dimensions(), Controllers(), Causes(), PoseSensor()):
        assert set(vars(part)) - {"geometry"} <= set(UNITS)


@pytest.mark.parametrize("name", ["steering_play", "command_delay"])
def test_a_negative_size_is_refused(name):
    with pytest.raises(InputError, match=name):
        Causes(**{name: -0.1})


def test_a_sensor_that_does_not_fit_the_rows_is_refused():
    car = Car(sensor=PoseSensor(rate=30.0))
    with pytest.raises(InputError, match="give 100, 50"):
        drive(car, replay(np.zeros(3), np.zeros(3)), duration=0.02, seed=0)


def test_without_mujoco_it_says_what_to_install(monkeypatch):
    monkeypatch.setitem(sys.modules, "mujoco", None)
    with pytest.raises(InputError, match=r"pip install vdmsi_jax\[mujoco\]"):
        drive(Car(), replay(np.zeros(3), np.zeros(3)), duration=0.02, seed=0)


def test_the_knuckles_keep_ackermanns_geometry():
    car = Car(controllers=Controllers(steering_ratio=1.0))
    middle = np.linspace(-0.6, 0.6, 25)
    left, right = (
        np.polynomial.polynomial.polyval(middle, knuckle_polynomial(car, side))
        for side in (1.0, -1.0)
    )
    d = car.dimensions
    apart = np.sin(left) * np.cos(right) - np.cos(left) * np.sin(right)
    ideal = d.track / d.wheelbase * np.sin(left) * np.sin(right)
    # cot(right) - cot(left) = track / wheelbase; the polynomial is of order 4
    np.testing.assert_allclose(apart, ideal, atol=2e-3)


def test_it_stands_still_and_holds_its_speed():
    standing = driven(v=0.0, duration=2.0).truth
    assert np.abs(standing[:, :3]).max() < 2e-3
    going = driven(v=2.0).truth
    assert going[-1, V] == pytest.approx(2.0, rel=0.01)
    assert np.abs(going[:, 1]).max() < 1e-3  # straight


def test_it_turns_like_a_bicycle_at_a_walk():
    car = Car()
    bicycle = Bicycle(car.dimensions.l_f, car.dimensions.l_r)
    last = driven(v=1.0, delta=0.3, duration=8.0).truth[-1]
    assert last[DELTA] == pytest.approx(0.93 * 0.3, rel=0.01)  # steering_ratio
    # what is missing is side slip of the tyres
    assert last[R] == pytest.approx(float(bicycle.yaw_rate(last[V], last[DELTA])), rel=0.02)


def test_its_tyres_creep_as_stated():
    """Side slip at the rear axle over the force that the tyres bear there."""
    car = Car()
    d = car.dimensions
    truth = driven(v=4.0, delta=0.2, duration=12.0, car=car).truth
    x, y, psi, v, r, _ = truth[-1]
    vx, vy = (truth[-1, :2] - truth[-11, :2]) / (10 * ROW)
    middle = truth[-6, 2]
    across = -vx * np.sin(middle) + vy * np.cos(middle) - r * d.l_r
    force = 0.5 * d.mass * r * v * d.l_f / d.wheelbase
    stated = d.creep * d.wheelbase / (2.0 * d.l_f)
    assert -across / force == pytest.approx(stated, rel=0.1)  # springs and drive force mix in


EFFECTS = {
    "steering_friction": (
        Causes(steering_friction=400.0),
        lambda a, b: a[-1, DELTA] < b[-1, DELTA],
    ),
    "steering_play": (
        Causes(steering_play=0.06),
        lambda a, b: 0.02 < b[-1, DELTA] - a[-1, DELTA] < 0.04,
    ),
    "steering_torque": (Causes(steering_torque=60.0), lambda a, b: a[130, DELTA] < b[130, DELTA]),
    "steering_rate": (
        Causes(steering_rate=0.2),
        lambda a, b: np.diff(a[:, DELTA]).max() / ROW < 0.22 < np.diff(b[:, DELTA]).max() / ROW,
    ),
    "steering_offset": (
        Causes(steering_offset=0.02),
        lambda a, b: abs(a[-1, DELTA] - b[-1, DELTA] - 0.02) < 2e-3,
    ),
    "drive_acceleration": (
        Causes(drive_acceleration=1.0),
        lambda a, b: np.diff(a[:, V]).max() / ROW < 1.1 < np.diff(b[:, V]).max() / ROW,
    ),
    "grade": (Causes(grade=0.1), lambda a, b: a[100, V] < b[100, V] - 0.05),
    "bank": (Causes(bank=0.1), lambda a, b: a[-1, R] < b[-1, R]),
    "mass_shift": (Causes(mass_shift=0.6), lambda a, b: a[-1, R] < b[-1, R]),
    "wheel_scale": (
        Causes(wheel_scale=1.05),
        lambda a, b: abs(a[-1, V] / b[-1, V] - 1.05) < 5e-3,
    ),
    "command_delay": (
        Causes(command_delay=0.2),
        lambda a, b: np.allclose(a[20:, V], b[:-20, V], atol=2e-3),
    ),
}


@pytest.mark.parametrize("name", EFFECTS)
def test_a_switch_does_what_it_is_called(name):
    causes, differs = EFFECTS[name]
    assert differs(driven(causes, delta=0.2).truth, driven(delta=0.2).truth)


def test_a_sensor_delay_stamps_poses_late():
    late = driven(Causes(sensor_delay=0.1))
    assert late.pose[-1, 0] == pytest.approx(late.truth[-11, 0], abs=0.03)


def test_every_switch_is_tested():
    assert set(vars(Causes())) == {*EFFECTS, "sensor_delay"}
    assert all(value in (0.0, 1.0, math.inf) for value in vars(Causes()).values())
