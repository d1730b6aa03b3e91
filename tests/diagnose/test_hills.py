"""Hills, which a slow line or nothing at all would be told for."""

from dataclasses import replace

import numpy as np
import pytest

import vdmsi_jax as vj
from vdmsi_jax.diagnose.actuator import hypothesis
from vdmsi_jax.diagnose.actuator.hypothesis import responses, sensitivities
from vdmsi_jax.diagnose.actuator.lanes import LEADS
from vdmsi_jax.diagnose.actuator.outcome import completed
from vdmsi_jax.diagnose.actuator.refit import refit
from vdmsi_jax.diagnose.actuator.starts import errs_slowly, hilly
from vdmsi_jax.diagnose.prepare import stage_of
from vdmsi_jax.diagnose.search.baseline import baselines
from vdmsi_jax.diagnose.search.found import Search
from vdmsi_jax.diagnose.search.search import _in_smaller_plant, search
from vdmsi_jax.diagnose.signals.runs import lay_out

POWERTRAIN = vj.PlantSpec("powertrain", "v_cmd", "v")
DT, LAG, PEDAL, FINE = 0.05, 1.2, 0.3, 20
SWELLS = ((60.0, 0.030), (170.0, -0.022), (300.0, 0.018), (430.0, -0.025))  # m, rise over run


def drive(seed: int, steepness: float) -> vj.Record:
    """A minute along the same road at speeds of its own, a millisecond or so at a time."""
    rng = np.random.default_rng(seed)
    v_cmd = np.repeat(rng.uniform(6.0, 11.0, 8), 150)
    v, drive, way, told = v_cmd[0], v_cmd[0], 0.0, []
    for wanted in v_cmd:
        told.append(v)
        for _ in range(FINE):
            rise = sum(a * np.exp(-0.5 * ((way - at) / 25.0) ** 2) for at, a in SWELLS)
            drive += DT / FINE * (wanted - drive) / PEDAL
            v += DT / FINE * ((drive - v) / LAG - 9.81 * steepness * rise)
            way += DT / FINE * v
    measured = np.array(told) + 0.04 * rng.standard_normal(len(told))
    still = np.zeros(len(v_cmd))
    return vj.Record.from_arrays(
        dt=DT, name=f"run_{seed}", vehicle=vj.VehicleGeometry(1.2, 1.3), v_cmd=v_cmd, v=measured,
        delta_cmd=still, delta=still,
    )  # fmt: skip


def stage_on(steepness: float):
    return stage_of(lay_out([drive(seed, steepness) for seed in (1, 2, 3)]), POWERTRAIN)


@pytest.fixture(scope="module")
def road():
    """Of the runs that are fitted over hills the stage, and its plants on a level road."""
    stage = stage_on(1.0).fitting
    return stage, baselines(stage)


def test_a_lead_that_moves_nothing_has_no_slope(road, monkeypatch):
    """Of a constant force: one of rounding sent the fit astray, and no hill was found."""
    stage, plants = road
    (level,) = hilly(stage, plants[2, 0].hypothesis)
    y = list(responses(stage, [level]))
    rng = np.random.default_rng(1)

    def rounded(*asked):
        exact = responses(*asked)
        return exact * (1.0 + 4e-16 * rng.standard_normal(exact.shape))

    monkeypatch.setattr(hypothesis, "responses", rounded)
    (slopes,) = sensitivities(stage, [level], y)
    lead = level.free(stage).tolist().index(LEADS[0])
    assert not slopes[lead].any()
    assert np.abs(np.delete(slopes, lead, axis=0)).max(axis=(1, 2)).min() > 0.0


def test_hills_are_fitted_from_a_level_road(road):
    stage, plants = road
    assert errs_slowly(stage, plants[2, 0])
    (fit,) = refit(stage, hilly(stage, plants[2, 0].hypothesis))
    assert fit.error(stage) < 0.15 * plants[2, 0].error(stage)


@pytest.mark.parametrize("borne_out", [True, False])
def test_hills_that_fail_in_a_large_plant_are_asked_of_a_smaller_one(road, borne_out):
    """If data held out bear them out: a large plant may have learnt what they do."""
    stage, plants = road
    (small,) = refit(stage, hilly(stage, plants[2, 0].hypothesis))
    large = replace(small, hypothesis=replace(small.hypothesis, poles=4, zeros=2))
    logs = [drive(1, 1.0), drive(2, 1.0), drive(3, 1.0 if borne_out else 0.0)]
    whole = stage_of(lay_out(logs), POWERTRAIN)
    (plain,) = completed(whole, [plants[2, 0]])
    found = Search(whole, plain, plain, plain, ())
    seen = {f.hypothesis.kind: f for f in (plants[2, 0], small, large)}
    assert _in_smaller_plant(found, large, seen) is (small if borne_out else None)
    assert _in_smaller_plant(found, small, seen) is None  # which has failed itself


@pytest.mark.slow
@pytest.mark.parametrize(("steepness", "causes"), [(1.0, ["road_grade"]), (0.0, [])])
def test_the_search_names_hills_where_there_are_some(steepness, causes):
    stage = stage_on(steepness)
    assert [stage.slots[f.number].cause for f in search(stage).findings] == causes
