"""Drives on the road, of logs that were made by plain NumPy."""

import numpy as np
import pytest

import vdmsi_jax as vj
from vdmsi_jax.diagnose.body.fit import fit_body
from vdmsi_jax.diagnose.body.search import BodySearch
from vdmsi_jax.diagnose.findings.road import Road
from vdmsi_jax.diagnose.prepare import body_of
from vdmsi_jax.diagnose.signals.angle import steering_angle
from vdmsi_jax.diagnose.signals.runs import lay_out

DT, ROWS, FINE = 0.05, 1200, 50


def driven(tmp_path, heading: str) -> Road:
    """A minute of a rear-axle bicycle from a heading of 1 rad at a millisecond, its position with
    noise of 2 cm; the heading is measured, or 0.1 rad off, or missing."""
    rng, t = np.random.default_rng(3), DT / FINE * np.arange(ROWS * FINE)
    v, delta = 2.0 + 0.8 * np.sin(0.4 * t), 0.2 * np.sin(0.7 * t) + 0.02
    r = v * np.tan(delta) / 0.5
    psi = 1.0 + np.concatenate([[0.0], np.cumsum(r[:-1])]) * DT / FINE
    x, y = (np.cumsum(v * f(psi)) * DT / FINE for f in (np.cos, np.sin))
    seen = {"t": t, "v_cmd": v, "delta_cmd": delta, "v": v, "delta": delta, "r": r}
    noise = {"v": 0.01, "delta": 0.002, "r": 0.01, "x": 0.02, "y": 0.02, "psi": 0.002}
    seen |= {"x": x, "y": y, "psi": psi + 0.1 * (heading == "off")}
    if heading == "missing":
        del seen["psi"]
    rows = [s[::FINE] + noise.get(c, 0.0) * rng.standard_normal(ROWS) for c, s in seen.items()]
    log, config = tmp_path / "run.csv", tmp_path / "vehicle.toml"
    np.savetxt(log, np.transpose(rows), delimiter=",", header=",".join(seen), comments="")
    config.write_text('[vehicle]\nl_f = 0.25\nl_r = 0.25\nreference_point = "rear_axle"\n')
    runs = lay_out([vj.read_log(log, config=config)])
    body, angle = body_of(runs, {}), steering_angle(runs)
    assert body is not None and angle is not None
    plain = fit_body(body, [()])[0]
    return Road(runs, {}, BodySearch(body, plain, plain, ()), angle[0])


def test_a_heading_that_was_not_measured_costs_a_drive_nothing(tmp_path):
    """The path is turned about its start; one that was measured is taken as it is."""
    errors = {h: driven(tmp_path, h).baseline_mean for h in ("measured", "off", "missing")}
    assert errors["missing"] == pytest.approx(errors["measured"], abs=0.1)
    assert errors["off"] > 3.0 * errors["missing"]
