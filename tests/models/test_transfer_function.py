"""Transfer functions of every proper order against scipy and python-control, and their anchors."""

import control
import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
import scipy.signal
from jaxtyping import TypeCheckError

from vdmsi_jax.models.transfer_function import TransferFunction, improper_reason

DT = 0.01
# scipy's discrete filter of order five loses up to six digits where poles are slow against the rate
FILTER_RTOL = 1e-8
ORDERS = [(1, 0), (1, 1), (2, 1), (3, 3), (4, 0), (5, 4), (5, 5)]

POWERTRAIN = TransferFunction([0.0631, 2.21, 143.90], [1.0, 18.15, 143.20])  # paper, table 2
STEERING = TransferFunction([0.47, 23.15, -0.49], [1.0, 25.44, 1.7e-7])


def coefficients(poles, zeros):
    """A stable plant with poles between 2 and 40 rad/s, some of them complex."""
    rng = np.random.default_rng(10 * poles + zeros)
    roots = [-rng.uniform(2.0, 40.0)] if poles % 2 else []
    for _ in range(poles // 2):
        real, imaginary = rng.uniform(2.0, 20.0, 2)
        roots += [-real + 1j * imaginary, -real - 1j * imaginary]
    den = np.real(np.poly(roots))
    num = np.atleast_1d(np.poly(-rng.uniform(3.0, 60.0, zeros)))
    return num / num[-1] * den[-1] * rng.uniform(0.5, 1.5), den


def held(seed=0, rows=700):
    return np.repeat(np.random.default_rng(seed).normal(size=rows // 10), 10)


def filtered(num, den, u, dt):
    """The oracle: exact discretisation by scipy, filtered from rest under the first command."""
    (b,), a, _ = scipy.signal.cont2discrete((num, den), dt)
    return scipy.signal.lfilter(b, a, u, zi=scipy.signal.lfilter_zi(b, a) * u[0])[0]


def read(model, u, tau):
    """The response at the rows and after them, from one trace."""
    trace = model.trace(u, DT)
    return trace.rows().y, trace.at(jnp.asarray(tau))


def with_delay(model, delay):
    return TransferFunction(model.num, model.den, delay=delay)


@pytest.mark.parametrize(("poles", "zeros"), ORDERS)
def test_response_is_that_of_scipy(poles, zeros):
    num, den = coefficients(poles, zeros)
    u = held()
    response = TransferFunction(num, den).simulate(u, DT)
    expected = filtered(num, den, u, DT)
    np.testing.assert_allclose(response.y, expected, atol=FILTER_RTOL * np.abs(expected).max())


@pytest.mark.parametrize(("poles", "zeros"), ORDERS)
def test_step_and_frequency_response_are_those_of_scipy(poles, zeros):
    num, den = coefficients(poles, zeros)
    model, t, omega = TransferFunction(num, den), np.linspace(0.0, 2.0, 41), np.logspace(-2, 3, 31)
    _, expected = scipy.signal.step((num, den), T=t)
    np.testing.assert_allclose(model.step_response(t), expected, atol=1e-9 * np.abs(expected).max())
    _, response = scipy.signal.freqresp((num, den), w=omega)
    np.testing.assert_allclose(model.frequency_response(omega), response, rtol=1e-12)


@pytest.mark.parametrize(("poles", "zeros"), [(3, 3)])
def test_gradient_is_the_same_in_both_modes_and_by_differences(poles, zeros):
    num, den = coefficients(poles, zeros)
    u, weights = held(), np.random.default_rng(1).normal(size=700)

    def loss(vector):
        model = TransferFunction(
            vector[: zeros + 1],
            jnp.concatenate([jnp.ones(1), vector[zeros + 1 : -1]]),
            delay=vector[-1],
        )
        return weights @ model.simulate(u, DT).y

    at = np.concatenate([num, den[1:], [0.0234]])
    forward, reverse = jax.jit(lambda a: (jax.jacfwd(loss)(a), jax.jacrev(loss)(a)))(at)
    np.testing.assert_allclose(forward, reverse, rtol=1e-8, atol=1e-9 * np.abs(forward).max())
    direction = np.abs(at) * np.random.default_rng(2).normal(size=at.size)
    step = 1e-6
    run = jax.jit(loss)
    slope = (run(at + step * direction) - run(at - step * direction)) / (2 * step)
    np.testing.assert_allclose(forward @ direction, slope, rtol=1e-5)


def test_the_leading_coefficient_has_no_derivative_anywhere():
    def told(model):
        moved = model.simulate(jnp.arange(5.0), DT).y[-1] + model.dc_gain()
        at_three = jnp.abs(model.frequency_response(3.0))
        return moved + at_three + model.step_response(jnp.ones(1))[0] + model.poles()[0].imag

    den = eqx.filter_grad(told)(TransferFunction([25.0], [1.0, 6.0, 25.0])).den
    assert den[0] == 0.0 and (den[1:] != 0.0).all()


def test_a_transfer_function_prints_its_numbers_and_only_its_shapes_while_it_is_traced():
    plant = TransferFunction([20.0, 1.0 / 3.0], [2.0, 3.0, 8.0], delay=0.06)
    shown = "TransferFunction(num=[10.0, 0.166667], den=[1.0, 1.5, 4.0], delay=0.06)"
    assert repr(plant) == shown
    told = []
    jax.jit(lambda plant: told.append(repr(plant)))(plant)
    assert "num=f64[2]" in told[0]
    assert "object" in repr(jax.tree.map(lambda _: object(), plant))


@pytest.mark.parametrize("delay", [0.0007, 0.01, 0.0571])
def test_delay_is_that_of_a_finely_sampled_command(delay):
    fine = 1e-4
    num, den = coefficients(2, 2)
    u = held()
    late = np.concatenate([np.full(round(delay / fine), u[0]), np.repeat(u, 100)])[: u.size * 100]
    expected = filtered(num, den, late, fine)
    tau = np.array([0, 7, 33, 67, 71, 99])
    model, between = TransferFunction(num, den, delay=delay), tau * fine + 1e-12
    y, values = jax.jit(lambda model: read(model, u, between))(model)
    # 1e-4 s is fine for scipy's filter: it loses digits, and 1e-8 of the range is what it keeps
    atol = FILTER_RTOL * np.abs(expected).max()
    np.testing.assert_allclose(y, expected[::100], atol=atol)
    np.testing.assert_allclose(values, expected.reshape(-1, 100)[:, tau], atol=atol * 10)


def test_delay_of_zero_is_off_bit_for_bit():
    u = held()
    bare, off = POWERTRAIN.simulate(u, DT), with_delay(POWERTRAIN, 0.0).simulate(u, DT)
    for field in ("y", "dy", "x_end"):
        assert (np.asarray(getattr(bare, field)) == np.asarray(getattr(off, field))).all()


def test_delay_from_any_state_is_continuous_across_a_whole_sample():
    x0, u = jnp.array([0.4, -0.3]), held()
    # the feed-through jumps with the delayed command at a row, all else is continuous
    bare = TransferFunction([2.21, 143.90], [1.0, 18.15, 143.20])
    run = jax.jit(lambda d: with_delay(bare, d).simulate(u, DT, x0).y)
    np.testing.assert_allclose(run(0.03 - 1e-9), run(0.03 + 1e-9), atol=1e-6)
    assert np.abs(np.asarray(run(0.03) - run(0.0))).max() > 0.1


def test_rate_is_the_derivative_of_the_response():
    for model in (POWERTRAIN, with_delay(POWERTRAIN, 0.0234)):
        _, values = jax.jit(lambda model: read(model, held(), [0.0, 1e-5]))(model)
        slope = (values[:, 1] - values[:, 0]) / 1e-5
        dy = model.simulate(held(), DT).dy
        # one-sided difference: its error is half the step times the second derivative
        np.testing.assert_allclose(dy, slope, atol=1e-3 * np.abs(dy).max())


@pytest.mark.parametrize("delay", [None, 0.0234])
def test_travelled_is_the_integral(delay):
    model = TransferFunction([0.0631, 2.21, 143.9], [1.0, 18.15, 143.2], delay=delay, offset=0.2)
    edges = np.array([0.0, DT]) if delay is None else np.array([0.0, model.jump(DT), DT])
    at, weights = np.polynomial.legendre.leggauss(8)
    total = 0.0
    for a, b in zip(edges[:-1], edges[1:], strict=True):
        _, values = jax.jit(read)(model, held(), a + (b - a) * (at + 1) / 2)
        total = total + np.asarray(values) @ weights * (b - a) / 2
    travelled = jax.jit(lambda model: model.trace(held(), DT).travelled())(model)
    np.testing.assert_allclose(travelled, total, atol=1e-14)


def test_records_continue_from_the_state_at_their_end():
    u = held()
    whole = POWERTRAIN.simulate(u, DT)
    first = POWERTRAIN.simulate(u[:350], DT)
    second = POWERTRAIN.simulate(u[350:], DT, first.x_end)
    joined = jnp.concatenate([first.y, second.y])
    np.testing.assert_allclose(joined, whole.y, atol=1e-13)


@pytest.mark.parametrize("delay", [None, 0.013])
def test_padding_changes_nothing(delay):
    u = held()
    model = with_delay(POWERTRAIN, delay)
    bare, padded = model.simulate(u, DT), model.to_plant(5).simulate(u, DT)
    np.testing.assert_allclose(padded.y, bare.y, atol=1e-13)
    np.testing.assert_allclose(model.to_plant().to_plant(5).simulate(u, DT).y, bare.y, atol=1e-13)
    assert model.to_state_space(5).A.shape == (5, 5)
    assert np.real(np.linalg.eigvals(model.to_plant(5).system.A)).max() < 0.0
    with pytest.raises(ValueError, match="2 states"):
        model.to_plant(1)


def test_start_is_at_rest_under_the_first_command():
    model = TransferFunction(*coefficients(5, 3), delay=0.013, offset=0.3)
    y = model.simulate(np.full(40, 0.7), DT).y
    np.testing.assert_allclose(y, 0.7 * model.dc_gain() + 0.3, rtol=1e-9)


def test_many_plants_run_in_one_batch():
    plants = [TransferFunction(*coefficients(3, 2), delay=d) for d in (0.0, 0.013, 0.05)]
    stacked = jax.tree.map(lambda *leaves: jnp.stack(leaves), *plants)
    u = held()
    together = eqx.filter_jit(eqx.filter_vmap(lambda plant: plant.simulate(u, DT).y))(stacked)
    for one, plant in zip(together, plants, strict=True):
        np.testing.assert_allclose(one, plant.simulate(u, DT).y, atol=1e-12)


def test_stiff_plant_stays_exact():
    poles = np.array([-1e-3, -1.0, -1e4])
    model = TransferFunction([-np.prod(poles)], np.poly(poles))
    t = np.array([1e-4, 1.0, 2e3])
    residues = [-np.prod(np.delete(poles, i) / (np.delete(poles, i) - poles[i])) for i in range(3)]
    expected = 1.0 + sum(r * np.exp(p * t) for r, p in zip(residues, poles, strict=True))
    np.testing.assert_allclose(model.step_response(t), expected, rtol=1e-7, atol=1e-11)


def test_paper_powertrain():
    poles, zeros = np.sort_complex(POWERTRAIN.poles()), np.sort_complex(POWERTRAIN.zeros())
    np.testing.assert_allclose(poles, [-9.075 - 7.800j, -9.075 + 7.800j], atol=5e-4)
    np.testing.assert_allclose(zeros, [-17.51 - 44.43j, -17.51 + 44.43j], atol=5e-3)
    np.testing.assert_allclose(POWERTRAIN.dc_gain(), 1.00489, atol=5e-6)
    assert POWERTRAIN.order == "P2Z2"


def test_paper_steering():
    poles, zeros = np.sort_complex(STEERING.poles()).real, np.sort_complex(STEERING.zeros()).real
    np.testing.assert_allclose(poles, [-25.44, -6.7e-9], rtol=5e-3)
    np.testing.assert_allclose(zeros, [-49.28, 0.0212], rtol=5e-3)
    np.testing.assert_allclose(STEERING.dc_gain(), -2.9e6, rtol=1e-2)
    y = STEERING.simulate(np.full(3001, 0.52), DT).y  # a near-integrator starts from zero
    np.testing.assert_allclose(y[-1], 0.173, atol=5e-4)
    np.testing.assert_allclose(y[100], 0.52 * 0.910, rtol=0.03)


def test_improper_orders_are_refused_with_the_reason():
    reason = improper_reason(1, 3)
    assert reason is not None and reason.startswith("improper")
    assert improper_reason(2, 2) is None
    with pytest.raises(ValueError, match="improper: 2 zeros exceed 1 poles"):
        TransferFunction([1.0, 2.0, 3.0], [1.0, 2.0])


@pytest.mark.parametrize("den", [[0.0, 1.0], jnp.array([0.0, 1.0])])
def test_a_denominator_that_begins_with_zero_is_refused(den):
    with pytest.raises(ValueError, match="leading coefficient of den is zero"):
        TransferFunction([1.0], den)


@pytest.mark.parametrize(("num", "den"), [([1.0], [1.0]), ([], [1.0, 2.0]), ([[1.0]], [1.0, 2.0])])
def test_what_is_no_plant_is_refused(num, den):
    with pytest.raises((ValueError, TypeCheckError)):  # the latter where annotations are executed
        TransferFunction(num, den)


@pytest.mark.parametrize(("poles", "zeros"), ORDERS)
def test_round_trip_to_scipy_and_control(poles, zeros):
    model = TransferFunction(*coefficients(poles, zeros))
    for back in (
        TransferFunction.from_scipy(model.to_scipy()),
        TransferFunction.from_control(model.to_control()),
    ):
        assert back.order == model.order
        np.testing.assert_allclose(back.num, model.num, rtol=1e-12)
        np.testing.assert_allclose(back.den, model.den, rtol=1e-12)


def test_state_space_forms_of_other_packages_are_read():
    u = held()
    expected = POWERTRAIN.simulate(u, DT).y
    for foreign in (POWERTRAIN.to_scipy().to_ss(), POWERTRAIN.to_scipy().to_zpk()):
        back = TransferFunction.from_scipy(foreign)
        np.testing.assert_allclose(back.simulate(u, DT).y, expected, atol=1e-10)
    back = TransferFunction.from_control(control.ss(POWERTRAIN.to_control()))
    np.testing.assert_allclose(back.simulate(u, DT).y, expected, atol=1e-10)


def test_response_is_that_of_control():
    u, t = held(), DT * np.arange(700)
    system = control.sample_system(POWERTRAIN.to_control(), DT)
    expected = control.forced_response(system, t, u - u[0]).outputs
    y = POWERTRAIN.simulate(u, DT).y - POWERTRAIN.dc_gain() * u[0]
    np.testing.assert_allclose(y, expected, atol=1e-10)


def test_exchange_loses_nothing_silently():
    with pytest.raises(ValueError, match="neither delay nor offset"):
        with_delay(POWERTRAIN, 0.1).to_scipy()
    with pytest.raises(ValueError, match="discrete"):
        TransferFunction.from_scipy(scipy.signal.TransferFunction([1.0], [1.0, 0.5], dt=0.1))
    with pytest.raises(ValueError, match="discrete"):
        TransferFunction.from_control(control.tf([1.0], [1.0, 0.5], 0.1))
    with pytest.raises(ValueError, match="1 inputs and 2 outputs"):
        TransferFunction.from_control(control.ss([[-1.0]], [[1.0]], [[1.0], [2.0]], 0))
