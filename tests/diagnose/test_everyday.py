"""What every vehicle, plant or bus has."""

from dataclasses import replace

import numpy as np
import pytest

import made_up_diagnosis
from vdmsi_jax.data.record import Record, Segment
from vdmsi_jax.diagnose.answer.result import Estimate, Finding, Gain
from vdmsi_jax.diagnose.findings.everyday import is_everyday
from weighed_causes import RUNS, finding, gain


@pytest.mark.parametrize(("hertz", "nothing"), [(0.02, True), (0.5, False)])
def test_a_mode_swings_a_few_times_or_is_any_slow_error(hertz, nothing):
    seen = {"frequency": Estimate(hertz, 1e-4, "Hz"), "damping": Estimate(0.05, 0.01, "1")}
    mode = replace(
        made_up_diagnosis.siso().findings[0], cause="resonance", parameters=seen, gain=gain(0.4)
    )
    assert is_everyday(mode, RUNS, 0.35) is nothing


@pytest.mark.parametrize(("std", "nothing"), [(0.1, False), (0.3, True)])
def test_a_line_has_a_frequency_that_is_told_to_a_part_of_a_swing(std, nothing):
    """Wind has none: it swings in one run as it does not in another."""
    longest = RUNS.length * RUNS.dt
    seen = {"frequency": Estimate(8.0 / longest, std / longest, "Hz")}
    line = replace(finding("periodic_disturbance", 0.4), parameters=seen, gain=gain(0.4))
    assert is_everyday(line, RUNS, 0.4) is nothing


def of_a_car(cause: str, where: str, value: float, points: float, **more) -> Finding:
    """A finding of a car at 2 m/s, worth so many points of FIT."""
    worth = Gain("v", 96.0, 96.0 + points, 0.01, mse_before=1.0, mse_after=0.85, **more)
    seen = {"one": Estimate(value, 0.1 * abs(value), "1")}
    found = made_up_diagnosis.siso().findings[0]
    found = replace(found, cause=cause, where=where, parameters=seen, gain=worth, share=0.15)
    return replace(found, statistic=500.0)


TIME = RUNS.dt * np.arange(2000)
CAR = Record("run", RUNS.dt, TIME, {"v": np.full(2000, 2.0)}, {"v": "m/s"}, (Segment(0, 2000),))
DRIVES = replace(RUNS, records=(CAR,))


@pytest.mark.parametrize(
    ("points", "path", "nothing"),
    [(0.2, (1.0, 1.0), True), (0.2, (1.0, 0.5), False), (2.0, (1.0, 1.0), False)],
    ids=["as every vehicle", "on the road it matters", "much"],
)
def test_a_speed_that_falls_a_little_in_bends_is_every_vehicle_s(points, path, nothing):
    on_the_road = {"ate_before": path[0], "ate_after": path[1]}
    found = of_a_car("cross_coupling", "powertrain", 0.02, points, **on_the_road)
    assert is_everyday(found, DRIVES, 0.0) is nothing
    assert not is_everyday(replace(found, share=0.6), DRIVES, 0.0)


@pytest.mark.parametrize(("gradient", "nothing"), [(-0.002, True), (0.01, False)])
def test_a_body_that_turns_the_same_but_for_a_per_cent_does_not_understeer(gradient, nothing):
    found = of_a_car("understeer", "vehicle", gradient, 0.1)
    assert is_everyday(found, DRIVES, 0.0) is nothing


@pytest.mark.parametrize("cause", ["geometry_scale", "speed_scale"])
@pytest.mark.parametrize(
    ("scale", "points", "nothing"), [(-0.002, 0.1, True), (0.02, 0.1, False), (0.008, 0.5, False)]
)
def test_no_base_or_wheel_is_known_better_than_to_a_per_cent(cause, scale, points, nothing):
    assert is_everyday(of_a_car(cause, "vehicle", scale, points), DRIVES, 0.0) is nothing


@pytest.mark.parametrize(
    ("where", "statistic", "after", "nothing"),
    [
        ("vehicle", 40.0, 98.4, True),
        ("vehicle", 400.0, 98.4, False),
        ("vehicle", 40.0, 99.0, False),
        ("steering", 40.0, 98.4, False),
    ],
)
def test_a_body_that_is_slightly_another_is_every_vehicle(where, statistic, after, nothing):
    own = Gain("psi", 98.3, after, 0.1, mse_before=0.03, mse_after=0.025)
    seen = {"scale": Estimate(-0.012, 0.0005, "1")}
    told = replace(finding("speed_scale", 0.2), where=where, parameters=seen, gain=own)
    assert is_everyday(replace(told, statistic=statistic), RUNS, 0.0) is nothing
