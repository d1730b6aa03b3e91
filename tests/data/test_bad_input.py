"""What is refused, each with one line that names the file, the place and the mend."""

import numpy as np
import pytest

from small_logs import drive, write_csv
from vdmsi_jax.config import Config, Prepare, load_config
from vdmsi_jax.data import Record, check_excitation, read_log, table
from vdmsi_jax.errors import InputError


def changed(name, row, cell):
    columns = drive()
    values = list(columns[name])
    values[row] = cell
    return columns | {name: values}


def without(name):
    return {key: values for key, values in drive().items() if key != name}


COLUMNS = {
    "missing time": (without("t"), ["column 't'", "is missing", "[columns]"]),
    "no channel": ({"t": drive()["t"], "speed": drive()["v"]}, ["header", "v_cmd"]),
    "text": (
        changed("v", 17, "fast"),
        ["line 19", "column 'v'", "'fast' is no number", 'missing = "gap"'],
    ),
    "decimal comma": (changed("v", 3, '"1,5"'), ["line 5", "decimal point"]),
    "empty cell": (changed("v", 17, ""), ["line 19", "column 'v'", "missing"]),
    "nan": (changed("delta", 0, float("nan")), ["line 2", "column 'delta'", "not finite"]),
    "underscore": (changed("v", 17, "1_0"), ["line 19", "column 'v'", "'1_0' is no number"]),
    "other digits": (changed("v", 17, "\uff11"), ["line 19", "column 'v'", "is no number"]),
    "too large": (changed("v", 17, 1e200), ["column 'v'", "1e+200", "larger", "unit"]),
    "too small": (drive() | {"v": 1e-200 * drive()["v"]}, ["column 'v'", "1.1e-200", "unit"]),
    "infinity": (changed("v", 199, float("-inf")), ["line 201", "column 'v'", "not finite"]),
    "time missing": (changed("t", 5, ""), ["line 7", "column 't'", "time"]),
    "time backwards": (changed("t", 100, 0.5), ["line 102", "column 't'", "backwards", "0.99"]),
    "time twice": (changed("t", 100, 0.99), ["line 102", "twice", 'duplicates = "drop"']),
    "milliseconds": (
        drive() | {"t": 1000.0 * drive()["t"]},
        ["column 't'", "rows are 10 s apart", 't = "ms"'],
    ),
    "microseconds": (drive() | {"t": 1e6 * drive()["t"]}, ["rows are 10000 s apart", 't = "us"']),
    "nanoseconds": (drive() | {"t": 1e9 * drive()["t"]}, ["column 't'", 't = "ns"']),
    "one row": ({k: v[:1] for k, v in drive().items()}, ["only one row"]),
    "header only": ({k: v[:0] for k, v in drive().items()}, ["no rows"]),
    "too short": ({k: v[:5] for k, v in drive().items()}, ["10 samples"]),
}


def refusal(path, config=None) -> str:
    with pytest.raises(InputError) as caught:
        read_log(path, config)
    told = str(caught.value)
    assert "\n" not in told and "; " in told
    return told


@pytest.mark.parametrize("case", COLUMNS)
def test_bad_columns(tmp_path, case):
    columns, parts = COLUMNS[case]
    path = write_csv(tmp_path / "run.csv", columns)
    told = refusal(path)
    assert told.startswith(f"{path}: ")
    for part in parts:
        assert part in told


FILES = {
    "empty": (b"", ["is empty"]),
    "blank": (b"\n\n  \n", ["no header"]),
    "no header": (b"0.0,1.0,1.0\n0.1,1.0,1.0\n", ["no header"]),
    "binary": (bytes(range(256)) * 10, ["binary"]),
    "latin": ("t,v_cmd,v\n0,1,1 \xb0\n".encode("latin-1") * 20, ["UTF-8"]),
    "ragged, of the usual number of cells": (
        b"t,v_cmd,v,x\n0,1,1,1\n0.1,1\n0.2,1,1,1,1,1\n0.3,1,1,1\n",
        ["line 3", "2 cells", "4"],
    ),
    "ragged, short": (b"t,v_cmd,v\n0,1,1\n0.1,1\n0.2,1,1\n", ["line 3", "2 cells", "3"]),
    "ragged, long": (b"t,v_cmd,v\n0,1,1\n0.1,1,1,1\n0.2,1,1\n", ["line 3", "4 cells", "3"]),
    "twins": (b"t,v,v\n0,1,1\n0.1,1,1\n", ["two columns", "'v'"]),
}


@pytest.mark.parametrize("case", FILES)
def test_bad_files(tmp_path, case):
    content, parts = FILES[case]
    path = tmp_path / "run.csv"
    path.write_bytes(content)
    told = refusal(path)
    assert told.startswith(f"{path}: ")
    for part in parts:
        assert part in told


def test_moments_of_a_log_that_counts_from_an_epoch_are_told_from_its_first_row(tmp_path):
    columns = drive()
    columns["t"] = np.asarray(columns["t"]) + 1.7e9
    columns["v"] = [float("nan") if k == 50 else x for k, x in enumerate(columns["v"])]
    config = Config(prepare=Prepare(missing="interpolate"))
    log = read_log(write_csv(tmp_path / "run.csv", columns), config)
    assert any("the first 0.5 s after its first row" in told for told in log.repairs)


def test_long_names_of_columns_are_cut(tmp_path):
    path = tmp_path / "run.csv"
    path.write_text(
        "t," + ",".join(f"{'x' * 5000}{i}" for i in range(20)) + "\n" + "0," * 20 + "0\n"
    )
    told = refusal(path)
    assert "x…" in told and len(told) < 1000 + len(str(path))


def test_the_line_is_right_behind_comments_and_blank_lines(tmp_path):
    path = tmp_path / "run.csv"
    path.write_text("# a\n\nt,v_cmd,v\n\n0,1,1\n# b\n0.1,1,x\n")
    assert "line 7, column 'v'" in refusal(path)
    path.write_text("# a\n\nt,v_cmd,v\n\n0,1,1\n# b\n\n0,1,1\n")
    assert "line 8, column 't'" in refusal(path)


def test_a_bad_cell_deep_in_a_long_file(tmp_path):
    path = tmp_path / "run.csv"
    rows = [f"{0.01 * k:.2f},1,{k % 7}" for k in range(50_000)]
    rows[43_210] = rows[43_210] + "e"
    path.write_text("t,v_cmd,v\n" + "\n".join(rows))
    assert "line 43212, column 'v'" in refusal(path)


def test_no_file(tmp_path):
    assert "no such file" in refusal(tmp_path / "absent.csv")
    assert "is a folder" in refusal(tmp_path)


def test_a_column_that_the_configuration_names_is_missing(tmp_path):
    path = write_csv(tmp_path / "run.csv", drive())
    (tmp_path / "c.toml").write_text('[columns]\nv = "v_ist"\nr = "delta_"\n')
    told = refusal(path, tmp_path / "c.toml")
    assert "column 'v_ist'" in told and "c.toml" in told and "[columns] v" in told
    (tmp_path / "c.toml").write_text('[columns]\nr = "delt"\n')
    assert "did you mean 'delta'" in refusal(path, tmp_path / "c.toml")


@pytest.mark.parametrize(
    ("text", "parts"),
    [
        ("[select]\nwhere = 'phse == 1'", ["[select] where", "'phse'", "no column"]),
        ("[select]\nwhere = 'v > 100'", ["no row is selected"]),
        ("[select]\nwhere = 'v == \"fast\"'", ["[select] where", "compared with a text"]),
        ("[select]\nwhere = 'open(v)'", ["[select] where", "unknown function"]),
        ("[prepare]\ndt = 1e-9", ["[prepare] dt", "1e-09 s", "0.01 s between rows"]),
        (
            "[units]\nv = 'm/s'\n[sign]\ndelta = 1\n[columns]\ndelta = 't'\nt = 't'\n"
            "[vehicle]\nl_f = 1\nl_r = 1",
            ["column 't'", "1.97 rad", '[units] delta = "deg"'],
        ),
        ("[prepare]\nhold = ['pedal']", ["[prepare] hold", "'pedal'"]),
        (
            "[derive]\na = 'acceleration_from_speed'\nz = { expression = 'b', unit = '1' }",
            ["[derive] z"],
        ),
        ("[derive]\nz = { expression = 'v', unit = 'mph/h' }", ["[derive] z unit", "mph/h"]),
        ("[derive]\nv = { expression = 'v', unit = 'deg' }", ["[derive] v unit", "wrong unit"]),
        ("[derive]\nv = 'yaw_rate_from_heading'", ["[derive] v", "angular rate", "speed"]),
        ("[derive]\nz = { expression = '1 / (v - v)', unit = '1' }", ["[derive] z", "not finite"]),
        ("[derive]\ndelta = 'steering_from_yaw_rate'", ["[derive] delta", "'r'"]),
        ("[derive]\nr = 'yaw_rate_from_steering'", ["[derive] r", "wheelbase"]),
        (
            "[[plants]]\nname = 'yaw'\ninput = 'delta_cm'\noutput = 'v'",
            ["[[plants]] yaw", "input", "did you mean 'delta_cmd'"],
        ),
    ],
)
def test_configurations_that_the_log_cannot_serve(tmp_path, text, parts):
    path = write_csv(tmp_path / "run.csv", drive())
    (tmp_path / "c.toml").write_text(text)
    told = refusal(path, tmp_path / "c.toml")
    for part in parts:
        assert part in told


def test_seconds_that_are_called_milliseconds(tmp_path):
    path = write_csv(tmp_path / "run.csv", drive())
    assert "1e-05 s apart" in refusal(path, Config(units={"t": "ms"}))
    slow = write_csv(tmp_path / "slow.csv", drive() | {"t": 1000.0 * drive()["t"]})
    assert read_log(slow, Config(units={"t": "s"})).dt == 10.0


NPZ = {
    "lengths": ({"t": np.arange(20.0), "v": np.zeros(19)}, ["array", "19", "20"]),
    "shape": ({"t": np.arange(20.0), "v": np.zeros((20, 2))}, ["array 'v'", "(20, 2)"]),
    "objects": ({"t": np.arange(20.0), "v": np.array([None] * 20)}, ["array 'v'"]),
    "texts": ({"t": np.arange(20.0), "v": np.array(["a"] * 20)}, ["array 'v'", "numbers"]),
    "complex": ({"t": 0.1 * np.arange(20), "v": np.ones(20) * 1j}, ["array 'v'", "complex"]),
    "nan": ({"t": 0.1 * np.arange(20), "v": np.full(20, np.nan)}, ["sample 0", "'v'"]),
}


@pytest.mark.parametrize("case", NPZ)
def test_bad_arrays(tmp_path, case):
    arrays, parts = NPZ[case]
    np.savez(tmp_path / "run.npz", **arrays)
    told = refusal(tmp_path / "run.npz", Config(units={"t": "s"}))
    for part in parts:
        assert part in told


@pytest.mark.parametrize("save", [np.savez, np.savez_compressed])
def test_a_damaged_archive(tmp_path, save):
    path = tmp_path / "run.npz"
    save(path, t=0.01 * np.arange(500), v=np.random.default_rng(0).standard_normal(500))
    whole = path.read_bytes()
    path.write_bytes(whole[:3000] + bytes([whole[3000] ^ 255]) + whole[3001:])
    assert "save it anew" in refusal(path)


def test_an_archive_that_is_none(tmp_path):
    (tmp_path / "run.npz").write_text("t,v\n0,1\n")
    assert "is no NPZ file" in refusal(tmp_path / "run.npz")


def test_a_log_that_is_too_large_is_refused_before_it_is_read(tmp_path, monkeypatch):
    """10 million rows need 5 GB at 500 bytes a row: with 8 GB free, of which half may be taken."""
    monkeypatch.setattr(table, "available_memory", lambda: 8_000_000_000)
    path = tmp_path / "long.csv"
    row = b"0.010000,1.000000,1.000000\n"
    with path.open("wb") as file:  # a sparse file: the rows behind the first ones take no space
        file.write(b"t,v_cmd,v\n" + row * 5000)
        file.truncate(len(row) * 10_000_000)
    told = refusal(path)
    assert "rows would take 5.0 GB" in told and "8.0 GB are free" in told and "cut the log" in told
    np.savez(tmp_path / "long.npz", t=np.zeros(9_000_000, np.int8))
    assert "9,000,000 rows" in refusal(tmp_path / "long.npz")


def test_the_memory_that_is_free_is_told():
    assert 1e7 < table.available_memory() < 1e14


def made(**channels):
    return Record.from_arrays(dt=0.1, name="log", **channels)


@pytest.mark.parametrize(
    ("v_cmd", "v", "parts"),
    [
        (np.full(9, 0.3), np.arange(9.0), ["v_cmd", "0.3", "9 samples"]),
        (np.zeros(9), np.arange(9.0), ["v_cmd", "command", "0 in all"]),
        (np.arange(9.0), np.zeros(9), ["log: v:", "response", "zero"]),
        (np.arange(9.0), np.full(9, 0.1), ["log: v:", "0.1"]),
    ],
)
def test_nothing_can_be_learnt_without_change(v_cmd, v, parts):
    record = made(v_cmd=v_cmd, v=v)
    with pytest.raises(InputError) as caught:
        check_excitation(record, record.plant("powertrain"))
    for part in parts:
        assert part in str(caught.value)


def test_a_log_that_moves_passes():
    record = made(v_cmd=np.arange(9.0), v=np.arange(9.0))
    check_excitation(record, record.plant("powertrain"))


def test_nothing_is_left_of_a_log_without_cells(tmp_path):
    path = write_csv(tmp_path / "run.csv", drive() | {"a": [""] * 200})
    for policy in ("gap", "hold", "interpolate"):
        assert "samples" in refusal(path, Config(prepare=Prepare(missing=policy)))
    path = write_csv(tmp_path / "run.csv", drive() | {"t": [""] * 200})
    assert "no two rows" in refusal(path, Config(prepare=Prepare(missing="gap")))


def test_rows_of_empty_cells_are_missing_and_not_blank(tmp_path):
    path = write_csv(tmp_path / "run.csv", drive())
    lines = path.read_text().splitlines()
    lines.insert(50, ",,,,")
    path.write_text("\n".join(lines))
    assert "line 51, column 't'" in refusal(path)


SPOILS = ["", "nan", "-inf", "x", "1e400", "0", "0.5", "1_0", '"', "1,2", "-", "\x00", "é", "#"]


@pytest.mark.parametrize("seed", range(60))
def test_whatever_is_spoilt_it_is_refused_or_mended(tmp_path, seed):
    """No other exception, and never a record that breaks its promises."""
    rng = np.random.default_rng(seed)
    cells = [
        list(map(repr, row)) for row in zip(*map(np.ndarray.tolist, drive().values()), strict=True)
    ]
    for _ in range(rng.integers(1, 8)):
        row = int(rng.integers(200))
        match rng.integers(4):
            case 0:
                cells[row][rng.integers(5)] = str(rng.choice(SPOILS))
            case 1:
                cells[row] = cells[max(row - int(rng.integers(3)), 0)]
            case 2:
                cells[row : row + int(rng.integers(1, 30))] = []
                cells += [["9", "1", "1", "1", "1"]] * (200 - len(cells))
            case 3:
                cells[row] = cells[row][: rng.integers(5)] or [" "]
    path = tmp_path / "run.csv"
    path.write_text("\n".join(",".join(row) for row in [list(drive()), *cells]))
    for missing in ("refuse", "gap", "hold", "interpolate"):
        for duplicates in ("refuse", "drop"):
            try:
                config = Config(prepare=Prepare(missing=missing, duplicates=duplicates))
                record = read_log(path, config)
            except InputError as error:
                assert "\n" not in str(error)
                continue
            assert all(np.isfinite(values).all() for values in record.channels.values())
            assert np.all(np.diff(record.t) > 0.0)
            for own in record.segments:
                np.testing.assert_allclose(np.diff(record.t[own.samples]), record.dt, rtol=1e-6)


def test_an_unknown_policy_is_refused(tmp_path):
    (tmp_path / "c.toml").write_text("[prepare]\nmissing = 'ignore'")
    with pytest.raises(InputError, match="interpolate"):
        load_config(tmp_path / "c.toml")
    with pytest.raises(InputError):
        Prepare(jitter=0.6)
