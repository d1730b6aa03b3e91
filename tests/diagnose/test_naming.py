"""By which name a cause is told."""

from dataclasses import replace

import numpy as np
import pytest

from vdmsi_jax.diagnose.actuator.hypothesis import Hypothesis, Refit
from vdmsi_jax.diagnose.actuator.stage import Slot
from vdmsi_jax.diagnose.answer.result import Estimate, Rival
from vdmsi_jax.diagnose.findings.body_naming import as_offset, or_bank, or_wheels
from vdmsi_jax.diagnose.findings.merging import merged
from vdmsi_jax.diagnose.findings.naming import (
    Named,
    _friction,
    _same_force,
    told_unit,
    with_form,
)
from vdmsi_jax.effects.gain_nonlinearity import GainNonlinearity
from vdmsi_jax.effects.rate_limit import RateLimit
from vdmsi_jax.effects.saturation import Saturation
from vdmsi_jax.parameters import parameters


def named(cause: str, where: str, **parameters: tuple[float, float]) -> Named:
    told = {name: Estimate(*value, "rad") for name, value in parameters.items()}
    return Named(cause, where, None, "", told, 500.0, len(told), ())


BANK = replace(
    named("bank", "vehicle", slope=(0.01, 0.015), pull=(-0.018, 0.001)),
    rivals=(Rival("offset", "vehicle", 1.0, True),),
)
OFFSET = named("offset", "steering", bias=(0.0175, 0.0001))


def test_a_bank_that_only_turns_the_wheels_is_an_offset():
    told = as_offset(BANK)
    assert told.cause == "offset"
    assert told.parameters["bias"].value == -0.018
    assert [(r.cause, r.indistinguishable) for r in told.rivals] == [("bank", True)]


@pytest.mark.parametrize(
    "bank",
    [
        replace(BANK, rivals=(Rival("offset", "vehicle", 30.0, False),)),
        replace(BANK, parameters=BANK.parameters | {"slope": Estimate(0.05, 0.015, "1")}),
    ],
    ids=["told apart", "with a slope"],
)
def test_a_bank_that_is_one_stays_one(bank):
    assert as_offset(bank) is bank


def test_what_the_body_takes_back_is_the_sensors():
    (told,) = merged([OFFSET, as_offset(BANK)])
    assert (told.cause, told.where, told.channel) == ("sensor_bias", "sensor", "delta")
    other = replace(as_offset(BANK), parameters={"bias": Estimate(0.018, 0.001, "rad")})
    assert len(merged([OFFSET, other])) == 2


LATE = replace(
    named("sensor_lag", "sensor", time_constant=(0.055, 0.003)),
    channel="v",
    rivals=(Rival("sensor_delay", "sensor", 1.0, True, "v"),),
)


def test_a_lag_of_a_sensor_that_may_be_a_delay_is_that_of_its_actuator():
    delay = named("transport_delay", "powertrain", delay=(0.0545, 0.0013))
    (told,) = merged([delay, LATE])
    assert (told.cause, told.where, told.channel) == ("sensor_delay", "sensor", "v")
    assert told.parameters == delay.parameters
    # told apart from a delay, or of another size, it is one beside the actuator's
    assert len(merged([delay, replace(LATE, rivals=())])) == 2
    other = named("transport_delay", "powertrain", delay=(0.2, 0.0013))
    assert len(merged([other, LATE])) == 2


def test_what_cannot_be_told_from_a_sensors_bias_is_that_bias():
    bias = replace(named("sensor_bias", "sensor", bias=(-0.08, 0.002)), channel="v")
    weak = replace(
        named("dead_zone", "powertrain", half_width=(0.09, 0.02)),
        statistic=27.0,
        rivals=(Rival("offset", "powertrain", 1.0, True),),
    )
    (told,) = merged([weak, bias])
    assert (told.cause, told.where) == ("sensor_bias", "sensor")
    assert ("dead_zone", False) in [(r.cause, r.indistinguishable) for r in told.rivals]
    assert len(merged([replace(weak, rivals=()), bias])) == 2
    assert len(merged([replace(weak, statistic=5000.0), bias])) == 2


def test_what_is_not_known_of_a_form_widens_sizes_and_no_frequency():
    told = {"gap": Estimate(-2.0, 0.04, "rad"), "frequency": Estimate(5.0, 0.001, "Hz")}

    wider = with_form(told)

    assert wider["gap"].std == pytest.approx(0.05)
    assert wider["frequency"] == told["frequency"]


@pytest.mark.parametrize(
    ("effect", "units", "told"),
    [
        (GainNonlinearity(), ("1", "1"), ["1", "1"]),
        (GainNonlinearity(), ("rad", "rad"), ["1/rad", "1/rad^2"]),
        (RateLimit(), ("1", "1"), ["1/s", "1/s"]),
        (RateLimit(), ("1", "m/s"), ["m/s^2", "m/s^2"]),
        (Saturation(), ("1", "1"), ["1", "1"]),
    ],
)
def test_units_are_not_divided_by_one(effect, units, told):
    known = parameters(effect)
    slot = Slot(effect, "plant", tuple(range(len(known))), tuple(known), tuple(known.values()))
    assert [told_unit(slot, j, units) for j in range(len(known))] == told


@pytest.mark.parametrize(
    ("level", "more", "together", "told"),
    [
        ((0.02, 0.001), (0.001, 0.002), 0.002, {"level": 0.02}),
        ((0.02, 0.001), (0.008, 0.002), 0.002, {"level": 0.02, "static": 0.028}),
        # what hardly slides: either could be nothing, and both together not
        ((0.0004, 0.037), (0.024, 0.043), 0.005, {"level": 0.0004, "static": 0.0244}),
        ((0.0004, 0.037), (0.024, 0.043), 0.05, {"level": 0.0004}),
    ],
)
def test_the_static_level_of_friction_is_told_where_the_data_tell_it(level, more, together, told):
    shared = 0.5 * (together**2 - level[1] ** 2 - more[1] ** 2)
    covariance = np.array([[level[1] ** 2, shared], [shared, more[1] ** 2]])
    plant, rows = Hypothesis(1, 0, (0,), np.zeros(20)), np.zeros((1, 9))
    fit = Refit(plant, 0.0, rows, rows, np.zeros((9, 1)), np.zeros(3), 1.0, covariance)
    seen = {"level": Estimate(*level, "rad"), "breakaway": Estimate(*more, "rad")}
    found = _friction(seen, fit, [0, 1])
    assert {name: e.value for name, e in found.items()} == pytest.approx(told)
    if "static" in told:
        assert found["static"].std == pytest.approx(together)


@pytest.mark.parametrize(
    ("cause", "where", "parameters", "alike"),
    [
        ("drag", "powertrain", {"linear": 0.1, "quadratic": 0.02}, "coulomb_friction"),
        ("drag", "powertrain", {"linear": 0.1, "quadratic": 0.2}, None),
        ("backlash", "plant", {"gap": 0.1, "centring": 13.0}, "dead_zone"),
        ("backlash", "plant", {"gap": 0.1, "centring": 1.0}, None),
        ("backlash", "steering", {"gap": 0.1}, None),
        ("coulomb_friction", "steering", {"level": 0.1}, "backlash"),
        ("coulomb_friction", "steering", {"level": 0.1, "static": 0.11}, "backlash"),
        ("coulomb_friction", "steering", {"level": 0.1, "static": 0.12}, None),
        ("coulomb_friction", "powertrain", {"level": 0.1}, None),
    ],
)
def test_causes_that_are_the_same_force(cause, where, parameters, alike):
    """Uncertain by 0.01; the slowest time constant is 0.2 s."""
    told = {name: Estimate(value, 0.01, "1") for name, value in parameters.items()}
    assert _same_force(cause, where, told, 0.2) == alike


@pytest.mark.parametrize(("bias", "leans"), [(0.005, True), (-0.005, True), (0.02, False)])
def test_a_small_offset_of_the_wheels_may_be_a_road_that_leans(bias, leans):
    """Where no pose tells whether the vehicle slips down it; no road leans by a tenth."""
    wheels = named("offset", "vehicle", bias=(bias, 0.0001))
    assert [r.cause for r in or_bank(wheels).rivals] == ["bank"] * leans


@pytest.mark.parametrize(("cause", "alike"), [("geometry_scale", True), ("understeer", False)])
def test_another_wheelbase_may_be_other_wheels_where_no_pose_is(cause, alike):
    told = or_wheels(named(cause, "vehicle", scale=(0.05, 0.001)))
    assert [(r.cause, r.indistinguishable) for r in told.rivals] == [("speed_scale", True)] * alike
