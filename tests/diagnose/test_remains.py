"""What is left when all causes are in."""

from dataclasses import replace

import numpy as np
import pytest

from lasting_errors import (
    DT,
    EVERYWHERE,
    NOISE,
    RESPONSE,
    N,
    T,
    slow,
    when_it_jumps,
    wind,
)
from vdmsi_jax.data.record import Record, Segment
from vdmsi_jax.diagnose.answer.result import Unexplained
from vdmsi_jax.diagnose.residual.families import (
    HYSTERESIS,
    MEMORY,
    OF_STATES,
    PACE,
    PACE_BY_OTHER,
    Family,
)
from vdmsi_jax.diagnose.residual.leftover import is_rounding, of_a_kind, steps_of, taken_for_noise
from vdmsi_jax.diagnose.residual.of_plant import _MOST
from vdmsi_jax.diagnose.residual.regression import Explained
from vdmsi_jax.diagnose.residual.remains import Remains, unexplained
from vdmsi_jax.diagnose.signals.chain import bands, regress
from vdmsi_jax.diagnose.signals.unexplained import BURSTS, SMALL, beside_response


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


@pytest.mark.parametrize(
    ("cause", "share", "of_form", "part"),
    [
        ("periodic_disturbance", 0.36, False, True),
        ("periodic_disturbance", 0.36, True, False),
        ("periodic_disturbance", 0.6, False, False),
        ("backlash", 0.36, False, False),
    ],
)
def test_a_weak_line_beside_structure_is_a_part_of_what_comes_and_goes(cause, share, of_form, part):
    left = Unexplained("delta", 0.1, ("t",), of_form=of_form)
    assert Remains((left,), ()).comes_and_goes(cause, "delta", share) is part
    assert not Remains((left,), ()).comes_and_goes(cause, "v", share)


@pytest.mark.parametrize(("channel", "lags"), [("delta", True), ("v", False)])
def test_a_steering_whose_measurement_stands_still_hides_a_lag_of_the_body(channel, lags):
    left = Unexplained(channel, 0.4, ("t",), kind=BURSTS)
    assert Remains((left,), ()).lags("tyre_relaxation") is lags
    assert not Remains((left,), ()).lags("understeer")


@pytest.mark.parametrize(
    ("cause", "channel", "share", "stands"),
    [("sensor_lag", "v", 0.19, True), ("sensor_delay", "v", 0.19, True),
     ("sensor_lag", "r", 0.19, False), ("sensor_bias", "v", 0.19, False),
     ("sensor_lag", "v", 0.05, False)],
)  # fmt: skip
def test_messages_that_freeze_now_and_then_are_no_lag_of_their_sensor(
    cause, channel, share, stands
):
    remains = Remains((Unexplained("v", share, ("t",), kind=BURSTS),), ())
    assert remains.stands_still(cause, channel) is stands


@pytest.mark.parametrize(
    ("kind", "cause", "share", "of_form"),
    [
        (PACE, "rate_limit", 0.08, True),  # its corner is another
        (PACE, "rate_limit", 0.13, False),
        (HYSTERESIS, "backlash", 0.13, True),
        (HYSTERESIS, "backlash", 0.25, False),
    ],
)
def test_a_kind_that_takes_much_beside_its_cause_is_no_form_of_it(kind, cause, share, of_form):
    family = Family(kind, ("v",), np.empty((1, 1, N)), (cause,))
    known = Explained(family, 500.0, 100.0, share)
    (left,) = of_a_kind("v", known, [cause], wind(0.3), RESPONSE, EVERYWHERE)
    assert left.of_form is of_form and (left.kind == kind) is not of_form
    assert left.test.startswith(f"{cause} has another form") is of_form


def test_what_is_left_by_a_model_that_is_true_to_the_response_is_small():
    """Logs without noise leave the rounding of the integration, however surely it is no noise."""
    found = [Unexplained("v", 0.9, ("run",), (), "test", puzzling=True)]
    error = when_it_jumps(1e-3)[None]
    (told,) = beside_response(found, error, RESPONSE, EVERYWHERE)
    assert told.size < SMALL and not told.puzzling
    assert not unexplained([told], (), {}, lambda channel: 0.0)
    assert beside_response(found, error + NOISE, RESPONSE, EVERYWHERE) == found
    assert unexplained(found, (), {}, lambda channel: 0.0)


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
    found = taken_for_noise("y", e, white, y, np.ones(y.shape, bool), False, _MOST)
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


@pytest.mark.parametrize(("share", "rounded"), [(1.0, True), (0.4, True), (0.1, False)])
def test_an_error_that_is_the_rounding_of_what_is_logged_is_none_of_frequencies(share, rounded):
    rng = np.random.default_rng(4)
    smooth = np.cumsum(0.02 * rng.standard_normal(4000))
    logged = 0.05 * np.round(smooth / 0.05)
    record = Record(
        "log", 0.02, 0.02 * np.arange(4000), {"v": logged}, {"v": "m/s"}, (Segment(0, 4000),)
    )
    e = logged - smooth
    noise = rng.standard_normal(4000) * np.std(e) * np.sqrt(1.0 / share - 1.0)
    assert is_rounding(steps_of([record], "v"), e + noise) is rounded
    assert not is_rounding(steps_of([record], "delta"), e)
