"""How the plain vehicle follows, against a loop in small steps, and as members of one batch."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from vdmsi_jax.models.bicycle import Bicycle
from vdmsi_jax.models.following import FollowedAtOnce, RateLimited
from vdmsi_jax.models.transfer_function import TransferFunction
from vdmsi_jax.models.vehicle import Vehicle, stack_vehicles

DT = 0.1


def commands():
    return np.repeat([0.0, 1.0, 1.05, -0.5, -0.5, 2.0], 4)


@jax.jit
def read(plant, u, tau):
    """All that a trace tells."""
    trace = plant.trace(u, DT)
    return trace.rows(), trace.at(tau), trace.travelled()


def crept(u, rate, y, fine=1000):
    """A response that moves to each held command in small steps, at every step."""
    out = np.empty((u.size, fine))
    for k, command in enumerate(u):
        for i in range(fine):
            out[k, i] = y
            y += np.clip(command - y, -rate * DT / fine, rate * DT / fine)
    return out, y


@pytest.mark.parametrize("start", [None, 0.4])
def test_limited_rate_is_that_of_a_loop(start):
    u, rate = commands(), 4.5
    expected, end = crept(u, rate, u[0] if start is None else start)
    x0 = None if start is None else jnp.array(start)
    trace = RateLimited(rate).trace(u, DT, x0)
    response = trace.rows()
    np.testing.assert_allclose(response.y, expected[:, 0], atol=1e-12)
    np.testing.assert_allclose(response.x_end, end, atol=1e-12)
    tau = np.array([0, 123, 500, 999])
    between = trace.at(jnp.asarray(tau * DT / 1000))
    np.testing.assert_allclose(between, expected[:, tau], atol=1e-12)
    # the loop's sum takes the value at the beginning of each of its steps
    np.testing.assert_allclose(trace.travelled(), expected.mean(1) * DT, atol=rate * DT**2 / 1000)


def test_limited_rate_has_the_same_gradient_in_both_modes():
    @jax.jit
    def area(rate):
        return jnp.sum(RateLimited(rate).trace(commands(), DT).travelled())

    forward, reverse = jax.jacfwd(area)(4.5), jax.grad(area)(4.5)
    slope = (area(4.5 + 1e-6) - area(4.5 - 1e-6)) / 2e-6
    np.testing.assert_allclose([forward, reverse], slope, rtol=1e-6)


def test_at_once_is_the_command_alone_and_among_plants():
    u = commands()
    for plant in (FollowedAtOnce(), FollowedAtOnce().to_plant(3)):
        response, between, way = read(plant, u, jnp.array([0.0, 0.07]))
        np.testing.assert_array_equal(response.y, u)
        np.testing.assert_array_equal(response.dy, 0.0 * u)
        np.testing.assert_allclose(between, np.stack([u, u], axis=1))
        np.testing.assert_allclose(way, u * DT, rtol=1e-12)
        assert plant.jump(DT) is None


def test_stacked_plants_keep_what_only_some_have():
    """A delay or an offset of one vehicle becomes zero, and so nothing, in the others."""
    bicycle = Bicycle(1.75, 1.2)
    late = TransferFunction([5.0], [1.0, 5.0], delay=0.07, offset=0.2)
    vehicles = [Vehicle(bicycle), Vehicle(bicycle, late, TransferFunction([1.0], [1.0, 2.0, 3.0]))]
    stacked = stack_vehicles(vehicles)
    assert stacked.powertrain.delay.tolist() == [0.0, 0.07]
    assert stacked.powertrain.offset.tolist() == [0.0, 0.2]
    assert stacked.steering.delay is None
    assert stacked.steering.system.A.shape == (2, 2, 2)
