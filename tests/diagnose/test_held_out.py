"""Which logs judge: those whose commands the others cover."""

import numpy as np
import pytest

import vdmsi_jax as vj
from vdmsi_jax.diagnose.signals.held_out import judges
from vdmsi_jax.diagnose.signals.runs import lay_out

DT, ROWS = 0.05, 1200
T = DT * np.arange(ROWS)
GEOMETRY = vj.VehicleGeometry(1.0, 1.0)


def steps(seed, size=1.0, hold=30):
    levels = np.random.default_rng(seed).uniform(-size, size, ROWS // hold + 1)
    return np.repeat(levels, hold)[:ROWS]


SLALOM = 1.2 * np.sin(2.0 * np.pi * 0.1 * T)
STILL = np.full(ROWS, 0.3)


def logs(*angles, speeds=None):
    speeds = speeds or [3.0 + steps(90 + k) for k in range(len(angles))]
    return [
        vj.Record.from_arrays(
            dt=DT, name=f"run_{k}", vehicle=GEOMETRY, v_cmd=v, delta_cmd=delta, v=v, delta=delta
        )
        for k, (v, delta) in enumerate(zip(speeds, angles, strict=True))
    ]


def test_the_last_third_judges_where_the_others_cover_it():
    assert judges(logs(steps(1), steps(2), steps(3))) == {2}
    assert judges(logs(*(steps(k) for k in range(6)))) == {4, 5}
    assert judges(logs(steps(1), SLALOM)) == {1}


def test_steps_teach_and_a_slow_slalom_judges():
    assert judges(logs(SLALOM, steps(1))) == {0}
    assert judges(logs(steps(1), steps(2, size=3.0))) == {0}


def test_a_log_that_hardly_moves_judges_nothing():
    assert judges(logs(steps(1), steps(2), STILL)) != {2}


def test_of_many_logs_too_another_third_is_found():
    assert judges(logs(*(SLALOM for _ in range(6)), steps(1), steps(2))) == {0, 1, 2}


def test_speeds_that_were_measured_are_driving_too():
    def told(name, v):
        return vj.Record.from_arrays(
            dt=DT, name=name, vehicle=GEOMETRY, v=v, delta=0.1 * SLALOM, r=0.05 * v * SLALOM
        )

    slow, fast = 5.0 + 0.5 * steps(1), 10.0 + 0.5 * steps(2)
    fast[:20] = np.linspace(2.0, 10.0, 20)  # it passes the other's speeds as it sets off
    assert judges([told("fast", fast), told("slow", slow)]) is None
    assert judges([told("fast", fast), told("again", 10.0 + 0.5 * steps(3))]) == {1}


def test_where_each_log_is_of_a_kind_of_its_own_each_gives_a_part():
    fast_steering = logs(SLALOM, steps(1), speeds=[3.0 + steps(5), 3.0 + SLALOM])
    assert judges(fast_steering) is None
    runs = lay_out(fast_steering)
    assert all(len(spans) == 3 for spans in runs.judged)
    assert runs.held().mean() == pytest.approx(0.3, abs=0.01)


def test_a_single_log_has_nothing_whole_to_hold_out():
    assert judges(logs(steps(1))) is None


def test_parts_judge_in_which_the_command_moves():
    def moving(*blocks):
        return np.sum([T > DT * (120 * k + 60) for k in blocks], axis=0) * 0.2

    def first_of_parts(*angles):
        runs = lay_out(logs(*angles, speeds=[3.0 + steps(5)] * len(angles)), whole=False)
        return [spans[0][0] // 120 for spans in runs.judged]

    assert first_of_parts(steps(1)) == [2]
    assert first_of_parts(moving(0, 3, 6, 7)) == [3]  # would rest in the usual ones
    assert first_of_parts(moving(0, 1, 4, 6)) == [1]
    assert first_of_parts(moving(2, 4, 6, 8, 9)) == [2]
    # of several that move only where the usual ones are not, one judges and others teach
    assert sorted(first_of_parts(*[moving(3, 6, 9)] * 3)) == [2, 2, 3]
    (others,) = lay_out(logs(moving(0, 3, 6, 7)), whole=False, others=True).judged
    assert others[0][0] != 360
