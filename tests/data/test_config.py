"""Configurations: every example loads, and what is wrong is refused with the key and the nearest
right word."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest

from vdmsi_jax.config import Config, IdentifyOptions, Prepare, VehicleGeometry, load_config
from vdmsi_jax.decode import decode
from vdmsi_jax.errors import InputError
from vdmsi_jax.units import UNITS, unit

CONFIGS = Path(__file__).resolve().parents[2] / "configs"
EXAMPLES = [
    path for path in sorted(CONFIGS.rglob("*.toml")) if path.parent.name in ("data", "vehicle")
]


def refusal(tmp_path, text) -> str:
    path = tmp_path / "vehicle.toml"
    path.write_text(text)
    with pytest.raises(InputError) as caught:
        load_config(path)
    told = str(caught.value)
    assert "\n" not in told and told.startswith(f"{path}: ")
    return told


@pytest.mark.parametrize("path", EXAMPLES, ids=lambda path: path.stem)
def test_every_shipped_configuration_loads(path):
    config = load_config(path)
    assert config.path == path and config.source == str(path)


def test_the_example_of_every_table_names_every_key():
    """A key that is added must be shown to users too."""
    import dataclasses

    text = (CONFIGS / "vehicle" / "every_table.toml").read_text()
    config = load_config(CONFIGS / "vehicle" / "every_table.toml")
    for table in (config, config.vehicle, config.prepare, config.identify, config.select):
        for field in dataclasses.fields(table):
            if field.metadata.get("toml", True):
                assert field.name in text, field.name


def test_no_file_means_the_defaults():
    config = load_config(None)
    assert config == Config() and config.vehicle is None and config.source == "configuration"


@pytest.mark.parametrize(
    ("text", "parts"),
    [
        ("[vehicel]\nl_f = 1.0", ["[vehicel]", "did you mean 'vehicle'", "columns"]),
        ("[vehicle]\nl_f = 1.0\nl_rr = 1.0", ["[vehicle] l_rr", "did you mean 'l_r'"]),
        ("[vehicle]\nl_f = 1.0", ["[vehicle] l_r", "missing"]),
        ("[vehicle]\nl_f = '1.0'\nl_r = 1.0", ["[vehicle] l_f", "'1.0'", "a number"]),
        ("[vehicle]\nl_f = true\nl_r = 1.0", ["[vehicle] l_f", "True", "a number"]),
        ("[vehicle]\nl_f = -1.0\nl_r = 1.0", ["[vehicle] l_f", "-1.0"]),
        ("[vehicle]\nl_f = nan\nl_r = 1.0", ["[vehicle] l_f", "nan"]),
        ("[vehicle]\nl_f = 0\nl_r = 0", ["[vehicle]", "wheelbase"]),
        ("[vehicle]\nl_f = 150\nl_r = 150", ["[vehicle]", "300 m is no wheelbase"]),
        (
            "[vehicle]\nl_f = 1\nl_r = 1\nreference_point = 'rear axle'",
            ["reference_point", "did you mean 'rear_axle'", "cog"],
        ),
        ("[vehicle]\nl_f = 1\nl_r = 1\nreference_point = 'sensor'", ["lever_arm"]),
        (
            "[vehicle]\nl_f = 1\nl_r = 1\nreference_point = 'rear_axle'\nlever_arm = 0.3",
            ["lever_arm", "rear_axle"],
        ),
        (
            "[vehicle]\nl_f = 1\nl_r = 1\nreference_point = 'sensor'\nlever_arm = inf",
            ["lever_arm", "metres"],
        ),
        (f"[vehicle]\nl_f = {10**400}\nl_r = 1", ["[vehicle] l_f", "absurd size"]),
        (f"[vehicle]\nl_f = {'[' * 5000}", ["too deep"]),
        ("vehicle = 3", ["[vehicle]", "a table"]),
        ("[units]\nv = 'deg'", ["[units] v", "angle", "speed", "km/h"]),
        ("[units]\nv = 'kmph'", ["[units] v", "unknown unit 'kmph'", "km/h"]),
        ("[units]\nspeed = 'm/s'", ["[units] speed", "no such channel"]),
        ("[sign]\nr = 2", ["[sign] r", "1 or -1"]),
        ("[columns]\nv = 3", ["[columns] v", "a text"]),
        ("[prepare]\nduplicates = 'dropp'", ["[prepare] duplicates", "did you mean 'drop'"]),
        ("[prepare]\ndt = 0", ["[prepare] dt", "seconds"]),
        ("[prepare]\nhold = 'v'", ["[prepare] hold", "a list of texts"]),
        ("[prepare]\nmin_segment = 1.5", ["[prepare] min_segment", "a whole number"]),
        ("[derive]\ndelta = 'steering_from_yawrate'", ["did you mean 'steering_from_yaw_rate'"]),
        ("[derive]\np = { expression = 'v * v' }", ["[derive] p unit", "missing"]),
        ("[derive]\np = { unit = 'm' }", ["[derive] p", "rule or an expression"]),
        ("[[plants]]\nname = 'a'\ninputs = 'u'", ["[plants] 1 inputs", "did you mean 'input'"]),
        ("[plants.a]\ninput = 'u'", ["[plants]", "begin each of them by [[plants]]"]),
        (
            "[[plants]]\nname='a'\ninput='u'\noutput='y'\n[[plants]]\nname='a'\ninput='u'\noutput='y'",
            ["two plants"],
        ),
        ("[identify]\npoles = [1, 6]", ["[identify] poles", "[1, 2, 3, 4, 5]"]),
        ("[identify]\npoles = [1, '2']", ["[identify] poles 2", "a whole number"]),
        ("[identify]\nheld_out = 1", ["[identify] held_out"]),
        ("[identify]\ndelay = -1.0", ["[identify] delay"]),
        ("[derive]\nt = 'speed_from_pose'", ["[derive] t", "no channel"]),
        ("[derive]\na = { rule = 'speed_from_pose', window = 0 }", ["[derive] a window"]),
        ("[derive]\na = { rule = 'speed_from_pose', window = inf }", ["[derive] a window", "inf"]),
        ("[derive]\na = { rule = 'speed_from_pose', window = nan }", ["[derive] a window", "nan"]),
        ("[sweep]", ["[sweep] runs", "missing"]),
        ("[sweep]\nruns = []", ["[sweep] runs", "there are none", "give runs = [{ log"]),
        ("[[sweep.runs]]\nlogs = 'a'", ["[sweep] runs 1 logs", "did you mean 'log'"]),
        ("a = = 3", ["line 1, column 5", "TOML"]),
    ],
)
def test_what_is_wrong_is_named(tmp_path, text, parts):
    told = refusal(tmp_path, text)
    for part in parts:
        assert part in told


def test_files_that_are_none(tmp_path):
    with pytest.raises(InputError, match="no such file"):
        load_config(tmp_path / "absent.toml")
    with pytest.raises(InputError, match=r"is a folder; give a TOML file$"):
        load_config(tmp_path)
    (tmp_path / "binary.toml").write_bytes(b"\xff\xfe\x00")
    with pytest.raises(InputError, match=r"is no UTF-8 text; give a TOML file$"):
        load_config(tmp_path / "binary.toml")


@pytest.mark.parametrize(
    ("point", "arm", "expected"),
    [
        ("cog", None, 1.2),
        ("centre_of_gravity", None, 1.2),
        ("rear_axle", None, 0.0),
        ("sensor", 0.3, 1.5),
        ("sensor", -1.2, 0.0),
        ("cog", 0.3, 1.5),
    ],
)
def test_where_the_reference_point_is(point, arm, expected):
    vehicle = VehicleGeometry(1.75, 1.2, point, arm)
    assert vehicle.rear_to_reference == pytest.approx(expected) and vehicle.wheelbase == 2.95
    assert vehicle.reference_point == (
        "sensor" if arm else point.replace("centre_of_gravity", "cog")
    )


@pytest.mark.parametrize(
    ("made", "told"),
    [
        (lambda: VehicleGeometry(1.0, 1.0, "rear-axle"), "reference_point.*mean 'rear_axle'"),
        (lambda: Prepare(missing="interpolat"), "Prepare: missing.*did you mean 'interpolate'"),
        (lambda: Prepare(duplicates=True), "Prepare: duplicates.*True.*allowed: drop, refuse"),
        (lambda: IdentifyOptions(split="foo"), "split: unknown value 'foo'.*blocks, run"),
        (lambda: Config(vehicle={"l_f": 1.0}), "Config: vehicle: .* is no geometry"),
    ],
)
def test_a_value_from_python_is_held_to_what_a_file_may_say(unchecked, made, told):
    with pytest.raises(InputError, match=told):
        made()


def test_numbers_of_numpy_are_orders_too(unchecked):
    options = IdentifyOptions(poles=np.arange(1, 3), zeros=[np.int64(0)])
    assert options == IdentifyOptions(poles=(1, 2), zeros=(0,))


def test_decoding_serves_any_dataclass():
    """A table that is added later needs a dataclass and nothing else."""

    @dataclass(frozen=True)
    class Inner:
        size: float

    @dataclass(frozen=True)
    class Outer:
        inner: Inner
        many: tuple[Inner, ...] = ()
        limit: bool | float = True

    table = {"inner": {"size": 1}, "many": [{"size": 2}], "limit": 3}
    made = decode(Outer, table, source="file", place="[outer]")
    assert made == Outer(Inner(1.0), (Inner(2.0),), 3.0) and isinstance(made.limit, float)
    with pytest.raises(InputError, match=r"file: \[outer\] many 1 sise: .*'size'"):
        decode(Outer, {"inner": {"size": 1}, "many": [{"sise": 2}]}, source="file", place="[outer]")


def test_units_convert_to_si():
    """Against factors from the SI brochure and the definitions of the other units."""
    expected = {
        "km/h": 1 / 3.6,
        "deg": 0.017453292519943295,
        "rpm": 0.10471975511965977,
        "g": 9.80665,
        "h": 3600.0,
    }
    for name, factor in expected.items():
        assert UNITS[name].to_si == pytest.approx(factor, rel=1e-15)
    for name in ("m/s²", "°", "kmh", "1/min", ""):
        assert unit(name, source="f", place="p")


def test_a_plant_s_own_y_is_no_place_beside_a_vehicle(tmp_path):
    path = tmp_path / "vehicle.toml"
    vehicle, units = "[vehicle]\nl_f = 1\nl_r = 1\n", "[units]\ny = 'V'\n"
    path.write_text(f"{vehicle}{units}[[plants]]\nname = 'valve'\ninput = 'u'\noutput = 'y'")
    assert "y" not in load_config(path).canonical
    path.write_text(f"{vehicle}{units}[[plants]]\nname = 'way'\ninput = 'v_cmd'\noutput = 'y'")
    with pytest.raises(InputError, match="length"):
        load_config(path)


@pytest.mark.parametrize("names", [("input", "output"), ("command", "response")])
def test_a_plant_alone_stands_in_a_table_of_its_own(tmp_path, names):
    file = tmp_path / "motor.toml"
    file.write_text('[plant]\n{} = "volt"\n{} = "speed"\n'.format(*names), encoding="utf-8")

    (plant,) = load_config(file).plants

    assert (plant.name, plant.channels) == ("plant", ("volt", "speed"))

    file.write_text('[plant]\ninput = "volt"\noutlet = "speed"\n', encoding="utf-8")
    with pytest.raises(InputError, match="outlet.*output"):
        load_config(file)

    file.write_text('[plant]\ncommand = "volt"\ninput = "amps"\noutput = "speed"\n')
    with pytest.raises(InputError, match="command"):  # one too many
        load_config(file)

    file.write_text("plants = 3\n", encoding="utf-8")
    with pytest.raises(InputError, match="plants"):
        load_config(file)

    file.write_text('[plant]\ninput = "a"\noutput = "b"\n[[plants]]\nname = "c"\n')
    with pytest.raises(InputError, match=r"\[plant\]: stands beside \[\[plants\]\]"):
        load_config(file)

    file.write_text('[plant]\ninput = "volt"\noutput = "volt"\n')
    with pytest.raises(InputError, match="output: is its input 'volt', too"):
        load_config(file)
