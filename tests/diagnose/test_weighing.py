"""What causes take beside each other, and what stands in for them."""

from dataclasses import replace

import numpy as np
import pytest

from vdmsi_jax.data.record import Record
from vdmsi_jax.diagnose.answer.result import Estimate, Gain, Unexplained
from vdmsi_jax.diagnose.body.search import BodyFinding
from vdmsi_jax.diagnose.findings.minor import SPOILS, Weighed
from vdmsi_jax.diagnose.findings.naming import Named
from vdmsi_jax.diagnose.findings.rounding import quantised, tells_rounding
from vdmsi_jax.diagnose.findings.verdict import _doubt, _lost, _of_another_form, _or_else
from vdmsi_jax.diagnose.findings.weighing import of_innovations
from vdmsi_jax.diagnose.residual.remains import Remains
from vdmsi_jax.diagnose.signals.noise import OwnNoise
from vdmsi_jax.diagnose.signals.unexplained import BURSTS
from weighed_causes import (
    OTHER,
    SCORE,
    SPEC,
    WEIGHING,
    finding,
    gain,
    named,
    searched,
    trial,
    tried,
)

FRICTION, PLAY = named("coulomb_friction"), named("backlash")


@pytest.mark.parametrize(("part", "mends"), [(0.01, True), (0.2, False)])
def test_a_little_play_beside_friction_mends_its_form(part, mends):
    trials = tried(FRICTION, PLAY)
    assert WEIGHING.mends(PLAY, gain(part), trials) is mends
    assert not WEIGHING.mends(PLAY, gain(part), trials, leads=True)


def test_a_little_of_a_mode_beside_a_limited_rate_mends_its_form():
    mode, limit = named("resonance"), named("rate_limit")
    assert WEIGHING.mends(mode, gain(0.002), tried(limit, mode))
    assert not WEIGHING.mends(mode, gain(0.1), tried(limit, mode))
    assert not WEIGHING.mends(mode, gain(0.002), tried(PLAY, mode))


def test_alone_or_beside_another_kind_or_plant_it_does_not():
    elsewhere = named("coulomb_friction", search=OTHER)
    for beside in ([], [named("saturation")], [elsewhere]):
        assert not WEIGHING.mends(PLAY, gain(0.01), tried(PLAY, *beside))


def test_of_two_that_stand_in_for_each_other_the_first_leads():
    """Play and friction take nearly all together, and each next to nothing beside the other."""
    both = [(FRICTION, trial(0.012)), (PLAY, trial(0.016))]
    nearly_all = replace(WEIGHING, extended={"y": replace(SCORE, mse=0.02)})
    assert nearly_all.leads(PLAY, both) and not nearly_all.leads(FRICTION, both)
    assert nearly_all.of_its_kind(PLAY, both) == [both[0]]
    told = _or_else(PLAY, [FRICTION])
    assert [(r.cause, r.indistinguishable) for r in told.rivals] == [("coulomb_friction", True)]
    for mse, points, leads in ((0.6, 0.0, False), (0.6, 4.0, True), (0.9, 4.0, False)):
        taken = replace(SCORE, mse=mse, fit=SCORE.fit + points)
        assert replace(WEIGHING, extended={"y": taken}).leads(PLAY, both) is leads


def test_what_four_others_tell_as_well_is_a_name_only_by_itself():
    vague = named("offset", "backlash", "dead_zone", "drag", "coulomb_friction")
    assert WEIGHING.mends(vague, gain(0.2), tried(vague, named("saturation")))
    assert not WEIGHING.mends(vague, gain(0.2), tried(vague))
    fewer = named("offset", "backlash", "dead_zone")
    assert not WEIGHING.mends(fewer, gain(0.2), tried(fewer, named("saturation")))


@pytest.mark.parametrize(("step", "same"), [(0.09, True), (0.3, False), (0.02, False)])
def test_a_rounding_inside_of_what_is_logged_in_such_steps_is_that(step, same):
    y = 0.08 * np.round(np.sin(np.linspace(0.0, 9.0, 400)) / 0.08)
    record = Record.from_arrays(dt=0.05, name="run", plants=(SPEC,), u=y, y=y)
    rounded = quantised([record], {"y": replace(SCORE, mse=0.08**2 / 12.0)})
    rounding = replace(named("quantization"), parameters={"step": Estimate(step, 0.001, "1")})
    assert tells_rounding(rounding, trial(0.5), rounded) is same
    assert not tells_rounding(replace(rounding, cause="dead_zone"), trial(0.5), rounded)


@pytest.mark.parametrize(
    ("gap", "form", "same"),
    [
        (0.06, "of the response", True),
        (0.1, "of the response", False),
        (0.06, "of the command", False),
    ],
)
def test_a_play_narrower_than_the_steps_of_what_is_logged_is_their_rounding(gap, form, same):
    y = 0.08 * np.round(np.sin(np.linspace(0.0, 9.0, 400)) / 0.08)
    record = Record.from_arrays(dt=0.05, name="run", plants=(SPEC,), u=y, y=y)
    rounded = quantised([record], {"y": replace(SCORE, mse=0.08**2 / 12.0)})
    play = replace(named("backlash"), form=form, parameters={"gap": Estimate(gap, 0.001, "1")})
    assert tells_rounding(play, trial(0.5), rounded) is same


T = np.linspace(0.0, 9.0, 400)


@pytest.mark.parametrize(
    ("told", "found"),
    [(0.04 * np.round(np.sin(T) / 0.04), True), (np.sin(T), False), (0.04 * (T > 5.0), False)],
)
def test_a_run_of_few_values_does_not_speak_against_the_steps_of_another(told, found):
    """Of a yaw rate: a run of curves in steps, one in none, or one more straight one, beside two
    straight ones of three values."""
    straight = [0.04 * np.round(0.05 * np.sin(T + k) / 0.04) for k in range(2)]
    logs = enumerate([told, *straight])
    records = [Record.from_arrays(dt=0.05, name=f"run_{k}", y=y) for k, y in logs]
    rounded = quantised(records, {"y": replace(SCORE, mse=0.04**2 / 12.0)})
    assert bool(rounded) is found


def test_a_cause_of_the_body_that_is_next_to_nothing_of_its_channel_s_error_is_minor():
    """Of a yaw rate that understeer had spoilt: a wheelbase that is off by a per cent."""
    weighing = replace(WEIGHING, baseline={"y": replace(SCORE, mse=3.0)})
    body = Named("geometry_scale", "vehicle", None, "", {}, 200.0, 1, ())
    assert weighing.of_all(body, gain(0.06)) == pytest.approx(0.02)


@pytest.mark.parametrize(
    ("cause", "where", "channel", "minor"),
    [
        ("sensor_bias", "sensor", "v", True),
        ("sensor_bias", "sensor", "r", False),
        ("speed_scale", "vehicle", None, True),  # which that sensor tells, too
        ("understeer", "vehicle", None, False),
    ],
)
def test_what_a_sensor_that_drops_out_would_tell_is_minor(cause, where, channel, minor):
    remains = Remains((Unexplained("v", 0.4, ("t",), kind=BURSTS),), ())
    told = replace(named(cause), where=where, channel=channel, search=None)
    assert bool(_lost(told, finding(cause, 0.8), remains, "forward", 0.8)) is minor


@pytest.mark.parametrize(
    ("part", "outdone", "own", "minor"),
    [
        (0.01, True, True, True),
        (0.2, True, True, False),
        (0.01, False, True, False),
        (0.01, True, False, False),  # of another actuator
    ],
)
def test_a_little_beside_what_only_stands_in_for_another_form_is_minor(part, outdone, own, minor):
    """A limit of a rate, beside a gain by direction where it is the lag that has a direction."""
    strong, search = object(), searched(OwnNoise())
    object.__setattr__(search, "findings", (strong,) if own else ())
    weighing = replace(WEIGHING, searches={SPEC: search})
    limit = named("rate_limit", search=search)
    of = Weighed(weighing, limit, trial(part), finding("rate_limit", 0.8), tried(limit))
    remains = Remains((), (strong,) if outdone else ())
    assert bool(_of_another_form(of, remains)) is minor


@pytest.mark.parametrize(
    ("channel", "after", "of_body", "minor"),
    [
        ("r", 1.3, False, True),
        ("pose", 1.3, False, True),
        ("v", 1.3, False, False),  # where nothing says that the vehicle moves otherwise
        ("r", 1.05, False, False),
        ("r", 1.3, True, False),
    ],
)
def test_what_an_actuator_says_and_the_vehicle_does_not_do_is_minor(channel, after, of_body, minor):
    """Wheels that spin: a limit of the speed's rate with which the path gets worse."""
    remains = Remains((Unexplained(channel, 0.2, ("t",), size=0.2),), ())
    told = named("rate_limit")
    told = replace(told, search=None, where="vehicle") if of_body else told
    found = finding("rate_limit", 0.5)
    found = replace(found, gain=replace(found.gain, ate_before=1.0, ate_after=after))
    assert (_lost(told, found, remains, "v", 0.5) == SPOILS) is minor
    nearly_all = replace(found, share=0.9)
    assert _lost(told, nearly_all, remains, "v", 0.9) == ""


def test_what_is_small_in_a_response_casts_no_doubt_on_a_large_cause_of_the_body():
    """A slow error of 3 % in the speed, and a wheelbase that is worth 14 % of the yaw rate."""
    known = object.__new__(BodyFinding)  # of which nothing is asked here
    body = replace(named("geometry_scale"), search=None, where="vehicle", body=known)
    told = Gain("r", 84.6, 93.1, 0.8, 1.0, 0.2)
    for channel, size, doubt in (("v", 0.03, 0.0), ("v", 0.06, 0.6), ("r", 0.03, 0.6)):
        left = Unexplained(channel, 0.6, ("t",), puzzling=True, size=size)
        remains = Remains((left,), ())
        assert _doubt(remains.puzzle, body, told) == doubt
        of_actuator = Gain(channel, 84.6, 93.1, 0.8, 1.0, 0.2)
        assert _doubt(remains.puzzle, named("backlash"), of_actuator) == 0.6


@pytest.mark.parametrize(("cause", "share"), [("transport_delay", 0.43), ("resonance", 0.0)])
def test_a_delay_has_the_share_that_it_takes_of_the_innovations(cause, share):
    """A second at ten rows a second of a motor whose slow error a chain of lags leaves as well."""
    search = searched(OwnNoise())
    nothing = np.zeros((1, 645), bool)
    object.__setattr__(search.stage, "held_out", ~nothing)
    object.__setattr__(search.stage, "mask", nothing)
    told = replace(trial(0.0), worth=359.1)
    assert of_innovations(named(cause, search=search), told) == pytest.approx(share, abs=0.005)
