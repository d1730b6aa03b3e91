"""What of logs is looked at, and what where they lack something."""

from dataclasses import replace

import numpy as np
import pytest

import vdmsi_jax as vj
from vdmsi_jax.config import PlantSpec
from vdmsi_jax.data import uncommanded
from vdmsi_jax.diagnose.diagnose import _left_out, plants_of
from vdmsi_jax.diagnose.prepare import body_of, stage_of
from vdmsi_jax.diagnose.signals.contradictions import contradictions
from vdmsi_jax.diagnose.signals.runs import lay_out, slower
from vdmsi_jax.diagnose.signals.unexplained import structure
from vdmsi_jax.errors import InputError

PLANT = PlantSpec("plant", "u", "y")
CAR = vj.VehicleGeometry(1.0, 1.0)


def lagged(u, keep=0.9):
    y = np.zeros_like(u)
    for k in range(1, u.size):
        y[k] = keep * y[k - 1] + (1.0 - keep) * u[k - 1]
    return y


def plant(n, seed, name="log"):
    rng = np.random.default_rng(seed)
    u = np.repeat(rng.uniform(-1.0, 1.0, n // 25 + 1), 25)[:n]
    y = lagged(u) + 0.01 * rng.standard_normal(n)
    return vj.Record.from_arrays(dt=0.02, name=name, u=u, y=y, plants=(PLANT,))


def car(seed, n=1500, speed=4.0, name="log"):
    rng, t = np.random.default_rng(seed), 0.02 * np.arange(n)
    v = speed * (1.0 + 0.5 * np.sin(0.5 * t + seed))
    delta = 0.1 * np.sin(0.9 * t + seed)
    r = v * np.tan(delta) / 2.0
    psi = np.cumsum(r) * 0.02
    way = {"x": np.cumsum(v * np.cos(psi)) * 0.02, "y": np.cumsum(v * np.sin(psi)) * 0.02}
    noisy = {"v": v, "delta": delta, "r": r}
    noisy = {c: x + 0.002 * rng.standard_normal(n) for c, x in noisy.items()}
    commands = {"v_cmd": v, "delta_cmd": delta}
    return vj.Record.from_arrays(
        dt=0.02, name=name, vehicle=CAR, psi=psi, **way, **noisy, **commands
    )


@pytest.mark.parametrize("order", [(290, 6000), (6000, 290)])
def test_a_log_that_is_too_short_beside_another_neither_judges_nor_is_fitted(order):
    runs = lay_out([plant(n, n, f"of {n}") for n in order])

    held = runs.held()
    assert set(runs.names) == {"of 6000"}
    assert runs.judging() == ["of 6000"]
    assert 0.2 < held.mean() < 0.4


def test_a_channel_of_the_pose_that_was_hardly_measured_is_left_aside():
    records, rare = [car(1), car(2)], np.arange(1500) % 100 > 15
    filled = {c: rare for c in ("x", "y", "psi")}
    body = body_of(lay_out([replace(r, filled=filled) for r in records]), {})

    assert body is not None and set(body.measured) == {"r"}


def test_half_of_a_speed_is_none():
    records = [car(k, name=f"log {k}") for k in range(3)]
    part = records[1]
    slim = {c: x for c, x in part.channels.items() if c not in ("v", "v_cmd")}
    records[1] = replace(part, channels=slim)

    told = vj.diagnose(records)

    assert "log 1 lacks v_cmd, v: not looked at in any log." in told.unseen
    assert not any("v" in record for record in told.records)


def test_an_actuator_whose_command_was_not_logged_is_said_not_to_be_looked_at():
    records = [car(k) for k in range(2)]
    names = {c: "steer_cmd" if c == "delta_cmd" else c for c in records[0].channels}
    other = [
        replace(r, channels={names[c]: x for c, x in r.channels.items()}, plants=r.plants[:1])
        for r in records
    ]
    (told,) = uncommanded(other, plants_of(other))
    assert told.startswith("The steering was not looked at") and "delta_cmd" in told
    assert uncommanded(records, plants_of(records)) == []


def test_logs_that_are_left_aside_are_said_to_be():
    records = [plant(2000, 1, "long"), plant(45, 2, "short"), plant(2000, 3, "long too")]
    runs = lay_out(records)
    assert _left_out(records, runs) == [
        "Not looked at: short, which is much shorter than the others, or more than are looked at."
    ]
    assert _left_out(records[::2], runs) == []


def test_a_robot_that_creeps_steers_too():
    record = car(3, speed=0.15)
    slim = {c: x for c, x in record.channels.items() if c not in ("delta", "x", "y", "psi")}
    runs = lay_out([replace(record, channels=slim)])

    stage = stage_of(runs, PlantSpec("steering", "delta_cmd", "delta"))

    known = stage.mask | stage.held_out
    assert known.mean() > 0.5
    assert np.corrcoef(stage.y[known], stage.u[known])[0, 1] > 0.9


def test_too_few_samples_to_fit_are_said_to_be():
    record = car(4)
    record = replace(record, filled={"delta": np.arange(1500) > 20})
    with pytest.raises(InputError, match="samples of delta to fit"):
        stage_of(lay_out([record]), PlantSpec("steering", "delta_cmd", "delta"))


def test_the_command_of_a_plant_is_averaged_over_longer_rows_whatever_its_name():
    throttle = np.tile([0.0, 1.0], 500)
    drive = (PlantSpec("powertrain", "throttle", "v"),)
    record = vj.Record.from_arrays(
        dt=0.01, vehicle=CAR, plants=drive, throttle=throttle, v=throttle
    )
    assert slower(record)["throttle"] == pytest.approx(np.full(500, 0.5))
    brief = vj.Record.from_arrays(dt=0.001, vehicle=CAR, v_cmd=throttle[:15], v=throttle[:15])
    with pytest.raises(InputError, match="no stretch without a gap has 20 samples"):
        slower(brief)


def test_the_moment_of_an_event_is_that_in_its_run():
    rng, t = np.random.default_rng(6), 0.02 * np.arange(12_500)
    e = 0.01 * rng.standard_normal(t.size)
    e[(t >= 200.0) & (t < 201.0)] += rng.standard_normal(50)
    runs = lay_out([replace(plant(t.size, 6), channels={"u": np.sin(t), "y": e})])
    y, seen, held = runs.channel("y"), runs.seen("y"), runs.held()

    found = structure("y", y, y, seen & ~held, seen & held, runs.begins, runs.dt)

    moments = [when for left in found for when in left.when]
    assert moments and all(198.0 < start < 202.0 for _, start, _ in moments)


def test_samples_that_were_filled_contradict_nothing():
    record = car(7)
    gone = np.arange(1500) % 100 < 70
    off = np.where(gone, 1.5 * record["r"], record["r"])
    record = replace(record, channels=record.channels | {"r": off})
    assert contradictions([record], [])
    assert not contradictions([replace(record, filled={"r": gone})], [])
