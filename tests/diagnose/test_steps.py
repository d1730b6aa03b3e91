"""A command that is rounded before it acts, in logs that are faster than what a search looks at."""

import jax
import numpy as np
import pytest

import vdmsi_jax as vj
from vdmsi_jax.diagnose.actuator.screen import acts_in_steps
from vdmsi_jax.diagnose.diagnose import plants_of
from vdmsi_jax.diagnose.prepare import stage_of
from vdmsi_jax.diagnose.search.baseline import baselines
from vdmsi_jax.diagnose.search.price import score
from vdmsi_jax.diagnose.signals.runs import lay_out, slower

DT, H, SECONDS = 0.01, 0.001, 40.0


def car(step: float, seed: int = 0, by=np.round, noise: float = 0.002) -> list[vj.Record]:
    """Two logs of a small car's steering at 100 Hz: what is asked for moves from row to row, is
    rounded to a step, and is followed in 30 ms."""
    rng, made = np.random.default_rng(seed), []
    t = DT * np.arange(round(SECONDS / DT))
    for run in range(2):
        hertz, phases = rng.uniform(0.1, 1.5, 8), rng.uniform(0.0, 2.0 * np.pi, 8)
        asked = np.sum(np.sin(2.0 * np.pi * hertz[:, None] * t + phases[:, None]), axis=0)
        asked = 0.3 * asked / np.abs(asked).max()
        held = by(asked / step) * step if step else asked
        at, delta = held[0], []
        for command in held:
            delta.append(at)
            for _ in range(round(DT / H)):
                at += H / 0.03 * (command - at)
        delta = np.asarray(delta) + noise * rng.standard_normal(t.size)
        vehicle = vj.VehicleGeometry(0.13, 0.13)
        made.append(
            vj.Record.from_arrays(
                dt=DT, name=f"run_{run}", vehicle=vehicle, delta_cmd=asked, delta=delta
            )
        )
    return made


def test_a_slower_record_still_knows_each_row():
    (record, _) = car(0.0)
    half = slower(record)
    np.testing.assert_array_equal(half.within["delta_cmd"].ravel(), record["delta_cmd"])
    np.testing.assert_allclose(half.within["delta_cmd"].mean(axis=1), half["delta_cmd"])
    part = half.between(1.0, 3.0)
    np.testing.assert_array_equal(part.within["delta_cmd"][:, 0], record["delta_cmd"][100:300:2])
    assert slower(half) is half and not record.within


@pytest.mark.parametrize(
    ("step", "by"), [(0.0, np.round), (0.012, np.round), (0.012, np.floor)],
    ids=["not rounded", "nearest", "down"],
)  # fmt: skip
def test_steps_that_means_of_rows_hide_are_noticed(step, by):
    with jax.enable_x64(True):
        runs = lay_out([slower(record) for record in car(step, by=by)])
        stage = stage_of(runs, plants_of(runs.records)[0]).fitting
        plain = max(baselines(stage).values(), key=lambda f: score(stage, f))
        assert acts_in_steps(stage, plain) == (step > 0.0)


@pytest.mark.slow
@pytest.mark.parametrize("step", [0.006, 0.02])
def test_a_rounded_command_is_named_with_its_step(step):
    found = vj.diagnose(car(step))
    assert [(f.cause, f.where) for f in found.findings] == [("quantization", "steering")]
    assert found.findings[0].parameters["step"].value == pytest.approx(step, rel=0.01)
    assert found.findings[0].gain.after > found.findings[0].gain.before


@pytest.mark.slow
def test_a_command_that_is_not_rounded_is_left_alone():
    assert vj.diagnose(car(0.0)).verdict == "no_effect"
