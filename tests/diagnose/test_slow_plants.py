"""Causes of tanks and heaters, whose samples are seconds apart, in logs made by plain NumPy."""

import numpy as np
import pytest

import vdmsi_jax as vj
from vdmsi_jax.diagnose.actuator.starts import first_order, nested, plant
from vdmsi_jax.diagnose.prepare import stage_of
from vdmsi_jax.diagnose.signals.runs import lay_out


def tanks(seed: int, *, cascaded: bool = False, rim: float = np.inf, dt: float = 4.0):
    """Three logs of a tank that drains by the root of its level, or of the lower of two in cascade
    whose rims spill, that of the upper one into the lower; times in s, the sensor with white noise
    beside some that wanders."""
    made, h = [], 0.1
    for run in range(3):
        rng = np.random.default_rng(10 * seed + run)
        u = np.repeat(rng.uniform(1.0, 4.5 if cascaded else 3.0, 90), 10)
        upper = lower = 2.0
        y, wander = np.empty(u.size), 0.0
        for k, command in enumerate(u):
            wander += 0.1 * (-wander + 0.05 * rng.standard_normal())
            y[k] = lower + wander
            for _ in range(round(dt / h)):
                filled = 0.05 * command
                if cascaded:
                    upper += h * (filled - 0.054 * np.sqrt(max(upper, 0.0)))
                    spilt, upper = max(upper - rim, 0.0), min(upper, rim)
                    filled = 0.054 * np.sqrt(max(upper, 0.0)) + 0.3 * spilt / h
                lower += h * (filled - 0.05 * np.sqrt(max(lower, 0.0)))
                lower = min(lower, rim)
        y += 0.02 * rng.standard_normal(u.size)
        plant = vj.PlantSpec("tank", "u", "y")
        made.append(vj.Record.from_arrays(dt=dt, name=f"run_{run}", plants=(plant,), u=u, y=y))
    return made


def test_a_tank_that_drains_by_the_root_of_its_level_is_told_by_the_exponent():
    found = vj.diagnose(tanks(1))
    (finding,) = found.findings
    assert finding.cause == "gain_nonlinearity" and "power" in finding.form
    assert finding.parameters["bend"].value == pytest.approx(-0.5, abs=0.05)
    assert found.extended["y"].fit > found.channels["y"].fit + 3.0


@pytest.mark.slow
def test_noise_of_its_own_colour_takes_a_rim_for_what_wanders_and_brief_noise_does_not():
    """Two tanks in cascade that spill, which no cause of the library quite is."""
    found = vj.diagnose(tanks(1, cascaded=True, rim=9.0))
    assert "saturation" in [f.cause for f in found.findings]
    taken = 1.0 - found.extended["y"].mse / found.channels["y"].mse
    assert taken > 0.5


def test_samples_that_are_far_apart_in_time_are_judged_all_the_same():
    """A heater of an hour, looked at every 20 s."""
    made = []
    for run in range(2):
        rng = np.random.default_rng(run)
        u, y = np.repeat(rng.uniform(0.0, 1.0, 12), 50), np.empty(600)
        inner = outer = u[0]
        for k, command in enumerate(u):
            y[k] = outer
            inner += 20.0 / 300.0 * (command - inner)
            outer += 20.0 / 1500.0 * (inner - outer)
        y += 0.005 * rng.standard_normal(600)
        plant = vj.PlantSpec("heater", "u", "y")
        made.append(vj.Record.from_arrays(dt=20.0, name=f"run_{run}", plants=(plant,), u=u, y=y))
    found = vj.diagnose(made)
    assert found.verdict == "no_effect" and found.channels["y"].fit > 90.0


def logs_of(make, name: str, dt: float, count: int = 2) -> list[vj.Record]:
    """Of a plant: `make(rng)` gives its command and what it answers."""
    spec, made = vj.PlantSpec(name, "u", "y"), []
    for run in range(count):
        u, y = make(np.random.default_rng(run))
        made.append(vj.Record.from_arrays(dt=dt, name=f"run_{run}", plants=(spec,), u=u, y=y))
    return made


def test_a_plate_that_heats_faster_than_it_cools_has_no_other_gain():
    """Heat comes and goes by other ways, and where it rests it is the same: 18 s and 76 s."""

    def plate(rng):
        u, y, x = np.repeat(rng.uniform(20.0, 80.0, 25), 50), np.empty(1250), 50.0
        for k, command in enumerate(u):
            y[k] = x
            for _ in range(10):
                x += 0.1 * (command - x) / (18.0 if command > x else 76.0)
        return u, y + 0.3 * rng.standard_normal(y.size)

    found = vj.diagnose(logs_of(plate, "plate", 1.0))
    assert found.verdict == "unexplained_structure" and not found.findings
    assert any("differs up and down" in u.test for u in found.unexplained)


@pytest.mark.parametrize("hidden", [3.0, 20.0, 150.0])
def test_a_lag_before_a_tank_that_outlasts_the_log_has_a_start_near_by(hidden):
    """Steps from the tank's own pole alone would end beside it."""
    (record,) = logs_of(
        lambda rng: (rng.uniform(0.0, 1.0, 900), rng.uniform(0.0, 1.0, 900)), "tank", 1.0, 1
    )
    stage = stage_of(lay_out([record]), record.plants[0])
    slow = 1.0 / (900.0 * stage.pace)
    tank = plant(first_order(stage)[0], stage, np.array([1.0, slow]), np.array([slow]))
    starts = [h for h in nested(stage, tank) if h.zeros == 0]
    offered = [float(np.abs(np.roots(h.den)).max() * stage.pace) for h in starts]
    assert min(abs(np.log(p * hidden)) for p in offered) < np.log(2.5)


@pytest.mark.parametrize("fouls", [False, True])
def test_the_warmth_of_a_room_is_no_cause_and_hides_none(fouls):
    """An exchanger far from zero, whose gain falls by a third within each log. A pole that outlasts
    them would tell the level by its start, and take what drifts."""

    def exchanger(rng):
        u, y, inner, outer = np.repeat(rng.uniform(-1.0, 1.0, 20), 80), np.empty(1600), 0.5, 0.5
        for k, command in enumerate(u):
            y[k] = 313.0 + 6.0 * outer
            gain = 1.0 - fouls * k / 4800.0
            for _ in range(10):
                inner += 0.5 / 30.0 * (gain * command - inner)
                outer += 0.5 / 90.0 * (inner - outer)
        return u, y + 0.1 * rng.standard_normal(y.size)

    found = vj.diagnose(logs_of(exchanger, "exchanger", 5.0, 3))
    assert [f.cause for f in found.findings] == ["gain_drift"] * fouls
    assert found.verdict == ("explained" if fouls else "no_effect")
    assert not found.small
    if fouls:
        (level,) = found.levels
        assert level.parameters["bias"].value == pytest.approx(313.0, abs=0.2)
        assert "rests at 313" in found.summary
        rate = found.findings[0].parameters["rate"].value
        assert rate == pytest.approx(-1.0 / 3.0 / 8000.0, rel=0.1)
