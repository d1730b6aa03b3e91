"""The powertrain by an IMU, against the derivative of a measured speed; the plant is the tests'
own."""

import numpy as np
import pytest

import vdmsi_jax as vj
from known_plants import Truth, log, response, white
from vdmsi_jax.data.derive import differentiate
from vdmsi_jax.files import write_json
from vdmsi_jax.identify.acceleration import IMU_POWERTRAIN, speed_response
from vdmsi_jax.identify.document import identify_document
from vdmsi_jax.scenarios import random_steps

DT, SEEDS = 0.01, 7
SPEED = Truth((143.90,), (1.0, 18.15, 143.20))  # the paper's powertrain without its fast zeros
ACCELERATION = Truth((143.90, 0.0), SPEED.den)
SPEED_NOISE, IMU_NOISE, BIAS = 0.054, 0.1, 0.15  # m/s (the paper's residual), m/s², m/s²
OPTIONS = {"poles": (2,), "zeros": (1,), "delay": False, "held_out": 0.0}


def steps(seed: int) -> np.ndarray:
    return random_steps([0.0, 1.0], dwell=(1.0, 3.0), duration=30.0, dt=DT, seed=seed)


def record(u: np.ndarray, a: np.ndarray) -> vj.Record:
    return vj.Record.from_arrays(dt=DT, name="imu", v_cmd=u, a=a)


@pytest.fixture(scope="module")
def fits() -> dict[str, list[vj.SpeedResponse]]:
    found = {"imu": [], "derivative": []}
    for seed in range(SEEDS):
        u = steps(seed)
        speed = response(SPEED, u, DT) + white(len(u), SPEED_NOISE, 2 * seed)
        imu = response(ACCELERATION, u, DT) + BIAS + white(len(u), IMU_NOISE, 2 * seed + 1)
        for name, a in (("imu", imu), ("derivative", differentiate(speed, DT, 5))):
            grid = vj.identify(record(u, a), IMU_POWERTRAIN, **OPTIONS)
            found[name].append(speed_response(grid["P2Z1"]))
    return found


def parameter_error(fit: vj.SpeedResponse) -> float:
    assert fit.parameter_names == ("b0", "a1", "a0")
    return float(np.linalg.norm(fit.parameters / SPEED.parameters - 1.0))


def speed_error(fit: vj.SpeedResponse) -> float:
    """Of a drive that no fit has seen, m/s."""
    u = steps(1000)
    return float(np.std(np.asarray(fit.model.simulate(u, DT).y) - response(SPEED, u, DT)))


def test_an_imu_tells_more_than_the_derivative_of_the_speed(fits):
    for error in (parameter_error, speed_error):
        imu, derivative = (np.median([error(f) for f in fits[k]]) for k in ("imu", "derivative"))
        assert imu < 0.5 * derivative


def test_bias_and_intervals_hold(fits):
    off = [(f.bias - BIAS) / f.bias_std for f in fits["imu"]]
    assert np.all(np.abs(off) < 4.0)
    scores = [
        (f.parameters - SPEED.parameters) / [f.std[name] for name in f.parameter_names]
        for f in fits["imu"]
    ]
    assert np.mean(np.abs(scores) < 1.96) > 0.8  # of 21


def test_a_vehicle_is_simulated_by_the_speed(fits, tmp_path):
    u = steps(3)
    grid = vj.identify(record(u, response(ACCELERATION, u, DT) + BIAS), IMU_POWERTRAIN, **OPTIONS)
    model = vj.identified({"powertrain": grid})
    plant = model.plants["powertrain"]
    assert (plant.spec.input, plant.spec.output) == ("v_cmd", "v")
    np.testing.assert_allclose(plant.linear.num, SPEED.num, rtol=1e-4)
    np.testing.assert_allclose(plant.linear.den, SPEED.den, rtol=1e-4)
    path = write_json(
        tmp_path / "identify.json", identify_document({"powertrain": grid}, [record(u, u)])
    )
    read = vj.load_model(path).plants["powertrain"]
    assert read.spec == plant.spec
    np.testing.assert_allclose(read.linear.num, plant.linear.num)
    np.testing.assert_allclose(read.linear.den, plant.linear.den)
    assert read.linear.offset is None or read.linear.offset == 0.0


def test_what_it_refuses(tmp_path):
    u = steps(0)
    a = response(ACCELERATION, u, DT) + white(len(u), IMU_NOISE, 0)
    no_zero = vj.identify(
        record(u, a), IMU_POWERTRAIN, poles=(2,), zeros=(0,), delay=False, held_out=0.0
    )
    with pytest.raises(vj.InputError, match="has no zero"):
        speed_response(no_zero["P2Z0"])
    document = identify_document({"powertrain": no_zero}, [record(u, a)])
    with pytest.raises(vj.InputError, match="has no zero"):
        vj.load_model(write_json(tmp_path / "identify.json", document))
    other = vj.identify(log(u, a, DT), "plant", **OPTIONS)
    with pytest.raises(vj.InputError, match="is from u_cmd to out"):
        speed_response(other["P2Z1"])
