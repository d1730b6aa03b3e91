"""Which order of a grid is chosen, and what a grid says of itself."""

from dataclasses import replace

import numpy as np
import pytest

import known_plants as known
import made_up
import vdmsi_jax as vj
from vdmsi_jax.data.segment import Segment
from vdmsi_jax.errors import InputError
from vdmsi_jax.identify.orders import choose

LOG = made_up.record()


def grid(**fits):
    """Orders by name: FIT, and what is False of it."""
    made = {}
    for order, (score, *lacks) in fits.items():
        lacking = dict.fromkeys(lacks, False)
        made[order] = replace(made_up.fit(order, LOG), fit=score, bic=-score, **lacking)
    return made


@pytest.mark.parametrize(
    ("fits", "chosen"),
    [
        ({"P1Z0": (90.0,), "P2Z0": (94.0,), "P3Z0": (94.3,)}, "P2Z0"),
        ({"P1Z0": (90.0,), "P2Z1": (92.0, "supported")}, "P1Z0"),
        ({"P1Z0": (90.0,), "P2Z1": (94.0, "supported")}, "P2Z1"),
        ({"P1Z0": (90.0,), "P4Z1": (94.0, "supported", "sound")}, "P1Z0"),
        ({"P1Z0": (60.0,), "P2Z0": (94.0, "supported", "sound")}, "P2Z0"),  # a plant that grows
    ],
)
def test_the_smallest_order_that_the_data_support(fits, chosen):
    assert choose(grid(**fits), 0.5)[0] == chosen


def test_the_least_bic_is_not_that_of_a_model_that_grows():
    assert choose(grid(P1Z0=(90.0,), P4Z1=(94.0, "sound")), 0.5)[1] == "P1Z0"


def test_the_least_bic_is_not_that_of_a_copy():
    fits = grid(P2Z1=(94.0,), P2Z0=(94.0,))
    fits["P2Z1"] = replace(fits["P2Z1"], status="no better than what it contains: P2Z0")
    assert choose(fits, 0.5)[1] == "P2Z0"


def late_lag(delay: float, gaps: int) -> vj.Record:
    """A lag of 0.3 s that hears its commands late, with noise of 0.005, logged with gaps."""
    dt, lag, noise = 0.02, 0.3, 0.005
    rng = np.random.default_rng(5)
    u = np.repeat(rng.uniform(-1.0, 1.0, 60), 25)
    heard = np.roll(u, round(delay / dt))
    heard[: round(delay / dt)] = u[0]
    y, keep = np.full(u.size, u[0]), np.exp(-dt / lag)
    for k in range(1, u.size):
        y[k] = keep * y[k - 1] + (1.0 - keep) * heard[k - 1]
    y += noise * rng.standard_normal(u.size)
    edges = np.linspace(0, u.size, gaps + 2).astype(int).tolist()
    parts = tuple(Segment(a + 30, b) for a, b in zip(edges[:-1], edges[1:], strict=True))
    plant = vj.PlantSpec("plant", "u", "y")
    return vj.Record.from_arrays(dt=dt, plants=(plant,), u=u, y=y).select(parts)


def test_what_no_fit_saw_behind_a_gap_counts_in_no_score():
    """It answers to commands that were not logged, and had made the BIC ask for more poles."""
    log = late_lag(0.2, gaps=5)
    found = vj.identify(log, "plant", poles=(1, 2), zeros=(0,))
    assert found["P1Z0"].mse == pytest.approx(0.005**2, rel=0.1)
    assert found.chosen_by_bic == "P1Z0"


@pytest.mark.parametrize(("most", "told"), [(0.1, True), (0.4, False)])
def test_a_delay_at_its_bound_is_told(most, told):
    found = vj.identify(late_lag(0.2, gaps=0), "plant", poles=(1,), zeros=(0,), delay=most)
    said = "the delay is as long as it may be, 0.1 s: allow more by [identify] delay"
    assert (said in found["P1Z0"].warnings) is told


def test_fits_and_grids_are_told_in_a_line():
    found = made_up.order_grid()
    assert "\n" not in repr(found) and f"chosen {found.chosen}" in repr(found)
    assert "FIT" in repr(found["P2Z1"]) and "improper" in repr(found["P1Z3"])
    assert len(repr(found["P2Z1"])) < 120


def test_a_parameter_a_level_or_an_order_that_is_none_is_told_with_the_nearest():
    found = made_up.order_grid()
    fit = found["P2Z1"]
    with pytest.raises(InputError, match="P2Z1 of steering: a7: .*did you mean 'a1'"):
        fit.value("a7")
    with pytest.raises(InputError, match="a7: there is no such parameter"):
        fit.interval("a7")
    with pytest.raises(InputError, match="level: 95.0 is no share; give 0.95"):
        fit.interval("a0", 95.0)
    with pytest.raises(InputError, match="steering: P1Z3: improper"):
        found["P1Z3"].value("a0")
    with pytest.raises(KeyError, match="did you mean 'P2Z1'"):
        found["p2z1"]


def test_iterating_over_a_grid_gives_its_orders():
    found = made_up.order_grid()
    assert list(found) == list(found.fits)
    assert "P1Z0" in found and "P7Z0" not in found
    one = replace(found, fits={"P1Z0": found["P1Z0"]}, chosen="P1Z0")
    assert ": 1 order fitted," in repr(one)


def test_a_fit_alone_makes_a_model():
    found = made_up.order_grid()
    model = vj.identified({"steering": found["P3Z0"]})
    assert model.plants["steering"].linear.den.size == 4


def test_no_plant_and_no_order_is_left_out_of_a_model_in_silence():
    found = made_up.order_grid()
    with pytest.raises(InputError, match="steering: P1Z3: improper"):
        vj.identified({"steering": found}, orders={"steering": "P1Z3"})
    with pytest.raises(InputError, match="steering: P1Z3: improper"):
        vj.identified({"steering": found["P1Z3"]})
    with pytest.raises(InputError, match="steerng.*did you mean 'steering'"):
        vj.identified({"steering": found}, orders={"steerng": "P1Z0"})
    with pytest.raises(InputError, match="foo: is the plant steering"):
        vj.identified({"foo": found})


@pytest.mark.slow
def test_behind_a_gap_what_answers_to_unknown_commands_does_not_count():
    """A step inside a hole, just before the log goes on, is no delay that is shorter."""
    rng, dt, late = np.random.default_rng(2), 0.02, 5
    u = np.repeat(rng.uniform(-0.4, 0.4, 40), 50)
    y, x = np.empty_like(u), u[0]
    for k in range(u.size):
        y[k] = x
        x += 0.15 * (u[max(k - late, 0)] - x)
    y += 0.002 * rng.standard_normal(y.size)
    steps = range(150, 2000, 200)
    log = vj.Record.from_arrays(dt=dt, name="gaps", delta_cmd=u, delta=y)
    begin, end = [0, *(s + 2 for s in steps)], [*(s - 40 for s in steps), u.size]
    log = log.select([Segment(a, b, "gaps") for a, b in zip(begin, end, strict=True)])
    fit = vj.identify(log, "steering", poles=1, zeros=0, held_out=0.0).best
    low, high = fit.interval("delay")
    assert low - 0.002 < late * dt < high + 0.002


@pytest.mark.parametrize(("gain", "told"), [(0.0, True), (0.5, False)])
def test_a_response_that_may_be_nothing_but_noise_is_told(gain, told):
    """Of many delays and poles some happen to answer noise, and are fitted."""
    rng = np.random.default_rng(1)
    u = known.steps(1500, 50, seed=1)
    y = gain * known.response(known.POWERTRAIN, u, 0.02) + rng.standard_normal(1500)
    grid = vj.identify(known.log(u, y, 0.02), "plant", poles=(1,), zeros=(0,))
    assert any("nothing but noise" in warning for warning in grid.best.warnings) is told
