"""Recursive identification against plants made by code of the tests' own, and the offline fit."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import vdmsi_jax as vj
from known_plants import PLANT, POWERTRAIN, coloured, log, response, steps, white
from vdmsi_jax.identify.online import Forgetting, identify_online, track
from vdmsi_jax.identify.result import Fit

DT = 0.01
NOISE = 0.054  # m/s: the residual that FIT and MSE of the paper's powertrain imply
GUESS = vj.TransferFunction([0.1, 3.0, 100.0], [1.0, 25.0, 100.0])  # 30 to 60 % off in each
CHANGE, DROP, GRANTED = 2000, 0.8, 500  # sample, gain after over before, samples to recover


def drive(seed: int, seconds: float) -> tuple[np.ndarray, np.ndarray]:
    """Velocity steps between 0 and 1 m/s, and the speed without noise."""
    u = 0.5 + 0.5 * steps(round(seconds / DT), 100, seed)
    return u, response(POWERTRAIN, u, DT)


def changing(seed: int) -> tuple[np.ndarray, np.ndarray]:
    """A drive of 30 s in which the speed sensor's plant loses a fifth of its gain after 20 s."""
    u, y = drive(seed, 30.0)
    y[CHANGE:] *= DROP
    return u, y + white(len(y), NOISE, seed)


def errors(parameters: np.ndarray) -> np.ndarray:
    """Sizes of relative errors of all coefficients."""
    return np.linalg.norm(parameters / POWERTRAIN.parameters - 1.0, axis=-1)


@pytest.mark.slow
def test_it_is_as_good_as_the_offline_fit_after_20_s():
    seeds = 24
    drives = [drive(seed, 20.0) for seed in range(seeds)]
    u, y = np.array([u for u, _ in drives]), np.array([y for _, y in drives])
    y = y + np.array([white(y.shape[1], NOISE, seed) for seed in range(seeds)])
    parameters, *_ = jax.vmap(lambda u, y: track(u, y, DT, GUESS, NOISE, Forgetting()))(u, y)
    offline = [
        vj.identify(
            log(*pair, DT), PLANT, poles=(2,), zeros=(2,), delay=False, offset=False, held_out=0.0
        )["P2Z2"].parameters
        for pair in zip(u, y, strict=True)
    ]
    online, offline = errors(np.asarray(parameters[:, -1])), errors(np.array(offline))
    assert np.median(online) <= 1.2 * np.median(offline)


def test_it_recovers_from_a_change_of_gain_and_notices_it():
    seeds = 20
    u, y = (np.array(x) for x in zip(*map(changing, range(seeds)), strict=True))
    parameters, covariance, _, _, alarms = map(
        np.asarray, jax.vmap(lambda u, y: track(u, y, DT, GUESS, NOISE, Forgetting()))(u, y)
    )
    truth = POWERTRAIN.num[-1] / POWERTRAIN.den[-1]
    b, a = parameters[..., 2], parameters[..., 4]
    relative = b / a / truth
    assert np.all(np.abs(relative[:, CHANGE - 1] - 1.0) < 0.05)
    assert np.all(np.abs(relative[:, CHANGE + GRANTED - 1] / DROP - 1.0) < 0.05)
    gradient = np.zeros_like(parameters[:, -1])
    gradient[:, 2], gradient[:, 4] = 1.0 / a[:, -1], -b[:, -1] / a[:, -1] ** 2
    std = np.sqrt(np.einsum("si,sij,sj->s", gradient, covariance[:, -1], gradient))
    held = np.abs(b / a - DROP * truth)[:, -1] < 1.96 * std
    assert held.sum() >= 17  # of 20; 16 or fewer happen with odds of 1.6 % at 95 %
    assert not alarms[:, :CHANGE].any()
    assert alarms[:, CHANGE : CHANGE + GRANTED].any(axis=1).all()


def test_alarms_are_what_makes_it_quick():
    u, y = (np.array(x) for x in zip(*map(changing, range(10)), strict=True))
    truth = DROP * POWERTRAIN.num[-1] / POWERTRAIN.den[-1]

    def error(forgetting: Forgetting) -> float:
        known = jax.vmap(lambda u, y: track(u, y, DT, GUESS, NOISE, forgetting)[0])(u, y)
        b, a = np.moveaxis(np.asarray(known[:, CHANGE + GRANTED - 1, [2, 4]]), 1, 0)
        return float(np.median(np.abs(b / a / truth - 1.0)))

    assert error(Forgetting()) < 0.5 * error(Forgetting(alarm=1e9))


@pytest.mark.parametrize("colour", [0.0, 0.8])
def test_intervals_hold_the_truth_as_often_as_they_say(colour):
    seeds = 60
    u, y = drive(0, 20.0)
    noisy = y + np.array([coloured(len(y), NOISE, colour, seed) for seed in range(seeds)])
    result = jax.vmap(lambda y: track(u, y, DT, GUESS, NOISE, Forgetting()))(noisy)
    parameters, covariance = np.asarray(result[0][:, -1]), np.asarray(result[1][:, -1])
    std = np.sqrt(np.diagonal(covariance, axis1=1, axis2=2))
    held = np.abs(parameters - POWERTRAIN.parameters) < 1.96 * std
    assert held.mean() > 0.88
    assert not np.asarray(result[4]).any()  # coloured noise is no change


def test_a_delay_is_kept_and_an_offset_is_found():
    truth = type(POWERTRAIN)((9.1,), (1.0, 10.0), delay=0.034, offset=0.02)
    u = steps(3000, 100, 0)
    y = response(truth, u, DT) + white(3000, 0.01, 1)
    start = vj.TransferFunction([14.0], [1.0, 14.0], delay=0.034, offset=0.0)
    tracking = identify_online(log(u, y, DT), PLANT, start)
    model, low_high = tracking.model(), tracking.interval("offset", 0.999)
    assert (model.order, tracking.names) == ("P1Z0", ("b0", "a0", "offset"))
    np.testing.assert_allclose([model.num[0], model.den[1]], [9.1, 10.0], rtol=0.03)
    assert low_high[0][-1] < 0.02 < low_high[1][-1]
    gain, std = tracking.dc_gain()
    assert abs(gain[-1] - 0.91) < 4.0 * std[-1] < 0.01
    assert abs(tracking.noise_std[-1] - 0.01) < 0.001


def test_samples_that_were_not_measured_teach_nothing():
    u, y = drive(0, 10.0)
    y = y + white(len(y), NOISE, 0)
    counts = np.ones(len(y), bool)
    counts[300:400] = False
    wrong = np.where(counts, y, 77.0)
    one, other = (track(u, v, DT, GUESS, NOISE, Forgetting(), counts)[0] for v in (y, wrong))
    assert jnp.array_equal(one, other)


def test_it_begins_with_a_fit_too_and_names_its_coefficients():
    u, y = drive(0, 10.0)
    record = log(u, y, DT)
    found = identify_online(record, PLANT, GUESS)
    fit = Fit("P1Z0", PLANT, "converged", GUESS)
    same = identify_online(record, PLANT, fit)
    np.testing.assert_array_equal(same.parameters, found.parameters)
    with pytest.raises(vj.InputError, match="Tracking: zz: there is no such parameter"):
        found.interval("zz")
    with pytest.raises(vj.InputError, match="level: 95.0 is no share"):
        found.interval("a0", 95.0)


def test_what_it_refuses():
    u, y = drive(0, 10.0)
    record = log(u, y, DT)
    with pytest.raises(ValueError, match="not stable"):
        identify_online(record, PLANT, vj.TransferFunction([1.0], [1.0, 0.0]))
    halves = vj.Record.concatenate([record, record])
    with pytest.raises(vj.InputError, match="cannot cross a gap"):
        identify_online(halves, PLANT, GUESS)
    improper = Fit("P1Z2", PLANT, "improper: 2 zeros exceed 1 poles")
    with pytest.raises(vj.InputError, match="P1Z2: improper"):
        identify_online(record, PLANT, improper)
    with pytest.raises(ValueError, match="memory"):
        Forgetting(memory=0.0)
