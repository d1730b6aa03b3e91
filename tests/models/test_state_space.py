"""The exact response to held commands, against scipy's matrix exponential and a plain loop."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import scipy.linalg

from vdmsi_jax.models.state_space import BLOCK, StateSpace, propagate

RTOL = 1e-12  # float64, some tens of operations


def system(A, B):
    n = len(B)
    return StateSpace(jnp.asarray(A, float), jnp.asarray(B, float), jnp.ones(n), jnp.zeros(()))


def van_loan(A, B, dt):
    n = len(B)
    exponential = scipy.linalg.expm(np.block([[A, B[:, None]], [np.zeros((1, n + 1))]]) * dt)
    return exponential[:n, :n], exponential[:n, n]


@pytest.mark.parametrize("dt", [1e-6, 1e-2, 1.0, 300.0])
@pytest.mark.parametrize("n", [1, 2, 5])
def test_discretise_is_the_matrix_exponential(n, dt):
    rng = np.random.default_rng(n)
    A = rng.normal(size=(n, n)) - 3.0 * np.eye(n)
    B = rng.normal(size=n)
    Ad, Bd = system(A, B).discretise(dt)
    expected_Ad, expected_Bd = van_loan(A, B, dt)
    np.testing.assert_allclose(Ad, expected_Ad, rtol=1e-10, atol=1e-13)
    np.testing.assert_allclose(Bd, expected_Bd, rtol=1e-10, atol=1e-13)


def test_discretise_at_zero_is_the_identity_bit_for_bit():
    rng = np.random.default_rng(0)
    Ad, Bd = system(100.0 * rng.normal(size=(4, 4)), rng.normal(size=4)).discretise(0.0)
    assert (np.asarray(Ad) == np.eye(4)).all()
    assert (np.asarray(Bd) == 0.0).all()


def test_discretise_integrates_exactly_where_A_is_singular():
    Ad, Bd = system([[0.0, 1.0], [0.0, 0.0]], [0.0, 1.0]).discretise(0.5)
    np.testing.assert_allclose(Ad, [[1.0, 0.5], [0.0, 1.0]], rtol=RTOL)
    np.testing.assert_allclose(Bd, [0.125, 0.5], rtol=RTOL)


def test_slow_pole_keeps_its_digits_beside_a_fast_one():
    slow, fast, dt = 1e-7, 1e3, 0.1
    Ad, Bd = system(np.diag([-slow, -fast]), [1.0, 1.0]).discretise(dt)
    np.testing.assert_allclose(Ad[0, 0] - 1.0, np.expm1(-slow * dt), rtol=1e-7)  # 1 - 1e-8 in float
    np.testing.assert_allclose(Bd, [dt, 1.0 / fast], rtol=1e-8)


def test_discretise_derivative_is_A_times_itself():
    A, B = np.array([[-2.0, 1.0], [-30.0, -40.0]]), np.array([1.0, 2.0])
    for mode in (jax.jacfwd, jax.jacrev):
        slope, push = mode(system(A, B).discretise)(0.07)
        Ad, Bd = system(A, B).discretise(0.07)
        np.testing.assert_allclose(slope, A @ Ad, rtol=1e-10)
        np.testing.assert_allclose(push, A @ Bd + B, rtol=1e-10, atol=1e-12)


@pytest.mark.parametrize("samples", [1, 2, BLOCK, BLOCK + 1, 3 * BLOCK - 1])
def test_propagate_is_the_loop(samples):
    rng = np.random.default_rng(samples)
    Ad, Bd, x0 = 0.4 * rng.normal(size=(3, 3)), rng.normal(size=3), rng.normal(size=3)
    u, functions = rng.normal(size=samples), rng.normal(size=(3, 2))
    states = [x0]
    for k in range(samples - 1):
        states.append(Ad @ states[-1] + Bd * u[k])
    motion = propagate(*map(jnp.asarray, (Ad, Bd, x0, u)))
    scale = np.abs(states).max()
    read = motion.read(jnp.asarray(functions))
    np.testing.assert_allclose(read, np.stack(states) @ functions, atol=RTOL * scale)
    np.testing.assert_allclose(motion.last(), states[-1], atol=RTOL * scale)
