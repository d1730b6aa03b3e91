"""What is left when all causes are in, and what is held out to judge by."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import lfilter

from vdmsi_jax.config import PlantSpec
from vdmsi_jax.data.record import Record
from vdmsi_jax.diagnose.chain import bands, regress
from vdmsi_jax.diagnose.disturbance import apart, demands, moving, scores
from vdmsi_jax.diagnose.families import HYSTERESIS, MEMORY, OF_STATES, PACE, PACE_BY_OTHER
from vdmsi_jax.diagnose.judge import Scored, Trial, confirmed, gain_of
from vdmsi_jax.diagnose.leftover import _of_the_most
from vdmsi_jax.diagnose.prepare import stage_of
from vdmsi_jax.diagnose.remains import Remains, unexplained
from vdmsi_jax.diagnose.result import Gain, Unexplained
from vdmsi_jax.diagnose.runs import lay_out
from vdmsi_jax.diagnose.unexplained import SMALL, beside_response, events, slow_error, structure

DT = 0.02
N = 3000
RNG = np.random.default_rng(4)
T = DT * np.arange(N)
RESPONSE = 8.0 + 2.0 * np.sign(np.sin(2 * np.pi * T / 9.0))[None]
NOISE = 0.03 * RNG.standard_normal((1, N))
EVERYWHERE = np.ones((1, N), bool)


COMMAND = RESPONSE.copy()
ASKED = demands(COMMAND, RESPONSE, EVERYWHERE, DT)


def slow(error):
    masks = EVERYWHERE, ~EVERYWHERE
    return slow_error("v", NOISE + error, NOISE, RESPONSE, ASKED, masks, DT)


def wind(size, seconds=1.5):
    """Gaussian, of a first-order spectrum."""
    rng, keep = np.random.default_rng(7), np.exp(-DT / seconds)
    gusts = np.empty((1, N))
    gusts[:, 0] = rng.standard_normal()
    for k, now in enumerate(np.sqrt(1.0 - keep**2) * rng.standard_normal(N - 1)):
        gusts[:, k + 1] = keep * gusts[:, k] + now
    return size * gusts


def when_it_jumps(x):
    """Where the response has just jumped."""
    since = T % 4.5
    return np.where(since < 1.0, x, 0.0)


@pytest.mark.parametrize(
    ("size", "fraction", "open_"), [(0.02, 0.14, False), (0.02, 0.3, True), (0.04, 0.14, True)]
)
def test_a_slow_error_that_is_small_by_size_and_share_leaves_nothing_open(size, fraction, open_):
    left = Unexplained("delta", fraction, ("t",), (), "a slow error", puzzling=True, size=size)
    assert unexplained([left], (), {}, lambda channel: 0.0) is open_


@pytest.mark.parametrize(
    ("kind", "taken", "share", "outdone"),
    [
        (OF_STATES, 0.61, 0.56, {"coulomb_friction", "rate_limit", "saturation"}),  # 0.27 of all
        (OF_STATES, 0.61, 0.84, {"coulomb_friction"}),  # 0.1, which is most of what is left
        (OF_STATES, 0.3, 0.67, set()),
        (OF_STATES, 0.61, 0.95, set()),
        (HYSTERESIS, 0.35, 0.44, {"coulomb_friction"}),
        (HYSTERESIS, 0.15, 0.82, set()),
        (PACE, 0.23, 0.4, {"rate_limit", "saturation"}),
        (PACE, 0.26, 0.72, {"saturation"}),  # a limit of a rate that is not sharp leaves such
        (PACE, 0.07, 0.97, set()),
        (MEMORY, 0.38, 0.94, {"offset", "saturation"}),
        (MEMORY, 0.07, 0.97, set()),
        ("", 0.61, 0.56, set()),  # of a small one, of a form, or another test's
    ],
)
def test_a_cause_stands_in_for_a_kind_that_takes_much_beside_it(kind, taken, share, outdone):
    remains = Remains((Unexplained("v", taken, ("v",), kind=kind, puzzling=True),), ())
    asked = ("coulomb_friction", "rate_limit", "saturation", "offset", "transport_delay")
    assert {c for c in asked if remains.outdoes(c, "v", share)} == outdone
    assert not any(remains.outdoes(c, "delta", share) for c in asked)


@pytest.mark.parametrize(
    ("kind", "share", "cause", "lags"),
    [
        (PACE_BY_OTHER, 0.49, "tyre_relaxation", True),
        (PACE, 0.49, "yaw_inertia", True),
        (PACE_BY_OTHER, 0.2, "tyre_relaxation", False),
        (PACE_BY_OTHER, 0.49, "understeer", False),
        (MEMORY, 0.49, "tyre_relaxation", False),
    ],
)
def test_an_actuator_whose_lag_changes_hides_that_of_the_body_it_moves(kind, share, cause, lags):
    left = Unexplained("delta", share, ("the other command",), kind=kind, puzzling=True)
    assert Remains((left,), ()).lags(cause) is lags


def test_what_is_left_by_a_model_that_is_true_to_the_response_is_small():
    """Logs without noise leave the rounding of the integration, however surely it is no noise."""
    found = [Unexplained("v", 0.9, ("run",), (), "test", puzzling=True)]
    error = when_it_jumps(1e-3)[None]
    (told,) = beside_response(found, error, RESPONSE, EVERYWHERE)
    assert told.size < SMALL and not told.puzzling
    assert not unexplained([told], (), {}, lambda channel: 0.0)
    assert beside_response(found, error + NOISE, RESPONSE, EVERYWHERE) == found
    assert unexplained(found, (), {}, lambda channel: 0.0)


def test_noise_is_no_slow_error():
    assert slow(0.0) is None


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


@pytest.mark.parametrize(
    ("size", "fraction", "open_"),
    [
        (0.22, 0.21, True),
        (0.13, 0.9, True),
        (0.06, 0.21, False),
        (0.09, 0.64, True),
        (0.04, 0.9, False),
    ],
)
def test_a_slow_error_that_is_large_beside_the_response_is_open_whatever_was_found(
    size, fraction, open_
):
    """Be it a fifth of what a noisy channel leaves, or that findings took nine tenths before."""
    left = slow(when_it_jumps(wind(0.6)))
    assert left is not None
    left = replace(left, size=size, fraction=fraction)
    assert unexplained([left], {"v"}, {}, lambda channel: 0.9) is open_
    assert not unexplained([replace(left, steady=True)], {"v"}, {}, lambda channel: 0.9)


def test_a_large_error_of_the_yaw_rate_is_open_beside_a_cause_that_the_heading_told():
    left = slow(when_it_jumps(wind(0.6)))
    assert left is not None
    left = replace(left, channel="r", size=0.18, fraction=0.74)
    assert unexplained([left], {"psi"}, {}, lambda channel: 0.9)
    assert not unexplained([left], {"v"}, {}, lambda channel: 1.0)


def test_wind_that_rests_while_a_vehicle_stands_does_not_go_with_what_is_asked():
    v = np.where(T % 20.0 < 6.0, 0.0, 5.0 + np.sin(T))[None]
    error = wind(0.3) * (v > 0.0) + 0.003 * NOISE
    asked = demands(v, v, EVERYWHERE, DT)
    assert scores(error, asked, EVERYWHERE, DT)[0] > 6.0
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


def test_bands_add_up_and_part_slow_from_fast():
    drift = np.sin(2 * np.pi * T / 20.0)[None]
    low, high = bands(drift + NOISE, DT)
    np.testing.assert_allclose(low + high, drift + NOISE, atol=1e-12)
    inner = slice(100, -100)
    assert np.std((low - drift)[:, inner]) < 0.2 * np.std(drift)
    assert np.std((high - NOISE)[:, inner]) < 0.5 * np.std(NOISE)


def test_shares_of_rows_that_are_zero_are_zero():
    X = np.stack([T, np.zeros(N)])
    np.testing.assert_allclose(regress(X, 0.7 * T), [0.7, 0.0], atol=1e-6)


def record(name, n):
    return Record.from_arrays(dt=DT, name=name, v_cmd=np.ones(n), v=np.ones(n))


def test_a_single_log_is_judged_in_parts_that_lie_apart():
    held = lay_out([record("one", 1000)]).held()[0]
    assert held.mean() == pytest.approx(0.3)
    assert np.count_nonzero(np.diff(held.astype(int)) == 1) == 3
    assert not held[:200].any() and not held[-100:].any()


def test_of_three_logs_the_last_judges():
    runs = lay_out([record(str(k), 400) for k in range(3)])
    assert [bool(row.all()) for row in runs.held()] == [False, False, True]
    assert not runs.held()[:2].any()


def test_a_long_log_is_looked_at_in_stretches_that_span_it():
    runs = lay_out([record("hour", 180_000)])
    looked = sum(b - a for a, b in zip(runs.starts, runs.stops, strict=True))
    assert looked <= 15_000
    assert runs.starts[0] < 10_000 and runs.stops[-1] > 170_000


def test_a_change_in_every_run_is_looked_for_over_a_long_log_that_is_cut():
    rows, rng = 10_000, np.random.default_rng(1)
    logs = []
    for name in ("one", "two"):
        u = np.repeat(rng.uniform(1.0, 3.0, rows // 100), 100)
        logs.append(Record.from_arrays(dt=DT, name=name, v_cmd=u, v=u))
    stage = stage_of(lay_out(logs), PlantSpec("powertrain", "v_cmd", "v"))
    assert stage.mask.shape[1] < rows // 4  # stretches of it are looked at
    latest = {
        slot.effect.over: max(probe[0] for probe in slot.effect.probes(stage.scales))
        for slot in stage.slots
        if slot.cause == "regime_change"
    }
    assert 0.7 * rows * DT < latest["run"] < rows * DT
    way = np.asarray(stage.signals.distance)
    starts = np.array([np.sum(np.abs(u[:k])) * DT for k in lay_out(logs).starts])
    own = np.array(lay_out(logs).names) == "two"
    np.testing.assert_allclose(way[own, 0], starts[own])
    assert stage.scales.distance == pytest.approx(way.max(), rel=0.05)


def trial(before, after, y):
    scored = Scored("v", y, before, after, np.zeros(1))
    worth, variance = confirmed(scored, EVERYWHERE, DT)
    return worth, worth / np.sqrt(variance)


def test_a_gain_in_every_block_is_steadier_than_the_same_gain_in_one():
    y = RESPONSE + NOISE
    everywhere = 0.02 * np.sin(2 * np.pi * T / 3.0)[None]
    once = np.where(T < 5.0, 1.0, 0.0)[None] * everywhere * np.sqrt(60.0 / 5.0)
    steady, sudden = (trial(RESPONSE + e, RESPONSE, y) for e in (everywhere, once))
    assert steady[0] > 0.0 and sudden[0] > 0.0
    assert steady[1] > 3.0 > 2.0 > sudden[1]


@pytest.mark.parametrize(
    ("share", "steady", "puzzling", "named"),
    [(0.1, 4.0, False, True), (0.1, 1.0, False, False), (0.5, 1.0, False, True),
     (0.5, 1.0, True, False), (0.95, 1.0, True, True), (0.5, 4.0, True, True)],
)  # fmt: skip
def test_a_name_must_take_more_where_much_is_left(share, steady, puzzling, named):
    gain = Gain("v", 90.0, 90.5, 10.0, 1.0, 0.9)
    assert Trial(gain, None, 50.0, steady, fast=0.9).believed(share, puzzling) is named


@pytest.mark.parametrize(
    ("share", "steady", "named"), [(0.4, 1.0, False), (0.6, 1.0, True), (0.1, 2.5, True)]
)
def test_beside_a_disturbance_a_name_must_take_most_or_hold(share, steady, named):
    gain = Gain("v", 90.0, 90.5, 10.0, 1.0, 0.9)
    assert Trial(gain, None, 50.0, steady, fast=0.9).believed(share, False, disturbed=True) is named


@pytest.mark.parametrize(
    ("fast", "se", "named"), [(0.9, 1.0, True), (0.1, 1.0, False), (0.9, 9.0, False)]
)
def test_what_is_fast_does_not_stand_in_for_a_slow_error(fast, se, named):
    gain = Gain("delta", 80.0, 88.0, se, 1.0, 0.4)
    assert Trial(gain, None, 50.0, 1.0, fast).believed(0.6, puzzling=True) is named


def test_data_that_hardly_show_a_cause_do_not_speak_against_it():
    y, fitted = RESPONSE + NOISE, (T < 40.0)[None]
    effect = np.where(fitted, 0.2, 0.004) * np.sin(2 * np.pi * T / 0.7)[None]
    shown = Scored("v", y, RESPONSE - effect, RESPONSE, np.zeros(1))
    assert shown.faint(fitted, ~fitted) and not shown.faint(~fitted, fitted)
    gain = Gain("v", 90.0, 90.1, 0.1, 1.0, 0.9)
    weak = Trial(gain, None, 10.0, 1.0, fast=0.9)
    assert not weak.believed(0.1, puzzling=False)
    assert replace(weak, faint=True).believed(0.1, puzzling=False)
    assert not replace(weak, faint=True).believed(0.1, puzzling=True)


def test_what_makes_errors_that_last_says_the_same_over_and_over():
    """A change that lasts a quarter of the data is four of them, and not as many as its blocks."""
    change = np.repeat([0.3, 0.1, 0.4, 0.2], N // 4)[None]
    brief = Scored("v", RESPONSE + NOISE, RESPONSE - change, RESPONSE, np.zeros(1))
    ses = [gain_of(replace(brief, memory=m), EVERYWHERE, True, DT).se for m in (1.0, 15.0)]
    assert ses[1] > 1.5 * ses[0]


def test_one_event_does_not_outweigh_all_that_a_cause_explains():
    before, after = np.full((1, T.size), 0.1), np.zeros((1, T.size))
    after[:, :100] = 2.0
    scored = Scored("v", RESPONSE, RESPONSE - before, RESPONSE - after, np.zeros(1))
    gain = gain_of(scored, np.ones((1, T.size), bool), True, DT)
    assert gain.after < gain.before and gain.typical > 0.99


def test_where_rough_ground_goes_with_the_commands_only_events_are_the_model_s():
    masks, nothing = (EVERYWHERE, ~EVERYWHERE), np.empty((0, 1, N))
    told = slow_error("r", NOISE + wind(0.3), NOISE, RESPONSE, nothing, masks, DT)
    assert told is not None and told.steady
    rng = np.random.default_rng(3)
    at = np.cumsum(rng.uniform(3.0, 9.0, 9))[:, None]
    pulses = np.sum(rng.choice([-1.0, 1.0], (9, 1)) * np.exp(-(((T - at) / 0.5) ** 2)), axis=0)
    found = slow_error("r", NOISE + pulses[None], NOISE, RESPONSE, nothing, masks, DT)
    assert found is not None and found.puzzling


@pytest.mark.parametrize(
    ("answered", "share", "hides_small", "drowned"),
    [
        (True, 0.38, True, True),
        (True, 0.38, False, False),
        (True, 0.3, False, True),
        (True, 0.6, True, False),
        (False, 0.3, True, False),
    ],
)
def test_a_cause_beside_a_load_that_is_answered_takes_enough(answered, share, hides_small, drowned):
    load = Unexplained("y", 0.9, (), (), "a slow error", steady=True, answered=answered, size=0.1)
    assert Remains((load,), ()).drowns("y", share, hides_small) is drowned


def test_a_small_error_of_the_first_moments_of_a_run_is_what_went_on_before():
    knock = 0.5 * np.exp(-(((T - 1.0) / 0.5) ** 2))[None]
    masks = EVERYWHERE, ~EVERYWHERE
    later = slow_error("v", NOISE + np.roll(knock, N // 2), NOISE, RESPONSE, ASKED, masks, DT)
    assert later is not None and not later.steady
    assert SMALL < later.size < 0.05
    assert slow_error("v", NOISE + knock, NOISE, RESPONSE, ASKED, masks, DT) is None


@pytest.mark.parametrize(
    ("share", "lasts", "told"), [(0.7, True, True), (0.7, False, False), (0.3, True, False)]
)
def test_an_error_that_is_most_of_a_response_and_lasts_is_told(share, lasts, told):
    rng, t = np.random.default_rng(9), 0.02 * np.arange(3000)
    innovations = rng.standard_normal((1, 3000))
    rings = np.convolve(innovations[0], np.exp(-0.5 * t) * np.sin(6.0 * t))[:3000]
    e = rings[None] if lasts else innovations
    y = np.sin(t)[None] * np.sqrt(2.0 * (1.0 - share**2)) + share * e / e.std()
    e, white = share * e / e.std(), share * innovations / e.std()
    found = _of_the_most("y", e, white, y, np.ones(y.shape, bool))
    assert [u.puzzling for u in found] == [True] * told


@pytest.mark.parametrize(
    ("channel", "share", "statistic", "hides_small", "echoed"),
    [
        ("v", 0.1, 59.0, False, True),
        ("v", 0.1, 300.0, False, False),
        ("v", 0.6, 59.0, False, False),
        ("delta", 0.1, 59.0, False, False),
        ("v", 0.48, 441.0, True, True),  # the tremble of its commands between the rows
        ("v", 0.48, 441.0, False, False),
        ("v", 0.6, 441.0, True, False),
        ("delta", 0.48, 441.0, True, False),
    ],
)
def test_a_faint_cause_in_a_loop_may_tell_what_its_commands_know(
    channel, share, statistic, hides_small, echoed
):
    remains = Remains((), (), echoing=frozenset({"v"}))
    assert remains.echoes(channel, share, statistic, hides_small) is echoed
