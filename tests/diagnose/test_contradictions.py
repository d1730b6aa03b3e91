"""What logs say against themselves is told before any cause."""

from dataclasses import replace

import numpy as np
import pytest

import vdmsi_jax as vj
from vdmsi_jax.config import DEFAULT_PLANTS
from vdmsi_jax.diagnose.signals.contradictions import contradictions


def lagged(u, steps):
    keep = np.exp(-1.0 / steps)
    y = np.empty_like(u)
    y[0] = u[0]
    for k in range(1, u.size):
        y[k] = keep * y[k - 1] + (1.0 - keep) * u[k - 1]
    return y


@pytest.fixture(scope="module")
def logs():
    """Two drives with steps in speed and angle; the pose is that of a bicycle."""
    rng, n, dt = np.random.default_rng(4), 1500, 0.02
    made = []
    for name in ("run_1", "run_2"):
        v_cmd = np.repeat(rng.uniform(1.0, 3.0, n // 100), 100)
        delta_cmd = np.repeat(rng.uniform(-0.3, 0.3, n // 75), 75)
        v, delta = lagged(v_cmd, 25.0), lagged(delta_cmd, 8.0)
        r = v * np.tan(delta) / 1.5
        psi = np.cumsum(r) * dt
        noise = 0.003 * rng.standard_normal((4, n))
        made.append(
            vj.Record.from_arrays(
                dt=dt,
                name=name,
                vehicle=vj.VehicleGeometry(0.8, 0.7, reference_point="rear_axle"),
                v_cmd=v_cmd,
                delta_cmd=delta_cmd,
                v=v + noise[0],
                delta=delta + noise[1],
                r=r + noise[2],
                psi=psi + noise[3],
                x=np.cumsum(v * np.cos(psi)) * dt,
                y=np.cumsum(v * np.sin(psi)) * dt,
            )
        )
    return made


def changed(logs, **by):
    return [replace(r, channels=r.channels | {c: f(r) for c, f in by.items()}) for r in logs]


CASES = {
    "none": ({}, None, ""),
    "yaw rate": ({"r": lambda r: -r["r"]}, "r", "[sign] r = -1"),
    "scale of the yaw rate": ({"r": lambda r: 0.9 * r["r"] + 0.05}, "r", "0.90 times"),
    "scale of the heading": ({"psi": lambda r: 1.1 * r["psi"]}, "psi", "the pose was left aside"),
    "a scale nearly right": ({"r": lambda r: 1.05 * r["r"]}, None, ""),
    "heading": ({"psi": lambda r: -r["psi"]}, "psi", "[sign] psi = -1"),
    "angle": (
        {"delta": lambda r: -r["delta"], "delta_cmd": lambda r: -r["delta_cmd"]},
        "delta",
        "[sign] delta_cmd = -1 and [sign] delta = -1",
    ),
    "speeds exchanged": ({"v": lambda r: r["v_cmd"], "v_cmd": lambda r: r["v"]}, "v", "exchanged"),
    "angles exchanged": (
        {"delta": lambda r: r["delta_cmd"], "delta_cmd": lambda r: r["delta"]},
        "delta",
        "exchanged",
    ),
}


@pytest.mark.parametrize("case", CASES)
def test_each_is_told_with_its_mend(logs, case):
    by, channel, mend = CASES[case]
    told = contradictions(changed(logs, **by), DEFAULT_PLANTS)
    assert [one.channel for one in told] == ([] if channel is None else [channel])
    assert all(mend in one.said for one in told)


def test_a_noisy_response_to_a_smooth_command_is_no_command():
    """A lag smooths the noise, and what is left tells the command better than it is told."""
    rng, dt = np.random.default_rng(2), 0.02
    t = dt * np.arange(3000)
    v_cmd = 1.3 + 0.2 * np.sin(0.4 * t) + 0.1 * np.sin(0.15 * t)
    v = lagged(v_cmd, 8.0) + 0.03 * rng.standard_normal(t.size)
    log = vj.Record.from_arrays(dt=dt, v_cmd=v_cmd, v=v)
    assert not contradictions([log], DEFAULT_PLANTS)
    swapped = vj.Record.from_arrays(dt=dt, v_cmd=v, v=np.repeat(rng.uniform(1.0, 2.0, 30), 100))
    assert not contradictions([swapped], DEFAULT_PLANTS)


@pytest.mark.slow
def test_a_heading_that_turns_the_other_way_comes_before_all_else(logs):
    found = vj.diagnose(changed(logs, psi=lambda r: -r["psi"]))
    assert found.verdict == "unexplained_structure" and not found.findings
    assert found.contradictions and found.summary.startswith("psi turns against")
    assert found.unexplained[0].channel == "psi" and found.ate is None
    assert "psi" not in found.records[0] and "r" in found.records[0]
    assert repr(found).startswith("<Diagnosis unexplained_structure: no finding")
