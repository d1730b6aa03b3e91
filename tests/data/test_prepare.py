"""From rows to an even grid: gaps, duplicates, missing cells, jitter, thinning out; and that each
is told."""

import numpy as np
import pytest
from scipy.signal import lfilter

from small_logs import drive, write_csv
from vdmsi_jax.config import Config, PlantSpec, Prepare, Select, load_config
from vdmsi_jax.data import read_log
from vdmsi_jax.data.resample import sample_period
from vdmsi_jax.errors import InputError


def read(tmp_path, columns, **prepare):
    path = write_csv(tmp_path / "run.csv", columns)
    return read_log(path, Config(prepare=Prepare(**prepare)))


def rows(columns, index):
    return {name: np.asarray(values)[index] for name, values in columns.items()}


def clean(t):
    """Smooth responses, and commands that jump, as functions of time."""
    return {
        "t": t,
        "v_cmd": np.floor(2.0 * t),
        "v": 3.0 + np.sin(2.0 * t),
        "delta": 0.2 * np.cos(3.0 * t),
    }


# ---------------------------------------------------------------- time


def test_even_rows_are_taken_as_they_are(tmp_path):
    log = read(tmp_path, drive())
    np.testing.assert_array_equal(log["v"], drive()["v"])
    assert log.repairs == () and len(log.segments) == 1


@pytest.mark.parametrize("start", [0.0, -3.0, 1.7e9])
def test_time_need_not_start_at_zero(tmp_path, start):
    log = read(tmp_path, drive() | {"t": start + drive()["t"]})
    assert log.dt == pytest.approx(0.01, rel=1e-9) and log.t[0] == pytest.approx(start)
    np.testing.assert_array_equal(log["v"], drive()["v"])


@pytest.mark.parametrize(
    ("dt", "decimals"), [(0.0016384, 4), (1 / 60, 3), (1 / 51200, 6), (0.02, 2)]
)
def test_rounded_stamps_are_no_jitter(tmp_path, dt, decimals):
    """Stamps printed with few digits step unevenly, and yet the log is even."""
    t = dt * np.arange(3000)
    log = read(tmp_path, clean(t) | {"t": np.round(t, decimals)})
    assert log.repairs == () and log.n == 3000
    assert log.dt == pytest.approx(dt, rel=2e-5)  # the digits that are there tell no more
    np.testing.assert_array_equal(log["v"], clean(t)["v"])


def test_stamps_of_six_significant_digits_are_no_jitter(tmp_path):
    t = 0.0016384 * np.arange(100_000)
    stamps = np.array([float(f"{x:.6g}") for x in t])
    log = read(tmp_path, clean(t) | {"t": stamps})
    assert log.dt == pytest.approx(0.0016384, rel=1e-6) and log.repairs == ()


@pytest.mark.parametrize("dropped", [[], [50], [50, 51, 400]])
def test_the_period_is_found_with_jitter_and_holes(dropped):
    rng = np.random.default_rng(0)
    t = np.delete(0.0137 * np.arange(500) + 0.001 * rng.uniform(-1, 1, 500), dropped)
    fresh = np.arange(t.size) == 0
    assert sample_period(t, fresh) == pytest.approx(0.0137, rel=1e-3)


@pytest.mark.parametrize("n", [400, 401])
@pytest.mark.parametrize("steps", [(0.001, 0.019), (0.019, 0.001)])
def test_rows_in_pairs_are_read_or_refused(tmp_path, steps, n):
    """Half of the steps are so short, and half so long, that their mean is near none of them."""
    t = np.append(0.0, np.cumsum(np.resize(steps, n - 1)))
    try:
        log = read(tmp_path, clean(t))
    except InputError as why:
        assert str(why).startswith(str(tmp_path)) and "\n" not in str(why)
        return
    np.testing.assert_allclose(np.diff(log.t), log.dt, rtol=1e-6)
    np.testing.assert_allclose(log["v"], clean(log.t)["v"], atol=0.019**2 * 4 / 8)


def test_rows_in_pairs_are_read_where_they_are_told_to_be_one_stretch(tmp_path):
    t = np.append(0.0, np.cumsum(np.resize([0.001, 0.019], 399)))
    log = read(tmp_path, clean(t), gap=0.1)
    assert len(log.segments) == 1
    np.testing.assert_allclose(log["v"], clean(log.t)["v"], atol=0.019**2 * 4 / 8)


def test_small_jitter_is_tolerated(tmp_path):
    t = drive()["t"] + 0.0004 * np.random.default_rng(0).uniform(-1, 1, 200)
    log = read(tmp_path, drive() | {"t": t})
    np.testing.assert_array_equal(log["v"], drive()["v"])
    assert log.repairs == ()


def test_uneven_rows_are_resampled_each_channel_by_its_rule(tmp_path):
    rng = np.random.default_rng(1)
    t = np.cumsum(rng.uniform(0.006, 0.014, 2000))
    log = read(tmp_path, clean(t))
    assert log.dt == 0.01 and "2000 unevenly spaced rows" in log.repairs[0]
    truth = clean(log.t)
    # linear interpolation of sin(2 t) between stamps up to h apart is off by h²·2²/8
    np.testing.assert_allclose(log["v"], truth["v"], atol=0.014**2 * 4 / 8)
    np.testing.assert_allclose(log["delta"], truth["delta"], atol=0.2 * 0.014**2 * 9 / 8)
    within = log.t[:-1, None] + 1e-5 * (np.arange(1000) + 0.5)  # of a command that is held
    held = clean(t)["v_cmd"][np.searchsorted(t, within, side="right") - 1].mean(axis=1)
    np.testing.assert_allclose(log["v_cmd"][:-1], held, atol=2e-3)
    assert np.mean(np.isin(log["v_cmd"], np.unique(clean(t)["v_cmd"]))) > 0.9  # it steps rarely


def test_a_plant_answers_alike_when_its_log_is_thinned_out(tmp_path):
    """Steps between the longer rows are not late: a lag of 0.1 s from 100 to 20 Hz."""
    t = 0.01 * np.arange(3000)
    u = np.random.default_rng(2).normal(size=400)[np.cumsum(np.arange(3000) % 13 == 0) - 1]
    y = lfilter([0.0, 1.0 - np.exp(-0.1)], [1.0, -np.exp(-0.1)], u)
    log = read(tmp_path, {"t": t, "v_cmd": u, "v": y}, dt=0.05)
    pole = np.exp(-0.5)
    of_means, of_samples = (
        np.std(lfilter([0.0, 1.0 - pole], [1.0, -pole], command) - log["v"])
        for command in (log["v_cmd"], u[::5])
    )
    assert of_means < 0.1 * y.std() < 0.3 * of_samples


def test_the_input_of_a_plant_is_held_whatever_its_name(tmp_path):
    t = np.cumsum(np.random.default_rng(1).uniform(0.6, 1.4, 500))
    pump, level = np.floor(t / 40.0) % 3.0, np.sin(t / 20.0)
    config = Config(plants=(PlantSpec("tank", "pump", "level"),))
    log = read_log(write_csv(tmp_path / "run.csv", {"t": t, "pump": pump, "level": level}), config)
    assert np.mean(np.isin(log["pump"], [0.0, 1.0, 2.0])) > 0.95  # no ramps between its levels
    assert np.mean(np.isin(log["level"], level)) < 0.05


def test_a_channel_can_be_held_by_name(tmp_path):
    t = np.cumsum(np.random.default_rng(1).uniform(0.006, 0.014, 500))
    columns = {"t": t, "v": np.floor(5 * t), "v_cmd": t}
    held, free = (read(tmp_path, columns, hold=hold)["v"] for hold in (("v",), ()))
    assert np.any(held != free)
    before = np.searchsorted(t, 0.01 * np.arange(len(held)) + t[0] + 1e-9, side="right") - 1
    at_rest = np.floor(5 * t)[before] == np.floor(5 * t)[np.minimum(before + 2, t.size - 1)]
    np.testing.assert_array_equal(held[at_rest], np.floor(5 * t)[before][at_rest])


def test_a_missing_row_is_filled_and_marked(tmp_path):
    t = 0.01 * np.arange(300)
    log = read(tmp_path, rows(clean(t), np.delete(np.arange(300), [100, 101])))
    assert log.n == 300 and len(log.segments) == 1
    np.testing.assert_allclose(log.t, t, atol=1e-12)
    assert np.flatnonzero(~log.measured("v")).tolist() == [100, 101]
    assert log["v_cmd"][100] == clean(t)["v_cmd"][99]
    assert log["v"][100] == pytest.approx(clean(t)["v"][100], abs=1e-3)
    assert any("filled in 2 samples for which the log has no row" in told for told in log.repairs)


@pytest.mark.parametrize(("gap", "segments"), [(None, 2), (0.3, 1), (0.05, 2)])
def test_a_hole_parts_segments(tmp_path, gap, segments):
    t = np.delete(0.01 * np.arange(400), np.arange(150, 170))
    log = read(tmp_path, clean(t), gap=gap)
    assert len(log.segments) == segments
    if segments == 2:
        assert [len(s) for s in log.segments] == [150, 230]
        np.testing.assert_allclose(log.t, t, atol=1e-9)
        assert "1 hole of more than 0.05 s" in log.repairs[0] and "0.21 s" in log.repairs[0]


def test_short_pieces_are_left_out_and_told(tmp_path):
    keep = np.r_[0:100, 150:155, 200:300]
    log = read(tmp_path, rows(clean(0.01 * np.arange(300)), keep))
    assert [len(s) for s in log.segments] == [100, 100]
    assert any("1 piece between" in told and "(5 rows)" in told for told in log.repairs)


def test_warm_up_is_cut_from_every_run(tmp_path):
    one = clean(0.01 * np.arange(100))
    columns = {name: np.tile(values, 2) for name, values in one.items()}
    path = write_csv(tmp_path / "run.csv", columns | {"trial": ["a"] * 100 + ["b"] * 100})
    log = read_log(path, Config(columns={"run": "trial"}, prepare=Prepare(warm_up=0.2)))
    assert [len(s) for s in log.segments] == [80, 80]
    np.testing.assert_array_equal(log.pieces("v")[1], one["v"][20:])
    assert "cut off the first 0.2 s of every run (40 rows)" in log.repairs


def test_duplicates_are_dropped_if_so_configured(tmp_path):
    columns = rows(drive(), np.repeat(np.arange(200), np.where(np.arange(200) % 50 == 7, 3, 1)))
    with pytest.raises(InputError, match="twice"):
        read(tmp_path, columns)
    log = read(tmp_path, columns, duplicates="drop")
    np.testing.assert_array_equal(log["v"], drive()["v"])
    assert len(log.segments) == 1 and "8 rows" in log.repairs[0] and "0.07 s" in log.repairs[0]


# ---------------------------------------------------------------- missing cells


def with_holes(t, holes):
    columns = clean(t)
    for name, index in holes.items():
        columns[name] = columns[name].copy()
        columns[name][index] = np.nan
    return columns


def test_missing_cells_become_gaps(tmp_path):
    t = 0.01 * np.arange(300)
    log = read(tmp_path, with_holes(t, {"v": [100], "v_cmd": [200, 201]}), missing="gap")
    assert [len(s) for s in log.segments] == [100, 99, 98]
    np.testing.assert_allclose(log["v"], np.delete(clean(t)["v"], [100, 200, 201]))
    assert "cut out 3 rows without v_cmd or v, the first at 1 s" in log.repairs


@pytest.mark.parametrize("policy", ["hold", "interpolate"])
def test_missing_cells_are_filled_by_rule(tmp_path, policy):
    t = 0.01 * np.arange(300)
    log = read(tmp_path, with_holes(t, {"v": [100, 101], "v_cmd": [50]}), missing=policy)
    truth = clean(t)
    assert len(log.segments) == 1
    if policy == "hold":
        np.testing.assert_array_equal(log["v"][100:102], truth["v"][99])
    else:
        np.testing.assert_allclose(log["v"][100:102], truth["v"][100:102], atol=1e-3)
    assert log["v_cmd"][50] == truth["v_cmd"][49] != truth["v_cmd"][50]
    assert np.flatnonzero(~log.measured("v")).tolist() == [100, 101]
    assert log.measured("delta").all()
    assert any(
        "filled in 2 missing cells of v" in told and "at 1 s" in told for told in log.repairs
    )


@pytest.mark.parametrize("policy", ["interpolate", "hold"])
def test_a_sensor_slower_than_the_log_is_filled_between_its_cells(tmp_path, policy):
    """In every twentieth row; where it is silent for longer, the log has a gap."""
    t = 0.01 * np.arange(800)
    silent = (np.arange(800) % 20 != 0) | ((t > 1.85) & (t < 5.95))
    columns = clean(t) | {"x": np.where(silent, np.nan, 2.0 * t)}
    log = read(tmp_path, columns, missing=policy)
    pieces = [(round(log.t[s.start], 2), round(log.t[s.stop - 1], 2)) for s in log.segments]
    last = 7.8 if policy == "interpolate" else 7.99
    assert pieces[0][0] == 0.0 and pieces[-1] == (6.0, last) and len(pieces) == 2
    assert log.measured("x").sum() == 10 + 10 and log.measured("v").all()
    if policy == "interpolate":
        np.testing.assert_allclose(log["x"], 2.0 * log.t, atol=1e-9)
    with pytest.raises(InputError, match="no stretch without a gap"):
        read(tmp_path, columns, missing=policy, gap=0.1)


@pytest.mark.parametrize("policy", ["hold", "interpolate"])
def test_long_holes_are_not_filled(tmp_path, policy):
    t = 0.01 * np.arange(300)
    log = read(tmp_path, with_holes(t, {"v": np.arange(100, 120)}), missing=policy)
    assert [len(s) for s in log.segments] == [100, 180] and log.measured("v").all()
    assert log.repairs[-1].endswith("holes of up to 0.05 s are filled in, as [prepare] gap says")


def test_holes_at_the_ends_are_cut(tmp_path):
    t = 0.01 * np.arange(300)
    log = read(tmp_path, with_holes(t, {"v": [0, 1, 299]}), missing="interpolate")
    assert log.n == 297 and log.t[0] == pytest.approx(0.02)


def test_a_slow_sensor_in_a_fast_log(tmp_path):
    """Pose at 20 Hz among rows at 100 Hz: four of five cells are empty."""
    t = 0.01 * np.arange(500)
    empty = np.flatnonzero(np.arange(500) % 5)
    log = read(tmp_path, with_holes(t, {"delta": empty}), missing="interpolate", gap=0.06)
    assert len(log.segments) == 1 and log.n >= 495
    np.testing.assert_allclose(log["delta"], clean(log.t)["delta"], atol=0.2 * 0.05**2 * 9 / 8)
    assert np.count_nonzero(log.measured("delta")) == 100


def test_rows_without_time_are_cut_where_gaps_are_allowed(tmp_path):
    columns = drive()
    t = columns["t"].copy()
    t[70] = np.nan
    log = read(tmp_path, columns | {"t": t}, missing="gap")
    assert [len(s) for s in log.segments] == [70, 129]


def test_no_piece_crosses_what_was_cut(tmp_path):
    """Whatever is cut out at random, samples inside a segment are neighbours in the log."""
    rng = np.random.default_rng(5)
    t = 0.01 * np.arange(2000)
    bad = rng.choice(2000, 60, replace=False)
    log = read(tmp_path, with_holes(t, {"v": bad}) | {"a": np.arange(2000.0)}, missing="gap")
    for piece in log.pieces("a"):
        assert np.all(np.diff(piece) == 1.0)
    lost = set(range(2000)) - set(log["a"].astype(int))
    assert set(bad) <= lost
    edges = np.sort(np.concatenate([[-1], bad, [2000]]))
    short = sum(gap - 1 for gap in np.diff(edges) if gap - 1 < 10)
    assert len(lost) == 60 + short


# ---------------------------------------------------------------- selection


def test_rows_that_are_not_selected_become_gaps(tmp_path):
    t = 0.01 * np.arange(300)
    mode = np.where((t < 1.0) | (t >= 1.5), "auto", "manual")
    path = write_csv(tmp_path / "run.csv", clean(t) | {"mode": list(mode)})
    (tmp_path / "c.toml").write_text("[select]\nwhere = 'mode == \"auto\" and v > 0'")
    log = read_log(path, load_config(tmp_path / "c.toml"))
    assert [len(s) for s in log.segments] == [100, 150]
    assert "left out 50 of 300 rows that [select] does not choose" in log.repairs


def test_one_row_that_is_not_selected_is_a_gap(tmp_path):
    path = write_csv(tmp_path / "run.csv", drive() | {"ok": np.arange(200) != 90})
    log = read_log(path, Config(select=Select(where="ok == 1")))
    assert [len(s) for s in log.segments] == [90, 109]


def test_time_may_be_bad_where_no_row_is_selected(tmp_path):
    t = drive()["t"].copy()
    t[50:60] = 0.0
    path = write_csv(tmp_path / "run.csv", drive() | {"t": t, "k": np.arange(200.0)})
    log = read_log(path, Config(select=Select(where="k < 50 or k >= 60")))
    assert [len(s) for s in log.segments] == [50, 140]


# ---------------------------------------------------------------- another period


def test_thinning_out_takes_measurements_as_they_are(tmp_path):
    """A low-pass would be taken for a part of the plant, whose command passes none."""
    t = 0.001 * np.arange(20_000)
    corner = np.where(t < 7.003, 0.0, 1.0 - np.exp(-(t - 7.003) / 0.05))
    log = read(tmp_path, {"t": t, "v": corner, "v_cmd": np.floor(t), "delta": t}, dt=0.02)
    assert log.dt == 0.02 and log.n == 1000
    np.testing.assert_allclose(log["v"], corner[::20], atol=1e-12)
    np.testing.assert_array_equal(log["v_cmd"], np.floor(log.t + 1e-9))
    told = "thinned out from 0.001 to 0.02 s: one of 20 measurements taken"
    assert any(told in repair for repair in log.repairs)


def test_a_period_that_is_no_multiple(tmp_path):
    t = 0.01 * np.arange(1000)
    log = read(tmp_path, clean(t), dt=0.025)
    assert log.dt == 0.025 and log.n == pytest.approx(400, abs=1)
    np.testing.assert_allclose(log["v"][20:-20], clean(log.t)["v"][20:-20], atol=2e-3)


def test_a_shorter_period_marks_what_no_row_measured(tmp_path):
    t = 0.02 * np.arange(200)
    log = read(tmp_path, clean(t), dt=0.01)
    assert log.n == 399 and np.count_nonzero(log.measured("v")) == 200
    np.testing.assert_allclose(log["v"][::2], clean(t)["v"], atol=1e-12)
