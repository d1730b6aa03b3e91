"""A report is one file that needs nothing else and says what the results say."""

import re
from dataclasses import replace
from html.parser import HTMLParser

import numpy as np
import pytest

import made_up
from vdmsi_jax.report.identification import identification_page
from vdmsi_jax.report.page import Page, Section, Table, Text, render
from vdmsi_jax.report.simulation import simulation_page
from vdmsi_jax.report.text import number, percent, polynomial, roots, typeset
from vdmsi_jax.terminal import show_grids

VOID = {"meta", "path", "use", "rect", "br"}


class Balanced(HTMLParser):
    """Collects open tags and every reference to something outside."""

    def __init__(self):
        super().__init__()
        self.open, self.outside, self.ids, self.tags = [], [], [], set()

    def handle_starttag(self, tag, attrs):
        self.tags.add(tag)
        if tag not in VOID:
            self.open.append(tag)
        for name, value in attrs:
            if name == "id":
                self.ids.append(value)
            if name in ("src", "href", "xlink:href", "action") and not value.startswith("#"):
                self.outside.append(value)

    def handle_startendtag(self, tag, attrs):
        self.handle_starttag(tag, attrs)
        if tag not in VOID:
            self.open.pop()

    def handle_endtag(self, tag):
        if tag not in VOID:
            assert self.open.pop() == tag, tag


@pytest.fixture(scope="module", params=["identification", "simulation"])
def html(request):
    if request.param == "simulation":
        return render(simulation_page([made_up.comparison()]))
    grid = made_up.order_grid()
    return render(identification_page({"steering": grid}, [grid.record]))


def test_a_report_is_one_file_that_asks_for_nothing(html):
    parser = Balanced()
    parser.feed(html)
    assert parser.open == []
    assert parser.outside == []
    assert "script" not in parser.tags and "link" not in parser.tags
    assert "@import" not in html and not re.search(r"url\((?!#)", html)
    assert len(set(parser.ids)) == len(parser.ids), "two elements have one id"


def test_the_identification_says_what_was_found():
    grid = made_up.order_grid()
    html = render(identification_page({"steering": grid}, [grid.record]))
    for fit in grid.fits.values():
        assert f"<td>{fit.order}</td>" in html
    assert "improper: 3 zeros exceed 1 poles" in html
    assert "P3Z2 has the least BIC" in html
    low, high = grid.best.interval("a0")
    assert f"{number(low)} … {number(high)}" in html
    assert "Nothing had to be repaired" in html
    assert html.count("<svg") == 4


def test_the_identification_says_which_better_orders_the_data_do_not_support(capsys):
    grid = made_up.order_grid()
    told = "pole 0.01 rad/s cannot be told from an integrator"
    best = grid["P2Z1"].fit
    fits = {
        **{order: replace(fit, fit=best - 0.1) for order, fit in grid.fits.items() if fit.ok},
        "P2Z1": grid["P2Z1"],
        "P2Z2": replace(grid["P2Z2"], fit=best + 0.2, supported=False, warnings=(told,)),
        "P3Z1": replace(grid["P3Z1"], fit=best + 1.0, supported=False, warnings=(told,)),
        "P4Z1": replace(grid["P4Z1"], fit=best + 2.0, supported=False),
    }
    grid = replace(grid, fits=fits)
    assert [fit.order for fit in grid.left_out] == ["P4Z1", "P3Z1"]
    html = render(identification_page({"steering": grid}, [grid.record]))
    assert "Of the orders that the data support, P2Z1 is the smallest within 0.5 points" in html
    assert f"P3Z1 (FIT {percent(best + 1.0)}): {told}" in html
    assert f"P2Z2 (FIT {percent(best + 0.2)})" not in html
    assert {row["order"] for row in grid.table() if not row["supported"]} == {
        "P2Z2",
        "P3Z1",
        "P4Z1",
    }
    show_grids({"steering": grid})
    assert f"do not support them: P4Z1 ({best + 2.0:.2f} %), P3Z1" in capsys.readouterr().out
    alone = replace(grid, fits={o: f for o, f in fits.items() if f.supported})
    assert alone.left_out == []
    assert "left out" not in render(identification_page({"steering": alone}, [grid.record]))


def test_where_nothing_was_held_out_the_terminal_shows_a_dash(capsys):
    grid = made_up.order_grid()
    fits = {order: replace(fit, held_out_fit=float("nan")) for order, fit in grid.fits.items()}
    show_grids({"steering": replace(grid, fits=fits)})
    assert "nan" not in capsys.readouterr().out


def test_the_simulation_says_how_much_is_gained():
    comparison = made_up.comparison()
    html = render(simulation_page([comparison]))
    assert "−81.2 %" in html  # 1.5 m against 8 m
    assert "41.00 %" in html and "96.70 %" in html
    assert html.count("<svg") == 3
    assert "warning" not in re.sub(r"<style>.*?</style>", "", html, flags=re.S)


def test_what_a_log_says_cannot_break_the_page():
    bad = '<script>alert("x")</script>'
    html = render(Page(bad, bad, [Section(bad, [Text(bad), Table([bad], [[bad]])])]))
    assert "<script" not in html


@pytest.mark.parametrize(
    ("value", "text"),
    [
        (0.0123456, "0.01235"),
        (-2.0, "−2"),
        (1.2e-7, "1.2·10⁻⁷"),
        (float("nan"), "–"),
        (float("inf"), "–"),
    ],
)
def test_numbers_as_people_read_them(value, text):
    assert number(value) == text


def test_sentences_as_people_read_them():
    said = "0.0028 rad per m/s^2, gradient 0.00101 ± 2.7e-05 s^2/m^2, from run_e-1.csv"
    read = "0.0028 rad per m/s², gradient 0.00101 ± 2.7·10⁻⁵ s²/m², from run_e-1.csv"
    assert typeset(said) == read


def test_formulas_as_people_read_them():
    assert (
        polynomial(np.array([1.0, -2.5, 3.0])) == "<i>s</i><sup>2</sup> − 2.5&thinsp;<i>s</i> + 3"
    )
    assert roots(np.array([-1.0 + 2.0j, -1.0 - 2.0j, -0.5 + 0j])) == "−0.5, −1 ± 2j"
    assert roots(np.zeros(0, complex)) == "none"
