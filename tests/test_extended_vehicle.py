"""A vehicle with causes in it: its actuators hear each other, body and road bend its path."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from effects.worlds import WORLDS, filled, label
from vdmsi_jax.config import PlantSpec, VehicleGeometry
from vdmsi_jax.effects import VEHICLE
from vdmsi_jax.effects.backlash import Backlash
from vdmsi_jax.effects.bank import COMPLIANCE, Bank
from vdmsi_jax.effects.cross_coupling import CrossCoupling
from vdmsi_jax.effects.gain_drift import GainDrift
from vdmsi_jax.effects.geometry_scale import GeometryScale
from vdmsi_jax.effects.misalignment import Misalignment
from vdmsi_jax.effects.speed_dependent_gain import SpeedDependentGain
from vdmsi_jax.effects.speed_scale import SpeedScale
from vdmsi_jax.effects.transport_delay import TransportDelay
from vdmsi_jax.effects.tyre_relaxation import TyreRelaxation
from vdmsi_jax.effects.understeer import Understeer
from vdmsi_jax.effects.yaw_inertia import YawInertia
from vdmsi_jax.model_file import Model, Plant, load_model, save_model
from vdmsi_jax.models.bicycle import Bicycle
from vdmsi_jax.models.extended_plant import ExtendedPlant
from vdmsi_jax.models.transfer_function import TransferFunction
from vdmsi_jax.models.vehicle import SpeedInput, Vehicle, stack_vehicles
from vdmsi_jax.simulate import Arcs, Commands, Quadrature, Solver, Start, simulate, simulate_many

DT, ROWS = 0.01, 801
METRES = 1e-8  # after 8 s, see test_simulate.py
BICYCLE = Bicycle(1.75, 1.2)
POWERTRAIN = TransferFunction([4.5], [1.0, 5.0], delay=0.0234)
STEERING = TransferFunction([9.3], [1.0, 10.0])
MEMORYLESS = (
    SpeedScale(0.03), Misalignment(0.01), Bank(0.05, 0.004), GeometryScale(0.05), Understeer(0.01)
)  # fmt: skip
RELAXED = TyreRelaxation(0.6)


def commands(seed=0, since=0.0):
    rng = np.random.default_rng(seed)
    v = np.repeat(rng.uniform(1.0, 3.0, ROWS // 97 + 1), 97)[:ROWS]
    delta = np.repeat(rng.uniform(-0.3, 0.3, ROWS // 53 + 1), 53)[:ROWS]
    return Commands(v, delta, DT, since=since)


def vehicle(*effects, powertrain=POWERTRAIN, steering=STEERING):
    return Vehicle(BICYCLE, powertrain, steering, SpeedInput.VELOCITY, effects)


def apart(one, other, names=("x", "y", "psi", "v", "delta", "r")):
    return max(float(jnp.abs(getattr(one, n) - getattr(other, n)).max()) for n in names)


def test_effects_that_are_off_change_nothing():
    drive, start = commands(), Start(1.0, -2.0, 0.3)
    plain = simulate(vehicle(), drive, start)
    assert apart(plain, simulate(vehicle(*VEHICLE), drive, start)) < 1e-12


def late(*effects, delays):
    powertrain = TransferFunction([4.5], [1.0, 5.0], delay=delays[0])
    steering = TransferFunction([9.3], [1.0, 10.0], delay=delays[1])
    return simulate(vehicle(*effects, powertrain=powertrain, steering=steering), commands())


@pytest.mark.parametrize("effect", VEHICLE, ids=label)
def test_jumps_may_fall_on_a_row_or_together(effect):
    on = filled((effect,), jnp.asarray(effect.probes(WORLDS[0].scales)[0]))
    for delays, apart_by_little in (
        ((None, 3 * DT), (None, 3 * DT + 1e-7)),
        ((0.0, 3 * DT), (1e-7, 3 * DT + 1e-7)),
        ((0.0234, 0.0234), (0.0234, 0.0234 + 1e-7)),
    ):
        bare, moved = late(delays=delays), late(*on, delays=delays)
        assert apart(late(effect, delays=delays), bare) < 1e-12
        assert np.isfinite(moved.poses).all() and np.isfinite(moved.r).all()
        assert apart(moved, bare) > 1e-3
        assert apart(moved, late(*on, delays=apart_by_little), ("x", "y", "psi")) < 1e-5


def test_quadrature_is_the_solver_where_nothing_remembers():
    drive, start = commands(), Start(1.0, -2.0, 0.3)
    bent = vehicle(*MEMORYLESS)
    fast, slow = (simulate(bent, drive, start, method=m) for m in (Quadrature(), Solver()))
    assert apart(fast, slow) < METRES
    assert apart(fast, simulate(vehicle(), drive, start), ("x", "y")) > 0.1
    assert apart(fast, simulate(vehicle(), drive, start), ("v", "delta")) == 0.0


def test_arcs_are_the_quadrature_where_they_can_be():
    drive, at_once = commands(), vehicle(*MEMORYLESS, powertrain=None, steering=None)
    arcs, nodes = (simulate(at_once, drive, method=m) for m in (Arcs(), Quadrature()))
    assert apart(arcs, nodes) < METRES
    turned = vehicle(Misalignment(0.01), Bank(0.05, 0.004), steering=None)
    arcs, nodes = (simulate(turned, drive, method=m) for m in (Arcs(), Quadrature()))
    assert apart(arcs, nodes) < METRES
    assert apart(simulate(turned, drive), arcs) == 0.0


def test_a_circle_is_bent_as_the_effects_say():
    v, delta = 2.0, 0.2
    drive = Commands(np.full(ROWS, v), np.full(ROWS, delta), DT)
    bent = vehicle(*MEMORYLESS, powertrain=None, steering=None)
    path = simulate(bent, drive)
    ground, angle = 1.03 * v, delta + 0.01 + 0.004
    slip = np.arctan(1.2 / 2.95 * np.tan(angle))
    r = ground * np.cos(slip) * np.tan(angle) / 2.95 / 1.05 / (1.0 + 0.01 * ground**2)
    np.testing.assert_allclose(path.r, r, rtol=1e-12)
    np.testing.assert_allclose(path.psi[-1], r * DT * (ROWS - 1), rtol=1e-12)
    course = slip + COMPLIANCE * 0.05
    np.testing.assert_allclose(path.x[1], ground * DT * np.cos(course + r * DT / 2), rtol=1e-6)
    np.testing.assert_allclose(path.y[1], ground * DT * np.sin(course + r * DT / 2), rtol=1e-6)


@pytest.mark.parametrize("powertrain", [None, POWERTRAIN])
def test_relaxed_tyres_follow_over_the_way(powertrain):
    """Against a loop of fine steps: kappa' = |v| (kappa_now - kappa) / length."""
    drive, fine = commands(), 100
    path = simulate(vehicle(RELAXED, powertrain=powertrain), drive)
    h, tau = DT / fine, jnp.arange(fine) * DT / fine
    v = np.asarray(vehicle(powertrain=powertrain).powertrain.trace(drive.v_cmd, DT).at(tau))
    now = np.asarray(BICYCLE.course(STEERING.trace(drive.delta_cmd, DT).at(tau))[2])
    bent, psi, turned, rate = now[0, 0], 0.0, np.empty(ROWS), np.empty(ROWS)
    for k in range(ROWS):
        turned[k], rate[k] = psi, v[k, 0] * bent
        for i in range(fine):
            psi += h * v[k, i] * bent
            bent += h * abs(v[k, i]) * (now[k, i] - bent) / 0.6
    # the loop's own error is of the order of its step; straight pieces between nodes cost less,
    # but where the speed jumps at a row, the way from the last node to it is that of the new speed
    np.testing.assert_allclose(path.psi, turned, atol=2e-4)
    np.testing.assert_allclose(path.r, rate, atol=1e-3)
    assert apart(path, simulate(vehicle(powertrain=powertrain), drive), ("psi",)) > 0.01


def test_a_body_with_inertia_comes_back_from_its_file(tmp_path):
    plants = {}
    for name, output, own in (("powertrain", "v", POWERTRAIN), ("steering", "delta", STEERING)):
        at_once = TransferFunction(own.num, own.den, delay=0.0, offset=0.0)
        plants[name] = Plant(PlantSpec(name, f"{output}_cmd", output), at_once)
    model = Model(plants, VehicleGeometry(1.75, 1.2), (YawInertia(0.005),))
    loaded = load_model(save_model(tmp_path / "model.json", model))
    for plant in loaded.plants.values():
        assert plant.model.delay is None and plant.model.offset is None
    path = simulate(model, commands())
    assert np.isfinite(path.poses).all()
    assert apart(path, simulate(loaded, commands())) < METRES


def test_actuators_hear_each_other():
    drive = commands(since=100.0)
    slowed = ExtendedPlant(POWERTRAIN, (CrossCoupling(-0.5, "size"), GainDrift(1e-4)))
    weak = ExtendedPlant(STEERING, (SpeedDependentGain(-0.05),))
    path = simulate(vehicle(powertrain=slowed, steering=weak), drive, Start(v=9.0))
    t = 100.0 + DT * np.arange(ROWS)
    v_cmd = np.asarray(drive.v_cmd - 0.5 * abs(drive.delta_cmd))
    v = POWERTRAIN.simulate(v_cmd * (1.0 + 1e-4 * t), DT).y
    np.testing.assert_allclose(path.v, v, atol=2e-4)  # its delay is no multiple of a sub-step
    delta = STEERING.simulate(drive.delta_cmd * (1.0 - 0.05 * path.v), DT).y
    np.testing.assert_allclose(path.delta, delta, atol=1e-12)


def test_what_a_method_cannot_do_names_the_one_that_can():
    drive = commands()
    with pytest.raises(ValueError, match="remembers the way; use Quadrature"):
        simulate(vehicle(RELAXED, steering=None), drive, method=Arcs())
    with pytest.raises(ValueError, match="speed or curvature .* use Quadrature"):
        simulate(vehicle(Understeer(0.01), steering=None), drive, method=Arcs())
    with pytest.raises(ValueError, match="remembers the way; use Quadrature"):
        simulate(vehicle(RELAXED), drive, method=Solver())
    played = vehicle(steering=ExtendedPlant(STEERING, (Backlash(0.1),)))
    with pytest.raises(ValueError, match="Quadrature"):
        simulate(played, drive, method=Solver())
    with pytest.raises(ValueError, match="ExtendedPlant"):
        vehicle(Backlash(0.1))
    with pytest.raises(ValueError, match="kinds of effects"):
        stack_vehicles([vehicle(), vehicle(RELAXED)])
    for bent in (RELAXED, Understeer(0.01)):
        assert simulate(vehicle(bent, steering=None), drive).ok


def extended(sizes):
    late, gap, gradient, length = sizes
    steering = ExtendedPlant(STEERING, (TransportDelay(late), Backlash(gap)))
    return vehicle(Understeer(gradient), TyreRelaxation(length), steering=steering)


def test_vehicles_with_effects_in_their_plants_are_stacked_too():
    drive = commands()
    vehicles = [extended(sizes) for sizes in SIZES]
    many = simulate_many(stack_vehicles(vehicles), drive)
    for lane, own in enumerate(vehicles):
        np.testing.assert_allclose(many.x[lane], simulate(own, drive).x, atol=METRES)
    other = vehicle(*vehicles[0].effects, steering=ExtendedPlant(STEERING, (Backlash(0.02),)))
    with pytest.raises(ValueError, match="give plants of one kind"):
        stack_vehicles([vehicles[0], other])


SIZES = jnp.array([[0.033, 0.02, 0.003, 0.4], [0.0, 0.0, 0.0, 0.0], [0.01, 0.05, -0.001, 0.1]])


def test_a_batch_of_extended_vehicles_is_the_single_ones():
    drive, parts = commands(), [extended(row) for row in SIZES]
    batch = jax.tree.map(lambda *leaves: jnp.stack(leaves), *parts)
    for many in (
        simulate_many(batch, drive),
        eqx.filter_vmap(lambda one: simulate(one, drive))(batch),
    ):
        for lane, one in enumerate(parts):
            picked = jax.tree.map(lambda leaf, lane=lane: leaf[lane], many)
            assert apart(simulate(one, drive), picked) < 1e-11


@pytest.mark.slow
def test_gradient_of_the_error_on_the_road():
    drive = commands()
    truth = simulate(vehicle(), drive).poses[:, :2]

    def error(sizes):
        return jnp.mean((simulate(extended(sizes), drive).poses[:, :2] - truth) ** 2)

    reverse, run = jax.jit(jax.grad(error)), jax.jit(error)
    forward = jax.jit(jax.jacfwd(error))(SIZES[0])
    np.testing.assert_allclose(forward, reverse(SIZES[0]), rtol=1e-8)
    assert np.isfinite(reverse(SIZES[1])).all()
    slopes = [(run(SIZES[0] + d) - run(SIZES[0] - d)) / 2e-7 for d in 1e-7 * np.eye(4)]
    np.testing.assert_allclose(forward, slopes, rtol=1e-4)
