"""Which causes that the data support do not matter."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from vdmsi_jax.diagnose.actuator.hypothesis import Refit
from vdmsi_jax.diagnose.answer.result import Estimate
from vdmsi_jax.diagnose.body.lane import BodyFit
from vdmsi_jax.diagnose.body.search import BodyFinding
from vdmsi_jax.diagnose.findings.minor import (
    Weighed,
    _is_of_a_bend,
    changes_somehow,
    crowd,
    overshadowed,
)
from vdmsi_jax.diagnose.search.found import PlantFinding, Search
from vdmsi_jax.diagnose.signals.noise import BriefNoise, OwnNoise
from vdmsi_jax.effects.regime_change import RegimeChange
from weighed_causes import RUNS, SCORE, SPEC, WEIGHING, finding, judged, named, searched, trial


@pytest.mark.parametrize(("least", "part"), [(0.2, True), (0.0, False)])
def test_an_offset_beside_a_bend_that_never_comes_near_zero_is_part_of_it(least, part):
    search = searched(OwnNoise())
    u = np.linspace(least, 1.0, 50)[None]
    for name, values in (("u", u), ("mask", u >= 0.0), ("held_out", u < 0.0)):
        object.__setattr__(search.stage, name, values)
    offset, bend = (named(c, search=search) for c in ("offset", "gain_nonlinearity"))

    def beside(other):
        taken = trial(0.5)
        tried = [(offset, taken), (other, taken)]
        return Weighed(WEIGHING, offset, taken, finding("offset", 0.5), tried)

    assert _is_of_a_bend(beside(bend)) is part
    assert not _is_of_a_bend(beside(named("backlash")))


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


@pytest.mark.parametrize(("before", "minor"), [(97.1, True), (96.0, False)])
def test_a_trace_beside_a_cause_that_takes_nearly_all_is_minor(before, minor):
    """Of a baseline of 80 % FIT; a quarter of next to nothing, and a half of it."""
    play, coupling = named("backlash"), named("cross_coupling")
    trial, told = judged(play, before, 97.4)
    trials = [(coupling, judged(coupling, 80.0, 97.4)[0]), (play, trial)]
    assert bool(Weighed(WEIGHING, play, trial, told, trials).why_minor()) is minor


@pytest.mark.parametrize(("before", "minor"), [(97.36, True), (97.2, False)])
def test_a_trace_that_is_next_to_nothing_is_minor_however_sure_it_is(before, minor):
    play, coupling = named("backlash"), named("cross_coupling")
    trial, told = judged(play, before, 97.4)
    trials = [(coupling, judged(coupling, 80.0, 97.4)[0]), (play, trial)]
    told = replace(told, statistic=600.0)
    assert bool(Weighed(WEIGHING, play, trial, told, trials).why_minor()) is minor
    late = named("transport_delay")  # which zeros of the plant without it have told nearly as well
    trials = [trials[0], (late, trial)]
    assert not Weighed(WEIGHING, late, trial, told, trials).why_minor()


@pytest.mark.parametrize(("puzzle", "minor"), [(0.3, False), (0.6, True)])
def test_a_name_that_takes_less_than_what_stays_a_puzzle_stands_in_for_it(puzzle, minor):
    """It takes 0.28 of the error; of the rest so much is structure that nothing explains."""
    play = named("backlash")
    trial, told = judged(play, 90.0, 91.5)
    weighed = Weighed(WEIGHING, play, trial, told, [(play, trial)], puzzle=puzzle)
    assert bool(weighed.why_minor()) is minor


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
    assert bool(Weighed(weighing, bend, trial, told, tried, puzzle=0.3).why_minor()) is minor
    assert not Weighed(weighing, bend, trial, told, tried).why_minor()


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
    assert bool(Weighed(WEIGHING, late, trial, told, [(late, trial)]).why_minor()) is minor


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


@pytest.mark.parametrize(
    ("place", "statistic", "before", "minor"),
    [("powertrain", 250.0, 1.5, False), ("powertrain", 250.0, 1.2, True),
     ("powertrain", 150.0, 1.5, True), ("vehicle", 250.0, 1.5, True),
     ("steering", 250.0, None, True)],
)  # fmt: skip
def test_what_noise_hides_in_a_response_and_adds_up_on_the_path_is_not_little(
    place, statistic, before, minor
):
    """Drag of a powertrain whose speed is measured badly: a metre in three on the way."""
    drag, coupling = named("drag", place), named("cross_coupling")
    trial, told = judged(drag, 97.1, 97.4)
    own = replace(told.gain, ate_before=before, ate_after=1.0)
    told = replace(told, where=place, statistic=statistic, gain=own)
    trials = [(coupling, judged(coupling, 80.0, 97.4)[0]), (drag, trial)]
    assert bool(Weighed(WEIGHING, drag, trial, told, trials).why_minor()) is minor
    strong = finding("understeer", 0.8)
    assert overshadowed(replace(told, share=0.03), [strong]) is minor


@pytest.mark.parametrize(("se", "minor"), [(0.3, False), (2.0, True)])
def test_a_small_gain_that_is_less_than_its_standard_error_is_minor(se, minor):
    grade = named("road_grade")
    trial, told = judged(grade, 80.0, 81.4)
    trial = replace(trial, gain=replace(trial.gain, se=se, typical=0.4))
    assert bool(Weighed(WEIGHING, grade, trial, told, [(grade, trial)]).why_minor()) is minor


@pytest.mark.parametrize("cause", ["periodic_disturbance", "backlash"])
@pytest.mark.parametrize("disturbance", [0.3, 0.9])
def test_a_line_is_one_where_what_wanders_beside_it_is_less(cause, disturbance):
    line = named(cause)
    trial, told = judged(line, 90.0, 91.5)
    trial = replace(trial, gain=replace(trial.gain, typical=0.28))
    told = replace(told, parameters={"frequency": Estimate(0.5, 0.001, "Hz")})
    why = Weighed(WEIGHING, line, trial, told, [(line, trial)], disturbance=disturbance).why_minor()
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
    why = Weighed(WEIGHING, named_so, trial, told, [(named_so, trial)]).why_minor()
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
    why = Weighed(WEIGHING, drag, trial, told, [(drag, trial)], puzzle=puzzle).why_minor()
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
    why = Weighed(WEIGHING, weak, trials[1][1], told, trials).why_minor()
    assert ("mend" in why) is minor and bool(why) is minor


@pytest.mark.parametrize(
    ("share", "statistic", "after", "se", "minor"),
    [(0.24, 66.0, 0.7, 1.2, True), (0.45, 66.0, 0.7, 1.2, False), (0.24, 260.0, 1.4, 1.2, False),
     (0.24, 66.0, 0.62, 1.2, False), (0.58, 66.0, 3.0, 1.2, True), (0.58, 4900.0, 3.0, 1.2, False),
     (0.24, 66.0, None, 1.2, False), (0.24, 66.0, 0.7, 0.4, False), (0.24, 66.0, 1.4, 0.4, True)],
)  # fmt: skip
def test_a_faint_cause_that_makes_the_path_worse_is_minor(share, statistic, after, se, minor):
    """Unless data held out surely bear it out: one path may be worse by chance."""
    bend = named("gain_nonlinearity")
    trial, told = judged(bend, 90.0, 92.0)
    trial = replace(trial, gain=replace(trial.gain, se=se))
    own = replace(told.gain, ate_before=0.6, ate_after=after)
    told = replace(told, share=share, statistic=statistic, gain=own)
    why = Weighed(WEIGHING, bend, trial, told, [(bend, trial)]).why_minor()
    assert ("path" in why) is minor and bool(why) is minor


@pytest.mark.parametrize(
    ("ends", "puzzle", "minor"), [(True, 0.57, True), (True, 0.0, False), (False, 0.57, False)]
)
def test_a_cause_of_the_body_at_the_end_of_its_range_beside_structure_is_minor(ends, puzzle, minor):
    """As castors that swing round after each reversal are understeer of 5 s^2/m^2."""
    nowhere = object.__new__(BodyFit)
    bank = replace(named("bank"), body=BodyFinding(0, 700.0, nowhere, (), None, ends))
    trial, told = judged(bank, 2.0, 59.0)
    why = Weighed(WEIGHING, bank, trial, told, [(bank, trial)], puzzle=puzzle).why_minor()
    assert ("as far as is tried" in why) is minor and bool(why) is minor


def test_of_what_only_brief_noise_shows_little_mends_what_takes_more():
    search = searched(BriefNoise(1.0, 0.1))
    weighing = replace(WEIGHING, searches={SPEC: search})
    first, second = named("saturation", search=search), named("backlash", search=search)
    trials = [(first, judged(first, 74.0, 82.0)), (second, judged(second, 77.0, 82.0))]
    tried = [(cause, trial) for cause, (trial, _) in trials]
    minor = [bool(Weighed(weighing, c, t, told, tried).why_minor()) for c, (t, told) in trials]
    assert minor == [False, True]
    alone = Weighed(weighing, second, *trials[1][1], tried[1:]).why_minor()
    assert not alone  # what leads is told, however little it takes beside the others


@pytest.mark.parametrize("pieces", [1, 4])
@pytest.mark.parametrize(
    ("at", "over", "minor"),
    [(0.04, "run", True), (0.97, "run", True), (0.3, "run", False), (0.04, "session", False)],
)
def test_a_change_as_the_runs_begin_or_end_is_what_warms_up(at, over, minor, pieces):
    """A long run lies in pieces side by side, and its clock goes on from one to the next."""
    edges = [2000 * k // pieces for k in range(pieces + 1)]
    since = tuple(RUNS.dt * a for a in edges[:-1])
    cut = replace(
        RUNS,
        names=RUNS.names * pieces,
        starts=tuple(edges[:-1]),
        stops=tuple(edges[1:]),
        since=since,
        judged=RUNS.judged * pieces,
    )
    assert cut.lasting == RUNS.lasting == 100.0
    search = searched(OwnNoise())
    slot = SimpleNamespace(effect=RegimeChange(over=over))
    object.__setattr__(search.stage, "slots", (slot,))
    nowhere = object.__new__(Refit)
    finding = PlantFinding(0, 160.0, nowhere)
    change = replace(named("regime_change", search=search), finding=finding)
    trial, told = judged(change, 89.5, 91.8)
    sizes = {"time": Estimate(at * 100.0, 0.1, "s"), "gain": Estimate(-0.2, 0.01, "1")}
    told = replace(told, parameters=sizes)
    why = Weighed(replace(WEIGHING, runs=cut), change, trial, told, [(change, trial)]).why_minor()
    assert ("begin" in why) is minor
    assert changes_somehow(told, why) is minor


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
    why = Weighed(WEIGHING, change, trial, told, tried, disturbance=disturbed).why_minor()
    assert bool(why) is minor
    assert changes_somehow(told, why) is minor  # it takes three quarters of the error


@pytest.mark.parametrize(
    ("cause", "sure", "minor"),
    [("regime_change", 0.7, True), ("regime_change", 2.0, False), ("gain_drift", 0.7, False)],
)
def test_a_change_whose_size_is_lost_in_its_error_is_none(cause, sure, minor):
    """Its moment and its lag fit what is slow, as an oven's surroundings, very surely."""
    change = named(cause)
    trial, told = judged(change, 90.0, 95.0)
    sizes = {"time": Estimate(23.0, 2.0, "s"), "gain": Estimate(0.03, 0.03 / sure, "1")}
    told = replace(told, parameters=sizes)
    why = Weighed(WEIGHING, change, trial, told, [(change, trial)]).why_minor()
    assert ("lost in its standard error" in why) is minor


@pytest.mark.parametrize(
    ("after", "puzzle", "minor"), [(93.6, 0.83, True), (93.6, 0.0, False), (97.2, 0.83, False)]
)
def test_a_change_beside_what_nothing_explains_is_part_of_it(after, puzzle, minor):
    """As gears that interrupt the drive are told; the right ones of all exams stand alone."""
    change = named("regime_change")
    trial, told = judged(change, 90.5, after)
    sizes = {"time": Estimate(23.0, 1.0, "s"), "gain": Estimate(0.3, 0.033, "1")}
    told = replace(told, parameters=sizes)
    why = Weighed(WEIGHING, change, trial, told, [(change, trial)], puzzle=puzzle).why_minor()
    assert bool(why) is minor
    assert changes_somehow(told, why) is minor
