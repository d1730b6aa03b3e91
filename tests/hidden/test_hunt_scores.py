"""The hunt's counting, on lines made by hand."""

import json
import math

import numpy as np
import pytest

from hidden import hunt, hunt_report
from hidden import hunt_scores as score
from hidden.hunt_case import FREEDOMS, energy, laguerre
from hidden.hunt_plan import PLANS, plan


def truth(cause, where, channel=None, lambda0=100.0, **parameters):
    return {
        "cause": cause,
        "where": where,
        "channel": channel,
        "parameters": parameters,
        "form": "",
        "lambda0": lambda0,
        "before_projection": 2.0 * lambda0,
    }


def finding(cause, where, channel=None, rivals=(), gain=("delta", 80.0, 95.0), **parameters):
    return {
        "cause": cause,
        "where": where,
        "channel": channel,
        "form": "",
        "parameters": parameters,
        "rivals": [list(r) for r in rivals],
        "statistic": 100.0,
        "share": 0.5,
        "gain": list(gain),
        "held_out": True,
        "predicted": 94.0,
        "experiment": bool(rivals),
    }


def line(truths=(), findings=(), minor=(), kind="cause", verdict=None, **other):
    return {
        "key": f"{kind}/{len(truths)}",
        "kind": kind,
        "size": "middle",
        "seed": 1,
        "driving": "rich",
        "repeat": False,
        "slowest": 2.0,
        "truth": list(truths),
        "energy": {},
        "lambda0": min((t["lambda0"] for t in truths), default=0.0),
        "attainable": {"v": 98.0, "delta": 95.0},
        "verdict": verdict or ("explained" if findings else "no_effect"),
        "findings": list(findings),
        "minor": list(minor),
        "unexplained": [],
        "fit": {"delta": [80.0, 95.0], "v": [98.0, 98.0]},
        "seconds": 5.0,
        "code": "abc",
    } | other


BACKLASH = truth("backlash", "steering", gap=0.02)


def test_a_right_name_alone():
    told = score.judged(line([BACKLASH], [finding("backlash", "steering")]))
    assert (told.detected, told.in_set, told.named, told.wrong) == (True, True, True, False)
    assert (told.spurious, told.label) == (0, "backlash@steering")


def test_a_set_that_holds_the_truth_is_right_but_no_name():
    rivals = [("backlash", "steering")]
    lead = finding("coulomb_friction", "steering", rivals=rivals)
    told = score.judged(line([BACKLASH], [lead]))
    assert (told.in_set, told.named, told.wrong) == (True, False, False)


def test_a_wrong_name_counts_only_where_it_stands_alone():
    lone = score.judged(line([BACKLASH], [finding("dead_zone", "steering")]))
    both = finding("dead_zone", "steering", rivals=[("offset", "steering")])
    assert lone.wrong and not lone.in_set
    assert not score.judged(line([BACKLASH], [both])).wrong
    elsewhere = score.judged(line([BACKLASH], [finding("backlash", "powertrain")]))
    assert elsewhere.wrong


def test_how_far_other_names_are():
    lacks = [["coulomb_friction", "steering", 12.0], ["dead_zone", "steering", 50.0]]
    right = finding("backlash", "steering") | {"lacks": lacks}
    assert score.separation(line([BACKLASH], [right])) == 12.0
    lead = finding("dead_zone", "steering", rivals=[("backlash", "steering")])
    near = lead | {"lacks": [["backlash", "steering", 3.0]]}
    assert score.separation(line([BACKLASH], [near])) == -3.0
    only = finding("backlash", "steering") | {"lacks": []}
    assert score.separation(line([BACKLASH], [only])) == math.inf
    wrong = finding("offset", "steering") | {"lacks": lacks}
    for told in ([], [finding("backlash", "steering")], [wrong]):
        assert score.separation(line([BACKLASH], told)) is None
    # a name that counts as the same one is no other
    bank = finding("offset", "vehicle") | {"lacks": [["bank", "vehicle", 0.0]]}
    assert score.separation(line([truth("bank", "vehicle")], [bank])) == math.inf


def test_silence_and_what_is_minor():
    silent = score.judged(line([BACKLASH]))
    assert not silent.detected and silent.label == "none"
    flagged = line([BACKLASH], verdict="unexplained_structure")
    assert score.judged(flagged).label == "unexplained"
    small = score.judged(line([BACKLASH], minor=[finding("backlash", "steering")]))
    assert small.detected and small.named
    other = score.judged(line([BACKLASH], minor=[finding("offset", "steering")]))
    assert not other.detected


def test_further_findings_are_spurious_unless_they_hold_the_truth():
    right, wrong = finding("backlash", "steering"), finding("bank", "vehicle")
    assert score.judged(line([BACKLASH], [right, wrong])).spurious == 1
    second = score.judged(line([BACKLASH], [wrong, right]))
    assert second.wrong and second.spurious == 0


def test_the_channel_of_a_sensor_counts():
    hidden = truth("sensor_delay", "sensor", "r")
    assert score.judged(line([hidden], [finding("sensor_delay", "sensor", "r")])).named
    assert score.judged(line([hidden], [finding("sensor_delay", "sensor", "v")])).wrong
    rival = finding("sensor_lag", "sensor", "r", rivals=[("sensor_delay", "sensor")])
    assert score.judged(line([hidden], [rival])).in_set
    # a channel that is told of a cause that sits elsewhere is no part of its name
    assert score.judged(line([BACKLASH], [finding("backlash", "steering", "delta")])).named


@pytest.mark.parametrize(
    ("hidden", "told", "slowest", "right"),
    [
        (("drag", "vehicle"), ("drag", "powertrain"), -1.0, True),
        (("offset", "vehicle"), ("bank", "vehicle"), -1.0, True),
        (("coulomb_friction", "powertrain"), ("offset", "powertrain"), 2.0, True),
        (("coulomb_friction", "powertrain"), ("offset", "powertrain"), -1.0, False),
        (("dead_zone", "powertrain"), ("coulomb_friction", "powertrain"), 2.0, True),
        (("coulomb_friction", "powertrain"), ("drag", "vehicle"), 2.0, True),
        (("dead_zone", "powertrain"), ("drag", "vehicle"), 2.0, False),
        (("drag", "vehicle"), ("offset", "powertrain"), 2.0, False),
        (("dead_zone", "steering"), ("offset", "steering"), 2.0, False),
        (("offset", "steering"), ("offset", "vehicle"), 2.0, False),
    ],
)
def test_names_that_count_as_one(hidden, told, slowest, right):
    judged = score.judged(line([truth(*hidden)], [finding(*told)], slowest=slowest))
    assert (judged.named, judged.wrong, bool(judged.by)) == (right, not right, right)


def test_pairs_need_a_finding_each():
    two = [BACKLASH, truth("understeer", "vehicle")]
    one, other = finding("backlash", "steering"), finding("understeer", "vehicle")
    assert score.found(line(two, [other, one])) == [True, True]
    assert score.found(line(two, [one])) == [True, False]
    both_names = finding("backlash", "steering", rivals=[("understeer", "vehicle")])
    assert score.found(line(two, [both_names])) == [True, False]
    assert score.stated_wrongly(line(two, [one, finding("bank", "vehicle")])) == 1
    open_ = finding("bank", "vehicle", rivals=[("offset", "vehicle")])
    assert score.stated_wrongly(line(two, [one, open_])) == 0


def test_flags_and_errors_of_sizes():
    assert score.flagged(line(verdict="unexplained_structure"))
    left = {"channel": "v", "fraction": 0.1, "test": ""}
    assert score.flagged(line(unexplained=[left]))
    assert not score.flagged(line())
    told = line([BACKLASH], [finding("backlash", "steering", gap=[0.021, 0.0005])])
    ((label, error, z),) = score.errors(told, score.EXACT)
    assert (label, error, z) == ("backlash gap", pytest.approx(0.05), pytest.approx(2.0))
    assert not score.errors(line([BACKLASH], [finding("offset", "steering")]), score.EXACT)
    bare = line([BACKLASH], [finding("backlash", "steering", gap=[0.02, None])])
    assert score.errors(bare, score.EXACT)[0][2] is None


def test_shares_of_gain():
    told = line([BACKLASH], [finding("backlash", "steering")])
    assert score.share_of_attainable(told) == pytest.approx(1.0)
    assert score.predicted_over_realised(told) == pytest.approx(14.0 / 15.0)
    little = line([BACKLASH], [finding("backlash", "steering", gain=("v", 98.0, 98.0))])
    assert score.share_of_attainable(little) is None
    assert score.share_of_attainable(line([BACKLASH])) is None


def test_wilson_and_the_laws():
    low, high = score.wilson(0, 500)
    assert low == 0.0 and high == pytest.approx(3.8416 / 503.8416)
    assert score.wilson(5, 10) == (pytest.approx(0.2366, abs=1e-4), pytest.approx(0.7634, abs=1e-4))
    assert score.wilson(0, 0) == (0.0, 1.0)
    assert str(score.rate([])) == "none"
    assert "50.0 % (1 of 2;" in str(score.rate([True, False]))
    assert score.law(5.35**2) == pytest.approx(0.5)
    assert score.law(49.0) == pytest.approx(0.9505, abs=1e-4)


def test_bins_of_detection():
    lines = [line([truth("backlash", "steering", lambda0=x)]) for x in (1.0, 50.0, 50.0)]
    lines[1]["findings"] = [finding("backlash", "steering")]
    (_, quiet), (middle, loud) = score.detection(lines)
    assert (quiet.hits, quiet.n, loud.hits, loud.n) == (0, 1, 1, 2)
    assert middle == pytest.approx(50.0)


def test_energy_counts_innovations_and_projects():
    rng = np.random.default_rng(0)
    white = rng.standard_normal((2, 6001))
    noise = np.zeros_like(white)
    for k in range(1, white.shape[1]):
        noise[:, k] = 0.8 * noise[:, k - 1] + 0.1 * white[:, k]
    change = np.zeros(2000)
    change[1000:] = 0.05
    raw, left = energy([change], list(noise), [np.zeros((0, 0))], 2)
    # a step of 0.05 makes an innovation of 0.5 sigma, then 999 of 0.1 sigma
    assert raw == pytest.approx(0.25 + 999 * 0.01, rel=0.1) and left == raw
    raw, left = energy([change], list(noise), [change[:, None]], 2)
    assert left < 1e-9 * raw


def test_laguerre_filters_mimic_a_lag_that_is_a_little_slower():
    u = np.repeat(np.random.default_rng(1).standard_normal(40), 50)

    def lag(pole):
        y = np.zeros_like(u)
        for k in range(1, len(u)):
            y[k] = pole * y[k - 1] + (1 - pole) * u[k - 1]
        return y

    columns = laguerre(u, 0.9)
    assert columns.shape == (len(u), FREEDOMS)
    change = lag(0.92) - lag(0.9)
    missing = change - columns @ np.linalg.lstsq(columns, change, rcond=None)[0]
    assert missing @ missing < 1e-4 * (change @ change)


def test_plans_hold_what_they_promise():
    plans = {name: plan(name) for name in PLANS}
    keys = {name: [task.key for task in tasks] for name, tasks in plans.items()}
    assert all(len(set(names)) == len(names) for names in keys.values())
    assert set(keys["small"]) <= set(keys["full"])
    kinds = [task.kind for task in plans["full"]]
    assert kinds.count("clean") >= 500 and kinds.count("pair") >= 40
    assert len(plans["tiny"]) == 6
    assert keys["full"] == [task.key for task in plan("full")]
    early = [task.kind for task in plans["full"][:300]]
    assert all(early.count(kind) > 0 for kind in set(kinds))
    with pytest.raises(ValueError, match="one of full"):
        plan("huge")


def test_a_report_is_written_of_whatever_is_there(tmp_path):
    crash = line([BACKLASH], key="crash")
    for key in ("findings", "verdict", "minor", "unexplained", "fit"):
        del crash[key]
    crash["error"] = "ValueError: no"
    bank = finding("bank", "vehicle", rivals=[("offset", "vehicle")])
    lines = [
        line([BACKLASH], [finding("backlash", "steering", gap=[0.021, 0.0005])], key="right"),
        line([BACKLASH], [bank], key="wrong", lambda0=0.0),
        line([BACKLASH, truth("understeer", "vehicle")], [bank], kind="pair", key="two"),
        line(kind="clean", findings=[bank], key="alarm"),
        line([truth("dropout", "steering")], [bank], kind="outside", key="outside"),
        crash,
    ]
    for count in (0, 1, len(lines)):
        hunt_report.write(lines[:count], tmp_path, "tiny", 6)
    words = (tmp_path / "hunt.md").read_text()
    assert "6 of 6 cases" in words and "`crash`: ValueError: no" in words
    assert "`alarm`: bank@vehicle or offset@vehicle" in words
    assert (tmp_path / "confusion.png").stat().st_size > 5000
    assert (tmp_path / "detection.png").stat().st_size > 5000


def test_results_survive_a_line_that_was_cut_short(tmp_path):
    file = tmp_path / "results.jsonl"
    assert hunt.read(file) == []
    hunt.append(file, {"key": "a", "seconds": math.nan})
    hunt.append(file, {"key": "b", "n": 1})
    with file.open("a") as handle:
        handle.write('{"key": "c", "n"')
    assert [x["key"] for x in hunt.read(file)] == ["a", "b"]
    hunt.append(file, {"key": "b", "n": 2})
    assert [(x["key"], x.get("n")) for x in hunt.read(file)] == [("a", None), ("b", 2)]


def test_lines_are_plain_json():
    told = line([BACKLASH], [finding("backlash", "steering", gap=[0.021, 0.0005])])
    assert json.loads(json.dumps(told)) == told
