"""Units that are not declared: a speed in km/h or an angle in degrees is refused by how the vehicle
moves, and nothing else is. That no measured log is refused is in test_datasets.py."""

from pathlib import Path

import numpy as np
import pytest

from small_logs import write_csv
from vdmsi_jax.config import Config, VehicleGeometry
from vdmsi_jax.data import read_log
from vdmsi_jax.errors import InputError

DRIVE = Path(__file__).parents[2] / "configs" / "demo" / "s_curve.csv"
CAR = VehicleGeometry(1.75, 1.20)
DEGREES = 180.0 / np.pi


@pytest.fixture(scope="module")
def drive():
    names = DRIVE.read_text().splitlines()[0].split(",")
    return dict(zip(names, np.loadtxt(DRIVE, delimiter=",", skiprows=1).T, strict=True))


def read(folder, columns, **config):
    return read_log(write_csv(folder / "run.csv", columns), Config(**{"vehicle": CAR} | config))


def refusal(folder, columns, **config) -> str:
    with pytest.raises(InputError) as caught:
        read(folder, columns, **config)
    return str(caught.value)


FACTORS = {
    "v": (3.6, "km/h"),
    "v_cmd": (3.6, "km/h"),
    "psi": (DEGREES, "deg"),
    "r": (DEGREES, "deg/s"),
    "delta": (DEGREES, "deg"),
    "delta_cmd": (DEGREES, "deg"),
}


@pytest.mark.parametrize("name", FACTORS)
def test_a_wrong_unit_is_refused_unless_it_is_declared(drive, tmp_path, name):
    factor, unit = FACTORS[name]
    wrong = drive | {name: factor * drive[name]}
    told = refusal(tmp_path, wrong)
    assert told.startswith(f"{tmp_path / 'run.csv'}: column '{name}': ") and "\n" not in told
    assert f'[units] {name} = "{unit}"' in told
    right = read(tmp_path, wrong, units={name: unit})
    np.testing.assert_allclose(right[name], read(tmp_path, drive)[name], atol=1e-9)


@pytest.mark.parametrize(("factor", "unit"), [(1000.0, "mm"), (100.0, "cm")])
def test_positions_that_are_no_metres_are_refused_unless_declared(drive, tmp_path, factor, unit):
    wrong = drive | {name: factor * drive[name] for name in ("x", "y")}
    assert f'[units] x = "{unit}" and y = "{unit}"' in refusal(tmp_path, wrong)
    right = read(tmp_path, wrong, units={"x": unit, "y": unit})
    np.testing.assert_allclose(right["x"], read(tmp_path, drive)["x"], atol=1e-9)


def test_a_unit_in_the_name_of_a_mapped_column_is_the_one_in_which_it_is_read(drive, tmp_path):
    def named(name: str) -> Path:
        columns = {(name if k == "v_cmd" else k): x for k, x in drive.items()}
        return write_csv(tmp_path / "run.csv", columns)

    columns = {"v_cmd": "Soll v [km/h]"}
    path = named(columns["v_cmd"])
    with pytest.raises(InputError, match=r"says 'km/h', and v_cmd is read in m/s"):
        read_log(path, Config(vehicle=CAR, columns=columns))
    for unit, factor in (("km/h", 1 / 3.6), ("m/s", 1.0)):  # what is declared is taken at its word
        log = read_log(path, Config(columns=columns, units={"v_cmd": unit}))
        assert log["v_cmd"].max() == pytest.approx(factor * drive["v_cmd"].max())
    assert "v_cmd" in read_log(named("v [raw]"), Config(columns={"v_cmd": "v [raw]"}))


@pytest.mark.parametrize("name", ["delta", "delta_cmd"])
def test_small_angles_in_degrees(drive, tmp_path, name):
    """One degree is an angle that a wheel may have in radians, too."""
    gentle = {k: 0.04 * drive[k] if k in ("delta", "delta_cmd", "r") else drive[k] for k in drive}
    del gentle["psi"], gentle["x"], gentle["y"]
    read(tmp_path, gentle)
    told = refusal(tmp_path, gentle | {name: DEGREES * gentle[name]})
    assert "times the angle that turns the vehicle so" in told


@pytest.mark.parametrize("wrapped", [False, True])
@pytest.mark.parametrize("without", [(), ("r",), ("r", "v", "delta"), ("x", "y")])
def test_a_heading_in_degrees(drive, tmp_path, wrapped, without):
    psi = DEGREES * drive["psi"] + 170.0
    columns = drive | {"psi": (psi + 180.0) % 360.0 - 180.0 if wrapped else psi}
    kept = {name: values for name, values in columns.items() if name not in without}
    assert '[units] psi = "deg"' in refusal(tmp_path, kept)


def test_a_unit_that_is_declared_is_taken_at_its_word(drive, tmp_path):
    log = read(tmp_path, drive | {"v": 3.6 * drive["v"]}, units={"v": "m/s"})
    assert log["v"].max() > 3.5 * drive["v"].max()


def test_a_speed_that_is_stuck_below_its_command_is_no_unit(drive, tmp_path):
    """A gain of 3.6 alone says nothing: one of the race car's measured logs has it."""
    stuck = np.full_like(drive["v"], 3.6 * drive["v"].mean())
    read(tmp_path, drive | {"v_cmd": stuck + 0.5 * np.sin(drive["t"])})


def test_nothing_is_said_without_a_vehicle_or_a_turn(drive, tmp_path):
    wrong = drive | {"v": 3.6 * drive["v"]}
    read(tmp_path, wrong, vehicle=None)
    straight = {k: 0.0 * drive[k] if k in ("y", "psi", "r") else drive[k] for k in drive}
    read(tmp_path, straight | {"delta": 0.01 * drive["delta"], "delta_cmd": 0.0 * drive["t"]})
