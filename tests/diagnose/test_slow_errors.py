"""Errors that last: disturbances, and what the model makes."""

from dataclasses import replace

import numpy as np
from scipy.signal import lfilter

from lasting_errors import (
    ASKED,
    COMMAND,
    DT,
    EVERYWHERE,
    NOISE,
    RESPONSE,
    RNG,
    N,
    T,
    slow,
    when_it_jumps,
    wind,
)
from vdmsi_jax.diagnose.answer.result import Unexplained
from vdmsi_jax.diagnose.residual.remains import Remains
from vdmsi_jax.diagnose.signals.disturbance import apart, demands, moving, scores
from vdmsi_jax.diagnose.signals.unexplained import SMALL, events, slow_error, structure
from vdmsi_jax.diagnose.signals.windows import SLOW, moving_mean, slow_part


def test_noise_is_no_slow_error():
    assert slow(0.0) is None


def test_of_samples_that_are_far_apart_a_single_one_is_little_of_a_slow_error():
    noise = RNG.standard_normal((1, N))
    assert np.std(slow_part(noise, 1.0)) < 0.4
    np.testing.assert_array_equal(slow_part(noise, DT), moving_mean(noise, SLOW, DT))


def test_wind_is_told_as_steady_unless_it_is_all_there_is():
    found = slow(wind(0.3))
    assert found is not None and found.steady and not found.puzzling
    assert found.fraction > 0.8  # of the residual
    assert slow(wind(0.05)) is None  # small beside the response
    all_there_is = slow(wind(1.0))
    assert all_there_is is not None and all_there_is.puzzling and not all_there_is.steady


def test_a_larger_disturbance_is_one_where_nothing_hints_at_another_thing():
    found = slow(wind(0.3))
    assert found is not None and found.even
    args = "v", NOISE + wind(0.3), NOISE, RESPONSE, ASKED, (EVERYWHERE, ~EVERYWHERE), DT
    of_slow = slow_error(*args, time_constant=10.0)
    assert of_slow is not None and of_slow.steady and not of_slow.even  # six of them are few
    masks = EVERYWHERE, ~EVERYWHERE
    blind = slow_error("r", NOISE + wind(0.3), NOISE, RESPONSE, ASKED[:0], masks, DT)
    assert blind is not None and blind.steady and not blind.even  # of rough ground alone

    def disturbs(size: float, even: bool) -> bool:
        remains = Remains((replace(found, size=size, even=even),), ())
        assert bool(remains.disturbances) is not bool(remains.structure)
        return bool(remains.disturbances)

    assert disturbs(0.14, even=True) and disturbs(0.06, even=False)
    assert not disturbs(0.14, even=False) and not disturbs(0.2, even=True)


def test_a_slow_error_that_goes_with_what_is_asked_is_the_model_s():
    found = slow(when_it_jumps(wind(0.6)))
    assert found is not None and found.puzzling and not found.steady


def test_wind_that_rests_while_a_vehicle_stands_does_not_go_with_what_is_asked():
    v = np.where(T % 20.0 < 6.0, 0.0, 5.0 + np.sin(T))[None]
    error = wind(0.3) * (v > 0.0) + 0.003 * NOISE
    asked = demands(v, v, EVERYWHERE, DT)
    assert scores(error, asked, EVERYWHERE, DT).along > 6.0
    assert max(scores(error, asked, moving(v, EVERYWHERE), DT)) < 2.5
    assert moving(np.zeros((1, N)), EVERYWHERE).all()  # a plant that is no vehicle's


def test_a_slow_error_that_comes_in_events_is_the_model_s():
    at = np.array([11.3, 31.7, 47.9])[:, None]
    gusts = np.sum(1.2 * np.exp(-(((T - at) / 0.8) ** 2)), axis=0)
    found = slow(gusts[None])
    assert found is not None and found.puzzling


def test_a_slow_error_that_sets_runs_apart_is_the_model_s():
    both = np.concatenate([EVERYWHERE, EVERYWHERE])
    gusts = np.concatenate([wind(0.3), wind(0.3)[:, ::-1]])
    raised = gusts + np.array([[0.3], [-0.3]])
    assert apart(raised, both, DT) > 0.25 > apart(gusts, both, DT)
    assert apart(gusts + 0.5, both, DT) < 0.25  # alike in all
    assert apart(raised, both & (T < 15.0), DT) == 0.0
    response, noise = (np.concatenate([x, x]) for x in (RESPONSE, NOISE))
    asked = demands(response, response, both, DT)
    found = slow_error("v", noise + raised, noise, response, asked, (both, ~both), DT)
    assert found is not None and found.puzzling and not found.steady


def test_runs_that_wander_by_themselves_are_not_set_apart_by_their_means():
    """A drift with a memory of a third of a run: by the means alone, a third of these were."""
    rng = np.random.default_rng(4)
    both, keep, shares = np.concatenate([EVERYWHERE, EVERYWHERE]), np.exp(-DT / 20.0), []
    for _ in range(40):
        steps = rng.normal(size=(2, N)) * np.r_[(1.0 - keep**2) ** -0.5, np.ones(N - 1)]
        shares.append(apart(lfilter([1.0], [1.0, -keep], steps), both, DT))
    assert np.mean(np.array(shares) > 0.25) < 0.15


def test_a_smaller_one_is_told_where_it_surely_goes_with_what_is_asked():
    found = slow(when_it_jumps(wind(0.2)))
    assert found is not None and found.puzzling and found.size < 0.05
    assert slow(wind(0.08)) is None


def test_small_events_are_told_where_surrogates_have_none_and_cast_no_doubt():
    at = np.array([11.3, 31.7, 47.9])[:, None]
    found = slow(np.sum(0.18 * np.exp(-(((T - at) / 0.8) ** 2)), axis=0)[None])
    assert found is not None and not found.steady and not found.puzzling
    assert 0.012 < found.size < 0.025
    assert slow(wind(0.04)) is None


def burst(seconds: float, size: float) -> list:
    residual = NOISE.copy()
    first = N // 2 + 5
    residual[0, first : first + max(1, round(seconds / DT))] += size
    nowhere = ~EVERYWHERE
    return structure("v", residual, residual, EVERYWHERE, nowhere, (("one", 0.0),), DT)


def test_an_event_is_told_and_a_sample_that_stands_out_is_not():
    assert burst(0.0, 1.0) == []
    (event,) = burst(0.6, 0.3)
    assert event.test == "energy of short windows"
    (run, start, stop), *_ = event.when
    assert run == "one" and start <= DT * (N // 2 + 5) + 0.5 and stop >= DT * (N // 2)


def test_a_knock_is_shorter_than_what_lasts_and_no_outlier():
    """It fills less than a fifth of the windows around it, as outliers may."""
    (knock,) = burst(0.12, 1.0)
    assert knock.test == "energy of short windows"
    assert burst(2 * DT, 1.0) == []


def test_events_in_coloured_noise_are_told_where_there_surely_are_some():
    noise = wind(0.05, 0.2)
    jumps = noise.copy()
    for first in range(200, N - 100, 150):
        jumps[0, first : first + 25] += 0.25

    def told(residual, sure):
        return events("pose", residual, NOISE, EVERYWHERE, (("one", 0.0),), DT, sure)

    assert told(jumps, False) == [] and told(noise, True) == []
    (found,) = told(jumps, True)
    assert found.fraction > 0.5


def test_what_goes_to_one_side_is_no_disturbance():
    """Brakes that are touched now and then, for two seconds: repeats say that it is noise, and half
    as much to either side may be wind."""
    nothing, masks = np.empty((0, 1, N)), (EVERYWHERE, ~EVERYWHERE)
    rng = np.random.default_rng(6)
    at = np.cumsum(rng.uniform(2.2, 7.7, 10))[:, None]
    brakes = -0.5 * rng.uniform(0.5, 1.0, (10, 1)) * np.exp(-(((T - at) / 0.7) ** 2))
    to_both = brakes * np.where(np.arange(len(at)) % 2, 1.0, -1.0)[:, None]

    def told(error: np.ndarray, noise: float) -> Unexplained | None:
        error = NOISE + error.sum(axis=0)[None]
        return slow_error("v", error, NOISE, RESPONSE, nothing, masks, DT, noise)

    for noise in (0.0, 0.3):
        found = told(brakes, noise)
        assert found is not None and not found.steady and found.puzzling
        assert found.test.endswith(", to one side")
    assert told(to_both, 0.3) is None


def test_where_rough_ground_goes_with_the_commands_only_events_are_the_model_s():
    masks, nothing = (EVERYWHERE, ~EVERYWHERE), np.empty((0, 1, N))
    told = slow_error("r", NOISE + wind(0.3), NOISE, RESPONSE, nothing, masks, DT)
    assert told is not None and told.steady
    rng = np.random.default_rng(3)
    at = np.cumsum(rng.uniform(3.0, 9.0, 9))[:, None]
    pulses = np.sum(rng.choice([-1.0, 1.0], (9, 1)) * np.exp(-(((T - at) / 0.5) ** 2)), axis=0)
    found = slow_error("r", NOISE + pulses[None], NOISE, RESPONSE, nothing, masks, DT)
    assert found is not None and found.puzzling

    def on_ground(error: np.ndarray) -> Unexplained:
        told = slow_error("r", NOISE + error, NOISE, RESPONSE, ASKED, masks, DT, ground=True)
        assert told is not None and told.steady
        return told

    assert on_ground(wind(0.3)).even  # nothing hints at another thing
    rougher_when_fast = 1.0 + 0.6 * np.sign(COMMAND - 8.0)
    assert not on_ground(rougher_when_fast * wind(0.3)).even


def test_a_small_error_of_the_first_moments_of_a_run_is_what_went_on_before():
    knock = 0.5 * np.exp(-(((T - 1.0) / 0.5) ** 2))[None]
    masks = EVERYWHERE, ~EVERYWHERE
    later = slow_error("v", NOISE + np.roll(knock, N // 2), NOISE, RESPONSE, ASKED, masks, DT)
    assert later is not None and not later.steady
    assert SMALL < later.size < 0.05
    assert slow_error("v", NOISE + knock, NOISE, RESPONSE, ASKED, masks, DT) is None
