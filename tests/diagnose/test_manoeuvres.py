"""What to drive next, for two causes that a log does not tell apart."""

import re
from dataclasses import replace

import numpy as np
import pytest

import vdmsi_jax as vj
from vdmsi_jax.diagnose.actuator import manoeuvres
from vdmsi_jax.diagnose.actuator.hypothesis import Hypothesis, Refit
from vdmsi_jax.diagnose.actuator.manoeuvres import APART, better
from vdmsi_jax.diagnose.actuator.refit import refit
from vdmsi_jax.diagnose.actuator.stage import Stage
from vdmsi_jax.diagnose.prepare import stage_of
from vdmsi_jax.diagnose.signals.runs import lay_out
from vdmsi_jax.effects import ACTUATOR, SENSOR, VEHICLE

DT, ROWS = 0.02, 1500
PLANT = vj.PlantSpec("motor", "u", "y")


def fitted(*, again: bool) -> tuple[Stage, Refit, Refit]:
    """A motor with a dead zone that is always driven one way, its fits by a dead zone and by an
    offset; of three logs two have the same commands, or none."""
    records = []
    for run in range(3):
        rng = np.random.default_rng(0 if again and run == 1 else run)
        u = np.repeat(rng.uniform(0.3, 1.0, ROWS // 30), 30)
        y, now, noise = [], 0.0, np.random.default_rng(10 + run)
        for command in u:
            y.append(now)
            now += DT / 0.2 * (max(command - 0.1, 0.0) - now)
        y = np.asarray(y) + 0.01 * noise.standard_normal(ROWS)
        records.append(vj.Record.from_arrays(dt=DT, name=f"{run}", plants=(PLANT,), u=u, y=y))
    stage = stage_of(lay_out(records), PLANT).fitting
    starts = []
    for cause, size in (("dead_zone", 0.1), ("offset", -0.1)):
        number = next(k for k in stage.allowed if stage.slots[k].cause == cause)
        theta = stage.off.copy()
        theta[0], theta[4] = 1.0 / (0.2 * stage.pace), 1.0 / (0.2 * stage.pace)
        theta[stage.slots[number].index[0]] = size
        starts.append(Hypothesis(1, 0, (number,), theta))
    zone, offset = refit(stage, starts)
    return stage, zone, offset


def told(text: str) -> float:
    found = re.search(r"λ = ([0-9.]+)", text)
    assert found is not None
    return float(found[1])


def test_a_release_tells_a_dead_zone_from_an_offset():
    stage, zone, offset = fitted(again=False)
    text = manoeuvres.separate(stage, zone, offset)
    assert text.startswith("full command, then release and coast down") and told(text) > 1000.0


def test_a_repeat_doubles_what_the_logs_tell_unless_they_are_one(monkeypatch):
    stage, zone, offset = fitted(again=False)
    monkeypatch.setattr(manoeuvres, "CATALOGUE", ())
    monkeypatch.setattr(manoeuvres, "NEEDED", 0.0)
    text = manoeuvres.separate(stage, zone, offset)
    assert text.startswith("the same drives once more")
    wider = stage.u - 0.65  # both signs
    moved = replace(stage, u=wider)
    more = told(manoeuvres.separate(moved, zone, offset))
    assert more > 100.0
    first = np.arange(len(stage.u)) == 0
    half = replace(moved, mask=stage.mask & first[:, None])
    assert told(manoeuvres.separate(half, zone, offset)) == pytest.approx(0.5 * more, rel=0.3)


def test_where_the_logs_hold_a_repeat_another_is_not_advised():
    stage, zone, offset = fitted(again=True)
    assert stage.noise.by == "repeat"
    assert "once more" not in manoeuvres.separate(stage, zone, offset)


@pytest.mark.parametrize("pair", APART, ids=lambda pair: "-".join(sorted(pair)))
def test_what_separates_two_causes_is_said_of_both(pair):
    one, other = (
        next(e for e in ACTUATOR + VEHICLE + SENSOR if e.cause == cause) for cause in sorted(pair)
    )
    assert better(one, ["resonance", other.cause]) == better(other, [one.cause]) == APART[pair]
    assert better(one, []) == better(one, ["resonance"]) == one.shown_by
