"""What hypotheses pay."""

import math

import numpy as np
import pytest

import vdmsi_jax as vj
from vdmsi_jax.diagnose.actuator.hypothesis import GROWTH, Hypothesis, Lane, growth
from vdmsi_jax.diagnose.actuator.lanes import POLES
from vdmsi_jax.diagnose.actuator.outcome import _as_jumps
from vdmsi_jax.diagnose.actuator.refit import refit
from vdmsi_jax.diagnose.prepare import stage_of
from vdmsi_jax.diagnose.search.price import PARAMETER_COST, price
from vdmsi_jax.diagnose.signals.runs import lay_out

PLANT, RUNS = vj.PlantSpec("servo", "u", "y"), 3


def made(run: int, kernel: np.ndarray) -> vj.Record:
    rng = np.random.default_rng(run)
    u = np.repeat(rng.uniform(-1.0, 1.0, 10), 20)
    y = np.convolve(u, kernel)[: len(u)] + 1e-3 * rng.standard_normal(len(u))
    return vj.Record.from_arrays(dt=0.02, name=f"{run}", plants=(PLANT,), u=u, y=y)


DECAY = 0.1 * 0.9 ** np.arange(60)
STAGE = stage_of(lay_out([made(run, DECAY) for run in range(RUNS)]), PLANT)


def paid(*causes: str) -> float:
    """By a first-order plant with some causes, more than without; for parameters, too."""
    every = [slot.cause for slot in STAGE.slots]
    active = tuple(map(every.index, causes))
    theta = STAGE.off.copy()
    theta[[0, POLES]] = 1.0
    own = PARAMETER_COST * sum(STAGE.slots[k].weight for k in active)
    bare = price(STAGE, Hypothesis(1, 0, (), theta))
    return price(STAGE, Hypothesis(1, 0, active, theta)) - bare - own


def test_causes_pay_each_for_itself():
    assert paid("saturation", "offset") == paid("saturation") + paid("offset")


def test_a_second_static_curve_pays_more_since_two_mend_the_form_of_one():
    alone = paid("saturation")
    assert paid("saturation", "gain_nonlinearity") > 2.0 * alone
    three = paid("saturation", "gain_nonlinearity", "dead_zone")
    assert three - 3.0 * alone == 2.0 * (paid("saturation", "gain_nonlinearity") - 2.0 * alone)


def test_what_was_on_its_way_is_paid_in_each_run():
    assert paid("transport_delay") == paid("offset") + 2.0 * RUNS


def test_no_response_comes_before_a_command_that_a_controller_makes_of_it():
    """Stamps that are off let it seem so, by two rows; the answer of a loop comes after it."""
    number = [slot.cause for slot in STAGE.slots].index("transport_delay")
    theta = STAGE.off.copy()
    theta[[0, POLES]] = 1.0
    for delay, worth, worth_in_loop in ((0.02, True, True), (-0.02, True, False), (-0.06, 0, 0)):
        theta[STAGE.slots[number].index[0]] = delay
        early = Hypothesis(1, 0, (number,), theta.copy())
        assert math.isfinite(price(STAGE, early)) == worth
        assert math.isfinite(price(STAGE.looped(), early)) == worth_in_loop


def test_what_first_moves_the_wrong_way_pays_more_than_what_is_late():
    def second_order(zero: float) -> float:
        theta = STAGE.off.copy()
        theta[[0, 1, POLES, POLES + 1]] = 2.0, 1.0, 1.0, -zero
        return price(STAGE, Hypothesis(2, 1, (), theta))

    late = paid("transport_delay") + PARAMETER_COST
    assert second_order(3.0) - second_order(-3.0) > late + 10.0


@pytest.mark.parametrize(
    ("share", "lead", "late"),
    [
        (0.6, 0.02, False),  # a rope and its load
        (-0.05, -0.18, False),  # zeros hardly beyond the axis, as light modes may have them
        (1.0, -0.03, False),  # one zero, too far off to tell
        (0.75, -0.82, True),  # a delay of a drive that had been told so
        (-2.24, -2.34, True),  # that of a small car's steering
    ],
)
def test_a_mode_that_answers_late_pays_as_a_delay_does(share, lead, late):
    number = [slot.cause for slot in STAGE.slots].index("resonance")

    def with_mode(share: float, lead: float) -> float:
        theta = STAGE.off.copy()
        theta[[0, POLES]] = 1.0
        theta[list(STAGE.slots[number].index)] = 2.0, 0.06, share, lead
        return price(STAGE, Hypothesis(1, 0, (number,), theta))

    assert (with_mode(share, lead) > with_mode(0.5, 0.0)) is late


@pytest.mark.parametrize(("seconds", "worth"), [(0.02, False), (1.0, True), (np.inf, True)])
def test_a_drift_that_is_over_at_once_is_worth_nothing(seconds, worth):
    """In runs of 4 s."""
    number = [slot.cause for slot in STAGE.slots].index("gain_drift")
    theta = STAGE.off.copy()
    theta[[0, POLES]] = 1.0
    theta[list(STAGE.slots[number].index)] = 0.05, 1.0 / seconds
    assert math.isfinite(price(STAGE, Hypothesis(1, 0, (number,), theta))) is worth


@pytest.mark.parametrize(("hertz", "worth"), [(0.05, False), (0.5, False), (1.0, True)])
def test_what_swings_too_seldom_is_a_trend_and_worth_nothing(hertz, worth):
    """In runs of 4 s."""
    number = [slot.cause for slot in STAGE.slots].index("periodic_disturbance")
    theta = STAGE.off.copy()
    theta[[0, POLES]] = 1.0
    theta[STAGE.slots[number].index[0]] = hertz
    swing = np.ones((RUNS, 2))
    assert math.isfinite(price(STAGE, Hypothesis(1, 0, (number,), theta, swing))) is worth


def with_pole(exponent: float) -> Hypothesis:
    """First order, whose pole grows by that over a run."""
    theta = STAGE.off.copy()
    theta[[0, POLES]] = -exponent / (STAGE.pace * STAGE.dt * STAGE.u.shape[1]), 1.0
    return Hypothesis(1, 0, (), theta)


def test_a_plant_that_grows_by_itself_is_worth_nothing():
    told = growth(STAGE, [with_pole(e) for e in (0.5, 0.0, -0.5)])
    assert told == pytest.approx([0.5, 0.0, 0.0])  # poles that are not there rest
    assert math.isinf(price(STAGE, with_pole(1.1 * GROWTH)))
    assert math.isfinite(price(STAGE, with_pole(0.5 * GROWTH)))


def test_no_fit_ends_in_a_plant_that_grows_by_itself():
    """It stops near an integrator, though the plant that was simulated grows threefold."""
    step = np.arange(200) / 200
    stage = stage_of(
        lay_out([made(k, np.exp(1.2 * step) * np.sin(4 * step)) for k in (0, 1)]), PLANT
    )
    once = 1.0 / (stage.pace * stage.dt * stage.u.shape[1])
    theta = stage.off.copy()
    theta[[0, 1, POLES + 1]] = 0.5 * once, (4.0 * once) ** 2, 1.0
    (fit,) = refit(stage, [Hypothesis(2, 0, (), theta)])
    assert 0.5 * GROWTH < growth(stage, [fit.hypothesis])[0] <= GROWTH


def test_a_change_takes_less_than_a_drift_does():
    """Or a drift would have a change that takes as long in its place, and none could be told."""
    for slot in STAGE.slots:
        if slot.cause == "regime_change" and slot.effect.over == "run":
            ramp = slot.index[slot.names.index("ramp")]
            assert STAGE.bounds[1][ramp] == pytest.approx(0.1 * 200 * 0.02)


@pytest.mark.parametrize(("rows", "held"), [(0.0, True), (5.0, False)])
def test_the_moment_of_a_jump_does_not_hang_on_how_long_it_takes(rows, held):
    """The one row that a jump lies in tells both alike."""
    number = [slot.cause for slot in STAGE.slots].index("regime_change")
    slot, theta, nothing = STAGE.slots[number], STAGE.off.copy(), np.zeros(1)
    theta[[0, POLES]] = 1.0
    theta[slot.index[slot.names.index("ramp")]] = rows * STAGE.dt
    h = Hypothesis(1, 0, (number,), theta)
    free = h.free(STAGE)
    alike = np.ones((len(free), len(free)))
    changed = _as_jumps(STAGE, Lane(h, free, nothing, nothing, nothing), alike)
    assert np.array_equal(changed, alike) is not held
    assert np.all(np.diag(changed) == 1.0) and np.all(alike == 1.0)
    assert np.count_nonzero(changed == 0.0) == held * 2 * (len(free) - 1)
