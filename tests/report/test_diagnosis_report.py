"""The report of a diagnosis says all that the diagnosis says, in one file; so does the terminal."""

import dataclasses
import re
from html import unescape
from html.parser import HTMLParser

import pytest
from rich.console import Console

import made_up_diagnosis
from vdmsi_jax import terminal
from vdmsi_jax.diagnose.answer.words import title
from vdmsi_jax.report.diagnosis import diagnosis_page
from vdmsi_jax.report.page import render
from vdmsi_jax.report.text import percent

ALWAYS = ("In short", "What remains", "What these logs could have shown", "What to drive next",
          "What was read")  # fmt: skip


class Reader(HTMLParser):
    """Collects headings, ids and references to something outside."""

    def __init__(self):
        super().__init__()
        self.ids, self.outside, self.headings, self.figures = [], [], [], 0
        self.here = ""

    def handle_starttag(self, tag, attrs):
        self.here = tag
        self.figures += tag == "figure"
        for name, value in attrs:
            if name == "id":
                self.ids.append(value)
            if name in ("src", "href", "xlink:href") and not value.startswith("#"):
                self.outside.append(value)

    def handle_data(self, data):
        if self.here == "h2":
            self.headings.append(data)
        self.here = ""


@pytest.fixture(scope="module", params=made_up_diagnosis.ALL)
def told(request):
    diagnosis = made_up_diagnosis.ALL[request.param]()
    return diagnosis, render(diagnosis_page(diagnosis))


def said(diagnosis, **changes) -> str:
    """The words of the page of a changed diagnosis, without its signals (slow to draw)."""
    light = dataclasses.replace(diagnosis, responses=(), paths=(), **changes)
    return words(render(diagnosis_page(light)))


def words(html: str) -> str:
    """What a reader reads, without the pictures."""
    bare = re.sub(r"<(svg|style|script).*?</\1>", " ", html, flags=re.S)
    return re.sub(r"\s+", " ", unescape(re.sub(r"<[^>]+>", " ", bare)))


def test_the_page_is_one_file_with_every_section(told):
    diagnosis, html = told
    reader = Reader()
    reader.feed(html)
    assert reader.outside == [] and "<script" not in html
    assert len(set(reader.ids)) == len(reader.ids), "two elements have one id"
    assert all(name in reader.headings for name in ALWAYS)
    assert ("What the extension changes" in reader.headings) == bool(diagnosis.findings)
    assert ("Who is responsible" in reader.headings) == bool(diagnosis.budget)
    one_each = [h for h in reader.headings if re.match(r"\d+\. ", h)]
    assert len(one_each) == len(diagnosis.findings)
    pictures = 3 * len(diagnosis.responses) + bool(diagnosis.findings) + bool(diagnosis.budget)
    on_paths = bool(diagnosis.paths) * len(diagnosis.responses)
    assert reader.figures == pictures + on_paths + bool(diagnosis.paths)


def test_every_finding_is_told_with_its_numbers(told):
    diagnosis, html = told
    text = words(html)
    assert diagnosis.summary in text
    for finding in (*diagnosis.findings, *diagnosis.minor):
        assert finding.sentence in text
        assert title(finding) in text
    for finding in diagnosis.findings:
        assert percent(finding.gain.before) in text and percent(finding.gain.after) in text
        for estimate in finding.parameters.values():
            if abs(estimate.value) < float("inf"):
                assert f"{estimate.value:.4g} {estimate.unit}" in text
        for rival in finding.rivals:
            assert rival.cause.replace("_", " ") in text.lower()


def test_what_cannot_be_told_apart_is_said_with_what_would_tell():
    text = said(made_up_diagnosis.explained())
    assert "These logs cannot tell backlash from Coulomb friction." in text
    assert "To tell them apart, drive: a steering chirp of 0.5 to 6 Hz for 20 s." in text
    assert text.count("ruled out") >= 3
    assert "A steering chirp of 0.5 to 6 Hz for 20 s: to tell backlash from Coulomb" in text
    assert "An amplitude sweep of the steering up to its stop: shows saturation" in text


def test_an_ambiguity_without_a_manoeuvre_says_that_there_is_none():
    diagnosis = made_up_diagnosis.explained()
    first = dataclasses.replace(diagnosis.findings[0], separating_experiment=None)
    text = said(diagnosis, findings=(first,))
    assert "No manoeuvre of the catalogue is predicted to tell them apart." in text


def test_what_remains_is_said_where_when_and_on_what():
    text = said(made_up_diagnosis.unexplained())
    assert "in a way that no known cause accounts for" in text
    assert "61.0 %" in text and "run_3.csv: 14 to 15.2 s" in text
    assert "No significant structure is left" not in text
    clean = said(made_up_diagnosis.no_effect())
    assert "No significant structure is left" in clean and "No cause had to be added" in clean


@pytest.mark.parametrize(
    ("by", "words"),
    [
        ("repeat", "The noise of {} is what runs with the same commands differ by."),
        ("brief", "that of {} was taken to be brief"),
    ],
)
def test_what_tells_the_noise_is_said_where_it_is_not_the_residual(by, words):
    diagnosis = made_up_diagnosis.explained()
    (first, score), *rest = diagnosis.channels.items()
    assert words.format(first) not in said(diagnosis)
    again = {first: dataclasses.replace(score, noise_by=by), **dict(rest)}
    assert words.format(first) in said(diagnosis, channels=again)


def test_a_gain_on_seen_data_is_not_sold_as_held_out():
    text = said(made_up_diagnosis.siso())
    assert "On the data of the fit (none was held out) the FIT of speed goes from" in text
    assert "On held-out data" not in text
    assert "no limit on this side" in text and "inf" not in text.split()


def test_a_vanishing_probability_is_no_zero(told):
    diagnosis, html = told
    for finding in diagnosis.findings:
        if finding.p_value == 0.0:
            assert "below 10⁻³⁰⁰" in html
    assert "noise alone does that is 0." not in html


def test_causes_that_leave_something_do_not_claim_everything():
    diagnosis = made_up_diagnosis.explained()
    left = made_up_diagnosis.unexplained().unexplained
    assert "account for most of it" in said(diagnosis, unexplained=left)
    text = said(diagnosis, unexplained=left, verdict="unexplained_structure")
    assert "Diagnosis: backlash" in text and "structure without a known cause" in text


def test_the_terminal_says_it_too(told, monkeypatch):
    diagnosis, _ = told
    console = Console(width=120, highlight=False, record=True, quiet=False)
    monkeypatch.setattr(terminal, "OUT", console)
    terminal.show_diagnosis(diagnosis)
    shown = console.export_text()
    for finding in diagnosis.findings:
        assert finding.sentence in shown
        assert f"{finding.gain.before:.1f}" in shown and f"{finding.gain.after:.1f}" in shown
    for finding in diagnosis.minor:
        assert title(finding) in shown
    for left in diagnosis.unexplained:
        assert f"Unexplained in {left.channel}" in shown
    for sentence in diagnosis.unseen:
        assert sentence in shown
    assert "nan" not in shown


def test_the_terminal_takes_brackets_for_brackets(monkeypatch):
    diagnosis = made_up_diagnosis.siso()
    odd = dataclasses.replace(diagnosis.findings[0], sentence="Motor: [bold] of 5 V [/x].")
    console = Console(width=120, record=True)
    monkeypatch.setattr(terminal, "OUT", console)
    terminal.show_diagnosis(dataclasses.replace(diagnosis, findings=(odd,)))
    assert "Motor: [bold] of 5 V [/x]." in console.export_text()


def test_a_narrow_terminal_takes_no_digits_from_a_table(monkeypatch):
    """A number that lacks its end is another number."""
    console = Console(width=40, record=True)
    monkeypatch.setattr(terminal, "OUT", console)
    row = ["powertrain of the car", "P2Z1 (least BIC)", "2.47e-05", "97.09", "12.3"]
    terminal.show_table(["plant", "order", "MSE", "FIT %", "delay"], [row, row])
    lines = console.export_text().splitlines()
    assert len(lines) == 3 and all(cell in lines[1] for cell in row)
