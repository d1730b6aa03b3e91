"""A gap inside a servo's position loop, made by plain NumPy, is friction by its law."""

import numpy as np
import pytest

import vdmsi_jax as vj

GAP, DT, FINE = 0.05, 0.02, 2e-4


@pytest.mark.slow
def test_a_gap_inside_the_loop_of_a_servo_is_told_beside_friction():
    """The servo closes its loop on a motor without inertia; behind the gap the wheels are damped,
    and the angle is theirs."""
    rng = np.random.default_rng(5)
    rows, runs = 3000, 3
    level = np.repeat(rng.uniform(-0.3, 0.3, (runs, rows // 40 + 1)), 40, axis=1)[:, :rows]
    t = DT * np.arange(rows)
    u = 0.6 * level + 0.15 * np.sin(2.0 * np.pi * (0.1 + 0.004 * t) * t + np.arange(runs)[:, None])
    motor, wheels, delta = np.zeros(runs), np.zeros(runs), np.empty((runs, rows))
    for k in range(rows):
        delta[:, k] = wheels
        for _ in range(round(DT / FINE)):
            apart = motor - wheels
            force = 40.0 * (apart - np.clip(apart, -0.5 * GAP, 0.5 * GAP))
            motor = motor + FINE / 0.01 * (u[:, k] - motor - force)
            wheels = wheels + FINE / 0.12 * force
    delta += 0.001 * rng.standard_normal(delta.shape)
    logs = [
        vj.Record.from_arrays(dt=DT, name=f"run_{i}", delta_cmd=u[i], delta=delta[i])
        for i in range(runs)
    ]
    found = vj.diagnose(logs)
    (finding,) = found.findings
    assert finding.cause == "coulomb_friction" and finding.where == "steering"
    assert "backlash" in finding.indistinguishable_from
    assert finding.parameters["level"].value == pytest.approx(0.5 * GAP, rel=0.1)
    rival = next(r for r in finding.rivals if r.cause == "backlash")
    assert rival.deficit == 0.0
    assert finding.separating_experiment.startswith("turn the wheels by hand")
