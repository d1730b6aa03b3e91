"""Eq. (1) against CommonRoad's kinematic single-track model and against geometry."""

import jax.numpy as jnp
import numpy as np
import pytest
from scipy.integrate import solve_ivp

from vdmsi_jax.models.bicycle import Bicycle, BicycleState
from vdmsi_jax.models.commands import Commands
from vdmsi_jax.models.vehicle import Vehicle
from vdmsi_jax.simulate import simulate

RTOL = 1e-12  # float64, some ten operations
L_F, L_R = 1.75, 1.2


def samples(count=50, seed=0):
    rng = np.random.default_rng(seed)
    pose = rng.uniform(-10.0, 10.0, (2, count))
    psi, delta = rng.uniform(-4.0, 4.0, count), rng.uniform(-0.9, 0.9, count)
    return *pose, psi, rng.uniform(-5.0, 25.0, count), rng.uniform(-4.0, 4.0, count), delta


def test_derivatives_are_the_paper_s_formula():
    x, y, psi, v, a, delta = samples()
    beta = np.arctan(L_R / (L_F + L_R) * np.tan(delta))
    got = Bicycle(L_F, L_R).derivatives(BicycleState(x, y, psi, v), a, delta)
    expected = v * np.cos(psi + beta), v * np.sin(psi + beta), v / L_R * np.sin(beta), a
    for channel, value in zip(got, expected, strict=True):
        np.testing.assert_allclose(channel, value, rtol=RTOL, atol=1e-13)


def commonroad():
    """CommonRoad's parameters of its second car, or a skip."""
    pytest.importorskip("vehiclemodels", reason="commonroad-vehicle-models is not installed")
    from vehiclemodels.parameters_vehicle2 import parameters_vehicle2

    return parameters_vehicle2()


@pytest.mark.parametrize("point", ["centre of gravity", "rear axle"])
def test_derivatives_are_those_of_commonroad(point):
    parameters = commonroad()
    from vehiclemodels.utils.vehicle_dynamics_ks_cog import vehicle_dynamics_ks_cog
    from vehiclemodels.vehicle_dynamics_ks import vehicle_dynamics_ks

    if point == "rear axle":
        oracle, bicycle = vehicle_dynamics_ks, Bicycle(parameters.a + parameters.b, 0.0)
    else:
        oracle, bicycle = vehicle_dynamics_ks_cog, Bicycle(parameters.a, parameters.b)
    for x, y, psi, v, a, delta in zip(*samples(), strict=True):
        # the acceleration is the one that its limits leave
        dx, dy, _, dv, dpsi = oracle([x, y, delta, v, psi], [0.0, a], parameters)
        got = bicycle.derivatives(BicycleState(x, y, psi, v), dv, delta)
        np.testing.assert_allclose(got, [dx, dy, dpsi, dv], rtol=RTOL, atol=RTOL)


def test_forty_seconds_are_those_of_commonroad():
    parameters = commonroad()
    from vehiclemodels.utils.vehicle_dynamics_ks_cog import vehicle_dynamics_ks_cog

    rng = np.random.default_rng(3)
    v, delta = np.repeat(rng.uniform(1, 5, 40), 100), np.repeat(rng.uniform(-0.4, 0.4, 40), 100)
    state = [0.0, 0.0, 0.0]
    for k in range(0, 4000, 100):

        def field(t, s, k=k):
            dx, dy, _, _, dpsi = vehicle_dynamics_ks_cog(
                [s[0], s[1], delta[k], v[k], s[2]], [0.0, 0.0], parameters
            )
            return [dx, dy, dpsi]

        state = solve_ivp(field, (0.0, 1.0), state, rtol=1e-11, atol=1e-11).y[:, -1]
    vehicle = Vehicle(Bicycle(parameters.a, parameters.b))
    path = simulate(vehicle, Commands(np.append(v, 0.0), np.append(delta, 0.0), 0.01))
    np.testing.assert_allclose([path.x[-1], path.y[-1], path.psi[-1]], state, atol=1e-6)


def test_rear_axle_as_the_reference_point():
    bicycle, delta = Bicycle(2.95, 0.0), jnp.array([-0.4, 0.0, 0.3])
    assert np.asarray(bicycle.slip_angle(delta)).tolist() == [0.0, 0.0, 0.0]
    np.testing.assert_allclose(bicycle.yaw_rate(2.0, delta), 2.0 * np.tan(delta) / 2.95, rtol=RTOL)


def test_course_is_cosine_sine_and_curvature():
    bicycle, delta = Bicycle(L_F, L_R), jnp.linspace(-1.2, 1.2, 25)
    cosine, sine, curvature = bicycle.course(delta)
    beta = bicycle.slip_angle(delta)
    np.testing.assert_allclose(cosine, np.cos(beta), rtol=RTOL)
    np.testing.assert_allclose(sine, np.sin(beta), rtol=RTOL, atol=1e-15)
    np.testing.assert_allclose(bicycle.steering_angle(curvature), delta, rtol=1e-11, atol=1e-15)
    assert np.isnan(bicycle.steering_angle(jnp.array(1.0 / L_R + 0.1)))
