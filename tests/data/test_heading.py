"""The heading of a vehicle that logs its position and yaw rate."""

import numpy as np
import pytest

from vdmsi_jax.data.heading import heading_of_path

DT, ROWS, AHEAD = 0.02, 6000, 0.4


def drive(seed: int, noise: float):
    """Two minutes at up to 5 m/s, ten seconds of them at rest and ten in reverse, of a point ahead
    of the rear axle; its position with noise, m, and a yaw rate that is 2 % too large and off by
    0.02 rad/s. And its heading."""
    rng, t = np.random.default_rng(seed), DT * np.arange(ROWS)
    v = 3.0 + 2.0 * np.sin(0.3 * t)
    v[2000:2500], v[4000:4500] = 0.0, -0.5 * v[4000:4500]
    rear = v / np.sqrt(1.0 + (AHEAD * 0.1 * np.sin(0.25 * t)) ** 2)
    r = 0.1 * rear * np.sin(0.25 * t)
    psi = 2.0 + DT * np.cumsum(r)
    vx = rear * np.cos(psi) - AHEAD * r * np.sin(psi)
    vy = rear * np.sin(psi) + AHEAD * r * np.cos(psi)
    x, y = (DT * np.cumsum(w) + noise * rng.standard_normal(ROWS) for w in (vx, vy))
    seen = 1.02 * r + 0.02 + 0.005 * rng.standard_normal(ROWS)
    return (x, y, seen, v + 0.02 * rng.standard_normal(ROWS)), psi


@pytest.mark.parametrize(("noise", "most"), [(0.0, 0.02), (0.02, 0.02), (0.3, 0.05)])
def test_the_summed_yaw_rate_goes_the_way_of_the_path(noise, most):
    """Its bias alone would turn it by 2.4 rad."""
    seen, psi = drive(1, noise)
    error = np.angle(np.exp(1j * (heading_of_path(*seen, DT, AHEAD) - psi)))
    assert np.sqrt(np.mean(error**2)) < most
    assert np.std(DT * np.cumsum(seen[2]) - psi) > 0.5


def test_a_vehicle_that_stands_keeps_its_summed_yaw_rate():
    zero, r = np.zeros(500), 0.1 * np.ones(500)
    np.testing.assert_allclose(heading_of_path(zero, zero, r, zero, DT), 0.1 * DT * np.arange(500))


@pytest.mark.parametrize("rows", [1, 2, 3])
def test_few_samples_have_a_heading(rows):
    x = np.arange(rows) * DT
    heading = heading_of_path(x, x, 0.0 * x, np.ones(rows), DT)
    np.testing.assert_allclose(heading, np.pi / 4 if rows > 1 else 0.0, atol=1e-12)
