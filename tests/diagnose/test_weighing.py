"""Which causes that the data support matter, and what is asked again."""

from dataclasses import replace

import numpy as np
import pytest

import made_up_diagnosis
from vdmsi_jax.config import PlantSpec
from vdmsi_jax.data.record import Record, Segment
from vdmsi_jax.diagnose.found import Finding as PlantFinding
from vdmsi_jax.diagnose.found import Search
from vdmsi_jax.diagnose.judge import Trial
from vdmsi_jax.diagnose.leftover import only_where_judged
from vdmsi_jax.diagnose.naming import Named
from vdmsi_jax.diagnose.noise import BriefNoise, Noise, OwnNoise
from vdmsi_jax.diagnose.remains import Remains
from vdmsi_jax.diagnose.result import (
    ChannelScore,
    Diagnosis,
    Estimate,
    Finding,
    Gain,
    Rival,
    Unexplained,
)
from vdmsi_jax.diagnose.rounding import quantised, tells_rounding
from vdmsi_jax.diagnose.runs import Runs
from vdmsi_jax.diagnose.stage import Stage
from vdmsi_jax.diagnose.unexplained import BURSTS, WORSE
from vdmsi_jax.diagnose.verdict import _lost, _or_else
from vdmsi_jax.diagnose.weighing import (
    Weighing,
    _of_a_bend,
    changes_somehow,
    crowd,
    of_innovations,
    overshadowed,
)


def searched(noise: Noise) -> Search:
    """By which causes are known as its own, and its noise."""
    search, stage = object.__new__(Search), object.__new__(Stage)
    object.__setattr__(stage, "noise", noise)
    object.__setattr__(search, "stage", stage)
    return search


SEARCH, OTHER = searched(OwnNoise()), searched(OwnNoise())
SPEC = PlantSpec("servo", "u", "y")
SCORE = ChannelScore(80.0, mse=1.0, noise_std=0.1, ceiling=95.0)
RUNS = Runs(("run",), (), (0,), (2000,), (0.0,), ((),), dt=0.05)  # of 100 s
WEIGHING = Weighing({SPEC: SEARCH}, RUNS, {"y": SCORE}, {"y": SCORE})


def named(cause: str, *rivals: str, search: Search = SEARCH) -> Named:
    alike = tuple(Rival(word, "plant", 1.0, True) for word in rivals)
    return Named(cause, "plant", None, "", {}, 500.0, 1, alike, search=search)


def gain(part: float) -> Gain:
    """Of a cause that takes this part of what the baseline errs by."""
    return Gain("y", 90.0, 91.0, 0.1, mse_before=0.05 + part, mse_after=0.05)


def trial(part: float) -> Trial:
    return Trial(gain(part), None, 1.0, 5.0, 0.5, False)


def tried(*causes: Named) -> list[tuple[Named, Trial]]:
    return [(cause, trial(0.2)) for cause in causes]


FRICTION, PLAY = named("coulomb_friction"), named("backlash")


@pytest.mark.parametrize(("part", "mends"), [(0.01, True), (0.2, False)])
def test_a_little_play_beside_friction_mends_its_form(part, mends):
    trials = tried(FRICTION, PLAY)
    assert WEIGHING._mends(PLAY, gain(part), trials) is mends
    assert not WEIGHING._mends(PLAY, gain(part), trials, leads=True)


def test_a_little_of_a_mode_beside_a_limited_rate_mends_its_form():
    mode, limit = named("resonance"), named("rate_limit")
    assert WEIGHING._mends(mode, gain(0.002), tried(limit, mode))
    assert not WEIGHING._mends(mode, gain(0.1), tried(limit, mode))
    assert not WEIGHING._mends(mode, gain(0.002), tried(PLAY, mode))


def test_alone_or_beside_another_kind_or_plant_it_does_not():
    elsewhere = named("coulomb_friction", search=OTHER)
    for beside in ([], [named("saturation")], [elsewhere]):
        assert not WEIGHING._mends(PLAY, gain(0.01), tried(PLAY, *beside))


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
    assert WEIGHING._mends(vague, gain(0.2), tried(vague, named("saturation")))
    assert not WEIGHING._mends(vague, gain(0.2), tried(vague))
    fewer = named("offset", "backlash", "dead_zone")
    assert not WEIGHING._mends(fewer, gain(0.2), tried(fewer, named("saturation")))


@pytest.mark.parametrize("cause", ["resonance", "periodic_disturbance"])
@pytest.mark.parametrize(("hertz", "nothing"), [(0.02, True), (0.5, False)])
def test_what_swings_does_so_a_few_times_or_is_any_slow_error(hertz, nothing, cause):
    seen = {"frequency": Estimate(hertz, 1e-4, "Hz"), "damping": Estimate(0.05, 0.01, "1")}
    mode = replace(
        made_up_diagnosis.siso().findings[0], cause=cause, parameters=seen, gain=gain(0.4)
    )
    assert WEIGHING._negligible(mode) is nothing


@pytest.mark.parametrize(("std", "nothing"), [(0.1, False), (0.3, True)])
def test_a_line_has_a_frequency_that_is_told_to_a_part_of_a_swing(std, nothing):
    """Wind has none: it swings in one run as it does not in another."""
    longest = RUNS.length * RUNS.dt
    seen = {"frequency": Estimate(8.0 / longest, std / longest, "Hz")}
    line = replace(finding("periodic_disturbance", 0.4), parameters=seen, gain=gain(0.4))
    assert WEIGHING._negligible(line) is nothing


def of_a_car(cause: str, where: str, value: float, points: float, **more) -> Finding:
    """A finding of a car at 2 m/s, worth so many points of FIT."""
    worth = Gain("v", 96.0, 96.0 + points, 0.01, mse_before=1.0, mse_after=0.85, **more)
    seen = {"one": Estimate(value, 0.1 * abs(value), "1")}
    found = made_up_diagnosis.siso().findings[0]
    found = replace(found, cause=cause, where=where, parameters=seen, gain=worth, share=0.15)
    return replace(found, statistic=500.0)


TIME = RUNS.dt * np.arange(2000)
CAR = Record("run", RUNS.dt, TIME, {"v": np.full(2000, 2.0)}, {"v": "m/s"}, (Segment(0, 2000),))
DRIVES = replace(WEIGHING, runs=replace(RUNS, records=(CAR,)))


@pytest.mark.parametrize(
    ("points", "path", "nothing"),
    [(0.2, (1.0, 1.0), True), (0.2, (1.0, 0.5), False), (2.0, (1.0, 1.0), False)],
    ids=["as every vehicle", "on the road it matters", "much"],
)
def test_a_speed_that_falls_a_little_in_bends_is_every_vehicle_s(points, path, nothing):
    on_the_road = {"ate_before": path[0], "ate_after": path[1]}
    found = of_a_car("cross_coupling", "powertrain", 0.02, points, **on_the_road)
    assert DRIVES._negligible(found) is nothing
    assert not DRIVES._negligible(replace(found, share=0.6))


@pytest.mark.parametrize(("gradient", "nothing"), [(-0.002, True), (0.01, False)])
def test_a_body_that_turns_the_same_but_for_a_per_cent_does_not_understeer(gradient, nothing):
    found = of_a_car("understeer", "vehicle", gradient, 0.1)
    assert DRIVES._negligible(found) is nothing


@pytest.mark.parametrize(("least", "part"), [(0.2, True), (0.0, False)])
def test_an_offset_beside_a_bend_that_never_comes_near_zero_is_part_of_it(least, part):
    search = searched(OwnNoise())
    u = np.linspace(least, 1.0, 50)[None]
    for name, values in (("u", u), ("mask", u >= 0.0), ("held_out", u < 0.0)):
        object.__setattr__(search.stage, name, values)
    offset, bend = (named(c, search=search) for c in ("offset", "gain_nonlinearity"))
    assert _of_a_bend(offset, [(offset, trial(0.5)), (bend, trial(0.5))]) is part
    assert not _of_a_bend(offset, [(offset, trial(0.5)), (named("backlash"), trial(0.5))])


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


def test_a_cause_of_the_body_that_is_next_to_nothing_of_its_channel_s_error_is_minor():
    """Of a yaw rate that understeer had spoilt: a wheelbase that is off by a per cent."""
    weighing = replace(WEIGHING, baseline={"y": replace(SCORE, mse=3.0)})
    body = Named("geometry_scale", "vehicle", None, "", {}, 200.0, 1, ())
    assert weighing._of_all(body, gain(0.06)) == pytest.approx(0.02)


def finding(cause: str, share: float) -> Finding:
    return replace(made_up_diagnosis.siso().findings[0], cause=cause, share=share)


def test_four_causes_of_one_actuator_are_one_without_a_name():
    words = ("saturation", "backlash", "dead_zone", "offset")
    many = [finding(cause, 0.9) for cause in words]
    assert crowd(many)[0] == many and crowd(many[:3])[0] == []


@pytest.mark.parametrize("other", ["saturation", "gain_asymmetry"])
def test_two_weak_bends_of_one_characteristic_are_one_without_a_name(other):
    bends = [finding("gain_nonlinearity", 0.3), finding(other, 0.2)]
    friction = finding("coulomb_friction", 0.7)
    assert crowd([friction, *bends])[0] == bends
    strong = [bends[0], finding(other, 0.8)]
    assert crowd(strong)[0] == crowd([bends[1], friction])[0] == []


def left(*where: str, kind: str = BURSTS, size: float = 1.0) -> Unexplained:
    when = tuple((run, 1.0, 1.5) for run in where)
    return Unexplained("y", 0.2, ("t",), when, size=size, kind=kind)


def said(*unexplained: Unexplained, verdict="unexplained_structure", findings=()) -> Diagnosis:
    return replace(
        made_up_diagnosis.siso(),
        verdict=verdict,
        findings=tuple(findings),
        unexplained=tuple(unexplained),
    )


def test_structure_that_only_unseen_runs_show_is_asked_again():
    assert only_where_judged(said(left("run_3"), left(kind=WORSE)), ["run_3"])
    assert only_where_judged(said(left("run_3"), left("run_1", size=0.001)), ["run_3"])


@pytest.mark.parametrize(
    "found",
    [
        said(left("run_3", "run_1")),
        said(left(kind="")),
        said(left("run_3"), findings=made_up_diagnosis.siso().findings),
        said(left("run_3"), verdict="explained"),
    ],
    ids=["elsewhere too", "everywhere", "beside a finding", "that changes nothing"],
)
def test_other_structure_is_not(found):
    assert not only_where_judged(found, ["run_3"])


def judged(cause: Named, before: float, after: float) -> tuple[Trial, Finding]:
    """Of a cause by FIT, in percent, without and with it, steadily."""
    mse = [(1.0 - fit / 100.0) ** 2 * 25.0 for fit in (before, after)]
    own = Gain("y", before, after, 0.05, *mse, held_out=True, typical=0.01)
    share = 1.0 - mse[1] / mse[0]
    told = replace(finding(cause.cause, share), parameters={}, gain=own, statistic=100.0)
    told = replace(told, parameters={"gap": Estimate(0.02, 0.001, "m")})
    return Trial(own, None, 100.0, 8.0, 0.9), told


@pytest.mark.parametrize(("before", "minor"), [(97.1, True), (96.0, False)])
def test_a_trace_beside_a_cause_that_takes_nearly_all_is_minor(before, minor):
    """Of a baseline of 80 % FIT; a quarter of next to nothing, and a half of it."""
    play, coupling = named("backlash"), named("cross_coupling")
    trial, told = judged(play, before, 97.4)
    trials = [(coupling, judged(coupling, 80.0, 97.4)[0]), (play, trial)]
    assert bool(WEIGHING.why_minor(play, trial, told, 0.0, 0.0, False, trials)) is minor


@pytest.mark.parametrize(("before", "minor"), [(97.36, True), (97.2, False)])
def test_a_trace_that_is_next_to_nothing_is_minor_however_sure_it_is(before, minor):
    play, coupling = named("backlash"), named("cross_coupling")
    trial, told = judged(play, before, 97.4)
    trials = [(coupling, judged(coupling, 80.0, 97.4)[0]), (play, trial)]
    told = replace(told, statistic=600.0)
    assert bool(WEIGHING.why_minor(play, trial, told, 0.0, 0.0, False, trials)) is minor
    late = named("transport_delay")  # which zeros of the plant without it have told nearly as well
    trials = [trials[0], (late, trial)]
    assert not WEIGHING.why_minor(late, trial, told, 0.0, 0.0, False, trials)


@pytest.mark.parametrize(("puzzle", "minor"), [(0.3, False), (0.6, True)])
def test_a_name_that_takes_less_than_what_stays_a_puzzle_stands_in_for_it(puzzle, minor):
    """It takes 0.28 of the error; of the rest so much is structure that nothing explains."""
    play = named("backlash")
    trial, told = judged(play, 90.0, 91.5)
    assert bool(WEIGHING.why_minor(play, trial, told, puzzle, 0.0, False, [(play, trial)])) is minor


@pytest.mark.parametrize(("without", "minor"), [(5.0, False), (200.0, True)])
def test_a_trace_of_what_was_wrong_mends_a_form_where_much_stays_a_puzzle(without, minor):
    """It takes half of the error beside another cause; without both it is so many times that."""
    bend = named("gain_nonlinearity")
    trial, told = judged(bend, 97.0, 97.8)
    beside = (named("rate_limit"), judged(named("rate_limit"), 70.0, 97.8)[0])
    bare = replace(SCORE, mse=without * trial.gain.mse_before)
    weighing = replace(WEIGHING, baseline={"y": bare})
    told = replace(told, statistic=600.0)
    tried = [(bend, trial), beside]
    assert bool(weighing.why_minor(bend, trial, told, 0.3, 0.0, False, tried)) is minor
    assert not weighing.why_minor(bend, trial, told, 0.0, 0.0, False, tried)


@pytest.mark.parametrize(("cause", "std", "minor"), [
    ("transport_delay", 0.002, False), ("transport_delay", 0.02, True), ("dead_zone", 0.002, True)
])  # fmt: skip
@pytest.mark.parametrize("after", [90.2, 90.12])
def test_a_delay_that_is_known_exactly_is_told_however_little_it_takes(cause, std, minor, after):
    """It takes four per cent, or two, and that not from block to block."""
    late = named(cause)
    trial, told = judged(late, 90.0, after)
    trial = replace(trial, steady=1.4, gain=replace(trial.gain, se=0.18, typical=0.001))
    told = replace(told, statistic=1000.0, parameters={"delay": Estimate(0.14, std, "s")})
    assert bool(WEIGHING.why_minor(late, trial, told, 0.0, 0.0, False, [(late, trial)])) is minor


@pytest.mark.parametrize(
    ("cause", "place", "hidden"),
    [
        ("transport_delay", "steering", False),  # mends nothing of the vehicle's
        ("transport_delay", "vehicle", True),
        ("dead_zone", "steering", True),
    ],
)
def test_next_to_nothing_beside_a_strong_finding_may_mend_its_form(cause, place, hidden):
    strong = replace(finding("understeer", 0.8), where="vehicle")
    exact = {"delay": Estimate(0.14, 0.002, "s")}
    weak = replace(finding(cause, 0.03), where=place, statistic=1000.0, parameters=exact)
    assert overshadowed(weak, [strong, weak]) is hidden
    assert not overshadowed(replace(weak, share=0.06), [strong, weak])


@pytest.mark.parametrize(("se", "minor"), [(0.3, False), (2.0, True)])
def test_a_small_gain_that_is_less_than_its_standard_error_is_minor(se, minor):
    grade = named("road_grade")
    trial, told = judged(grade, 80.0, 81.4)
    trial = replace(trial, gain=replace(trial.gain, se=se, typical=0.4))
    assert bool(WEIGHING.why_minor(grade, trial, told, 0.0, 0.0, False, [(grade, trial)])) is minor


@pytest.mark.parametrize("cause", ["periodic_disturbance", "backlash"])
@pytest.mark.parametrize("disturbance", [0.3, 0.9])
def test_a_line_is_one_where_what_wanders_beside_it_is_less(cause, disturbance):
    line = named(cause)
    trial, told = judged(line, 90.0, 91.5)
    trial = replace(trial, gain=replace(trial.gain, typical=0.28))
    told = replace(told, parameters={"frequency": Estimate(0.5, 0.001, "Hz")})
    why = WEIGHING.why_minor(line, trial, told, 0.0, disturbance, False, [(line, trial)])
    wanders = cause == "periodic_disturbance" and disturbance == 0.9
    assert why == ("what it leaves unexplained is more than it takes" if wanders else "")


@pytest.mark.parametrize(
    ("cause", "size", "std", "minor"),
    [
        ("dead_zone", 4.6, 43.0, True),
        ("dead_zone", 4.6, 4.3, False),  # which takes so much that blocks may disagree about it
        ("resonance", -0.028, 0.034, True),
        ("resonance", -0.119, 0.034, True),  # which a plant of more poles has, too
        ("resonance", -0.238, 0.034, False),
    ],
)
def test_a_cause_without_a_size_is_minor_whatever_it_takes(cause, size, std, minor):
    named_so = named(cause)
    trial, told = judged(named_so, 56.0, 87.0)
    seen = {"half_width": Estimate(size, std, "m")}
    if cause == "resonance":
        seen = {"frequency": Estimate(1.8, 0.2, "Hz"), "damping": Estimate(0.07, 0.1, "1")}
        seen |= {"weight": Estimate(size, std, "1")}
    told = replace(told, cause=cause, parameters=seen)
    why = WEIGHING.why_minor(named_so, trial, told, 0.0, 0.0, False, [(named_so, trial)])
    assert ("standard error" in why) is minor and bool(why) is minor


@pytest.mark.parametrize(
    ("se", "puzzle", "minor"), [(0.35, 0.0, False), (1.0, 0.0, True), (0.35, 0.05, True)]
)
def test_a_cause_that_surely_pays_needs_no_sure_size_beside_no_structure(
    se, puzzle, minor, monkeypatch
):
    """Drag of a cart, of which poles take over so much that each parameter may be nothing."""
    drag = named("drag")
    trial, told = judged(drag, 92.5, 94.3)
    trial = replace(trial, gain=replace(trial.gain, se=se))
    sizes = {"quadratic": Estimate(0.031, 0.026, "1/m"), "rolling": Estimate(0.02, 0.035, "m/s^2")}
    monkeypatch.setattr(Search, "away", lambda own, found: (np.array([1.2, 0.6]), 1.5))
    drag = replace(drag, finding=object.__new__(PlantFinding))
    told = replace(told, cause="drag", share=0.42, parameters=sizes)
    why = WEIGHING.why_minor(drag, trial, told, puzzle, 0.0, False, [(drag, trial)])
    assert ("standard error" in why) is minor and bool(why) is minor


@pytest.mark.parametrize(
    ("statistic", "first", "minor"),
    [(85.0, "gain_nonlinearity", True), (850.0, "gain_nonlinearity", False),
     (85.0, "backlash", False)],
)  # fmt: skip
def test_a_faint_bend_beside_another_mends_its_form(statistic, first, minor):
    strong, weak = named(first), named("gain_asymmetry")
    trials = [(strong, judged(strong, 93.7, 96.9)[0]), (weak, judged(weak, 96.5, 96.9)[0])]
    told = replace(judged(weak, 96.5, 96.9)[1], statistic=statistic)
    why = WEIGHING.why_minor(weak, trials[1][1], told, 0.0, 0.0, False, trials)
    assert ("mend" in why) is minor and bool(why) is minor


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
    ("share", "statistic", "after", "minor"),
    [(0.24, 66.0, 0.7, True), (0.45, 66.0, 0.7, False), (0.24, 260.0, 1.4, False),
     (0.24, 66.0, 0.62, False), (0.58, 66.0, 3.0, True), (0.58, 4900.0, 3.0, False),
     (0.24, 66.0, None, False)],
)  # fmt: skip
def test_a_faint_cause_that_makes_the_path_worse_is_minor(share, statistic, after, minor):
    bend = named("gain_nonlinearity")
    trial, told = judged(bend, 90.0, 92.0)
    own = replace(told.gain, ate_before=0.6, ate_after=after)
    told = replace(told, share=share, statistic=statistic, gain=own)
    why = WEIGHING.why_minor(bend, trial, told, 0.0, 0.0, False, [(bend, trial)])
    assert ("path" in why) is minor and bool(why) is minor


def test_of_what_only_brief_noise_shows_little_mends_what_takes_more():
    search = searched(BriefNoise(1.0, 0.1))
    weighing = replace(WEIGHING, searches={SPEC: search})
    first, second = named("saturation", search=search), named("backlash", search=search)
    trials = [(first, judged(first, 74.0, 82.0)), (second, judged(second, 77.0, 82.0))]
    tried = [(cause, trial) for cause, (trial, _) in trials]
    minor = [
        bool(weighing.why_minor(c, t, told, 0.0, 0.0, False, tried)) for c, (t, told) in trials
    ]
    assert minor == [False, True]
    alone = weighing.why_minor(second, *trials[1][1], 0.0, 0.0, False, tried[1:])
    assert not alone  # what leads is told, however little it takes beside the others


@pytest.mark.parametrize(
    ("where", "statistic", "after", "nothing"),
    [
        ("vehicle", 40.0, 98.4, True),
        ("vehicle", 400.0, 98.4, False),
        ("vehicle", 40.0, 99.0, False),
        ("steering", 40.0, 98.4, False),
    ],
)
def test_a_body_that_is_slightly_another_is_every_vehicle(where, statistic, after, nothing):
    own = Gain("psi", 98.3, after, 0.1, mse_before=0.03, mse_after=0.025)
    seen = {"scale": Estimate(-0.003, 0.0005, "1")}
    told = replace(finding("speed_scale", 0.2), where=where, parameters=seen, gain=own)
    assert WEIGHING._negligible(replace(told, statistic=statistic)) is nothing


@pytest.mark.parametrize(("cause", "share"), [("transport_delay", 0.43), ("resonance", 0.0)])
def test_a_delay_has_the_share_that_it_takes_of_the_innovations(cause, share):
    """A second at ten rows a second of a motor whose slow error a chain of lags leaves as well."""
    search = searched(OwnNoise())
    nothing = np.zeros((1, 645), bool)
    object.__setattr__(search.stage, "held_out", ~nothing)
    object.__setattr__(search.stage, "mask", nothing)
    told = replace(trial(0.0), worth=359.1)
    assert of_innovations(named(cause, search=search), told) == pytest.approx(share, abs=0.005)


@pytest.mark.parametrize(
    ("cause", "sure", "disturbed", "minor"),
    [
        ("regime_change", 3.5, 0.98, True),
        ("regime_change", 3.5, 0.0, False),
        ("regime_change", 17.0, 0.98, False),
        ("backlash", 3.5, 0.98, False),
    ],
)
def test_a_change_that_is_hardly_known_is_part_of_what_is_slow(cause, sure, disturbed, minor):
    change = named(cause)
    trial, told = judged(change, 90.0, 95.0)
    sizes = {"time": Estimate(23.0, 2.0, "s"), "gain": Estimate(-0.06, 0.06 / sure, "1")}
    told = replace(told, parameters=sizes)
    tried = [(change, trial)]
    why = WEIGHING.why_minor(change, trial, told, 0.0, disturbed, False, tried)
    assert bool(why) is minor
    assert changes_somehow(told, why) is minor  # it takes three quarters of the error
