"""Excitations have the properties that they are used for, and tracks the paper's shape."""

import numpy as np
import pytest

from vdmsi_jax.models.bicycle import Bicycle
from vdmsi_jax.models.vehicle import Vehicle
from vdmsi_jax.scenarios import (
    PAPER_SPEED,
    bend,
    chirp,
    held_levels,
    paper_powertrain_steps,
    paper_steering_steps,
    prbs,
    random_steps,
    s_curve,
)
from vdmsi_jax.simulate import Start, simulate

BICYCLE = Bicycle(1.75, 1.2)


@pytest.mark.parametrize("bits", [5, 6, 7, 9, 10, 11])
def test_prbs_is_white_over_its_period(bits):
    signal = prbs(bits=bits, clock=1, amplitude=1.0)
    period = 2**bits - 1
    assert signal.size == period and set(signal) == {-1.0, 1.0}
    correlation = np.real(np.fft.ifft(np.abs(np.fft.fft(signal)) ** 2))
    np.testing.assert_allclose(correlation[0], period)
    np.testing.assert_allclose(correlation[1:], -1.0, atol=1e-8)  # of a maximal-length sequence


def test_prbs_of_the_rao_garnier_benchmark():
    signal = prbs(bits=10, clock=7, amplitude=2.0)
    assert signal.size == 7161
    assert (signal.reshape(-1, 7) == signal[::7, None]).all() and np.abs(signal).max() == 2.0
    with pytest.raises(ValueError, match="no PRBS of 4 bits"):
        prbs(bits=4, clock=1, amplitude=1.0)


def test_steps_hold_and_change():
    signal = held_levels([0.0, 1.0, 0.5], dwell=0.2, duration=1.0, dt=0.1)
    assert signal.tolist() == [0, 0, 1, 1, 0.5, 0.5, 0, 0, 1, 1, 0.5]
    steps = random_steps([0.0, 1.0, 2.0], dwell=(0.5, 1.0), duration=20.0, dt=0.01, seed=3)
    holds = np.diff(np.flatnonzero(np.diff(steps) != 0))
    assert holds.min() >= 50 and holds.max() <= 100
    again = random_steps([0.0, 1.0, 2.0], dwell=(0.5, 1.0), duration=20.0, dt=0.01, seed=3)
    np.testing.assert_array_equal(steps, again)


def test_chirp_sweeps_from_low_to_high():
    signal = chirp(low=0.5, high=6.0, amplitude=0.3, duration=20.0, dt=1e-4)
    crossings = 1e-4 * np.flatnonzero(np.diff(np.sign(signal[1:])) != 0)
    half_periods = np.diff(crossings)
    np.testing.assert_allclose(half_periods[-1], 0.5 / 6.0, rtol=0.02)
    assert (half_periods[1:] <= half_periods[:-1] + 2e-4).all()
    assert np.abs(signal).max() <= 0.3


def test_figure_three():
    powertrain, steering = paper_powertrain_steps(), paper_steering_steps()
    for commands in (powertrain, steering):
        assert commands.v_cmd.shape == (3001,) and float(commands.dt) == 0.01
    assert set(np.asarray(powertrain.v_cmd)) == {0.0, 1.0}
    assert not np.asarray(powertrain.delta_cmd).any()
    assert set(np.asarray(steering.delta_cmd)) == {0.0, 0.52, -0.52}
    assert set(np.asarray(steering.v_cmd)) == {1.0}


def test_bend_turns_by_a_right_angle_of_twenty_metres():
    track = bend()
    pose = track.at(np.array([0.0, 20.0, 20.0 + 5.0 * np.pi, 20.0 + 10.0 * np.pi, track.length]))
    half = np.sqrt(0.5) * 20.0
    expected = [
        [0, 0, 0], [20, 0, 0], [20 + half, 20 - half, np.pi / 4], [40, 20, np.pi / 2],
        [40, 40, np.pi / 2],
    ]  # fmt: skip
    np.testing.assert_allclose(pose, expected, atol=1e-12)


def test_s_curve_ends_parallel_to_its_start():
    track = s_curve()
    assert set(np.abs(track.curvatures)) == {0.0, 1.0 / 15.0}
    np.testing.assert_allclose(track.at(np.array([track.length]))[0], [70.0, 30.0, 0.0], atol=1e-12)


@pytest.mark.parametrize("track", [bend(), s_curve()])
def test_an_ideal_vehicle_stays_on_the_track(track):
    """To the sample at which the curvature jumps; the course is psi and the slip angle."""
    commands = track.commands(BICYCLE, speed=PAPER_SPEED)
    slip = float(BICYCLE.slip_angle(commands.delta_cmd[0]))
    path = simulate(Vehicle(BICYCLE), commands, Start(psi=-slip))
    turns = np.diff(np.asarray(commands.delta_cmd), prepend=0.0)
    # the body's heading does not jump where the slip angle does, so the course would: an ideal
    # vehicle leaves a track whose curvature jumps by that angle and comes back at the end
    assert np.count_nonzero(turns) == sum(np.diff(track.curvatures, prepend=0.0) != 0)
    on_track = track.at(PAPER_SPEED * np.asarray(path.t))
    course = np.asarray(path.psi + BICYCLE.slip_angle(path.delta))
    np.testing.assert_allclose(path.psi[-1], on_track[-1, 2], atol=5e-3)
    turning = np.asarray(track.curvature(PAPER_SPEED * np.asarray(path.t))) != 0
    assert np.abs(course - on_track[:, 2])[~turning].max() < 5e-3
