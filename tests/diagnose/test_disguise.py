"""Plants that cannot tell a cause by their poles and zeros."""

import numpy as np
import pytest

import vdmsi_jax as vj
from vdmsi_jax.diagnose.actuator.hypothesis import Hypothesis
from vdmsi_jax.diagnose.actuator.stage import Stage
from vdmsi_jax.diagnose.actuator.starts import number_of, plant
from vdmsi_jax.diagnose.actuator.sticking import held
from vdmsi_jax.diagnose.prepare import stage_of
from vdmsi_jax.diagnose.search.disguise import levelled, stilled
from vdmsi_jax.diagnose.signals.runs import lay_out

DT, ROWS = 0.02, 1000


@pytest.fixture(scope="module")
def stage() -> Stage:
    spec, rng = vj.PlantSpec("servo", "u", "y"), np.random.default_rng(1)
    u = np.repeat(rng.uniform(-1.0, 1.0, ROWS // 40), 40)
    y = u + 0.02 * rng.standard_normal(ROWS)
    log = vj.Record.from_arrays(dt=DT, name="run", plants=(spec,), u=u, y=y)
    return stage_of(lay_out([log]), spec)


def made(stage: Stage, poles: list[complex], zeros: list[float], high: float) -> Hypothesis:
    """A plant of poles and zeros in 1/s, with the coefficient of the highest power."""
    den = np.poly(np.asarray(poles) / stage.pace).real
    num = np.atleast_1d(np.poly(np.asarray(zeros) / stage.pace)).real * high
    return plant(Hypothesis(1, 0, (), stage.off.copy()), stage, den, num)


@pytest.mark.parametrize("slow", [-1e-7, 1e-7, -0.02])
def test_a_level_that_lingers_is_an_offset_of_a_plant_with_the_gain_that_shows(stage, slow):
    """The gain at rest of what lingers longer than any run is never reached."""
    den = np.poly([-8.0 / stage.pace])
    lingering = made(stage, [-8.0, slow], [-0.03], den[-1])
    up, down = levelled(stage, lingering)
    offset = stage.slots[number_of(stage, "offset")].index[0]
    assert up.theta[offset] == -down.theta[offset] != 0.0
    for told in (up, down):
        assert told.den == pytest.approx(den)
        gain = told.num[-1] / told.den[-1]
        assert gain == pytest.approx(0.03 / 0.02 if slow == -0.02 else 1.0, rel=1e-6)


def test_friction_in_the_place_of_a_play_holds_a_body_on_a_spring(stage):
    number = number_of(stage, "backlash")
    theta = stage.off.copy()
    theta[stage.slots[number].index[0]] = 0.4
    den = np.poly(np.array([-2.0, -12.0]) / stage.pace)
    bare = Hypothesis(1, 0, (number,), theta)
    starts = held(stage, plant(bare, stage, den, np.array([2.0 * den[-1]])), number)
    assert starts
    for h in starts:
        (friction,) = (stage.slots[k] for k in h.active)
        assert friction.cause == "coulomb_friction"
        level, more, worn = h.theta[list(friction.index)]
        assert level == pytest.approx(0.1) and 0.0 < more < level and worn == 0.0
        assert h.order == "P3Z0" and h.num[-1] / h.den[-1] == pytest.approx(2.0)
        poles = np.roots(h.den) * stage.pace
        assert np.any(np.isclose(poles, -2.0)) and np.sum(poles.imag != 0.0) == 2
    both = Hypothesis(1, 0, (number, *starts[0].active), theta)
    others = held(stage, plant(both, stage, den, np.array([2.0 * den[-1]])), number)
    assert not any(set(h.active) == set(starts[0].active) for h in others)  # it is there already
    one = Hypothesis(1, 0, (number,), theta)
    assert held(stage, plant(one, stage, np.array([1.0, 1.0]), np.ones(1)), number) == []


def test_what_swings_on_is_taken_from_a_plant_unless_nothing_would_be_left(stage):
    """As of an oven between two points, which swings by itself."""
    swing, den = [-1e-3 + 3.0j, -1e-3 - 3.0j], np.poly([-8.0 / stage.pace])
    alone = made(stage, swing, [], 1.0)
    assert stilled(stage, alone) is alone
    told = stilled(stage, made(stage, [*swing, -8.0], [], 1.0))
    assert told.den == pytest.approx(den, rel=1e-6)


def test_a_plant_that_is_nothing_but_what_lingers_is_left_as_it_is(stage):
    assert levelled(stage, made(stage, [-0.02], [-0.03], 1.0)) == []
