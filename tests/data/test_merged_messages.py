"""Messages of several rates in one table, a row for each stamp."""

import numpy as np
import pytest

import vdmsi_jax as vj
from small_logs import write_csv
from vdmsi_jax.config import Config, Derivation, Prepare
from vdmsi_jax.data import read_log, read_logs
from vdmsi_jax.data.slow_sensors import between_their_samples
from vdmsi_jax.errors import InputError

SECONDS = 40.0
RATES = {"wheel": 20.0, "v": 50.0, "x": 10.0}
TRUTH = {
    "wheel": lambda t: 5.0 * np.sign(np.sin(0.9 * t)),
    "v": lambda t: 2.0 + np.sin(0.7 * t),
    "x": lambda t: 30.0 * np.sin(0.05 * t),
}
WHEEL = {"delta_cmd": Derivation(expression="wheel / 16", unit="rad")}


def table(spoilt: float | None = None, seed: int = 0) -> dict[str, np.ndarray]:
    """Stamps that jitter by a tenth of each one's period; `spoilt` is one measurement of v."""
    rng = np.random.default_rng(seed)
    parts = []
    for name, rate in RATES.items():
        stamps = np.arange(0.0, SECONDS, 1.0 / rate)
        stamps = np.round(stamps + rng.uniform(0.0, 0.1 / rate, stamps.size), 6)
        values = TRUTH[name](stamps)
        if name == "v":
            values = values + 1e-3 * rng.standard_normal(values.size)
            if spoilt is not None:
                values[values.size // 2] = spoilt
        cells = {other: np.full(stamps.size, np.nan) for other in RATES} | {name: values}
        parts.append({"t": stamps} | cells)
    rows = {name: np.concatenate([part[name] for part in parts]) for name in parts[0]}
    order = np.argsort(rows["t"], kind="stable")
    return {name: values[order] for name, values in rows.items()}


def read(tmp_path, columns, missing="interpolate") -> vj.Record:
    path = write_csv(tmp_path / "run.csv", columns)
    mend = Prepare(missing=missing, duplicates="drop")
    named = {"wheel": "wheel"}
    return read_log(path, Config(columns=named, prepare=mend, derive=WHEEL))


def test_a_log_has_the_period_of_its_fastest_channel(tmp_path):
    assert read(tmp_path, table()).dt == pytest.approx(0.02, rel=0.01)


def test_each_channel_counts_where_it_was_measured(tmp_path):
    log = read(tmp_path, table())
    assert log.measured("v").mean() > 0.98
    assert log.measured("x").mean() == pytest.approx(0.2, abs=0.02)
    _, slow = between_their_samples(log)
    assert slow == {"x": pytest.approx(0.1, rel=0.02)}


def test_a_sensor_that_ends_early_is_measured_no_longer(tmp_path):
    columns = table()
    late, early = columns["t"] > 0.9 * SECONDS, columns["t"] < 0.1 * SECONDS
    columns["v"][late | early] = np.nan
    log = read(tmp_path, columns)
    known = log.t[log.measured("v")]
    assert 0.1 * SECONDS - 0.03 < known.min() and known.max() < 0.9 * SECONDS + 0.03


def test_measurements_are_interpolated_from_their_own_stamps(tmp_path):
    log = read(tmp_path, table())
    for name, bends in (("v", 0.49 * 0.022**2), ("x", 0.075 * 0.11**2)):
        known = log.measured(name) & (
            log.t > log.t[0] + 0.01
        )  # the first may lie before its message
        off = log[name][known] - TRUTH[name](log.t[known])
        assert np.abs(off).max() < bends / 8.0 + (5e-3 if name == "v" else 1e-3)


def test_what_a_command_is_made_of_is_held(tmp_path):
    """Between its messages it keeps its value; a line would say something between."""
    log = read(tmp_path, table())
    told = 16.0 * log["delta_cmd"]
    between = np.abs(np.abs(told) - 5.0) > 1e-6
    changes = np.count_nonzero(np.diff(np.sign(np.sin(0.9 * log.t))))
    assert 0 < between.sum() <= changes  # means over the samples in which it changes


def test_of_a_sensor_that_is_quicker_the_mean_is_taken(tmp_path):
    """Its noise would be that of one message else, and what is quick would be told as slow."""
    columns, rng = table(), np.random.default_rng(3)
    stamps = np.sort(rng.uniform(0.0, SECONDS, 8000))  # 200 Hz, as they come
    own = {name: np.full(stamps.size, np.nan) for name in RATES}
    own |= {"t": stamps, "a": 0.3 * np.sin(stamps) + 0.1 * rng.standard_normal(stamps.size)}
    columns["a"] = np.full(columns["t"].size, np.nan)
    rows = {name: np.concatenate([columns[name], own[name]]) for name in columns}
    order = np.argsort(rows["t"], kind="stable")
    log = read(tmp_path, {name: values[order] for name, values in rows.items()})
    assert log.dt == pytest.approx(0.02, rel=0.01) and log.measured("a").mean() > 0.95
    off = (log["a"] - 0.3 * np.sin(log.t))[5:-5]
    assert abs(off.mean()) < 0.01 and off.std() < 0.07


@pytest.mark.parametrize("spoilt", [-9999.0, 4.0])
def test_an_outlier_is_taken_out_before_it_is_interpolated(tmp_path, spoilt):
    log = read(tmp_path, table(spoilt))
    assert any("left out 1 sample of v" in told for told in log.repairs)
    assert np.abs(log["v"] - TRUTH["v"](log.t)).max() < 0.02


def test_a_file_for_each_topic_is_refused_with_what_to_do(tmp_path):
    files = []
    for name in RATES:
        t = np.arange(0.0, SECONDS, 1.0 / RATES[name])
        files.append(write_csv(tmp_path / f"{name}.csv", {"t": t, name: TRUTH[name](t)}))
    named = Config(columns={name: name for name in RATES}, derive=WHEEL)
    with pytest.raises(InputError, match="topics of one drive") as refused:
        read_logs(files, named)
    assert "stands in" in str(refused.value)


@pytest.mark.parametrize(("missing", "told"), [("refuse", "several rates"), ("gap", "most rows")])
def test_a_refusal_says_how_such_a_table_is_read(tmp_path, missing, told):
    with pytest.raises(InputError, match=told) as refused:
        read(tmp_path, table(), missing)
    assert 'missing = "interpolate"' in str(refused.value)


def test_a_log_of_which_every_second_row_lacks_a_channel_is_told_to_fill_it(tmp_path):
    t = 0.02 * np.arange(400)
    rows = [f"{at:.2f},{i % 7},{'' if i % 2 else 1.0}" for i, at in enumerate(t)]
    (tmp_path / "run.csv").write_text("\n".join(["t,v_cmd,v", *rows]))
    with pytest.raises(InputError, match="many rows lack a channel") as refused:
        vj.read_log(tmp_path / "run.csv", Config(prepare=Prepare(missing="gap")))
    assert 'missing = "interpolate"' in str(refused.value)


def even(tmp_path, columns, **how) -> vj.Record:
    path = write_csv(tmp_path / "even.csv", columns)
    return read_log(path, Config(prepare=Prepare(**({"missing": "interpolate"} | how))))


def test_what_fills_in_the_ends_of_a_piece_leads_to_where_it_goes_on(tmp_path):
    """A simulation may start from there."""
    t = 0.01 * np.arange(1000)
    seldom = np.where(np.arange(1000) % 100 == 0, 10.0 * t, np.nan)
    log = even(tmp_path, {"t": t, "v": np.sin(t), "x": seldom}, warm_up=0.5)
    np.testing.assert_allclose(log["x"][:3], [5.0, 5.1, 5.2], atol=1e-9)


@pytest.mark.parametrize("each", [2, 10])
def test_rows_that_are_even_stay_as_they_are_however_few_cells_are_full(tmp_path, each):
    t, rows = 0.01 * np.arange(2000), np.arange(2000)
    v = np.where(rows % each == 0, np.sin(t), np.nan)
    v_cmd = np.where(rows % each == each // 2, np.sign(np.sin(t)), np.nan)
    log = even(tmp_path, {"t": t, "v_cmd": v_cmd, "v": v})
    assert log.dt == 0.01 and log.n > 1900
    assert log.measured("v").mean() == pytest.approx(1.0 / each, abs=0.01)


def test_stamps_that_jitter_by_no_more_than_is_tolerated_stay_rows(tmp_path):
    dt, rng = 1.0 / 30.0, np.random.default_rng(2)
    t = dt * np.arange(900) + dt * rng.uniform(-0.2, 0.2, 900)
    log = even(tmp_path, {"t": t, "v": np.sin(t)}, jitter=0.25)
    assert log.n == 900 and not any("resampled" in told for told in log.repairs)


def test_what_answers_a_pulse_of_a_slow_command_is_no_outlier(tmp_path):
    rng = np.random.default_rng(5)
    stamps = np.arange(0.0, 60.0, 0.1)
    pulse = np.arange(stamps.size) % 70 == 35
    parts = {
        "v_cmd": (stamps, 1.0 + 4.0 * pulse),
        "v": (stamps + 0.05, 1.0 + 3.0 * pulse + 0.01 * rng.standard_normal(stamps.size)),
        "a": (np.sort(rng.uniform(0.0, 60.0, 3600)), 0.01 * rng.standard_normal(3600)),
    }
    t = np.concatenate([own for own, _ in parts.values()])
    columns = {"t": t}
    for name in parts:
        cells = [x if other == name else np.full(x.size, np.nan) for other, (_, x) in parts.items()]
        columns[name] = np.concatenate(cells)
    order = np.argsort(t, kind="stable")
    path = write_csv(tmp_path / "pulses.csv", {k: x[order] for k, x in columns.items()})
    log = read_log(path, Config(prepare=Prepare(missing="interpolate", duplicates="drop")))
    assert log["v"].max() > 3.5 and not any("outliers" in told for told in log.repairs)


def test_cells_that_are_held_stay_held_beside_an_outlier(tmp_path):
    t = np.cumsum(np.random.default_rng(1).uniform(0.006, 0.014, 2000))
    v = np.sin(t)
    v[700] = 50.0
    holes = np.r_[300:303, 900:903]
    gone = v.copy()
    gone[holes] = np.nan
    log = even(tmp_path, {"t": t, "v": gone}, missing="hold")
    near = np.abs(log.t - t[301]) < 0.003
    np.testing.assert_allclose(log["v"][near], v[299], atol=1e-9)
    assert log["v"].max() < 1.1


def test_files_with_configurations_of_their_own_may_name_other_columns(tmp_path):
    t = 0.01 * np.arange(500)
    for name, column in (("a", "speed"), ("b", "vel")):
        write_csv(tmp_path / f"{name}.csv", {"t": t, "u_cmd": np.cos(t), column: np.sin(t)})
        own = f'[columns]\nv_cmd = "u_cmd"\nv = "{column}"\n'
        (tmp_path / f"{name}.toml").write_text(own)
    logs = read_logs([tmp_path / "a.csv", tmp_path / "b.csv"])
    assert [log.n for log in logs] == [500, 500]
