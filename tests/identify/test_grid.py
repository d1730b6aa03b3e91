"""The order grid: its orders, what nests, what is chosen, and what held-out data may do."""

import itertools
from dataclasses import replace

import jax
import numpy as np
import pytest

import known_plants as known
from vdmsi_jax.config import IdentifyOptions
from vdmsi_jax.data.record import Record
from vdmsi_jax.errors import InputError
from vdmsi_jax.identify import OrderGrid, identify

DT, N = 0.01, 3000
NOISE = 0.054  # m/s: what FIT and MSE of the paper's powertrain imply
ORDERS = [f"P{n}Z{m}" for n, m in itertools.product(range(1, 6), range(6))]


def powertrain_log(seed: int = 0) -> Record:
    """30 s of steps at 100 Hz, as in the paper's figure 3."""
    u = known.steps(N, 150, seed=seed)
    y = known.response(known.POWERTRAIN, u, DT) + known.white(N, NOISE, seed=100 + seed)
    return known.log(u, y, DT)


@pytest.fixture(scope="module")
def record() -> Record:
    return powertrain_log()


@pytest.fixture(scope="module")
def grid(record) -> OrderGrid:
    return identify(record, "plant", delay=False)


def small(record: Record, **options) -> OrderGrid:
    return identify(record, "plant", **{"poles": (1, 2), "zeros": (0, 1), **options})


def test_all_orders_are_there_improper_ones_with_the_reason(grid):
    assert list(grid.fits) == ORDERS
    for order, fit in grid.fits.items():
        assert fit.order == order
        if fit.n_zeros > fit.n_poles:
            assert fit.model is None and not fit.ok
            assert "improper" in fit.status
            assert np.isnan(fit.fit) and np.isnan(fit.bic)
        else:
            assert fit.ok and np.isfinite([fit.fit, fit.mse, fit.held_out_fit, fit.aic]).all()
            assert fit.residual.shape == fit.predicted.shape == (N,)
            assert fit.jacobian.shape == (N, len(fit.parameter_names))
            assert fit.covariance.shape == (len(fit.parameter_names),) * 2
            assert np.isfinite(fit.covariance).all()
    rows = grid.table()
    assert [row["order"] for row in rows] == ORDERS


def test_fit_never_falls_where_orders_nest(grid):
    fits = grid.fits
    for n, m in itertools.product(range(1, 6), range(6)):
        if m > n:
            continue
        inside = [(n, m - 1), (n - 1, m - 1)] + [(n - 1, m)] * (m < n - 1)
        for small_n, small_m in inside:
            if f"P{small_n}Z{small_m}" in fits and small_m <= small_n:
                smaller, larger = fits[f"P{small_n}Z{small_m}"], fits[f"P{n}Z{m}"]
                assert larger.fit >= smaller.fit, (smaller.order, larger.order)


def test_the_truth_is_found_among_the_orders(grid, record):
    truth = known.response(known.POWERTRAIN, record["u_cmd"], DT)
    own = 100.0 * (1.0 - np.linalg.norm(record["out"] - truth) / np.std(record["out"]) / N**0.5)
    assert grid["P2Z2"].fit >= own
    assert grid.chosen_by_bic == "P2Z2"
    # five free parameters, an offset and two initial states gain 8 noise variances of 3000: 0.01
    assert all(grid[o].fit > own - 0.01 for o in ("P2Z2", "P3Z3", "P4Z4", "P5Z5"))


def test_the_papers_rule_takes_the_smallest_order_near_the_best(grid, record):
    assert grid.best is grid[grid.chosen]
    usable = [fit for fit in grid.fits.values() if fit.ok and fit.supported]
    best = max(fit.fit for fit in usable)
    assert grid.best.fit >= best - grid.fit_loss
    size = grid.best.n_poles + grid.best.n_zeros
    for fit in usable:
        if fit.n_poles + fit.n_zeros < size:
            assert fit.fit < best - grid.fit_loss
    assert (
        grid.chosen_by_bic
        == min((fit for fit in grid.fits.values() if fit.ok), key=lambda fit: fit.bic).order
    )
    # a looser rule takes a smaller order
    assert small(record, delay=False, fit_loss=50.0).chosen == "P1Z0"


def test_an_unknown_order_is_refused_by_name(grid):
    with pytest.raises(KeyError, match="P7Z0"):
        grid["P7Z0"]


def test_a_grid_is_asked_like_a_mapping_of_its_orders(grid):
    assert list(grid) == list(grid.keys()) == list(grid.fits) and len(grid) == len(grid.fits)
    assert "P1Z0" in grid and "P9Z9" not in grid and dict(grid)["P1Z0"] is grid["P1Z0"]
    assert grid._ipython_key_completions_() == list(grid.fits)


def test_the_same_log_gives_the_same_bits(grid, record):
    again = identify(record, "plant", delay=False)
    for order, fit in grid.fits.items():
        np.testing.assert_array_equal(fit.parameters, again[order].parameters)
        np.testing.assert_array_equal(fit.covariance, again[order].covariance)


def test_held_out_samples_have_no_say_in_what_is_predicted_for_them(record):
    before = small(record)
    hidden = before.held_out
    assert 0.2 < hidden.mean() < 0.3
    y = np.where(hidden, -record["out"] + 7.0, record["out"])
    after = small(known.log(record["u_cmd"], y, DT))
    np.testing.assert_array_equal(after.held_out, hidden)
    compared = 0
    for order, fit in before.fits.items():
        # an order that is told as one that it contains, on all samples, has that one's prediction
        if fit.ok and fit.status == after[order].status == "converged":
            compared += 1
            assert np.isnan(fit.held_out_predicted[~hidden]).all()
            # the unit of y comes from the whole record and rounds differently; delays are only
            # looked for, and scales only set, by what is held out
            np.testing.assert_allclose(
                after[order].held_out_predicted[hidden],
                fit.held_out_predicted[hidden],
                atol=1e-3 * np.std(record["out"]),
            )
            assert after[order].held_out_fit < 0.0
    assert compared >= 2


def test_held_out_score_is_that_of_the_held_out_prediction(grid, record):
    hidden, y = grid.held_out, record["out"]
    for fit in grid.fits.values():
        if fit.ok:
            error = (y - fit.held_out_predicted)[hidden]
            assert fit.held_out_mse == pytest.approx(np.mean(error**2))
            spread = np.linalg.norm(y[hidden] - y[hidden].mean())
            score = 100.0 * (1.0 - np.linalg.norm(error) / spread)
            assert fit.held_out_fit == pytest.approx(score)


def test_nothing_held_out(record):
    grid = small(record, held_out=0.0)
    assert not grid.held_out.any()
    assert np.isnan(grid.best.held_out_fit)
    assert grid.best.held_out_predicted.shape in ((0,), (N,))


def test_a_log_too_short_to_hold_anything_out():
    """Which is told where nobody asked for it, and refused where somebody did."""
    u = np.random.default_rng(0).standard_normal(150)
    short = known.log(u, known.response(known.POWERTRAIN, u, DT), DT)
    for grid in (identify(short, known.PLANT), small(short)):
        assert not grid.held_out.any() and grid.note.startswith("nothing is held out: ")
    with pytest.raises(InputError, match=r"set \[identify\] held_out = 0"):
        small(short, held_out=0.25)
    with pytest.raises(InputError, match=r"a share of 0\.9999 leaves nothing to fit"):
        small(powertrain_log(seed=1), held_out=0.9999)


def test_options_that_say_nothing_of_what_is_held_out_leave_it_as_it_is_without_options():
    three = known.cut(powertrain_log(seed=1), [1000, 2000], runs=True)
    two = known.cut(powertrain_log(seed=1), [1500], runs=True)
    orders = IdentifyOptions(poles=(1,), zeros=(0,))
    for runs, whole in ((three, True), (two, False)):
        grid = identify(runs, known.PLANT, options=orders)
        of_runs = [grid.held_out[segment.samples] for segment in runs.segments]
        assert all(part.all() or not part.any() for part in of_runs) == whole
        assert 0.2 < grid.held_out.mean() < 0.4


def test_a_run_held_out_whole():
    """Its initial state is estimated from itself, its coefficients from the others."""
    runs = known.cut(powertrain_log(seed=1), [1000, 2000], runs=True)
    grid = small(runs, split="run", held_out=0.34)
    of_runs = [grid.held_out[segment.samples] for segment in runs.segments]
    assert sum(part.all() for part in of_runs) == 1
    assert sum(not part.any() for part in of_runs) == 2
    spoilt = np.where(grid.held_out, 3.0 * runs["out"] + 1.0, runs["out"])
    other = replace(runs, channels={**runs.channels, "out": spoilt})
    again = small(other, split="run", held_out=0.34)
    hidden = grid.held_out
    before, after = (g["P2Z1"].held_out_predicted[hidden] for g in (grid, again))
    # they differ by a free response only (of the training fit, whose poles are nearly the model's)
    model = grid["P2Z1"].model
    assert model is not None
    free = known.free_responses(np.asarray(model.den), int(hidden.sum()), DT)
    rest = after - before
    rest = rest - free @ np.linalg.lstsq(free, rest, rcond=None)[0]
    assert np.abs(rest).max() < 2e-2 * np.std(runs["out"])


def test_filled_in_samples_have_no_weight(record):
    holes = np.zeros(N, bool)
    holes[400:450] = holes[1200:1300] = True
    plain = small(replace(record, filled={"out": holes}), held_out=0.0, delay=False)
    y = np.where(holes, record["out"] + 0.5, record["out"])
    spoilt = replace(record, channels={**record.channels, "out": y}, filled={"out": holes})
    other = small(spoilt, held_out=0.0, delay=False)
    for order in ("P1Z0", "P2Z1"):
        # the scale of the output, and so rounding and the last step, come from all samples
        np.testing.assert_allclose(
            other[order].parameters, plain[order].parameters, rtol=1e-4, atol=1e-6
        )
        assert np.isnan(plain[order].residual[holes]).all()
        assert np.isfinite(plain[order].residual[~holes]).all()


def test_parts_of_the_grid(record):
    grid = small(record)
    assert list(grid.fits) == ["P1Z0", "P1Z1", "P2Z0", "P2Z1"]
    only = identify(record, "plant", poles=(3,), zeros=(0,), held_out=0.0)
    assert list(only.fits) == ["P3Z0"] and only.chosen == "P3Z0"


def test_a_grid_of_improper_orders_alone_is_refused(unchecked, record):
    with pytest.raises(InputError, match="[Ii]mproper|no proper"):
        identify(record, "plant", poles=(1,), zeros=(2, 3))
    with pytest.raises(InputError, match=r"zeros \[2, 3\] exceed poles \[1\]"):
        identify(record, "plant", poles=np.int64(1), zeros=np.arange(2, 4))


def test_fewer_samples_than_unknowns_are_refused(record):
    seen = (np.arange(N) >= 146) & (np.arange(N) < 156)
    first = replace(record, filled={"out": ~seen})
    with pytest.raises(InputError, match="10 samples to fit, and up to 18 unknowns"):
        identify(first, "plant", held_out=0.0)
    assert small(first, held_out=0.0).fits["P2Z1"].ok


def test_a_command_that_changes_late_is_not_held_out(record):
    """A fit of nothing had been scored: a FIT of -2e60 %."""
    u = np.where(np.arange(N) < 0.9 * N, 0.0, 1.0)
    y = known.response(known.POWERTRAIN, u, DT) + known.white(N, NOISE, seed=3)
    with pytest.warns(UserWarning, match="nothing is held out"):
        grid = small(known.log(u, y, DT))
    assert not grid.held_out.any() and np.isnan(grid.fits[grid.chosen].held_out_fit)


def test_without_delay_or_offset(record):
    grid = small(record, delay=False, offset=False, held_out=0.0)
    fit = grid["P2Z1"]
    assert fit.parameter_names == ("b1", "b0", "a1", "a0")
    assert fit.model is not None and fit.model.delay is None and fit.model.offset is None
    assert "delay" in small(record, held_out=0.0)["P2Z1"].parameter_names


def test_a_bound_of_the_delay_is_kept(record):
    late = replace(known.POWERTRAIN, delay=0.12)
    y = known.response(late, record["u_cmd"], DT) + known.white(N, NOISE, seed=3)
    log = known.log(record["u_cmd"], y, DT)
    assert small(log, delay=0.05, held_out=0.0)["P2Z1"].value("delay") <= 0.05 + 1e-9
    # free, P2Z1 finds its optimum beyond: a little less delay, and a zero for the rest
    assert small(log, delay=0.5, held_out=0.0)["P2Z1"].value("delay") > 0.05 + DT


@pytest.mark.parametrize(
    ("channel", "value", "words"),
    [
        ("u_cmd", 0.4, "command of plant is 0.4 in all"),
        ("out", 0.0, "response of plant is zero"),
        ("out", 2.0, "response of plant is 2 in all"),
    ],
)
def test_a_log_that_does_not_move_is_refused(record, channel, value, words):
    still = replace(record, channels={**record.channels, channel: np.full(N, value)})
    with pytest.raises(InputError, match=words):
        identify(still, "plant")


@pytest.mark.slow
def test_float32_is_warned_of(record):
    with jax.enable_x64(False), pytest.warns(UserWarning, match="float32"):
        grid = identify(record, "plant", poles=(1,), zeros=(0,), held_out=0.0, delay=False)
    # single precision: seven digits, times the conditioning of the normal equations
    assert grid["P1Z0"].fit == pytest.approx(
        small(record, held_out=0.0, delay=False)["P1Z0"].fit, abs=0.1
    )
