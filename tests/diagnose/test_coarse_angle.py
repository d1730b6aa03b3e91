"""An angle that its sensor rounds coarsely: the body feels the wheels, and not what was logged."""

import numpy as np
import pytest

import vdmsi_jax as vj

DT, ROWS, FINE = 0.02, 2000, 10  # sample period, rows, and steps between two rows
L_F, L_R = 0.91, 1.59
STEP = 0.021  # rad


def drive(seed: int) -> vj.Record:
    """Bumps of the steering at several speeds, Euler at 2 ms; the angle is logged in steps."""
    rng = np.random.default_rng(seed)
    h, n = DT / FINE, ROWS * FINE
    t = h * np.arange(n)
    v_cmd = np.repeat(rng.uniform(3.0, 9.0, 4), n // 4)
    delta_cmd = np.zeros(n)
    for start in np.arange(1.0, 37.0, 5.0):
        inside = (t > start) & (t < start + 4.0)
        bump = np.sin(np.pi * (t[inside] - start) / 4.0) ** 2
        delta_cmd[inside] = rng.choice([-1.0, 1.0]) * rng.uniform(0.4, 1.0) * bump / v_cmd[inside]
    v, delta, rate = v_cmd[0], 0.0, 0.0
    rows = np.empty((ROWS, 3))
    for k in range(n):
        if k % FINE == 0:
            beta = np.arctan(L_R / (L_F + L_R) * np.tan(delta))
            rows[k // FINE] = v, delta, v * np.cos(beta) * np.tan(delta) / (L_F + L_R)
        v += h * (v_cmd[k] - v) / 0.6
        rate += h * (100.0 * (delta_cmd[k] - delta) - 16.0 * rate)
        delta += h * rate
    noise = rng.normal(size=(ROWS, 3)) * (0.03, 0.0005, 0.003)
    logged = rows + noise
    logged[:, 1] = STEP * np.round(logged[:, 1] / STEP)
    return vj.Record.from_arrays(
        dt=DT, name=f"run_{seed}", vehicle=vj.VehicleGeometry(L_F, L_R),
        v_cmd=v_cmd[::FINE], delta_cmd=delta_cmd[::FINE],
        v=logged[:, 0], delta=logged[:, 1], r=logged[:, 2],
    )  # fmt: skip


@pytest.mark.slow
def test_a_coarse_angle_is_its_sensors_and_the_yaw_rate_is_left_as_it_was():
    found = vj.diagnose([drive(seed) for seed in (1, 2, 3)])
    assert [(f.cause, f.where, f.channel) for f in found.findings] == [
        ("quantization", "sensor", "delta")
    ]
    assert found.extended["r"].fit > max(95.0, found.channels["r"].fit - 0.1)
