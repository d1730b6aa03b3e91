"""A speed that stays the same while the pose says otherwise."""

import numpy as np
import pytest

import vdmsi_jax as vj
from vdmsi_jax.diagnose.signals.stuck import without_stuck_speed

DT, ROWS = 0.05, 2400
T = DT * np.arange(ROWS)
CREEPS = 1.0 + 0.8 * np.sin(0.21 * T)  # 0.2 to 1.8 m/s


def drive(speed, told, turning=0.2, noise=0.01, seed=0) -> vj.Record:
    """A vehicle that moves by `speed` and says `told`."""
    rng = np.random.default_rng(seed)
    psi = turning * T
    x, y = (np.cumsum(speed * way(psi)) * DT for way in (np.cos, np.sin))
    x, y = (place + noise * rng.standard_normal(ROWS) for place in (x, y))
    return vj.Record.from_arrays(dt=DT, v=told, x=x, y=y)


def noisy(speed: np.ndarray, by: float = 0.02) -> np.ndarray:
    return speed + by * np.random.default_rng(1).standard_normal(ROWS)


def least(speed: np.ndarray) -> np.ndarray:
    """A wheel sensor that says 0 below 0.6 m/s."""
    return np.where(speed < 0.6, 0.0, noisy(speed))


def staircase(rows: int) -> vj.Record:
    """Places that are held between messages, of a vehicle at a steady speed."""
    x = np.repeat((10.0 * T)[::rows], rows)[:ROWS]
    return vj.Record.from_arrays(dt=DT, v=np.full(ROWS, 10.0), x=x, y=np.zeros(ROWS))


@pytest.mark.parametrize("noise", [0.0, 0.01, 0.1])
def test_a_sensor_with_a_least_speed_is_told_and_its_zeros_left_out(noise):
    (mended,), told = without_stuck_speed([drive(CREEPS, least(CREEPS), noise=noise)])
    assert [one.channel for one in told] == ["v"] and "0 to the last digit" in told[0].said
    assert not mended.measured("v")[CREEPS < 0.6].any()
    assert mended.measured("v")[CREEPS >= 0.6].all()


def test_a_sensor_that_hangs_now_and_then_is_told_where_it_does():
    speed = 1.0 + 0.8 * np.sin(0.8 * T)
    held = noisy(speed)
    for first in (300, 900, 1500, 2100):
        held[first : first + 50] = held[first]
    (mended,), told = without_stuck_speed([drive(speed, held)])
    assert len(told) == 1 and "the same to the last digit" in told[0].said
    off = ~mended.measured("v")
    assert 0.02 * ROWS < off.sum() <= 200


@pytest.mark.parametrize(
    "record",
    [
        drive(CREEPS, noisy(CREEPS)),
        drive(np.where(T % 20.0 < 8.0, 0.0, CREEPS), np.where(T % 20.0 < 8.0, 0.0, noisy(CREEPS))),
        drive(np.full(ROWS, 2.0), np.full(ROWS, 2.0), turning=1.5),  # small circles, no noise
        drive(CREEPS, np.round(CREEPS / 0.1) * 0.1),  # a coarse counter
        drive(CREEPS, least(CREEPS), noise=2.0),  # of whose places nothing is known
        vj.Record.from_arrays(dt=DT, v=least(CREEPS)),  # without a pose
        staircase(20),  # places of 1 Hz, held, and a speed of which two digits were logged
        staircase(10),
        vj.Record.from_arrays(
            dt=0.5,
            v=np.full(200, 4.0),
            x=np.cos(0.4 * np.arange(200)) * 5.0,
            y=np.sin(0.4 * np.arange(200)) * 5.0,
        ),  # circles in few rows
        vj.Record.from_arrays(dt=DT, v=np.ones(5), x=np.arange(5.0), y=np.zeros(5)),
    ],
)
def test_all_else_stays_as_it_is(record):
    assert without_stuck_speed([record]) == ([record], [])


@pytest.mark.slow
def test_a_path_on_which_no_speed_is_known_is_not_told():
    """Of the drive that judges nothing but one number is logged as its speed."""
    rng, logs = np.random.default_rng(5), []
    for run in range(3):
        n, dt = 500, 0.04
        u = np.repeat(rng.uniform(1.0, 5.0, n // 50), 50)
        v = np.convolve(u - u[0], 0.08 * 0.92 ** np.arange(100))[:n] + u[0]
        delta = 0.2 * np.sin(0.5 * dt * np.arange(n) + run)
        psi = np.cumsum(v * np.tan(delta) / 2.0) * dt
        x, y = (np.cumsum(v * way(psi)) * dt for way in (np.cos, np.sin))
        told = np.full(n, v[0]) if run == 2 else v + 0.01 * rng.standard_normal(n)
        drive = dict(v_cmd=u, delta_cmd=delta, v=told, delta=delta, x=x, y=y, psi=psi)
        car = vj.VehicleGeometry(l_f=1.0, l_r=1.0)
        noise = {c: 0.003 * rng.standard_normal(n) for c in ("delta", "x", "y", "psi")}
        drive = {c: s + noise.get(c, 0.0) for c, s in drive.items()}
        logs.append(vj.Record.from_arrays(dt=dt, name=f"{run}", vehicle=car, **drive))
    found = vj.diagnose(logs)
    assert any("to the last digit" in said for said in (*found.unseen, found.summary))
    assert found.ate is None or np.isfinite(found.ate["model"]["mean"])
    assert "nan" not in found.summary
