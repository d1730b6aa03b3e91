"""By which name a cause is told."""

from dataclasses import replace

import pytest

from vdmsi_jax.diagnose.naming import Named, as_offset, merged, with_form
from vdmsi_jax.diagnose.result import Estimate, Rival


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


def test_what_is_not_known_of_a_form_widens_sizes_and_no_frequency():
    told = {"gap": Estimate(-2.0, 0.04, "rad"), "frequency": Estimate(5.0, 0.001, "Hz")}

    wider = with_form(told)

    assert wider["gap"].std == pytest.approx(0.05)
    assert wider["frequency"] == told["frequency"]
