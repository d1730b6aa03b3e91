"""Every picture of a diagnosis: it draws, labels its axes with units, and shows the right
samples."""

import dataclasses

import matplotlib
import numpy as np
import pytest
from matplotlib.figure import Figure

import made_up_diagnosis
from vdmsi_jax import plots
from vdmsi_jax.plots.diagnosis import leading_response, worst_paths
from vdmsi_jax.plots.overlays import best_window, binned, judged_run, over_time

OF_A_DIAGNOSIS = {
    "diagnosis": plots.diagnosis,
    "gains": plots.gains,
    "budget": plots.budget,
}
OF_A_RESPONSE = {
    "overlay": plots.overlay,
    "residual_against": plots.residual_against,
    "innovations": plots.innovations,
}


@pytest.fixture(scope="module", params=made_up_diagnosis.ALL)
def diagnosis(request):
    return made_up_diagnosis.ALL[request.param]()


def pictures(d):
    for name, draw in OF_A_DIAGNOSIS.items():
        if name != "budget" or d.budget:
            yield name, lambda draw=draw: draw(d)
    for response in d.responses:
        for name, draw in OF_A_RESPONSE.items():
            yield f"{name}-{response.name}", lambda draw=draw, of=response: draw(of)
        for path in d.paths:
            yield f"on_path-{response.name}", lambda of=response, on=path: plots.on_path(of, on)
    if d.paths:
        yield "paths", lambda: plots.paths_before_after(d)


def panels(figure: Figure):
    """Axes with data, those of parts of a figure too."""
    return [axes for axes in figure.axes if axes.get_label() != "<colorbar>"]


def test_every_picture_is_whole_and_labelled_and_changes_no_setting(diagnosis):
    for name, draw in pictures(diagnosis):
        before = dict(matplotlib.rcParams)
        figure = draw()
        assert dict(matplotlib.rcParams) == before
        assert isinstance(figure, Figure) and panels(figure)
        for axes in panels(figure):
            assert axes.has_data(), name
            shared = axes.get_shared_x_axes().get_siblings(axes)
            units = any("(" in other.get_xlabel() for other in shared)
            assert units, name
        figure.draw_without_rendering()
        frame, drawn = figure.bbox, figure.get_tightbbox().transformed(figure.dpi_scale_trans)
        assert drawn.x0 > frame.x0 - 3 and drawn.x1 < frame.x1 + 3, f"{name} is cut off"
        assert drawn.y0 > frame.y0 - 3 and drawn.y1 < frame.y1 + 3, f"{name} is cut off"
        svg = plots.to_svg(figure, "mine")
        assert svg.startswith("<svg") and svg.count(' id="') == svg.count(' id="mine-')
        assert "data:" not in svg and len(svg) < 600_000


def test_the_command_has_its_own_unit():
    motor = made_up_diagnosis.siso().responses[0]
    labels = [axes.get_xlabel() for axes in plots.residual_against(motor).axes]
    assert labels[1:] == ["voltage (V)", "simulated speed (rad/s)", "rate of speed (rad/s²)"]


def test_the_judged_run_is_the_held_out_one_without_its_padding():
    steering = made_up_diagnosis.explained().responses[0]
    run = judged_run(steering)
    assert run.name == "run_3.csv" and run.title == "run_3.csv, held out"
    padded = dataclasses.replace(steering, held_out=np.zeros_like(steering.held_out))
    padded.held_out[1] = padded.valid[1]
    run = judged_run(padded)
    assert run.name == "run_2.csv" and len(run.t) == made_up_diagnosis.LENGTHS[1]
    none = dataclasses.replace(steering, held_out=np.zeros_like(steering.held_out))
    assert judged_run(none).title.endswith("seen by the fit")


def test_the_zoom_lies_where_the_extension_helps_most():
    response = made_up_diagnosis.explained().responses[1]
    baseline = response.extended.copy()
    baseline[-1, 1200:1260] += 3.0
    response = dataclasses.replace(response, baseline=baseline)
    window = best_window(response, judged_run(response))
    assert window.start <= 1200 and window.stop >= 1260
    assert window.stop - window.start == 300  # a tenth of the run


def test_a_missing_stretch_breaks_the_lines():
    response = made_up_diagnosis.explained().responses[0]
    valid = response.valid.copy()
    valid[-1, 500:700] = False
    holey = dataclasses.replace(response, valid=valid, held_out=response.held_out & valid)
    run = judged_run(holey)
    assert np.isnan(run.y[500:700]).all() and np.isfinite(run.y[700:]).all()
    for draw in OF_A_RESPONSE.values():
        draw(holey).draw_without_rendering()


def test_bins_find_a_shape_and_their_band_covers_its_absence():
    rng = np.random.default_rng(0)
    x = rng.uniform(-1.0, 1.0, 20_000)
    noise = rng.standard_normal(x.size)
    at, mean, half = binned(x, np.sign(x) + noise, 1.0)
    assert len(at) > 20 and (np.diff(at) > 0.0).all()
    assert (np.sign(mean[np.abs(at) > 0.1]) == np.sign(at[np.abs(at) > 0.1])).all()
    covered = []
    for _ in range(40):
        _, mean, half = binned(x, rng.standard_normal(x.size), 1.0)
        covered.append(np.mean(np.abs(mean) < half))
    assert 0.93 < np.mean(covered) < 0.97
    one = np.zeros(100)
    at, mean, half = binned(one, one + 1.0, 1.0)  # a command that never moved
    assert at.tolist() == [0.0] and mean.tolist() == [1.0]
    assert binned(np.zeros(0), np.zeros(0), 1.0)[0].size == 0


def test_no_line_crosses_what_was_not_held_out():
    t = np.concatenate([np.arange(0.0, 5.0, 0.02), np.arange(20.0, 25.0, 0.02)])
    x, mean, half = over_time(t, np.sin(t), 1.0)
    breaks = np.isnan(x)
    assert breaks.sum() == 2 and np.isnan(mean[breaks]).all() and np.isnan(half[breaks]).all()
    inside = np.flatnonzero(~breaks)
    jumps = np.diff(x)[np.diff(x) > 1.0]
    assert jumps.size == 0 and x[inside[0]] < 5.0 and x[inside[-1]] > 20.0
    whole, *_ = over_time(np.arange(0.0, 5.0, 0.02), np.zeros(250), 1.0)
    assert np.isnan(whole).sum() == 1 and np.isnan(whole[-1])


def test_the_leading_response_is_that_of_the_strongest_finding():
    d = made_up_diagnosis.explained()
    assert leading_response(d).channel == "delta"
    assert leading_response(dataclasses.replace(d, findings=d.findings[::-1])).channel == "v"
    assert leading_response(dataclasses.replace(d, findings=())).channel == "delta"  # worst FIT


def test_gains_show_every_finding_before_and_after():
    d = made_up_diagnosis.explained()
    fits, road = plots.gains(d).axes
    labels = [tick.get_text().replace("\n", " ") for tick in fits.get_yticklabels()]
    assert ["backlash" in labels[0], "delay" in labels[1]] == [True, True]
    said = {text.get_text() for text in fits.texts}
    assert {f"{f.gain.before:.1f} → {f.gain.after:.1f}" for f in d.findings} == said
    assert len(road.texts) == 2 and all(t.get_text().endswith(" m") for t in road.texts)
    low, high = fits.get_xlim()
    assert all(low < g.before < high and low < g.after < high for g in (f.gain for f in d.findings))


def test_gains_stay_below_the_whole_and_their_numbers_within_the_axes():
    d = made_up_diagnosis.explained()
    first, *others = d.findings
    narrow = dataclasses.replace(first.gain, se=20.0, ate_before=0.02, ate_after=0.01)
    d = dataclasses.replace(d, findings=(dataclasses.replace(first, gain=narrow), *others))
    figure = plots.gains(d)
    fits, road = figure.axes
    (bars,) = fits.containers
    ends = np.concatenate([path.vertices[:, 0] for path in bars[2][0].get_paths()])
    assert ends.max() <= 100.0 and ends.min() < first.gain.after - 30.0
    figure.draw_without_rendering()
    assert all(text.get_window_extent().x0 > road.bbox.x0 for text in road.texts)


def test_a_budget_fills_each_bar_to_the_whole(diagnosis):
    if not diagnosis.budget:
        pytest.skip("it has none")
    (axes,) = plots.budget(diagnosis).axes
    for row, _ in enumerate(diagnosis.budget):
        bars = [bar for bar in axes.patches if np.isclose(bar.get_y() + 0.31, row)]
        assert np.isclose(sum(bar.get_width() for bar in bars), 100.0)
    several = len({cause for budget in diagnosis.budget for cause in budget.parts}) > 1
    assert ("all orders" in axes.get_xlabel()) == several


def test_an_rms_says_whether_it_is_that_of_a_window():
    d = made_up_diagnosis.explained()
    whole = plots.overlay(leading_response(d)).axes
    (said,) = [legend for axes in whole if "rms" in (legend := legend_of(axes))]
    assert "here" not in said
    (said,) = [legend for axes in plots.diagnosis(d).axes if "rms" in (legend := legend_of(axes))]
    assert said.count("rms here") == 2


def legend_of(axes) -> str:
    legend = axes.get_legend()
    return "" if legend is None else " ".join(text.get_text() for text in legend.get_texts())


def test_the_start_of_a_path_is_told_beside_it():
    axes = plots.paths_before_after(made_up_diagnosis.explained()).axes[0]
    assert "start" in legend_of(axes) and not axes.texts


def test_a_path_is_drawn_only_where_there_is_one():
    with pytest.raises(ValueError, match="no path to draw"):
        plots.paths_before_after(made_up_diagnosis.no_effect())
    d = made_up_diagnosis.explained()
    with pytest.raises(ValueError, match="has no run"):
        plots.on_path(d.responses[0], dataclasses.replace(d.paths[0], run="other.csv"))


def test_the_residuals_of_several_runs_share_a_picture_and_a_scale():
    d = made_up_diagnosis.explained()
    response = d.responses[0]
    runs = [dataclasses.replace(d.paths[0], run=name) for name in response.runs]
    figure = plots.on_path(response, *runs)
    models = ["baseline", "extended"]
    assert [axes.get_title(loc="left") for axes in panels(figure)] == [
        f"{name}, {model}" for model in models for name in response.runs
    ]
    (scale,) = {(axes.collections[0].norm.vmin, axes.collections[0].norm.vmax)
                for axes in panels(figure)}  # fmt: skip
    assert scale[1] == -scale[0] > 0.0


@pytest.mark.parametrize("size", [0.0026, 0.056, 300.0])
def test_the_numbers_of_a_scale_leave_room_for_its_label(size):
    d = made_up_diagnosis.explained()
    response = d.responses[0]
    swing = size * np.sin(0.01 * np.arange(response.y.shape[1]))
    off = dataclasses.replace(response, baseline=response.y - swing, extended=response.y - swing)
    figure = plots.on_path(off, d.paths[0])
    figure.draw_without_rendering()
    drawn = figure.get_tightbbox().transformed(figure.dpi_scale_trans)
    assert drawn.x1 < figure.bbox.x1


def test_of_many_held_out_drives_those_with_the_largest_errors_are_drawn():
    d = made_up_diagnosis.explained()
    path = d.paths[0]
    far = [3.0, 0.0, 1.0, 5.0, 2.0, 4.0]
    moved = [path.measured + np.array([size, 0.0, 0.0]) for size in far]
    paths = [
        dataclasses.replace(path, run=f"{size:g}", baseline=own)
        for size, own in zip(far, moved, strict=True)
    ]
    assert [one.run for one in worst_paths(paths)] == ["3", "5", "2", "4"]
    figure = plots.paths_before_after(dataclasses.replace(d, paths=tuple(paths)))
    assert [axes.get_title(loc="left") for axes in panels(figure)[::2]] == [
        f"path of {run}" for run in ("3", "5", "2", "4")
    ]


def test_a_diagnosis_plots_itself():
    assert isinstance(made_up_diagnosis.explained().plot(), Figure)


def test_a_diagnosis_without_pictures_of_signals_is_still_drawn():
    d = dataclasses.replace(made_up_diagnosis.explained(), responses=(), paths=())
    figure = plots.diagnosis(d)
    figure.draw_without_rendering()
    assert len(figure.axes) == 2
