"""Every figure on finished results: it draws, labels its axes with units, and leaves no trace."""

import dataclasses
import re

import matplotlib
import numpy as np
import pytest
from matplotlib.figure import Figure

import made_up
from vdmsi_jax import plots
from vdmsi_jax.errors import InputError
from vdmsi_jax.plots.style import envelope, squared_unit, unit_label
from vdmsi_jax.reproduce.beyond import recorded
from vdmsi_jax.reproduce.published import TABLE_3

FIGURES = {
    "order_grid": lambda grid, comparison: plots.order_grid(grid),
    "fitted": lambda grid, comparison: plots.fitted(grid),
    "residuals": lambda grid, comparison: plots.residuals(grid),
    "responses": lambda grid, comparison: plots.responses(grid["P3Z2"], grid.record),
    "channels": lambda grid, comparison: plots.channels(comparison),
    "paths": lambda grid, comparison: plots.paths(comparison),
    "translation_error": lambda grid, comparison: plots.translation_error(comparison),
    "order_sweep": lambda grid, comparison: plots.order_sweep(*swept(grid)),
}
TABLES = ("order_grid", "order_sweep")  # whose axes count orders, not quantities


def swept(grid):
    """Two rows of a sweep: all orders, and few of them."""
    fits = {order: fit.fit for order, fit in grid.fits.items()}
    few = {order: fits[order] - 5.0 for order in ("P1Z0", "P2Z1")}
    return {"a.csv steering": fits, "b.csv steering": few}, {"a.csv steering": grid.chosen}


@pytest.fixture(scope="module")
def results():
    return made_up.order_grid(), made_up.comparison()


OF_DIAGNOSES = {  # tested in test_diagnosis_plots.py
    "diagnosis",
    "gains",
    "budget",
    "paths_before_after",
    "overlay",
    "on_path",
    "residual_against",
    "innovations",
}
OF_THE_PAPER = {  # tested in tests/reproduce/test_document.py
    "distribution",
    "shares",
    "tracking",
    "outages",
    "steering_explained",
    "step_inputs",
    "courses",
    "open_loop",
    "navigation",
    "navigated",
    "vdm_rules",
}


def test_every_figure_is_in_the_table():
    assert set(FIGURES) | OF_DIAGNOSES | OF_THE_PAPER | {"to_svg"} == {
        name for name in vars(plots) if callable_figure(name)
    }


def callable_figure(name: str) -> bool:
    value = getattr(plots, name)
    return callable(value) and not name.startswith("_")


@pytest.mark.parametrize("name", FIGURES)
def test_a_figure_labels_its_axes_and_changes_no_setting(name, results):
    before = dict(matplotlib.rcParams)
    figure = FIGURES[name](*results)
    assert dict(matplotlib.rcParams) == before
    assert isinstance(figure, Figure) and figure.axes
    for axes in figure.axes:
        assert axes.has_data()
        shared = axes.get_shared_x_axes().get_siblings(axes)
        assert any(sibling.get_xlabel() for sibling in shared)
    labels = [a.get_xlabel() for a in figure.axes] + [a.get_ylabel() for a in figure.axes]
    if name not in TABLES:
        assert any("(" in label for label in labels), "no unit on any axis"


@pytest.mark.parametrize("name", FIGURES)
def test_an_svg_is_one_element_whose_ids_are_its_own(name, results):
    figure = FIGURES[name](*results)
    svg = plots.to_svg(figure, "mine")
    assert svg.startswith("<svg") and svg.rstrip().endswith("</svg>")
    assert 'id="' in svg and svg.count(' id="') == svg.count(' id="mine-')
    references = svg.count('href="#') + svg.count("url(#")
    assert references == svg.count('href="#mine-') + svg.count("url(#mine-")
    assert plots.to_svg(FIGURES[name](*results), "mine") == svg, "drawing is not repeatable"


def test_a_plant_may_be_called_anything(results):
    grid, _ = results
    named = dataclasses.replace(grid, plant=dataclasses.replace(grid.plant, name='a$x^{$ "<b>'))
    for draw in (plots.order_grid, plots.fitted, plots.residuals):
        svg = plots.to_svg(draw(named), named.plant.name)
        ids = set(re.findall(r'\bid="([^"]*)"', svg))
        assert ids and all(
            re.fullmatch(r"a\.24x\.5e\.7b\.24\.20\.22\.3cb\.3e-[\w.-]+", i) for i in ids
        )


def test_the_grid_shows_every_order_with_its_number_or_reason(results):
    grid, _ = results
    left, right = plots.order_grid(grid).axes[:2]
    for axes in (left, right):
        assert len(axes.texts) == len(grid.fits) == 30
        assert sum(text.get_text() == "improper" for text in axes.texts) == 10
    said = {text.get_text() for text in left.texts}
    assert {f"{fit.fit:.2f}" for fit in grid.fits.values() if fit.ok} <= said


def test_an_order_without_a_model_is_not_drawn():
    found = made_up.order_grid()
    with pytest.raises(InputError, match="steering: P1Z3: improper"):
        plots.fitted(found, "P1Z3")
    with pytest.raises(InputError, match="steering: P1Z3: improper"):
        plots.responses(found["P1Z3"], found.record)


def test_a_sweep_shows_what_each_order_reaches(results):
    rows, chosen = swept(results[0])
    (axes,) = plots.order_sweep(rows, chosen).axes
    said = [text.get_text() for text in axes.texts]
    fitted = [fit for fit in rows["a.csv steering"].values() if np.isfinite(fit)]
    assert said.count("–") == len(fitted) - 2, "what was not fitted is told"
    assert {f"{fit:.1f}" for fit in fitted} <= set(said)
    assert [tick.get_text() for tick in axes.get_yticklabels()] == list(rows)


def test_a_grid_without_any_model_is_still_drawn(results):
    grid, _ = results
    empty = {order: fit for order, fit in grid.fits.items() if not fit.ok}
    assert plots.order_grid(
        dataclasses.replace(grid, fits=empty, chosen="P1Z3", chosen_by_bic="P1Z3")
    )


def test_an_envelope_keeps_peaks_and_gaps():
    t = np.arange(100_000.0)
    y = np.sin(t / 500.0)
    y[31_234], y[70_001], y[50_000] = 9.0, -9.0, np.nan
    thin_t, thin_y = envelope(t, y)
    assert len(thin_t) < 5000
    assert np.nanmax(thin_y) == 9.0 and np.nanmin(thin_y) == -9.0 and np.isnan(thin_y).any()
    assert (np.diff(thin_t) > 0).all()


def test_units_read_as_people_write_them():
    assert unit_label("speed", "m/s") == "speed (m/s)"
    assert unit_label("throttle", "1") == "throttle"
    assert unit_label("MSE", squared_unit("rad")) == "MSE (rad²)"
    assert unit_label("MSE", squared_unit("m/s")) == "MSE ((m/s)²)"


def test_windows_are_drawn_where_they_say_more_than_the_whole_run(results):
    _, comparison = results
    assert len(plots.translation_error(comparison).axes) == 2
    one = {
        name: dataclasses.replace(own, windows=own.whole)
        for name, own in comparison.predictions.items()
    }
    (axes,) = plots.translation_error(dataclasses.replace(comparison, predictions=one)).axes
    assert "whole run" in axes.get_title(loc="left") and axes.get_xlabel() == "time t (s)"


def test_a_flat_path_takes_a_flat_picture(results):
    _, comparison = results
    along, still = np.linspace(0.0, 100.0, comparison.record.n), np.zeros(comparison.record.n)
    heights = []
    for x, y in ((along, still), (still, along)):
        channels = comparison.record.channels | {"x": x, "y": y}
        record = dataclasses.replace(comparison.record, channels=channels)
        driven = dataclasses.replace(comparison, record=record, predictions={})
        heights.append(plots.paths(driven).get_size_inches()[1])
    assert heights == [2.6, 6.5]


def test_bands_are_told_and_axes_named(results):
    grid, _ = results
    _, step, gain, phase = plots.responses(grid["P1Z0"], grid.record).axes
    for axes in (step, gain, phase):
        (said,) = axes.get_legend().get_texts()
        assert said.get_text().startswith("95 %")
    assert step.get_ylabel().startswith("steering angle δ\nper steering command")
    sure = dataclasses.replace(grid["P1Z0"], covariance=0.0 * grid["P1Z0"].covariance)
    (said,) = plots.responses(sure, grid.record).axes[1].get_legend().get_texts()
    assert said.get_text() == "95 %, as narrow as the line"


def test_intervals_and_marks_of_the_studies_are_told():
    document = recorded()
    published = {
        course: {"improved": dict.fromkeys(rows["VDM"], 70.0)} for course, rows in TABLE_3.items()
    }
    figure = plots.distribution(document["population"], published)
    said = [text.get_text() for text in figure.legends[0].get_texts()]
    assert {"asked of VDM-SI, 70 %", "middle 95 % of the vehicles"} <= set(said)
    for axes in figure.axes[2:]:
        lines = [np.asarray(line.get_xdata(), float) for line in axes.lines]
        lows = [float(x.min()) for x in lines if x.size]
        assert min(lows) > axes.get_xlim()[0] + 3.0
    labels = [
        axes.get_xlabel() for axes in plots.steering_explained(document["steering_model"]).axes
    ]
    assert "middle 95 %" in labels[1]


def test_clocks_and_maps_that_count_from_afar_are_drawn_from_the_start(results):
    """Stamps of an epoch and coordinates of a whole country have digits that no axis has room
    for."""
    _, comparison = results
    near, places = comparison.record, np.array([6.9e5, 5.3e6])
    moved = dict(near.channels)
    for name, far in zip(("x", "y"), places, strict=True):
        moved[name] = near[name] + far
    record = dataclasses.replace(near, t=near.t + 1.7e9, channels=moved)
    predictions = {
        name: dataclasses.replace(
            one,
            channels=one.channels
            | {axis: one.channels[axis] + p for axis, p in zip("xy", places, strict=True)},
        )
        for name, one in comparison.predictions.items()
    }
    far = dataclasses.replace(comparison, record=record, predictions=predictions)
    for draw in (plots.paths, plots.channels, plots.translation_error):
        for axes in draw(far).axes:
            assert max(np.abs(axes.dataLim.get_points()).ravel()) < 1e4
    (axes,) = plots.paths(far).axes
    assert axes.get_xlabel() == "x from the start (m)"
