"""The three ways to integrate the vehicle against each other, against geometry, and in batches."""

import diffrax
import equinox as eqx
import jax
import jax.flatten_util
import jax.numpy as jnp
import numpy as np
import pytest

from vdmsi_jax import metrics
from vdmsi_jax.config import PlantSpec, VehicleGeometry
from vdmsi_jax.data.record import Record, Segment
from vdmsi_jax.effects.backlash import Backlash
from vdmsi_jax.errors import InputError
from vdmsi_jax.model_file import Model, Plant
from vdmsi_jax.models.bicycle import Bicycle
from vdmsi_jax.models.extended_plant import ExtendedPlant
from vdmsi_jax.models.following import FollowedAtOnce, RateLimited
from vdmsi_jax.models.transfer_function import TransferFunction
from vdmsi_jax.models.vehicle import SpeedInput, Vehicle, stack_vehicles
from vdmsi_jax.scenarios import bend
from vdmsi_jax.simulate import (
    RESULTS,
    Arcs,
    Commands,
    Quadrature,
    Solver,
    Start,
    at_rest,
    resting_command,
    simulate,
    simulate_many,
)
from vdmsi_jax.simulate._given import as_vehicle

DT, ROWS = 0.01, 4001  # one length: a program that is compiled serves many tests
METRES = 1e-8  # after 40 s: what the solver's tolerance and three Gauss nodes leave

BICYCLE = Bicycle(1.75, 1.2)
POWERTRAIN = TransferFunction([0.0631, 2.21, 143.90], [1.0, 18.15, 143.20])
LATE_POWERTRAIN = TransferFunction(POWERTRAIN.num, POWERTRAIN.den, delay=0.0234)
STEERING = TransferFunction([9.3], [1.0, 10.0])
LATE_STEERING = TransferFunction([9.3], [1.0, 10.0], delay=0.0571, offset=0.01)
START = Start(1.0, -2.0, 0.3, 0.5)

VEHICLES = {
    "VDM": Vehicle(BICYCLE),
    "VDM-SI": Vehicle(BICYCLE, POWERTRAIN, STEERING),
    "two delays": Vehicle(BICYCLE, LATE_POWERTRAIN, LATE_STEERING),
    "velocity": Vehicle(BICYCLE, POWERTRAIN, None, SpeedInput.VELOCITY),
}


_CONTROLLERS = (None, diffrax.PIDController(rtol=1e-10, atol=1e-10))


def commands(seed=0, rows=ROWS):
    rng = np.random.default_rng(seed)
    v = np.repeat(rng.uniform(1.0, 3.0, rows // 97 + 1), 97)[:rows]
    delta = np.repeat(rng.uniform(-0.3, 0.3, rows // 53 + 1), 53)[:rows]
    return Commands(v, delta, DT)


def largest_difference(one, other, names=("x", "y", "psi", "v", "delta", "r")):
    return max(float(jnp.abs(getattr(one, n) - getattr(other, n)).max()) for n in names)


@pytest.mark.parametrize("name", VEHICLES)
def test_quadrature_is_the_solver(name):
    drive, vehicle, start = commands(), VEHICLES[name], START
    if name == "velocity":  # which takes no speed at the start, but a state of the powertrain
        start = Start(1.0, -2.0, 0.3, powertrain=jnp.zeros(2))
    fast = simulate(vehicle, drive, start, method=Quadrature())
    slow = simulate(vehicle, drive, start, method=Solver())
    assert fast.ok and slow.ok
    assert largest_difference(fast, slow) < METRES
    assert largest_difference(fast, slow, ("a",)) < 1e-7  # poles multiply the solver's error
    first = 0.0631 * drive.v_cmd[0] if name == "velocity" else 0.5
    np.testing.assert_allclose([fast.v[0], fast.x[0], fast.psi[0]], [first, 1.0, 0.3], rtol=1e-12)


def test_nodes_converge_at_their_order():
    drive, vehicle = commands(), Vehicle(BICYCLE, None, LATE_STEERING)
    paths = [simulate(vehicle, drive, method=Quadrature(n)) for n in (1, 2, 4)]
    errors = [largest_difference(path, paths[-1], ("x", "y")) for path in paths[:-1]]
    assert errors[0] > 100 * errors[1] > 0.0


@pytest.mark.parametrize("powertrain", [None, LATE_POWERTRAIN])
def test_arcs_are_the_quadrature(powertrain):
    vehicle, drive = Vehicle(BICYCLE, powertrain), commands()
    arcs, nodes = (simulate(vehicle, drive, START, method=m) for m in (Arcs(), Quadrature()))
    assert largest_difference(arcs, nodes) < METRES


def test_circle_closes():
    rows = 4001
    vehicle = Vehicle(BICYCLE)
    delta = 0.3
    cosine, _, curvature = (float(value) for value in BICYCLE.course(jnp.array(delta)))
    speed = 2.0 * np.pi / curvature / (DT * (rows - 1))  # once around
    drive = Commands(np.full(rows, speed), np.full(rows, delta), DT)
    for method in (Arcs(), Quadrature()):
        path = simulate(vehicle, drive, method=method)
        np.testing.assert_allclose([path.x[-1], path.y[-1]], 0.0, atol=1e-11)
        np.testing.assert_allclose(path.psi[-1], 2.0 * np.pi, rtol=1e-12)
        np.testing.assert_allclose(path.r, speed * curvature, rtol=1e-12)
        centre = np.array([-np.sin(np.arccos(cosine)), cosine]) / curvature
        radius = np.hypot(path.x - centre[0], path.y - centre[1])
        np.testing.assert_allclose(radius, 1.0 / curvature, rtol=1e-11)


def test_the_ways_to_follow_a_velocity_command():
    """v from 0 to 2 m/s at t = 1 s, straight on, for 3 s: each rule's distance by hand."""
    v = np.where(np.arange(301) < 100, 0.0, 2.0)
    drive = Commands(v, np.zeros(301), DT)
    at_once = simulate(Vehicle(BICYCLE, FollowedAtOnce()), drive)
    np.testing.assert_allclose(at_once.x[-1], 2.0 * 2.0, rtol=1e-12)
    increments = simulate(Vehicle(BICYCLE, FollowedAtOnce()), drive, Start(v=0.5))
    np.testing.assert_allclose(increments.x[-1], 0.5 * 1.0 + 2.5 * 2.0, rtol=1e-12)
    velocity = Vehicle(BICYCLE, FollowedAtOnce(), speed_input=SpeedInput.VELOCITY)
    np.testing.assert_allclose(simulate(velocity, drive, Start(v=0.5)).x[-1], 4.0, rtol=1e-12)
    limited = simulate(Vehicle(BICYCLE, RateLimited(4.5)), drive)
    ramp = 2.0 / 4.5
    np.testing.assert_allclose(limited.x[-1], 2.0 * 2.0 - 0.5 * 2.0 * ramp, rtol=1e-12)
    np.testing.assert_allclose(limited.a[100], 4.5)
    np.testing.assert_allclose(limited.a[-1], 0.0)
    # an identified steering needs nodes, and those see the kink of the ramp with a small error
    steered = Vehicle(BICYCLE, RateLimited(4.5), TransferFunction([10.0], [1.0, 10.0]))
    np.testing.assert_allclose(simulate(steered, drive).x[-1], limited.x[-1], atol=5e-5)


def test_acceleration_is_the_exact_derivative():
    """Eq. (6) from another speed than the response's own differs by that speed alone."""
    drive = commands()
    response = POWERTRAIN.simulate(drive.v_cmd, DT)
    moved = simulate(VEHICLES["VDM-SI"], drive, START)
    np.testing.assert_allclose(moved.v - moved.v[0], response.y - response.y[0], atol=1e-13)
    assert float(moved.v[0]) == 0.5
    np.testing.assert_allclose(moved.a, response.dy, atol=1e-13)


def test_many_scenarios_and_many_models_are_the_single_ones():
    """Vehicles of order 0, 1 and 2, with delays and without, in one batch."""
    vehicles = [VEHICLES[name] for name in ("VDM", "VDM-SI", "two delays")]
    drives = [commands(seed) for seed in range(3)]
    batch = Commands(
        jnp.stack([d.v_cmd for d in drives]), jnp.stack([d.delta_cmd for d in drives]), DT
    )
    starts = Start(jnp.arange(3.0), *(jnp.full(3, value) for value in (-2.0, 0.3, 0.5)))
    models = simulate_many(stack_vehicles(vehicles), batch, starts)
    stacked = jax.tree.map(lambda *parts: jnp.stack(parts), *drives)  # with a period each
    again = simulate_many(stack_vehicles(vehicles), stacked, starts)
    assert largest_difference(again, models) == 0.0
    scenarios = simulate_many(vehicles[1], batch, starts, batch_size=1)
    assert models.x.shape == scenarios.x.shape == (3, ROWS)
    assert bool(models.ok.all() and scenarios.ok.all())
    for many, lane in ((models, 0), (models, 1), (models, 2), (scenarios, 0), (scenarios, 2)):
        vehicle = vehicles[lane] if many is models else vehicles[1]
        one = simulate(vehicle, drives[lane], Start(float(lane), -2.0, 0.3, 0.5))
        picked = jax.tree.map(lambda leaf, lane=lane: leaf[lane], many)
        assert largest_difference(one, picked, ("t", "x", "y", "psi", "v", "delta", "a")) < 1e-11


def test_whole_numbers_have_derivatives_and_any_numbers_share_one_program():
    row = np.full(9, 2.0)
    integers = Vehicle(Bicycle(1, 1)), Commands(row, row // 10, 1), Start(0, 0, 0)
    numpys = (
        Vehicle(Bicycle(np.float64(1), np.float64(1))),
        Commands(jnp.asarray(row), row // 10, np.float64(1)),
        Start(*jnp.zeros(3)),
    )
    kinds = [jax.tree.map(jax.typeof, given) for given in (integers, numpys)]
    assert kinds[0] == kinds[1] and not any(kind.weak_type for kind in jax.tree.leaves(kinds))
    slope = eqx.filter_grad(lambda given: simulate(*given).x[-1])(integers)
    assert float(slope[2].x) == 1.0 and slope[0].bicycle.l_f is not None


@pytest.mark.parametrize("with_commands", [False, True])
@pytest.mark.parametrize(
    "where",
    [lambda v: v.steering.delay, lambda v: v.bicycle.l_f, lambda v: v.steering.den],
    ids=["delay", "l_f", "den"],
)
def test_one_number_of_a_vehicle_may_be_batched_alone(where, with_commands):
    vehicle, drive = VEHICLES["two delays"], commands(rows=9)
    scales = jnp.array([1.0, 1.1, 1.3])
    many = eqx.tree_at(where, vehicle, jnp.stack([scale * where(vehicle) for scale in scales]))
    drives = jax.tree.map(lambda row: jnp.stack([row] * 3), drive) if with_commands else drive
    paths = simulate_many(many, drives)
    one = simulate(eqx.tree_at(where, vehicle, 1.3 * where(vehicle)), drive)
    assert paths.x.shape == (3, 9)
    np.testing.assert_allclose(paths.poses[2], one.poses, atol=1e-12)


def test_a_plain_number_in_a_vehicle_needs_no_program_of_its_own():
    vehicle, drive, made = VEHICLES["two delays"], commands(rows=9), []
    for delay in (0.01, np.float64(0.02), jnp.asarray(0.03, float)):
        late = as_vehicle(eqx.tree_at(lambda v: v.steering.delay, vehicle, delay))
        made.append(jax.tree.map(jax.typeof, late))
        assert simulate(late, drive).ok
    assert made[0] == made[1] == made[2]


def test_batches_must_agree():
    drive = commands()
    with pytest.raises(ValueError, match="batch length"):
        simulate_many(VEHICLES["VDM"], drive)
    two = Commands(jnp.stack([drive.v_cmd] * 2), jnp.stack([drive.delta_cmd] * 2), DT)
    with pytest.raises(ValueError, match="batch length"):
        simulate_many(stack_vehicles([VEHICLES["VDM"]] * 3), two)


def test_what_cannot_be_stacked_is_refused():
    with pytest.raises(ValueError, match="speed_input"):
        stack_vehicles([VEHICLES["VDM-SI"], VEHICLES["velocity"]])
    with pytest.raises(ValueError, match="orders alike, and all effects .* not wanted off"):
        stack_vehicles([Vehicle(BICYCLE, RateLimited(1.0)), VEHICLES["VDM"]])


def test_a_track_is_no_record_of_commands_and_has_some():
    with pytest.raises(TypeError, match="Track"):
        simulate(VEHICLES["VDM"], bend())
    drive = bend().commands(BICYCLE, speed=2.0)
    assert simulate(VEHICLES["VDM"], drive).ok


@pytest.mark.parametrize(
    ("arguments", "more", "told"),
    [
        (([VEHICLES["VDM"]] * 2, commands(rows=9)), {}, "list is no vehicle; .*stack_vehicles"),
        ((VEHICLES["VDM"], [commands(rows=9)] * 2), {}, "list is no record of commands; .*leading"),
        ((VEHICLES["VDM"], commands(rows=9), (0, 0, 0)), {}, r"start = \(0, 0, 0\) .*Start\(x"),
        ((VEHICLES["VDM"], commands(rows=9)), {"method": Solver}, r"is none; give Quadrature\(\)"),
        ((VEHICLES["VDM"], commands(rows=9)), {"method": "rk4"}, "method = 'rk4' is none; give"),
    ],
)
def test_what_cannot_be_simulated_is_told_by_its_kind(unchecked, arguments, more, told):
    for verb in (simulate, simulate_many):
        with pytest.raises(TypeError, match=told):
            verb(*arguments, **more)


def test_commands_of_many_drives_are_for_simulate_many(unchecked):
    drive = commands(rows=9)
    two = Commands(jnp.stack([drive.v_cmd] * 2), jnp.stack([drive.delta_cmd] * 2), DT)
    with pytest.raises(ValueError, match="many drives; use simulate_many"):
        simulate(VEHICLES["VDM"], two)
    model = Model({}, VehicleGeometry(1.75, 1.2))
    assert simulate_many(model, two).x.shape == (2, 9)
    record = Record.from_arrays(dt=DT, v_cmd=drive.v_cmd, delta_cmd=drive.delta_cmd)
    assert simulate_many(stack_vehicles([VEHICLES["VDM"]] * 2), record).x.shape == (2, 9)
    motor = Plant(PlantSpec("motor", "u", "w"), TransferFunction([5.0], [1.0, 5.0]))
    with pytest.raises(InputError, match=r'take model.plants\["motor"\].model.simulate'):
        simulate(Model({"motor": motor}), drive)


def test_none_is_followed_at_once_however_it_came_there():
    drive = commands(rows=9)
    without = eqx.tree_at(lambda v: v.steering, VEHICLES["VDM-SI"], None)
    assert stack_vehicles([without, without]).bicycle.l_f.shape == (2,)
    path = simulate(without, drive)
    assert largest_difference(path, simulate(Vehicle(BICYCLE, POWERTRAIN), drive)) == 0.0


def test_a_solver_without_a_controller_has_its_own(unchecked):
    drive = commands(rows=9)
    paths = [simulate(VEHICLES["VDM"], drive, method=Solver(controller=c)) for c in _CONTROLLERS]
    assert largest_difference(*paths) == 0.0


def mean_ate(vehicle, drive, truth, method):
    path = simulate(vehicle, drive, method=method)
    return metrics.ate(truth, path.poses)["mean"]


def test_gradient_of_the_error_on_the_road():
    """Both modes of the fast path agree, and with differences, over every number of the vehicle."""
    drive, vehicle = commands(), Vehicle(BICYCLE, POWERTRAIN, LATE_STEERING)
    truth = simulate(Vehicle(BICYCLE), drive).poses
    flat, build = jax.flatten_util.ravel_pytree(vehicle)

    def loss(numbers):
        return mean_ate(build(numbers), drive, truth, Quadrature())

    both = jax.jit(lambda at: (loss(at), jax.grad(loss)(at), jax.jacfwd(loss)(at)))
    _, reverse, forward = both(flat)
    assert np.isfinite(forward).all()
    np.testing.assert_allclose(forward, reverse, rtol=1e-8, atol=1e-10)
    direction = flat * np.random.default_rng(0).normal(size=flat.size)
    step, run = 1e-6, jax.jit(loss)
    slope = (run(flat + step * direction) - run(flat - step * direction)) / (2 * step)
    # den[0] is 1 by construction and has no derivative; differences see none either
    np.testing.assert_allclose(forward @ direction, slope, rtol=1e-5)


@pytest.mark.parametrize(
    ("adjoint", "mode"),
    [
        pytest.param(diffrax.RecursiveCheckpointAdjoint(), jax.grad, marks=pytest.mark.slow),
        (diffrax.ForwardMode(), jax.jacfwd),
    ],
)
def test_gradient_through_the_solver_is_that_of_the_quadrature(adjoint, mode):
    drive = commands(rows=51)
    truth = simulate(Vehicle(BICYCLE), drive).poses

    def loss(gain, method):
        steering = TransferFunction(gain * STEERING.num, STEERING.den)
        return mean_ate(Vehicle(BICYCLE, POWERTRAIN, steering), drive, truth, method)

    expected = jax.grad(loss)(1.1, Quadrature())
    np.testing.assert_allclose(mode(loss)(1.1, Solver(adjoint=adjoint)), expected, rtol=1e-6)


def test_failure_is_a_status_and_not_an_exception():
    drive = commands()
    explosive = Vehicle(BICYCLE, TransferFunction([1.0], [1.0, -900.0]), STEERING)
    path = simulate(explosive, drive)
    assert not path.ok
    assert "not finite" in RESULTS[path.status] and "not finite" in repr(path)
    stiff = Vehicle(BICYCLE, TransferFunction([1e7], [1.0, 1e7]), STEERING)
    path = simulate(stiff, drive, method=Solver(max_steps=8))
    assert not path.ok
    assert "max_steps" in RESULTS[path.status]
    assert simulate(stiff, drive, method=Quadrature()).ok
    broken = Commands(drive.v_cmd.at[5].set(jnp.nan), drive.delta_cmd, DT)
    assert not simulate(VEHICLES["VDM"], broken, START).ok


def test_methods_that_do_not_suit_are_refused():
    drive = commands()
    with pytest.raises(ValueError, match="use Quadrature"):
        simulate(VEHICLES["VDM-SI"], drive, method=Arcs())
    with pytest.raises(ValueError, match="not linear"):
        simulate(Vehicle(BICYCLE, RateLimited(1.0)), drive, method=Solver())
    with pytest.raises(ValueError, match="at least one node"):
        Quadrature(0)
    with pytest.raises(ValueError, match="one shape"):
        Commands(np.zeros(3), np.zeros(4), DT)


@pytest.mark.parametrize("dt", [0.0, -DT, np.nan])
def test_time_goes_on_from_row_to_row(dt):
    with pytest.raises(ValueError, match="dt = .* is no sample period"):
        Commands(np.zeros(4), np.zeros(4), dt)
    with pytest.raises(ValueError, match="dt = .* is no sample period"):
        STEERING.simulate(np.zeros(4), dt)
    begun = jax.jit(
        lambda dt: Commands(np.zeros(4), np.zeros(4), dt).dt
    )  # whose value is not known
    assert begun(DT) == DT


def test_a_record_gives_its_own_commands():
    drive = commands()
    v, delta = np.asarray(drive.v_cmd), np.asarray(drive.delta_cmd)
    record = Record.from_arrays(dt=DT, t0=7.0, v_cmd=v, delta_cmd=delta)
    path = simulate(VEHICLES["VDM-SI"], record, START)
    assert largest_difference(path, simulate(VEHICLES["VDM-SI"], drive, START)) == 0.0
    np.testing.assert_allclose(path.t, record.t, rtol=1e-14)
    lag = Plant(PlantSpec("steering", "delta_cmd", "delta"), TransferFunction([5.0], [1.0, 5.0]))
    model = Model({"steering": lag}, VehicleGeometry(1.0, 1.2))
    described = simulate(model.to_vehicle(), record, START)
    assert largest_difference(simulate(model, record, START), described) == 0.0
    torn = Record(
        "torn", DT, record.t, record.channels, record.units, (Segment(0, 40), Segment(40, ROWS))
    )
    with pytest.raises(InputError, match="segments"):
        simulate(VEHICLES["VDM-SI"], torn)


def test_one_program_serves_every_vehicle_of_a_kind():
    traces = []

    @eqx.filter_jit
    def run(vehicle, drive):
        traces.append(1)
        return simulate(vehicle, drive).x

    for seed in range(3):
        run(Vehicle(Bicycle(1.0 + seed, 1.2), RateLimited(1.0 + seed)), commands(seed))
    assert len(traces) == 1


@pytest.mark.parametrize(
    ("command", "rests", "within"),
    [
        (0.3 + 0.01 * np.random.default_rng(0).standard_normal(400), 0.3, 3e-3),
        (np.repeat(0.01 * np.random.default_rng(1).standard_normal(200), 2), 0.0, 3e-3),
        (np.full(400, 0.1), 0.1, 0.0),
        (np.r_[0.0, np.full(399, 0.2)], 0.0, 0.0),
        (np.r_[np.zeros(12), np.full(388, 0.2)], 0.0, 0.0),
        (np.linspace(0.05, 1.0, 400), 0.05, 0.0),
        (np.sin(np.arange(400) / 30.0), 0.0, 0.0),
        (np.array([0.2, 0.1]), 0.2, 0.0),
    ],
)
def test_a_command_that_scatters_begins_at_its_mean_and_any_other_at_its_first_value(
    command, rests, within
):
    assert resting_command(command, 0.01) == pytest.approx(rests, abs=within)


def test_a_vehicle_at_rest_begins_under_the_mean_of_noisy_commands_and_nowhere_else():
    steering = ExtendedPlant(TransferFunction([5.0], [1.0, 5.0]), (Backlash(0.1),))
    vehicle = Vehicle(BICYCLE, FollowedAtOnce(), steering)
    noise = 0.01 * np.random.default_rng(2).standard_normal(500)
    noise[0] = 0.03
    commands = Commands(np.ones(500), noise, 0.01)
    start = at_rest(vehicle, commands, x=1.0, y=2.0, psi=0.5)
    assert (float(start.x), float(start.y), float(start.psi)) == (1.0, 2.0, 0.5)
    assert start.powertrain is None
    assert abs(float(simulate(vehicle, commands, start).delta[-1])) < 2e-3
    assert abs(float(simulate(vehicle, commands).delta[-1])) > 0.02
