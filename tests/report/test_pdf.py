"""The report in print: it compiles from what `vdmsi reproduce` leaves, and holds no result."""

import json
import re
from pathlib import Path

import pytest

from made_up_results import write_results
from vdmsi_jax.errors import InputError
from vdmsi_jax.report import pdf

SOURCES = sorted(pdf.sources().glob("*.typ"))


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return write_results(tmp_path_factory.mktemp("reproduced"))


def test_it_compiles_from_results_and_figures(folder):
    pytest.importorskip("typst")
    made = pdf.build_pdf(folder)
    assert made == folder.resolve() / "report.pdf"
    assert made.read_bytes().startswith(b"%PDF-")


def test_it_tells_of_a_run_without_the_studies_beyond(folder, tmp_path):
    pytest.importorskip("typst")
    document = json.loads((folder / "results.json").read_text())
    (tmp_path / "results.json").write_text(json.dumps({**document, "beyond": None}))
    (tmp_path / "figures").symlink_to(folder / "figures")
    assert pdf.build_pdf(tmp_path).stat().st_size > 10_000


def test_no_result_is_typed_by_hand():
    """Prose outside code has no number with a decimal point."""
    assert SOURCES
    for path in SOURCES:
        prose = [line for line in path.read_text().splitlines() if re.match(r"\s*[A-Z(]", line)]
        typed = [
            line for line in prose if re.search(r"(?<![\w.(])\d+\.\d+(?!pt|em|cm|\d*\.)", line)
        ]
        assert not typed, (path.name, typed)


def test_what_is_missing_is_told_with_the_mend(tmp_path, monkeypatch):
    pytest.importorskip("typst")
    with pytest.raises(InputError, match="vdmsi reproduce"):
        pdf.build_pdf(tmp_path)
    (tmp_path / "results.json").write_text("{}")
    with pytest.raises(InputError, match="anew"):
        pdf.build_pdf(tmp_path)
    monkeypatch.setattr(pdf.importlib.util, "find_spec", lambda name: None)
    with pytest.raises(InputError, match="vdmsi_jax\\[paper\\]"):
        pdf.require_typst()


def test_the_figures_of_the_sources_are_those_that_are_drawn(folder):
    drawn = {path.stem for path in (folder / "figures").iterdir()}
    text = "".join(path.read_text() for path in SOURCES)
    named = set(re.findall(r'drawing\("(\w+)"', text))
    assert named <= drawn and Path(SOURCES[0]).parent.name == "paper"
