"""The filter on drives made by plain NumPy: consistent, better than with VDM, exact without
noise."""

from functools import lru_cache

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.stats import chi2

import vdmsi_jax as vj
from known_plants import Truth, coloured, response, white
from vdmsi_jax.effects import TyreRelaxation, Understeer
from vdmsi_jax.fusion import Fused, GaussMarkov, ModelError, PoseSensor, fuse
from vdmsi_jax.models.following import RateLimited
from vdmsi_jax.simulate import Commands

DT, ROWS, SEEDS = 0.02, 2000, 60
BEGIN = 400  # row at which outages begin
POSITION, HEADING = 0.05, 0.01  # m and rad of the pose sensor's noise, five times a second
L_F, L_R = 1.75, 1.2
POWERTRAIN = Truth((144.0,), (1.0, 18.15, 143.2), delay=0.03)
STEERING = Truth((23.15,), (1.0, 25.44), delay=0.05)
OFF = {"speed": (0.04, 1.0), "angle": (0.004, 0.7)}  # std and memory (s) of what no model knows
BICYCLE = vj.Bicycle(L_F, L_R)


def models() -> dict[str, vj.Vehicle]:
    actuators = [
        vj.TransferFunction(truth.num, truth.den, delay=truth.delay)
        for truth in (POWERTRAIN, STEERING)
    ]
    return {"VDM": vj.Vehicle(BICYCLE), "VDM-SI": vj.Vehicle(BICYCLE, *actuators)}


@lru_cache
def drive(seed: int, rows: int = ROWS) -> dict[str, np.ndarray]:
    """Commands, responses and poses of a drive at 2 to 5 m/s; the actuators wander a little."""
    rng = np.random.default_rng(seed)
    v_cmd = np.repeat(rng.uniform(2.0, 5.0, rows // 100 + 1), 100)[:rows]
    delta_cmd = np.repeat(rng.uniform(-0.25, 0.25, rows // 75 + 1), 75)[:rows]
    off = [
        coloured(rows, std, np.exp(-DT / memory), 2 * seed + i)
        for i, (std, memory) in enumerate(OFF.values())
    ]
    v = response(POWERTRAIN, v_cmd, DT) + off[0]
    delta = response(STEERING, delta_cmd, DT) + off[1]
    mean_v, mean_delta = 0.5 * (v[1:] + v[:-1]), 0.5 * (delta[1:] + delta[:-1])
    beta = np.arctan(L_R / (L_F + L_R) * np.tan(mean_delta))
    psi = np.append(0.0, np.cumsum(DT * mean_v * np.sin(beta) / L_R))
    course = 0.5 * (psi[1:] + psi[:-1]) + beta
    x, y = (np.append(0.0, np.cumsum(DT * mean_v * f(course))) for f in (np.cos, np.sin))
    poses = np.stack([x, y, psi], axis=1)
    return {"v_cmd": v_cmd, "delta_cmd": delta_cmd, "v": v, "delta": delta, "poses": poses}


@pytest.fixture(scope="module")
def drives() -> dict[str, np.ndarray]:
    every = [drive(seed) for seed in range(SEEDS)]
    stacked = {name: np.stack([one[name] for one in every]) for name in every[0]}
    noise = np.random.default_rng(5).standard_normal(stacked["poses"].shape)
    stacked["measured"] = stacked["poses"] + noise * [POSITION, POSITION, HEADING]
    return stacked


def error_of(vehicle: vj.Vehicle) -> ModelError:
    """From a drive of its own, with noisy sensors, long enough to tell the size of a process with a
    memory of a second to a few percent."""
    rows = 20_000
    known, processes = drive(1000, rows), []
    for plant, command, channel, noise in (
        (vehicle.powertrain, "v_cmd", "v", 0.05),
        (vehicle.steering, "delta_cmd", "delta", 0.01),
    ):
        simulated = np.asarray(plant.simulate(known[command], DT).y)
        measured = known[channel] + white(rows, noise, 7)
        processes.append(GaussMarkov.of_residual(measured - simulated, DT)[0])
    return ModelError(*processes)


def filtered(vehicle, drives, seconds, error) -> Fused:
    """All drives, with the sensor gone for so many seconds."""
    rows = np.arange(ROWS)
    gone = (rows >= BEGIN) & (rows < BEGIN + round(seconds / DT))
    seen, sensor = (rows % 10 == 0) & ~gone, PoseSensor(POSITION, HEADING)

    def one(v_cmd, delta_cmd, measured):
        return fuse(
            vehicle, Commands(v_cmd, delta_cmd, DT), measured, seen, error=error, sensor=sensor
        )

    return jax.vmap(one)(drives["v_cmd"], drives["delta_cmd"], drives["measured"])


def at_end(fused: Fused, drives, seconds) -> tuple[np.ndarray, np.ndarray]:
    """Position error and NEES of every drive in the last row of the outage."""
    row = BEGIN + round(seconds / DT) - 1
    apart = np.asarray(fused.poses)[:, row, :2] - drives["poses"][:, row, :2]
    nees = jax.vmap(Fused.nees)(fused, jnp.asarray(drives["poses"]))
    return np.hypot(*apart.T), np.asarray(nees)[:, row]


@pytest.mark.parametrize("seconds", [1, 3, 10, 30])
def test_it_is_consistent_after_an_outage(seconds, drives):
    vehicle = models()["VDM-SI"]
    fused = filtered(vehicle, drives, seconds, error_of(vehicle))
    _, nees = at_end(fused, drives, seconds)
    low, high = chi2.ppf([0.001, 0.999], 3 * SEEDS) / SEEDS
    assert low < nees.mean() < high
    calm = np.asarray(jax.vmap(Fused.nees)(fused, jnp.asarray(drives["poses"])))[:, BEGIN - 1]
    assert low < calm.mean() < high


def test_noise_without_memory_makes_it_too_sure(drives):
    vehicle = models()["VDM-SI"]
    error = error_of(vehicle)
    white_error = ModelError(*(GaussMarkov(p.std, 1e-3) for p in (error.speed, error.angle)))
    _, nees = at_end(filtered(vehicle, drives, 10, white_error), drives, 10)
    assert nees.mean() > 10.0  # of 3


def test_an_outage_of_ten_seconds_costs_less_than_with_vdm(drives):
    worst = {
        name: at_end(filtered(vehicle, drives, 10, error_of(vehicle)), drives, 10)[0]
        for name, vehicle in models().items()
    }
    assert np.median(worst["VDM-SI"]) < 0.4 * np.median(worst["VDM"])
    assert np.sqrt(np.mean(worst["VDM-SI"] ** 2)) < 0.4 * np.sqrt(np.mean(worst["VDM"] ** 2))


def test_the_residual_tells_size_and_memory():
    residual = coloured(60_000, 0.04, np.exp(-DT / 0.8), 0) + white(60_000, 0.05, 1)
    process, rest = GaussMarkov.of_residual(residual, DT)
    np.testing.assert_allclose([process.std, process.time_constant], [0.04, 0.8], rtol=0.15)
    assert abs(rest - 0.05) < 0.002
    silent, rest = GaussMarkov.of_residual(white(20_000, 0.05, 2), DT)
    assert silent.std < 0.01 and abs(rest - 0.05) < 0.002


def test_a_residual_with_holes_tells_nearly_the_same():
    whole = coloured(60_000, 0.04, np.exp(-DT / 0.8), 0) + white(60_000, 0.05, 1)
    holes = np.random.default_rng(2).random(whole.size) < 0.1
    holes[20_000:26_000] = True
    told, rest = GaussMarkov.of_residual(np.where(holes, np.nan, whole), DT)
    process, expected = GaussMarkov.of_residual(whole, DT)
    np.testing.assert_allclose(
        [told.std, told.time_constant, rest],
        [process.std, process.time_constant, expected],
        rtol=0.1,
    )


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
def test_a_residual_that_tells_nothing_is_refused(value):
    residual = np.full(100, np.nan) if np.isnan(value) else white(100, 0.05, 1)
    residual[50] = value
    with pytest.raises(ValueError, match="four known values or more, all of them finite"):
        GaussMarkov.of_residual(residual, DT)


def test_all_that_a_residual_tells_is_no_process_and_says_which_part_is():
    told = GaussMarkov.of_residual(white(100, 0.05, 1), DT)
    with pytest.raises(TypeError, match=r"give the process alone, of_residual\(\.\.\.\)\[0\]"):
        ModelError(speed=told, angle=told[0])


def test_without_noise_it_is_the_simulation():
    """The trapezoidal rule of the filter against the quadrature, over 40 s of sharp commands."""
    vehicle, known = models()["VDM-SI"], drive(3)
    commands = Commands(known["v_cmd"], known["delta_cmd"], DT)
    trajectory = vj.simulate(vehicle, commands)
    still = GaussMarkov(1e-9, 1.0)
    seen = np.arange(ROWS) == 0
    fused = fuse(
        vehicle,
        commands,
        trajectory.poses,
        seen,
        error=ModelError(still, still),
        sensor=PoseSensor(1e-6, 1e-6),
    )
    apart = np.abs(np.asarray(fused.poses - trajectory.poses))
    assert apart[:, :2].max() < 0.02  # m after 120 m, of the order dt squared


def test_headings_may_be_wrapped(drives):
    vehicle, error = models()["VDM-SI"], error_of(models()["VDM-SI"])
    whole = filtered(vehicle, drives, 1, error).poses[0]
    wrapped = dict(drives, measured=drives["measured"].copy())
    psi = wrapped["measured"][..., 2] + 3.0
    wrapped["measured"][..., 2] = np.arctan2(np.sin(psi), np.cos(psi)) - 3.0
    again = filtered(vehicle, wrapped, 1, error).poses[0]
    assert np.ptp(wrapped["measured"][0, :, 2] - drives["measured"][0, :, 2]) > 6.0
    np.testing.assert_allclose(again, whole, atol=1e-9)


def test_what_it_refuses():
    known, still = drive(0), GaussMarkov(0.1, 1.0)
    commands = Commands(known["v_cmd"], known["delta_cmd"], DT)
    told = {"error": ModelError(still, still), "sensor": PoseSensor(0.1, 0.1)}
    seen = np.ones(ROWS, bool)
    with pytest.raises(ValueError, match="powertrain is not linear"):
        fuse(vj.Vehicle(BICYCLE, RateLimited(4.5)), commands, known["poses"], seen, **told)
    with pytest.raises(ValueError, match="remembers the way"):
        lagged = vj.Vehicle(BICYCLE, effects=(TyreRelaxation(0.3),))
        fuse(lagged, commands, known["poses"], seen, **told)
    with pytest.raises(RuntimeError, match="see the first row"):
        blind = seen.copy()
        blind[0] = False
        fuse(vj.Vehicle(BICYCLE), commands, known["poses"], blind, **told)
    extended = vj.Vehicle(BICYCLE, effects=(Understeer(0.003),))
    assert bool(jnp.isfinite(fuse(extended, commands, known["poses"], seen, **told).poses).all())


def test_a_model_and_a_record_are_filtered_too():
    known, still = drive(0, 60), GaussMarkov(0.1, 1.0)
    told = {"error": ModelError(still, still), "sensor": PoseSensor(0.1, 0.1)}
    channels = {name: known[name] for name in ("v_cmd", "delta_cmd")}
    record = vj.Record.from_arrays(dt=DT, **channels)
    model = vj.Model({}, vj.VehicleGeometry(L_F, L_R))
    seen = np.ones(60, bool)
    own = fuse(model.to_vehicle(), Commands(**channels, dt=DT), known["poses"], seen, **told)
    same = fuse(model, record, known["poses"], seen, **told)
    np.testing.assert_array_equal(same.poses, own.poses)
