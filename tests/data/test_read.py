"""Reading: what stands in the file arrives in SI under the right name, whatever the file looks
like."""

import time

import numpy as np
import pytest

from small_logs import drive, write_csv
from vdmsi_jax.config import Config, PlantSpec, Prepare, VehicleGeometry, load_config
from vdmsi_jax.data import Record, read_log, read_logs
from vdmsi_jax.data.array_table import ArrayTable
from vdmsi_jax.data.derive import steering_from_curvature
from vdmsi_jax.data.read import options_of
from vdmsi_jax.errors import InputError


def configured(tmp_path, text):
    path = tmp_path / "config.toml"
    path.write_text(text)
    return load_config(path)


def test_the_canonical_header_needs_no_configuration(tmp_path):
    log = read_log(write_csv(tmp_path / "run.csv", drive()))
    assert isinstance(log, Record) and log.name == "run" and log.dt == 0.01 and log.repairs == ()
    for channel in ("v_cmd", "delta_cmd", "v", "delta"):
        np.testing.assert_array_equal(log[channel], drive()[channel])
    assert {plant.name for plant in log.plants} == {"powertrain", "steering"}
    assert log.runs == ("run",) and log.vehicle is None


def test_any_order_and_subset_of_columns(tmp_path):
    columns = drive()
    some = {name: columns[name] for name in ("v", "t", "v_cmd")} | {"note": ["x"] * 200}
    log = read_log(write_csv(tmp_path / "run.csv", some))
    assert set(log.channels) == {"v", "v_cmd"}
    np.testing.assert_array_equal(log["v"], columns["v"])


def test_a_column_that_is_nearly_called_as_a_channel_is_told(tmp_path):
    renamed = {"delta_cmd": "Delta_Cmd [rad]", "v": "v\u200b"}
    columns = {renamed.get(name, name): x for name, x in drive().items()} | {"R": drive()["v"]}
    log = read_log(
        write_csv(tmp_path / "run.csv", columns | {"r": drive()["delta"], "vv": drive()["v"]})
    )
    said = "passed by the column {!r}, which [columns] {} = {!r} would read".format
    passed = [("delta_cmd", "Delta_Cmd [rad]"), ("v", "v\u200b")]
    assert log.repairs == tuple(said(name, channel, name) for channel, name in passed)


@pytest.mark.parametrize("delimiter", [",", ";", "\t"])
def test_delimiters(tmp_path, delimiter):
    log = read_log(write_csv(tmp_path / "run.csv", drive(), delimiter))
    np.testing.assert_array_equal(log["v"], drive()["v"])


@pytest.mark.parametrize(
    "change",
    [
        lambda text: "\ufeff" + text,
        lambda text: text.replace("\n", "\r\n"),
        lambda text: "# made by a logger, 2024\n" + text,
        lambda text: text.replace("\n", "\n\n", 3),
        lambda text: text.replace(",", ", "),
        lambda text: text.rstrip("\n"),
        lambda text: text.replace("t,v_cmd", '"t","v_cmd"'),
        lambda text: "# " + text,
        lambda text: "# by numpy.savetxt, at night\n#" + text,
        lambda text: text.replace("t,v_cmd,", "t [s],v_cmd (m/s),").replace(",v,", ",v[m/s],"),
        lambda text: "# " + text.replace("t,", "t [s],", 1).replace("1.0", "", 1) + "# end\n",
    ],
    ids=["bom", "crlf", "comment", "blank lines", "spaces", "no last newline", "quotes"]
    + ["header in a comment", "two comments", "units", "comment and units, cell by cell"],
)
def test_habits_of_other_programs(tmp_path, change):
    path = write_csv(tmp_path / "run.csv", drive())
    path.write_bytes(change(path.read_text()).encode())
    config = Config(prepare=Prepare(missing="hold"))
    log = read_log(path, config)
    np.testing.assert_array_equal(log["v"], drive()["v"][-log.n :])


def test_a_unit_behind_a_name_is_that_in_which_the_channel_is_read(tmp_path):
    path = write_csv(tmp_path / "run.csv", drive())
    path.write_text(path.read_text().replace(",v,", ",v [km/h],", 1))
    with pytest.raises(InputError, match=r"column 'v \[km/h\]': says 'km/h', and v is read in m/s"):
        read_log(path)
    for config in (
        Config(units={"v": "km/h"}),
        Config(columns={"v": "v [km/h]"}, units={"v": "kmh"}),
    ):
        np.testing.assert_allclose(read_log(path, config)["v"], drive()["v"] / 3.6)
    path.write_text(path.read_text().replace("v [km/h]", "v [knots]", 1))
    with pytest.raises(InputError, match=r"set \[columns\] v = \"v \[knots\]\""):
        read_log(path)


def test_npz_is_read_like_csv(tmp_path):
    np.savez(tmp_path / "run.npz", **drive())
    np.savez_compressed(tmp_path / "small.npz", **drive())
    for name in ("run", "small"):
        log = read_log(tmp_path / f"{name}.npz")
        np.testing.assert_array_equal(log["v"], drive()["v"])


class Frame:
    """What a data frame of pandas or of another library offers: columns by their names."""

    def __init__(self, columns):
        self.columns, self._values = list(columns), columns

    def __getitem__(self, name):
        return self._values[name]


@pytest.mark.parametrize("kind", [dict, Frame])
def test_arrays_go_through_the_same_repairs_as_the_file_that_holds_them(tmp_path, kind):
    columns = dict(drive())
    columns["t"] = columns["t"] + 1e-4 * np.sin(np.arange(columns["t"].size))
    columns["v"] = np.where(np.arange(columns["t"].size) % 50 == 7, np.nan, 3.6 * columns["v"])
    np.savez(tmp_path / "run.npz", **columns)
    config = Config(units={"v": "km/h"}, prepare=Prepare(missing="interpolate"))
    log, stored = read_log(kind(columns), config), read_log(tmp_path / "run.npz", config)
    assert log.repairs == stored.repairs and log.repairs and log.dt == stored.dt
    np.testing.assert_array_equal(log["v"], stored["v"])
    assert (log.name, log.file, log.source) == ("arrays", "", "arrays")


def test_logs_in_memory_are_numbered_and_stand_beside_files(tmp_path):
    logs = read_logs([drive(), write_csv(tmp_path / "run.csv", drive()), drive(400)])
    assert [log.name for log in logs] == ["arrays-1", "run", "arrays-2"]
    alone = read_log(drive(), name="Tuesday")
    assert alone.name == alone.segments[0].run == "Tuesday"


def test_arrays_are_refused_with_their_name_and_the_mend(tmp_path):
    dates = np.arange(200).astype("datetime64[ms]")
    for columns, told in (
        (drive() | {"v": ["fast"] * 200}, "arrays: array 'v': cannot be read as numbers"),
        (drive() | {"v": np.ones(3)}, "arrays: array .*samples"),
        (drive() | {"t": dates}, "arrays: array 't': cannot be read as numbers .they are dates"),
        ({"time": drive()["t"], "v": drive()["v"]}, "arrays: column 't': is missing"),
    ):
        with pytest.raises(InputError, match=told):
            read_log(columns)
    with pytest.raises(InputError, match="arrays: a int is no log; give a file, a mapping"):
        ArrayTable(3, "arrays")


UNITS_IN = {
    "t": ("ms", 1e3),
    "v_cmd": ("km/h", 3.6),
    "v": ("cm/s", 100.0),
    "delta_cmd": ("deg", 180 / np.pi),
    "delta": ("mrad", 1e3),
    "r": ("deg/s", 180 / np.pi),
    "a": ("g", 1 / 9.80665),
    "x": ("km", 1e-3),
    "psi": ("deg", 180 / np.pi),
    "wheel": ("rpm", 30 / np.pi),
}


def test_units_signs_and_names(tmp_path):
    si = drive() | {"r": np.linspace(-1, 1, 200), "a": np.linspace(0, 3, 200)}
    si |= {
        "x": np.linspace(0, 9, 200),
        "psi": np.linspace(0, 1, 200),
        "wheel": np.linspace(0, 50, 200),
    }
    text = "[columns]\n" + "".join(f'{c} = "raw {c}"\n' for c in UNITS_IN)
    text += "[units]\n" + "".join(f'{c} = "{u}"\n' for c, (u, _) in UNITS_IN.items())
    text += "[sign]\nr = -1\n"
    raw = {
        f"raw {c}": factor * si[c] * (-1 if c == "r" else 1) for c, (_, factor) in UNITS_IN.items()
    }
    log = read_log(write_csv(tmp_path / "run.csv", raw), configured(tmp_path, text))
    assert log.dt == pytest.approx(0.01, rel=1e-12)
    for channel in set(UNITS_IN) - {"t"}:
        np.testing.assert_allclose(log[channel], si[channel], rtol=1e-12, atol=1e-15)
    assert log.units["wheel"] == "rad/s" and log.units["a"] == "m/s^2"


@pytest.mark.parametrize("point", ["cog", "rear_axle"])
def test_a_commanded_curvature_becomes_a_steering_angle(tmp_path, point):
    vehicle = VehicleGeometry(0.08, 0.07, point)
    curvature = np.linspace(-3.0, 3.0, 200)
    path = write_csv(tmp_path / "run.csv", drive() | {"delta_cmd": curvature})
    config = Config(vehicle=vehicle, units={"delta_cmd": "1/m"})
    log = read_log(path, config)
    np.testing.assert_allclose(log["delta_cmd"], steering_from_curvature(curvature, vehicle))
    assert log.units["delta_cmd"] == "rad"
    if point == "rear_axle":
        np.testing.assert_allclose(log["delta_cmd"], np.arctan(0.15 * curvature))
    with pytest.raises(InputError, match="wheelbase"):
        read_log(path, Config(units={"delta_cmd": "1/m"}))


def test_curvatures_that_cannot_be_driven_are_cut_and_told(tmp_path):
    columns = drive()
    curvature = columns["delta_cmd"] * 10
    curvature[50:57] = [20.0, -20.0, 50.0, 50.0, 50.0, 50.0, 50.0]
    path = write_csv(tmp_path / "run.csv", columns | {"delta_cmd": curvature})
    config = Config(vehicle=VehicleGeometry(0.08, 0.07), units={"delta_cmd": "1/m"})
    log = read_log(path, config)
    (told,) = log.repairs
    assert told.startswith("cut delta_cmd in 7 rows to the sharpest curvature")
    sharpest = np.arctan(0.15 * 0.95 / 0.07 / np.sqrt(1.0 - 0.95**2))
    assert log["delta_cmd"][50] == log["delta_cmd"].max() == pytest.approx(sharpest)
    assert log["delta_cmd"][51] == pytest.approx(-sharpest)
    rear = Config(vehicle=VehicleGeometry(0.08, 0.07, "rear_axle"), units={"delta_cmd": "1/m"})
    assert read_log(path, rear).repairs == ()


def test_headings_are_unwrapped(tmp_path):
    true = np.linspace(0.0, 20.0, 200)
    wrapped = (true + np.pi) % (2 * np.pi) - np.pi
    log = read_log(write_csv(tmp_path / "run.csv", drive() | {"psi": wrapped}))
    np.testing.assert_allclose(log["psi"], true, atol=1e-12)
    assert log.repairs == ("unwrapped psi at 3 jumps",)
    smooth = read_log(write_csv(tmp_path / "run.csv", drive() | {"psi": true}))
    np.testing.assert_array_equal(smooth["psi"], true)
    assert smooth.repairs == ()


def test_any_plant_is_a_log(tmp_path):
    path = write_csv(
        tmp_path / "motor.csv", {"s": drive()["t"], "u": drive()["v_cmd"], "w": drive()["v"]}
    )
    text = """
        [columns]
        t = "s"
        volts_cmd = "u"
        shaft = "w"
        [units]
        volts_cmd = "mV"
        shaft = "rpm"
        [[plants]]
        name = "motor"
        input = "volts_cmd"
        output = "shaft"
        """
    log = read_log(path, configured(tmp_path, text))
    np.testing.assert_allclose(log["volts_cmd"], 1e-3 * drive()["v_cmd"])
    assert log.plants == (PlantSpec("motor", "volts_cmd", "shaft"),)


def test_a_description_beside_the_log_is_found(tmp_path):
    path = write_csv(tmp_path / "run.csv", drive())
    (tmp_path / "vehicle.toml").write_text("[vehicle]\nl_f = 1.0\nl_r = 2.0\n")
    assert read_log(path).vehicle == VehicleGeometry(1.0, 2.0)
    (tmp_path / "run.toml").write_text("[vehicle]\nl_f = 3.0\nl_r = 2.0\n")
    assert read_log(path).vehicle == VehicleGeometry(3.0, 2.0)
    assert read_log(path, Config()).vehicle is None


def test_logs_with_one_name_get_their_folders(tmp_path):
    paths = []
    for folder in ("monday", "tuesday"):
        (tmp_path / folder).mkdir()
        paths.append(write_csv(tmp_path / folder / "run.csv", drive()))
    records = read_logs([*paths, write_csv(tmp_path / "other.csv", drive())])
    assert [record.name for record in records] == ["monday/run", "tuesday/run", "other"]
    assert Record.concatenate(records).runs == ("monday/run", "tuesday/run", "other")
    twice = read_logs([paths[0], paths[0], paths[1]])
    assert [record.name for record in twice] == ["monday/run-1", "monday/run-2", "tuesday/run"]


def test_logs_of_one_vehicle_get_one_sample_period(tmp_path):
    """Two even logs at 100 and 50 Hz, and one whose stamps jitter around 55 Hz."""
    uneven, shift = drive(400, 0.018), np.random.default_rng(0).uniform(0.0, 0.009, 400)
    columns = {"fast": drive(400, 0.01), "slow": drive(200, 0.02)}
    columns["uneven"] = uneven | {"t": uneven["t"] + shift}
    paths = {name: write_csv(tmp_path / f"{name}.csv", own) for name, own in columns.items()}
    fast, slow, jittering = read_logs(list(paths.values()))
    assert fast.dt == slow.dt == jittering.dt == 0.02
    assert slow.repairs == () and "thinned out from 0.01 to 0.02 s" in fast.repairs[0]
    np.testing.assert_array_equal(fast["v_cmd"], columns["fast"]["v_cmd"][::2])
    assert "resampled 400 unevenly spaced rows" in jittering.repairs[0]
    assert Record.concatenate([fast, slow, jittering]).runs == ("fast", "slow", "uneven")
    again = read_logs(list(paths.values())[:2], configured(tmp_path, "[prepare]\ndt = 0.04"))
    assert [record.dt for record in again] == [0.04, 0.04]
    each = read_logs(list(paths.values())[:2], in_step=False)
    assert [record.dt for record in each] == [0.01, 0.02] and each[0].repairs == ()


def test_runs_are_told_apart_by_their_column(tmp_path):
    one = drive(100)
    columns = {name: np.tile(values, 3) for name, values in one.items()}
    columns["trial"] = ["a"] * 100 + ["b"] * 100 + ["c"] * 100
    path = write_csv(tmp_path / "run.csv", columns)
    log = read_log(path, configured(tmp_path, '[columns]\nrun = "trial"'))
    assert log.runs == ("a", "b", "c") and [len(s) for s in log.segments] == [100] * 3
    assert np.all(np.diff(log.t) > 0.0)
    assert "laid 2 runs whose clock starts anew" in log.repairs[0]
    for piece in log.pieces("v"):
        np.testing.assert_array_equal(piece, one["v"])


@pytest.mark.parametrize(
    ("header", "text"),
    [
        (("command", "response"), ""),
        (("u", "y"), ""),
        (("set", "got"), '[columns]\ncommand = "set"\nresponse = "got"\n'),
        (("set", "y"), '[columns]\ninput = "set"\noutput = "y"\n'),
    ],
)
def test_a_single_plant_needs_no_table(tmp_path, header, text):
    columns = dict(zip(("t", *header), [drive()[c] for c in ("t", "v_cmd", "v")], strict=True))
    log = read_log(write_csv(tmp_path / "run.csv", columns), configured(tmp_path, text))
    (plant,) = log.plants
    assert plant.name == plant.role == "plant"
    np.testing.assert_array_equal(log[plant.input], drive()["v_cmd"])
    np.testing.assert_array_equal(log[plant.output], drive()["v"])


def test_a_vehicle_is_no_single_plant(tmp_path):
    drive_of_more = drive() | {"u": drive()["v"], "y": drive()["v"]}
    log = read_log(write_csv(tmp_path / "run.csv", drive_of_more))
    assert {plant.name for plant in log.plants} == {"powertrain", "steering"}
    posed = {c: drive()["v"] for c in ("u", "x", "y", "psi")} | {"t": drive()["t"]}
    assert not read_log(write_csv(tmp_path / "posed.csv", posed)).plants


def test_logs_of_one_name_are_told_apart_in_files_too(tmp_path, monkeypatch):
    paths = [tmp_path / name for name in ("a/r.csv", "b/r.csv", "a.r.csv", "a/b/r.csv", "r.csv")]
    for path in paths:
        path.parent.mkdir(exist_ok=True)
        write_csv(path, drive())
    monkeypatch.chdir(tmp_path)
    logs = read_logs([*paths[:4], "r.csv", "a/../r.csv"])
    own = tmp_path.name
    names = ["a/r-1", "b/r-1", "a.r-2", "b/r-2", f"{own}/r-1", f"{own}/r-2"]
    assert [log.name for log in logs] == names


def test_the_slow_way_reads_the_same_as_the_fast_one(tmp_path):
    """A column of text makes the reader go cell by cell."""
    fast = read_log(write_csv(tmp_path / "fast.csv", drive()))
    path = write_csv(tmp_path / "slow.csv", drive() | {"mode": ["on"] * 200})
    slow = read_log(path, configured(tmp_path, "[select]\nwhere = 'mode == \"on\"'"))
    for channel in fast.channels:
        np.testing.assert_array_equal(fast[channel], slow[channel])


def test_a_large_log_is_read_fast(tmp_path):
    """360 000 rows of ten columns, an hour at 100 Hz: about 1 s on the machine this was written
    on."""
    n = 360_000
    block = np.random.default_rng(0).standard_normal((1000, 9))
    lines = [",".join(f"{x:.9g}" for x in row) for row in block]
    path = tmp_path / "hour.csv"
    with path.open("w") as file:
        file.write("t,v_cmd,delta_cmd,v,delta,r,x,y,psi,a\n")
        file.writelines(f"{0.01 * k:.2f},{lines[k % 1000]}\n" for k in range(n))
    start = time.perf_counter()
    log = read_log(path)
    assert time.perf_counter() - start < 6.0
    assert log.n == n and log.dt == 0.01
    np.testing.assert_allclose(log["v"], np.tile(block[:, 2], 360), rtol=1e-8)


def test_a_plant_names_its_columns_by_itself(tmp_path):
    rows = [f"{0.02 * k},{(k // 20) % 3},{0.1 * k % 1.0}" for k in range(200)]
    (tmp_path / "log.csv").write_text("\n".join(["t,u,y", *rows]))
    plant = '[[plants]]\nname = "motor"\ninput = "u"\noutput = "y"\n'
    (tmp_path / "c.toml").write_text('[units]\ny = "V"\n' + plant)
    record = read_log(tmp_path / "log.csv", tmp_path / "c.toml")
    assert set(record.channels) == {"u", "y"}
    assert record.units == {"u": "1", "y": "V"}, "without a vehicle y is no place"
    (tmp_path / "c.toml").write_text(plant.replace('"u"', '"w"'))
    with pytest.raises(InputError, match=r"no channel 'w'.*\[columns\] w"):
        read_log(tmp_path / "log.csv", tmp_path / "c.toml")


@pytest.mark.parametrize(
    ("call", "told"),
    [
        (lambda: read_logs("car_1.csv"), "car_1.csv: is a single log; give a list"),
        (lambda: read_log(None), "NoneType is no log; give a file, a mapping"),
        (lambda: read_logs([3.0]), "float is no log; give a file, a mapping"),
        (lambda: read_logs({"t": [0.0]}), "arrays: is a single log; give a list"),
        (lambda: read_logs(iter([])), "no log is given"),
        (lambda: read_log("car_1.csv", {"vehicle": {}}), "config: dict is no configuration; give"),
    ],
)
def test_what_is_no_log_is_refused_in_one_line(unchecked, call, told):
    with pytest.raises(InputError, match=told):
        call()


def test_logs_that_ask_to_be_identified_in_other_ways_are_refused(tmp_path):
    logs = [write_csv(tmp_path / f"run_{k}.csv", drive()) for k in (1, 2)]
    (tmp_path / "run_1.toml").write_text("[identify]\npoles = [1]\n")
    with pytest.raises(InputError, match=r"\[identify\]: asks for other things.*run_1.toml"):
        options_of(logs)
    (tmp_path / "run_2.toml").write_text("[identify]\npoles = [1]\n")
    options = options_of(logs)
    assert options is not None and options.poles == (1,)
    assert options_of(logs, Config()) is None
