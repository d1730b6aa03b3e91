"""Wheels that spin, whose speed is not the vehicle's: no cause of the library, and yet several of
the body together take much of the errors of yaw rate and steps, and ruin the path."""

from types import SimpleNamespace

import numpy as np
import pytest

import vdmsi_jax as vj
from vdmsi_jax.diagnose.body.body import CAUSES
from vdmsi_jax.diagnose.body.search import BodySearch

DT, ROWS, FINE, WHEELBASE = 0.02, 1500, 20, 2.6


def on_ice(seed: int, grip: float = 1.0) -> vj.Record:
    """A drive by plain NumPy at a millisecond: the wheels follow the command at once, the vehicle
    follows them by `grip` m/s^2 at the most, and the log has the speed of the wheels."""
    rng, h = np.random.default_rng(seed), DT / FINE
    v_cmd = np.repeat(rng.uniform(2.0, 12.0, ROWS // 150), 150)
    delta_cmd = np.repeat(rng.uniform(-0.12, 0.12, ROWS // 100), 100)
    wheels = ground = v_cmd[0]
    delta = x = y = psi = 0.0
    rows = []
    for k in range(ROWS * FINE):
        turns = ground / WHEELBASE * np.tan(delta)
        if k % FINE == 0:
            rows.append((wheels, delta, turns, x, y, psi))
        wheels += h / 0.15 * (v_cmd[k // FINE] - wheels)
        delta += h / 0.2 * (delta_cmd[k // FINE] - delta)
        ground += h * np.clip(4.0 * (wheels - ground), -grip, grip)
        x, y = x + h * ground * np.cos(psi), y + h * ground * np.sin(psi)
        psi += h * turns
    logged = np.array(rows)
    logged += rng.standard_normal(logged.shape) * [0.03, 0.002, 0.004, 0.02, 0.02, 0.003]
    channels = dict(zip(("v", "delta", "r", "x", "y", "psi"), logged.T, strict=True))
    half = WHEELBASE / 2.0
    return vj.Record.from_arrays(
        dt=DT, name=f"run_{seed}", vehicle=vj.VehicleGeometry(l_f=half, l_r=half),
        v_cmd=v_cmd, delta_cmd=delta_cmd, **channels,
    )  # fmt: skip


@pytest.mark.slow
def test_causes_of_the_body_that_together_ruin_the_path_leave_the_model():
    told = vj.diagnose([on_ice(seed) for seed in (1, 2, 3)])
    assert told.verdict == "unexplained_structure" and told.findings == ()
    assert told.model.body == () and told.model.sensors == ()
    assert told.ate is not None
    assert told.ate["model"]["mean"] == pytest.approx(told.ate["baseline"]["mean"], rel=0.01)
    spoil = [f for f in told.minor if "the path gets worse with it" in f.sentence]
    assert "speed_scale" in {f.cause for f in spoil}
    for f in spoil:
        assert f.gain.ate_after is not None
        assert f.gain.ate_after > 4.0 * told.ate["baseline"]["mean"]


def test_it_is_the_speed_that_is_off_where_all_else_is_late():
    number = {(cause.cause, cause.channel): k for k, cause in enumerate(CAUSES)}

    def late(*sensors: tuple[str, str]) -> bool:
        findings = [SimpleNamespace(number=number[sensor]) for sensor in sensors]
        return BodySearch.all_late.fget(SimpleNamespace(findings=findings))

    two = (("sensor_lag", "r"), ("sensor_delay", "pose"))
    assert late(("sensor_delay", "delta"), *two)
    assert not late(*two) and not late(("sensor_bias", "v"), *two)
