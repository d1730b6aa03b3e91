"""A plant with effects: the linear one where they are off, and plain loops where they are on."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from vdmsi_jax.effects import ACTUATOR, VEHICLE, Signals
from vdmsi_jax.effects.backlash import Backlash
from vdmsi_jax.effects.coulomb_friction import CoulombFriction
from vdmsi_jax.effects.drag import Drag
from vdmsi_jax.effects.gain_asymmetry import GainAsymmetry
from vdmsi_jax.effects.offset import Offset
from vdmsi_jax.effects.rate_limit import RateLimit
from vdmsi_jax.effects.road_grade import KNOTS, RoadGrade
from vdmsi_jax.effects.saturation import Saturation
from vdmsi_jax.effects.sensor import SensorBias
from vdmsi_jax.effects.speed_dependent_gain import SpeedDependentGain
from vdmsi_jax.effects.transport_delay import TransportDelay
from vdmsi_jax.models.extended_plant import ExtendedPlant, respond, surroundings
from vdmsi_jax.models.observer_form import observer, slowness_of
from vdmsi_jax.models.transfer_function import TransferFunction
from vdmsi_jax.units import STANDARD_GRAVITY

DT, ROWS, STEPS = 0.01, 1200, 4
SAME = 1e-9  # the response is of order one; the two ways round differently
LAG, GAIN = 8.0, 0.9  # rad/s and no unit, of the plant in the loops

PLANTS = {
    "P1Z0": TransferFunction([9.3], [1.0, 10.0]),
    "P2Z2": TransferFunction([0.0631, 2.21, 143.90], [1.0, 18.15, 143.20]),
    "P3Z1": TransferFunction([3.0, 700.0], [1.0, 50.0, 800.0, 700.0]),
    "integrator": TransferFunction([3.0], [1.0, 5.0, 0.0]),
    "late": TransferFunction([9.3], [1.0, 10.0], delay=0.0575, offset=0.1),
}


def commands(seed=0, rows=ROWS):
    rng = np.random.default_rng(seed)
    return np.repeat(rng.uniform(-1.0, 1.0, rows // 60 + 1), 60)[:rows]


def lag(u, y=None):
    """Sub-steps of a first-order lag under commands held for a sub-step each."""
    keep = np.exp(-LAG * DT / STEPS)
    y, out = GAIN * u[0] if y is None else y, []
    for held in u:
        out.append(y)
        y = keep * y + (1.0 - keep) * GAIN * held
    return np.array(out)


def lagged(*effects, **more):
    return ExtendedPlant(TransferFunction([GAIN * LAG], [1.0, LAG]), effects, **more)


@pytest.mark.parametrize(
    ("name", "rolling"),
    [("P1Z0", False), ("P2Z2", True), ("P3Z1", False), ("integrator", True), ("late", True)],
)
def test_without_effects_it_is_the_transfer_function(name, rolling):
    plant, u = PLANTS[name], commands()
    x0 = 0.1 * jnp.arange(1.0, len(plant.den)) if rolling else None
    expected = plant.simulate(u, DT, x0)
    bare = ExtendedPlant(plant, ()).simulate(u, DT, x0)
    np.testing.assert_allclose(bare.y, expected.y, atol=SAME)
    off = ExtendedPlant(plant, ACTUATOR).simulate(u, DT, x0)
    np.testing.assert_array_equal(off.y, bare.y)
    np.testing.assert_array_equal(off.dy, bare.dy)
    assert bare.x_end is None  # what effects remember is no state


def test_between_the_rows_it_is_near_the_exact_motion():
    """Straight lines of h = dt / steps stray from a curve by h²/8 of its bend."""
    plant, u = PLANTS["P1Z0"], commands()
    tau = jnp.array([0.0, 0.0011, 0.0049, 0.0099])
    for steps in (1, 8):
        exact = plant.trace(u, DT)
        near = ExtendedPlant(plant, (), substeps=steps).trace(u, DT)
        stray = (DT / steps) ** 2 / 8.0 * 10.0**2 * 0.93 * np.ptp(u)
        np.testing.assert_allclose(near.at(tau), exact.at(tau), atol=1.001 * stray)
        np.testing.assert_allclose(near.travelled(), exact.travelled(), atol=DT * stray)
        ahead = 0.5 * DT / steps * 10.0**2 * 0.93 * np.ptp(u)
        np.testing.assert_allclose(near.rows().dy, exact.rows().dy, atol=1.001 * ahead)


def test_backlash_saturation_and_delay_are_those_of_a_loop():
    u, gap, upper, late = commands(), 0.2, 0.6, 7 * DT
    y = lag(np.repeat(np.minimum(np.r_[[u[0]] * 7, u[:-7]], upper), STEPS))
    rest, out = y[0], []
    for now in y:
        rest = min(max(rest, now - gap / 2), now + gap / 2)
        out.append(rest)
    expected = np.minimum(np.array(out)[::STEPS], 1.0 / 2.5) + 0.05
    for plant in (
        lagged(
            Saturation(1.0 / upper, 0.0), TransportDelay(late), Saturation(2.5, 0.0, "response"),
            Backlash(gap), Offset(0.05),
        ),
        ExtendedPlant(  # the plant's own delay and offset do the same
            TransferFunction([GAIN * LAG], [1.0, LAG], delay=late, offset=0.05),
            (Saturation(1.0 / upper, 0.0), Saturation(2.5, 0.0, "response"), Backlash(gap)),
        ),
    ):  # fmt: skip
        np.testing.assert_allclose(plant.simulate(u, DT).y, expected, atol=SAME)


def test_a_stop_shows_between_the_rows_too():
    u = commands()
    trace = lagged(Saturation(2.5, 2.5, "response")).trace(u, DT)
    assert float(abs(trace.at(jnp.linspace(0.0, 0.99 * DT, 9))).max()) <= 0.4
    np.testing.assert_allclose(trace.travelled()[u > 0.9], 0.4 * DT, atol=0.4 * DT)


@pytest.mark.parametrize("gain", [0.5, 20.0, -3.0])
@pytest.mark.parametrize("ratio", [-0.5, 0.8])
def test_a_weak_push_keeps_the_level_of_a_plant_of_any_gain(gain, ratio):
    u, den = commands(), np.array([1.0, 30.0, 200.0])

    def answer(gain, u, *effects):
        return ExtendedPlant(TransferFunction([gain * den[-1]], den), effects).simulate(u, DT).y

    pushed, one = answer(gain, u, weak := GainAsymmetry(ratio, "effort")), answer(1.0, u, weak)
    plain = answer(1.0, u)
    assert float(abs(one - plain).max()) > 0.05
    np.testing.assert_allclose(pushed, gain * one, atol=SAME * abs(gain))
    up, down = np.r_[0.0, np.full(ROWS, 0.7)], np.r_[0.0, np.full(ROWS, -0.7)]
    np.testing.assert_allclose(answer(gain, up, weak)[-1], 0.7 * gain, rtol=1e-6)
    np.testing.assert_allclose(answer(gain, down, weak)[-1], -0.7 * gain, rtol=1e-6)


def test_friction_spends_what_it_costs_and_holds_what_it_can():
    stuck = lagged(CoulombFriction(0.3, 0.0)).simulate(np.r_[0.0, np.full(400, 0.25)], DT)
    np.testing.assert_allclose(stuck.y, 0.0, atol=1e-12)
    moved = lagged(CoulombFriction(0.3, 0.0)).simulate(np.r_[0.0, np.full(800, 1.0)], DT)
    np.testing.assert_allclose(moved.y[-1], GAIN * 0.7, rtol=1e-6)


@pytest.mark.parametrize("poles", [(4.0,), (4.0, 15.0), (4.0, 15.0, 60.0)])
def test_a_deceleration_is_worth_time_constants_of_command(poles):
    """At rest the command spent is deceleration times the sum of the time constants over the gain,
    by which a road and rolling resistance count."""
    den = np.poly(-np.array(poles))
    linear = TransferFunction([GAIN * den[-1]], den)
    worth = sum(1.0 / p for p in poles) / GAIN
    u, rolling, slope = np.full(1500, 2.0), 0.4, 0.03
    drag = ExtendedPlant(linear, (Drag(0.0, rolling),)).simulate(u, DT)
    np.testing.assert_allclose(drag.y[-1], GAIN * (2.0 - worth * rolling), rtol=1e-6)
    hill = RoadGrade(np.full(KNOTS, slope), 50.0)
    told = surroundings(jnp.asarray(u), jnp.zeros(u.size), DT)
    climbed = ExtendedPlant(linear, (hill,)).hearing(told).simulate(u, DT)
    spent = worth * STANDARD_GRAVITY * slope
    np.testing.assert_allclose(climbed.y[-1], GAIN * (2.0 - spent), rtol=1e-6)


def test_a_controller_with_an_integral_makes_up_for_a_hill():
    """A mass under a PI controller, in small steps: it gives way to a hill, and comes back. To the
    plant that force has a long lead, and still the slope is the slope."""
    kp, ki, dt, slope = 2.0, 1.5, 1e-4, 0.03
    v, integral, seen = 0.0, 0.0, []
    for k in range(int(20.0 / dt)):
        if k % round(DT / dt) == 0:
            seen.append(v)
        error = (1.0 if k * dt >= 1.0 else 0.0) - v
        hill = STANDARD_GRAVITY * slope if k * dt >= 10.0 else 0.0
        v, integral = v + dt * (kp * error + ki * integral - hill), integral + dt * error
    u = (np.arange(len(seen)) * DT >= 1.0 - 1e-9).astype(float)
    linear = TransferFunction([kp, ki], [1.0, kp, ki])
    late = CoulombFriction(0.0, 0.0)  # a plant needs an effect to have leads
    way = np.where(np.arange(KNOTS) * 100.0 / (KNOTS - 1) > 50.0, slope, 0.0)
    told = surroundings(jnp.where(jnp.arange(u.size) * DT < 10.0, 0.0, 1e4), jnp.zeros(u.size), DT)
    told = eqx.tree_at(lambda s: s.distance, told, jnp.clip(told.distance, 0.0, 99.0))
    plant = ExtendedPlant(linear, (late, RoadGrade(way, 100.0)), leads=(400.0, 0.0))
    y = plant.hearing(told).simulate(u, DT).y
    np.testing.assert_allclose(y, seen, atol=4e-3)
    assert abs(seen[1100] - 1.0) > 0.05 and abs(seen[-1] - 1.0) < 2e-3


def test_it_is_what_a_diagnosis_simulates():
    """The same plant, in the form in which a diagnosis looks for causes, whose unit of time is its
    own."""
    u, pace, leads = commands(), 5.0, np.array([0.4, 0.0])
    linear = TransferFunction([2.0, 90.0], [1.0, 20.0, 100.0])
    effects = (CoulombFriction(0.1, 0.05), Backlash(0.05), Offset(0.1))
    a = jnp.array([20.0 / pace, 100.0 / pace**2, 0.0, 0.0])
    b = jnp.array([2.0 / pace, 90.0 / pace**2, 0.0, 0.0])
    system, rest = observer(a, b, jnp.asarray(pace))
    slowness = slowness_of(a, b, jnp.asarray(pace), jnp.asarray(leads * pace))
    signals = Signals.plain(u.size, DT, STEPS)
    told = Signals(
        signals.t, signals.v, signals.other, signals.distance, slowness,
        jnp.asarray(leads * pace), signals.h, STEPS,
    )  # fmt: skip
    expected = respond(system, rest, effects, jnp.asarray(u), told)
    plant = ExtendedPlant(linear, effects, leads=leads)
    np.testing.assert_allclose(plant.simulate(u, DT).y, expected, atol=SAME)
    without = ExtendedPlant(linear, effects).simulate(u, DT).y
    assert float(abs(without - expected).max()) > 1e-3


def test_it_hears_the_speed():
    u, v = commands(), np.linspace(0.0, 5.0, ROWS)
    told = surroundings(jnp.asarray(v), jnp.zeros(ROWS), DT)
    y = lagged(SpeedDependentGain(-0.08)).hearing(told).simulate(u, DT).y
    expected = lag(np.repeat(u * (1.0 - 0.08 * v), STEPS))[::STEPS]
    np.testing.assert_allclose(y, expected, atol=SAME)
    np.testing.assert_allclose(told.distance[-1], np.sum(v[:-1]) * DT, rtol=1e-12)
    with pytest.raises(ValueError, match="1200 rows and has 3 commands"):
        lagged().hearing(told).simulate(u[:3], DT)


def test_what_a_sensor_adds_does_not_move():
    u = commands()
    np.testing.assert_array_equal(
        lagged(SensorBias(0.3)).simulate(u, DT).y, lagged().simulate(u, DT).y
    )


@pytest.mark.parametrize("effect", VEHICLE, ids=lambda effect: effect.cause)
def test_what_acts_on_body_or_road_is_none_of_an_actuator(effect):
    with pytest.raises(ValueError, match=f"{type(effect).__name__} acts on no actuator.*Vehicle"):
        lagged(effect)


def test_an_effect_may_stand_alone(unchecked):
    plant, effect = PLANTS["P1Z0"], Backlash(0.1)
    assert ExtendedPlant(plant, effect).effects == (effect,)


def test_only_the_bare_one_is_linear():
    assert ExtendedPlant(PLANTS["P2Z2"], ()).to_plant(3).rest.shape == (3,)
    assert lagged(Backlash(0.1)).jump(jnp.asarray(DT)) is None
    with pytest.raises(ValueError, match="not linear.*Quadrature"):
        lagged(Backlash(0.1)).to_plant()
    with pytest.raises(ValueError, match="sub-step"):
        lagged(substeps=0)


def test_many_at_once_and_their_gradients():
    """A batch over sizes is the single ones, and both modes agree with differences."""
    u = jnp.asarray(commands(rows=240))

    def error(sizes):
        late, gap, limit = sizes
        made = (Saturation(limit, 0.0), TransportDelay(late), Backlash(gap))
        return jnp.mean((lagged(*made).trace(u, DT).rows().y - 0.5 * u) ** 2)

    sizes = jnp.array([[0.013, 0.1, 1.2], [0.031, 0.05, 0.9], [0.0, 0.0, 0.0]])
    many, one = jax.jit(jax.vmap(error)), jax.jit(error)
    np.testing.assert_allclose(many(sizes), [one(row) for row in sizes], rtol=1e-12)
    reverse, forward = jax.jit(jax.grad(error)), jax.jit(jax.jacfwd(error))
    assert all(np.isfinite(reverse(row)).all() for row in sizes)
    row, step = sizes[0], 1e-7
    slopes = [(one(row + d) - one(row - d)) / (2 * step) for d in step * np.eye(3)]
    np.testing.assert_allclose(forward(row), reverse(row), rtol=1e-9)
    np.testing.assert_allclose(reverse(row), slopes, rtol=1e-5)


@pytest.mark.parametrize(
    "plant",
    [
        TransferFunction([8.0], [1.0, 8.0]),
        TransferFunction([160.0], [1.0, 18.0, 160.0]),
        TransferFunction([290.0, 1200.0], [1.0, 21.6, 188.0, 782.0, 1200.0]),
        TransferFunction([20.0, 80.0], [1.0, 14.0, 40.0]),
    ],
    ids=["a lag", "two", "with a zero that leads", "with a gain of two"],
)
def test_behind_a_limited_drive_the_response_moves_at_that_rate(plant):
    """The limit is the slope that is seen in the response, whatever lags or leads behind it."""
    limited = ExtendedPlant(plant, (RateLimit(1 / 0.5, 1 / 0.2, at="drive"),), substeps=STEPS)
    for sign, rate in ((1.0, 0.5), (-1.0, 0.2)):
        u = np.full(ROWS, 100.0 * sign)
        y = np.asarray(limited.simulate(u, DT, jnp.zeros(len(plant.den) - 1)).y)
        slope = np.diff(y)[ROWS // 2 :] / DT
        np.testing.assert_allclose(slope, sign * rate, rtol=2e-3)


def test_a_start_needs_the_states_of_the_linear_part():
    with pytest.raises(ValueError, match="states"):
        ExtendedPlant(PLANTS["P2Z2"], ()).simulate(commands(), DT, jnp.ones(1))
