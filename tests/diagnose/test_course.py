"""A position beside speed and angle, with neither heading nor yaw rate: how much the course turns
tells what the body does."""

import numpy as np
import pytest

import vdmsi_jax as vj
from vdmsi_jax.diagnose.body.body import along_course
from vdmsi_jax.diagnose.prepare import _course
from vdmsi_jax.diagnose.signals.runs import lay_out

DT, FINE, ROWS = 0.05, 50, 1600
L_F, L_R = 1.2, 1.4


def drive(seed: int, gradient: float = 0.0, noise: float = 0.02) -> dict[str, np.ndarray]:
    """A car by plain NumPy at a millisecond, with stops and a stretch in reverse; its receiver
    tells the position of its centre of gravity, far from the origin."""
    rng, h = np.random.default_rng(seed), DT / FINE
    t = DT * np.arange(ROWS)
    v_cmd = np.repeat(rng.permutation([0.0, -2.0, *rng.uniform(3.0, 11.0, 14)]), ROWS // 16)
    delta_cmd = 0.1 * np.sin(2.0 * np.pi * rng.uniform(0.05, 0.15) * t + seed)
    v, delta, x, y, psi = v_cmd[0], 0.0, 3e4, -2e4, rng.uniform(-3.0, 3.0)
    rows = []
    for k in range(ROWS):
        rows.append((v, delta, x, y))
        for _ in range(FINE):
            v += h / 0.5 * (v_cmd[k] - v)
            delta += h / 0.15 * (delta_cmd[k] - delta)
            course = psi + np.arctan(L_R / (L_F + L_R) * np.tan(delta))
            x, y = x + h * v * np.cos(course), y + h * v * np.sin(course)
            psi += h * v * np.tan(delta) / (L_F + L_R) / (1.0 + gradient * v * v)
    logged = np.array(rows) + rng.standard_normal((ROWS, 4)) * [0.05, 0.003, noise, noise]
    names = ("v", "delta", "x", "y")
    return {"t": t, "v_cmd": v_cmd, "delta_cmd": delta_cmd} | dict(
        zip(names, logged.T, strict=True)
    )


def diagnosed(**how: float) -> vj.Diagnosis:
    config = vj.Config(vehicle=vj.VehicleGeometry(L_F, L_R))
    return vj.diagnose(vj.read_logs([drive(seed, **how) for seed in (1, 2, 3)], config))


def test_understeer_is_named_with_its_size_and_what_it_costs():
    told = diagnosed(gradient=0.004)
    (found,) = told.findings
    gradient = found.parameters["gradient"]
    assert (found.cause, found.where, told.verdict) == ("understeer", "vehicle", "explained")
    assert gradient.value == pytest.approx(0.004, abs=4.0 * gradient.std) and gradient.std < 4e-4
    assert told.ate is not None
    assert told.ate["model"]["mean"] < 0.2 < 1.0 < told.ate["baseline"]["mean"]


@pytest.mark.slow
def test_what_hides_in_a_receiver_s_noise_and_leads_astray_is_no_small_matter():
    told = diagnosed(gradient=0.004, noise=0.2)
    assert [f.cause for f in told.findings] == ["understeer"]
    assert told.findings[0].share < 0.1


@pytest.mark.slow
def test_nothing_is_named_where_there_is_nothing():
    told = diagnosed()
    assert (told.verdict, told.findings, told.unexplained) == ("no_effect", (), ())


def test_the_way_along_a_course_is_that_of_a_circle_wherever_it_lies():
    """Both chords of an angle a are 2 R sin(a/2) long; in the frame of both together each goes on
    by cos(a/2) of that, and the second leads 2 sin(a/2) of it further aside."""
    rows, window, radius, rate = 200, 10, 20.0, 0.4
    angle = 0.1 * rate * np.arange(rows)
    x, y = radius * np.sin(angle), radius * (1.0 - np.cos(angle))
    turn, step = 1.3, 0.1 * rate * window
    moved = np.cos(turn) * x - np.sin(turn) * y + 1e3, np.sin(turn) * x + np.cos(turn) * y - 5e2
    whole = slice(0, rows - 2 * window)
    chord = 2.0 * radius * np.sin(0.5 * step)
    along, aside = chord * np.cos(0.5 * step), 2.0 * chord * np.sin(0.5 * step)
    for pose in ((x, y), moved):
        way = along_course(*pose, np.ones(rows), window)
        np.testing.assert_allclose(way["forward"][whole], along, rtol=1e-8)
        np.testing.assert_allclose(way["aside"][whole], aside, rtol=1e-8)
    back = along_course(x[::-1], y[::-1], -np.ones(rows), window)
    np.testing.assert_allclose(back["forward"][whole], -along, rtol=1e-8)
    np.testing.assert_allclose(back["aside"][whole], aside, rtol=1e-8)
    still = along_course(0.0 * x, 0.0 * y, np.ones(rows), window)
    assert not np.any(still["forward"]) and not np.any(still["aside"])


def test_noise_of_a_position_makes_its_ways_no_longer():
    """Of half a second's way of five times the noise: taken as they are, they are 1 % too long."""
    rng, rows = np.random.default_rng(0), 60_000
    angle = DT * 0.3 * np.arange(rows)
    pose = np.stack([10.0 * np.sin(angle), 10.0 * (1.0 - np.cos(angle))])
    seen = pose + 0.3 * rng.standard_normal(pose.shape)
    channels = {"v": np.full(rows, 3.0), "x": seen[0], "y": seen[1]}
    runs = lay_out([vj.Record.from_arrays(dt=DT, **channels)])
    window = round(0.5 / DT)
    true = along_course(*pose, np.ones(rows), window)
    told, clear = _course(runs, runs.channel("x"), runs.channel("y"), window)
    for name, least in (("forward", 0.004), ("aside", 0.04)):
        found = np.mean(told[name][clear])
        assert found == pytest.approx(true[name][0], rel=least)
