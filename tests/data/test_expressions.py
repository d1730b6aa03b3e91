"""Expressions of the configuration: they compute, and can do nothing else."""

import numpy as np
import pytest

from vdmsi_jax.data.expressions import parse
from vdmsi_jax.errors import InputError

COLUMNS = {
    "v": np.array([0.0, 1.0, -2.0]),
    "w": np.array([1.0, 0.0, 2.0]),
    "phase": np.array(["calib", "idle", "calib"]),
    "Speed (km/h)": np.array([3.6, 7.2, 0.0]),
}


def value(text):
    return parse(text, source="file", place="key")(COLUMNS)


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("v * tan(w) / 0.5", COLUMNS["v"] * np.tan(COLUMNS["w"]) / 0.5),
        ("-v ** 2 + 1", 1 - COLUMNS["v"] ** 2),
        ("v > 0", [False, True, False]),
        ("-1 < v <= 0", [True, False, False]),
        ('phase == "calib"', [True, False, True]),
        ('phase == "calib" and v < 0 or w == 0', [False, True, True]),
        ("not (v > 0)", [True, False, True]),
        ("maximum(abs(v), 1)", [1.0, 1.0, 2.0]),
        ("minimum(v, w, 0.5)", [0.0, 0.0, -2.0]),
        ("`Speed (km/h)` > 3", [True, True, False]),
        ("2 ** -1", 0.5),
    ],
)
def test_what_they_compute(text, expected):
    np.testing.assert_allclose(np.asarray(value(text), float), np.asarray(expected, float))


def test_which_columns_are_texts():
    expression = parse('phase == "a" and "b" != kind and v > 1', source="file", place="key")
    assert expression.names == ("phase", "kind", "v") and expression.texts == ("phase", "kind")


@pytest.mark.parametrize(
    "text",
    [
        "__import__('os').system('true')",
        "v.__class__",
        "().__class__.__bases__",
        "[x for x in v]",
        "lambda: 1",
        "v if w else v",
        "open('file')",
        "v[0]",
        "f'{v}'",
        "(v := 3)",
        "tan(x=1)",
        "tan(*v)",
        "v @ w",
        "v // w",
        "b'a' == v",
        "v = 3",
        "v +",
        "",
        "+".join(["v"] * 5000),
    ],
)
def test_what_they_cannot_do(text):
    with pytest.raises(InputError, match="^file: key: "):
        parse(text, source="file", place="key")


def test_they_leave_the_columns_alone():
    kept = {name: values.copy() for name, values in COLUMNS.items()}
    np.testing.assert_array_equal(value("maximum(v, 0, w)"), [1.0, 1.0, 2.0])
    assert all(np.array_equal(COLUMNS[name], values) for name, values in kept.items())


def test_large_powers_end_at_once():
    assert np.isinf(value("9 ** 9 ** 9 ** 9"))


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("vv > 0", "did you mean 'v'"),
        ("tann(v)", "did you mean 'tan'"),
        ('v + "a"', "cannot be computed"),
        ("tan()", "tan with 0 arguments; give it one$"),
        ("abs(v, w)", "abs with 2 arguments; give it one$"),
        ("hypot(v, w, v)", "hypot with 3 arguments; give it two$"),
        ("maximum(v)", "maximum with 1 argument; give it two or more"),
    ],
)
def test_mistakes_are_named(text, told):
    with pytest.raises(InputError, match=told):
        value(text)
