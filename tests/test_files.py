"""Results are written whole or not at all, as JSON that any parser takes."""

import errno
import json
import os
import stat

import numpy as np
import pytest

from vdmsi_jax.errors import InputError
from vdmsi_jax.files import output_folder, plain, read_json, write_json, write_text


def test_json_is_strict_and_keeps_numbers_exactly(tmp_path):
    value = {
        "array": np.array([1.0, np.nan, -np.inf]),
        "poles": np.array([1 + 2j]),
        "count": np.int64(3),
        "flag": np.True_,
        "third": 1.0 / 3.0,
        "none": None,
        "text": "δ",
    }
    path = write_json(tmp_path / "r.json", value)

    def refuse(word):
        raise AssertionError(f"{word} is no JSON")

    read = json.loads(path.read_text(), parse_constant=refuse)
    assert read["array"] == [1.0, None, None]
    assert read["poles"] == [[1.0, 2.0]]
    assert (read["count"], read["flag"], read["none"], read["text"]) == (3, True, None, "δ")
    assert read["third"] == 1.0 / 3.0


def test_plain_takes_jax_arrays():
    jnp = pytest.importorskip("jax.numpy")
    assert plain({"x": jnp.arange(2.0), "y": jnp.asarray(1.5)}) == {"x": [0.0, 1.0], "y": 1.5}


def test_what_cannot_be_written_leaves_the_old_file_and_no_litter(tmp_path):
    path = write_json(tmp_path / "r.json", {"old": 1})
    with pytest.raises(TypeError):
        write_json(path, {"bad": object()})
    assert read_json(path) == {"old": 1}
    assert os.listdir(tmp_path) == ["r.json"]


def test_a_crash_while_writing_leaves_the_old_file_and_no_litter(tmp_path, monkeypatch):
    path = write_text(tmp_path / "r.txt", "old")

    def crash(*_):
        raise OSError(errno.ENOSPC, "disk full")

    monkeypatch.setattr(os, "fsync", crash)
    with pytest.raises(OSError, match="disk full") as caught:
        write_text(path, "new " * 10_000)
    assert caught.value.filename == str(path)  # which the system does not say
    assert path.read_text() == "old"
    assert os.listdir(tmp_path) == ["r.txt"]


def test_a_folder_that_is_not_there_is_named(tmp_path):
    with pytest.raises(InputError, match="a.json: there is no folder .*nodir; make it"):
        write_json(tmp_path / "nodir" / "a.json", {})


def test_a_result_is_as_readable_as_any_other_file(tmp_path):
    (tmp_path / "plain").write_text("")
    path = write_text(tmp_path / "result", "")
    assert stat.S_IMODE(path.stat().st_mode) == stat.S_IMODE((tmp_path / "plain").stat().st_mode)


@pytest.mark.parametrize(
    ("text", "told"), [("{", "line 1, column 2"), ("\x00", "no JSON"), (None, "no such file")]
)
def test_reading_refuses_in_one_line(tmp_path, text, told):
    path = tmp_path / "model.json"
    if text is not None:
        path.write_text(text)
    with pytest.raises(InputError, match=told) as refused:
        read_json(path)
    assert "\n" not in str(refused.value)


def test_an_output_folder_that_is_a_file_is_refused(tmp_path):
    (tmp_path / "out").write_text("")
    with pytest.raises(InputError, match="--out"):
        output_folder(tmp_path / "out")
