"""`Record`: what it promises about its arrays, and how it is cut, split, joined and judged for
noise."""

import pickle
from dataclasses import replace

import numpy as np
import pytest

from vdmsi_jax.config import PlantSpec, VehicleGeometry
from vdmsi_jax.data import Record, Segment
from vdmsi_jax.errors import InputError


def record(n=1000, dt=0.01, runs=("a",), name="log", seed=0):
    """A record of equal segments, one for each run."""
    rng = np.random.default_rng(seed)
    edges = np.linspace(0, n, len(runs) + 1).astype(int)
    t = dt * np.arange(n) + np.repeat(np.arange(len(runs)), np.diff(edges))
    return Record(
        name=name,
        dt=dt,
        t=t,
        channels={"v_cmd": rng.standard_normal(n), "v": np.arange(n, dtype=float)},
        units={"v_cmd": "m/s", "v": "m/s"},
        segments=tuple(
            Segment(int(a), int(b), r) for a, b, r in zip(edges[:-1], edges[1:], runs, strict=True)
        ),
        filled={"v": np.arange(n) % 10 == 0},
    )


def test_a_record_prints_as_one_line():
    assert repr(record()) == "<Record log: 1000 samples of 0.01 s: v_cmd, v>"
    cut = "<Record log: 1000 samples of 0.01 s in 2 segments: v_cmd, v>"
    assert str(record(runs=("a", "b"))) == cut


def test_a_record_counts_its_samples_and_lists_its_channels():
    log = record()
    assert len(log) == log.n and list(log) == ["v_cmd", "v"]
    assert log._ipython_key_completions_() == ["t", "v_cmd", "v"]
    assert {name: log[name] for name in log}.keys() == log.channels.keys()


def test_what_from_arrays_makes(unchecked):
    made = Record.from_arrays(dt=0.1, v_cmd=[0, 1, 2], v=[0.0, 1.0, 2.0], t0=5.0, name="mine")
    assert made.n == 3 and made.duration == pytest.approx(0.3) and made.runs == ("mine",)
    np.testing.assert_allclose(made.t, [5.0, 5.1, 5.2])
    assert made.plants == (PlantSpec("powertrain", "v_cmd", "v"),)
    alone = PlantSpec("motor", "u", "w")
    motor = Record.from_arrays(dt=np.array([0.1]), u=[0, 1], w=[0, 1], plants=alone)
    assert motor.dt == 0.1 and motor.plants == (alone,)
    assert made.units["v"] == "m/s" and "v" in made and "t" in made and "delta" not in made


@pytest.mark.parametrize(
    ("arguments", "told"),
    [
        ({"v": [1.0, 2.0], "v_cmd": [1.0]}, "lengths"),
        ({"v": [1.0, np.nan]}, "sample 1"),
        ({"v": [[1.0, 2.0]]}, "one-dimensional"),
        ({"v": [1.0, 1e200]}, "unit"),
        ({"v": [1.0]}, "at least two"),
        ({}, "none"),
        ({"v": [1.0, 2.0], "dt": 0.0}, "dt"),
        ({"v": [1.0, 2.0], "t": [0.0, 1.0]}, "t0"),
        ({"v": [1.0, 2.0], "dt": "0.1"}, "dt: '0.1' is no sample period; give seconds"),
        ({"v": [1.0, 2.0], "dt": None}, "dt: None is no sample period"),
        ({"v": [1.0, 2.0], "dt": np.array([0.1, 0.1])}, "dt: .* is no sample period"),
        ({"v": [1.0, 2.0j]}, "v: is complex"),
        ({"v": ["1", "a"]}, "v: holds what is no number .*'a'.*; give numbers"),
        ({"v": [1.0, 2.0], "vehicle": {"l_f": 1.0}}, "is no geometry; give VehicleGeometry"),
        ({"v": [1.0, 2.0], "plants": [PlantSpec("m", "vv", "v")]}, "vv: .* did you mean 'v'"),
        ({"v": [1.0, 2.0], "units": {"v": "km/h"}}, "units v: km/h is not m/s; give it in SI, or"),
    ],
)
def test_what_from_arrays_refuses(unchecked, arguments, told):
    with pytest.raises(InputError, match=told):
        Record.from_arrays(**{"dt": 0.1, **arguments})


def test_a_record_does_not_change():
    given = np.ones(5)
    made = Record.from_arrays(dt=1.0, v=given)
    given[0] = 7.0
    assert made["v"][0] == 1.0
    seen = given.view()
    seen.flags.writeable = False  # and yet it changes with what it is a view of
    made = Record.from_arrays(dt=1.0, v=seen)
    given[0] = 1.0
    assert made["v"][0] == 7.0
    with pytest.raises(ValueError):
        made["v"][0] = 2.0
    with pytest.raises(TypeError):
        made.channels["v"] = given
    with pytest.raises(AttributeError):
        made.dt = 2.0


def test_it_survives_pickling():
    made = replace(record(), session=3.0, file="monday/run.csv")
    made = replace(made, within={"v": np.stack([made["v"], made["v"]], axis=1)})
    again = pickle.loads(pickle.dumps(made))
    assert (again.source, again.log) == ("monday/run.csv", f"{made.name}.csv")
    np.testing.assert_array_equal(again["v"], made["v"])
    np.testing.assert_array_equal(again.measured("v"), made.measured("v"))
    assert again.segments == made.segments and again.session == 3.0
    np.testing.assert_array_equal(again.within["v"], made.within["v"])


def test_an_unknown_channel_or_plant_names_the_nearest(unchecked):
    made = Record.from_arrays(dt=0.1, v_cmd=[0, 1], v=[0, 1])
    with pytest.raises(InputError, match="'v_cmd'"):
        made["vcmd"]
    with pytest.raises(InputError, match="is no name; .*between"):
        record()[0:5]
    assert list(record()) == ["v_cmd", "v"]
    with pytest.raises(InputError, match="is no plant's name; give its name"):
        record().plant(("v_cmd", "v"))
    with pytest.raises(InputError, match="'powertrain'"):
        made.plant("powertrian")
    assert made.plant("powertrain").output == "v"


def test_between_takes_the_start_and_leaves_the_end():
    part = record().between(1.0, 2.0)
    assert part.n == 100 and part["v"][0] == 100.0 and part["v"][-1] == 199.0
    with pytest.raises(InputError, match="nothing is left"):
        record().between(100.0, 200.0)


def test_select_keeps_every_array_aligned():
    whole = record(runs=("a", "b"))
    part = whole.select([Segment(510, 520, "b"), Segment(10, 15, "a")])
    np.testing.assert_array_equal(part["v"], np.r_[510:520, 10:15])
    np.testing.assert_array_equal(part.measured("v"), part["v"] % 10 != 0)
    np.testing.assert_array_equal(part.t, np.r_[whole.t[510:520], whole.t[10:15]])
    assert [len(s) for s in part.segments] == [10, 5] and part.runs == ("b", "a")


def test_select_refuses_to_cross_a_gap():
    with pytest.raises(InputError, match="no single segment"):
        record(runs=("a", "b")).select([Segment(490, 510)])


def test_warm_up_is_cut_from_every_segment():
    part = record(runs=("a", "b")).without_warm_up(0.05)
    assert [len(s) for s in part.segments] == [495, 495]
    assert part["v"][0] == 5.0 and part["v"][495] == 505.0


@pytest.mark.parametrize("share", [0.1, 0.25, 0.5])
@pytest.mark.parametrize("runs", [("a",), ("a", "b", "c")])
def test_blocks_part_every_sample_once(share, runs):
    whole = record(n=6000, runs=runs)
    seen, hidden = whole.split(held_out=share)
    both = np.sort(np.concatenate([seen["v"], hidden["v"]]))
    np.testing.assert_array_equal(both, whole["v"])
    assert hidden.n == pytest.approx(share * whole.n, abs=2 * len(runs))
    # both halves of every segment are seen and judged
    for run in runs:
        own = whole["v"][[s for s in whole.segments if s.run == run][0].samples]
        for half in (own[: own.size // 2], own[own.size // 2 :]):
            assert np.isin(half, seen["v"]).any() and np.isin(half, hidden["v"]).any()


def test_blocks_are_contiguous():
    _, hidden = record(n=4000).split()
    for piece in hidden.pieces("v"):
        assert piece.size >= 50 and np.all(np.diff(piece) == 1.0)


def test_short_segments_go_to_training():
    seen, hidden = record(n=2100, runs=("a",) * 1).split(blocks=100)
    assert min(map(len, hidden.segments)) >= 50
    with pytest.raises(InputError, match="hold out a block"):
        record(n=100).split()


@pytest.mark.parametrize(
    ("count", "share", "held"), [(2, 0.25, 1), (4, 0.25, 1), (8, 0.25, 2), (3, 0.9, 2)]
)
def test_runs_are_held_out_whole(count, share, held):
    whole = record(n=100 * count, runs=tuple("abcdefgh"[:count]))
    seen, hidden = whole.split(held_out=share, by="run")
    assert len(hidden.runs) == held and not set(seen.runs) & set(hidden.runs)
    assert set(seen.runs) | set(hidden.runs) == set(whole.runs)
    assert whole.runs[-1] in hidden.runs


def test_one_run_cannot_be_split_by_run(unchecked):
    with pytest.raises(InputError, match="only one run"):
        record().split(by="run")
    with pytest.raises(InputError, match="'runs'; did you mean 'run'"):
        record().split(0.5, by="runs")
    with pytest.raises(InputError, match="share"):
        record().split(held_out=1.0)


def test_the_way_goes_on_through_gaps_and_starts_anew_with_a_run():
    whole = Record.from_arrays(dt=0.1, v=[1.0, 2.0, -3.0, 3.0, 3.0, 1.0])
    np.testing.assert_allclose(whole.travelled(), [0.0, 0.1, 0.3, 0.6, 0.9, 1.2])
    torn = whole.select([Segment(0, 3), Segment(4, 6)])
    np.testing.assert_allclose(torn.travelled(), [0.0, 0.1, 0.3, 0.9, 1.2])
    twice = Record.concatenate([whole, torn.renamed("again")])
    np.testing.assert_allclose(twice.travelled(), np.r_[whole.travelled(), torn.travelled()])
    turns = Record.concatenate([whole, torn.renamed("b"), whole.renamed("c")])
    back = [replace(s, run="a") if s.run != "b" else s for s in turns.segments]
    rolled = replace(turns, segments=tuple(back)).travelled()  # the run a comes back behind b
    between = 1.0 * (turns.t[-6] - turns.t[5])  # at the speed before b
    assert rolled[6] == 0.0 and rolled[-1] == pytest.approx(2.4 + between)
    told = Record.from_arrays(dt=0.1, v_cmd=[2.0, 2.0, 0.0])
    np.testing.assert_allclose(told.travelled(), [0.0, 0.2, 0.4])
    assert not Record.from_arrays(dt=0.1, u=[1.0, 2.0]).travelled().any()


def test_joining_keeps_runs_samples_and_masks():
    first, second = record(name="one", runs=("one",)), record(name="two", runs=("x", "y"), seed=1)
    both = Record.concatenate([first, second])
    assert both.n == 2000 and both.runs == ("one", "two/x", "two/y")
    np.testing.assert_array_equal(both["v"], np.r_[first["v"], second["v"]])
    np.testing.assert_array_equal(
        both.measured("v"), np.r_[first.measured("v"), second.measured("v")]
    )
    assert np.all(np.diff(both.t) > 0.0)


def test_joining_twins_tells_them_apart():
    both = Record.concatenate([record(runs=("log",)), record(runs=("log",))])
    assert both.runs == ("log", "log 2")


def test_joining_what_does_not_fit():
    with pytest.raises(InputError, match="every 0.02 s"):
        Record.concatenate([record(), record(dt=0.02)])
    with pytest.raises(InputError, match="share none"):
        Record.concatenate([record(), Record.from_arrays(dt=0.01, a=[1.0, 2.0])])
    with pytest.raises(InputError, match="another vehicle"):
        other = Record.from_arrays(dt=0.01, v=[1.0, 2.0], vehicle=VehicleGeometry(1.0, 1.0))
        Record.concatenate([record(), other])
    with pytest.raises(InputError, match="no record"):
        Record.concatenate([])


TEN_PERCENT = 0.1  # five standard errors of the estimate from 3000 samples


@pytest.mark.parametrize("std", [1e-4, 0.02, 3.0])
@pytest.mark.parametrize(
    "motion",
    [
        lambda t: 0.0 * t,
        lambda t: 10.0 * np.sin(2 * np.pi * 0.5 * t),
        lambda t: t**3,
        lambda t: np.cumsum(np.sign(np.sin(2 * np.pi * 0.4 * t))) * 0.01,
    ],
    ids=["rest", "sine", "cubic", "kinks"],
)
def test_noise_is_found_under_smooth_motion(std, motion):
    t = 0.01 * np.arange(3000)
    noisy = std * (motion(t) / 1e-3 if std < 1e-3 else motion(t))
    noisy = noisy + std * np.random.default_rng(1).standard_normal(t.size)
    made = Record.from_arrays(dt=0.01, v=noisy)
    assert made.noise_std("v") == pytest.approx(std, rel=TEN_PERCENT)


def test_noise_is_blind_to_steps_and_outliers():
    rng = np.random.default_rng(2)
    values = np.repeat(rng.uniform(-5, 5, 20), 150) + 0.03 * rng.standard_normal(3000)
    values[rng.integers(0, 3000, 20)] += 50.0
    assert Record.from_arrays(dt=0.01, v=values).noise_std("v") == pytest.approx(0.03, rel=0.15)


def test_noise_of_a_quantised_signal_is_near_that_of_rounding():
    """A sensor that repeats its reading most of the time is not without noise."""
    step, t = 0.02, 0.01 * np.arange(4000)
    values = np.round(np.sin(2 * np.pi * 0.3 * t) / step) * step
    found = Record.from_arrays(dt=0.01, v=values).noise_std("v")
    assert 0.3 * step / np.sqrt(12) < found < 2.0 * step / np.sqrt(12)


def test_noise_does_not_look_across_gaps():
    values = np.repeat([0.0, 1000.0] * 10, 50) + 0.1 * np.random.default_rng(3).standard_normal(
        1000
    )
    segments = tuple(Segment(k, k + 50, "a") for k in range(0, 1000, 50))
    t = np.arange(1000) + 10.0 * np.repeat(np.arange(20), 50)
    made = Record("log", 1.0, t, {"v": values}, {"v": "m/s"}, segments)
    assert made.noise_std("v") == pytest.approx(0.1, rel=0.15)
    assert np.isnan(Record.from_arrays(dt=1.0, v=np.arange(6.0)).noise_std("v"))
