"""Sentences say what the numbers say, for better and for worse."""

from dataclasses import replace

import pytest

import made_up_diagnosis
from vdmsi_jax.diagnose.answer.result import Estimate, Finding, Gain, Rival, Unexplained
from vdmsi_jax.diagnose.answer.words import apart, disturbed, sentence, summary
from vdmsi_jax.diagnose.findings.verdict import _rank


def found(before=80.0, after=90.0, share=0.5, **more) -> Finding:
    return Finding(
        cause="saturation", where="powertrain", channel=None, form="of the command",
        parameters={"upper": Estimate(1.36, 0.02, "m/s")}, statistic=300.0, p_value=0.0,
        gain=Gain("v", before, after, 0.1, 2.0, 1.0, **more), predicted_gain=None, share=share,
        rivals=(), separating_experiment=None, sentence="",
    )  # fmt: skip


def said(before, after, **more) -> str:
    return sentence(found(before, after, **more))


def test_a_finding_prints_its_sizes_and_its_gain():
    shown = "<Finding saturation (powertrain, of the command): upper 1.36 ± 0.02 m/s; FIT of v"
    assert repr(found()) == f"{shown} 80.0 to 90.0 %>"


def test_a_gain_rises_and_a_loss_falls():
    assert "FIT of v on held-out driving rises from 80.0 to 90.0 % with it" in said(80.0, 90.0)
    worse = said(33.6, 21.5, typical=0.99)
    assert "falls from 33.6 to 21.5 %" in worse
    assert "half of the stretches lose 99 % of their error" in worse


@pytest.mark.parametrize(
    ("cause", "form", "size", "told"),
    [
        ("gain_asymmetry", "by the sign of the effort", -0.496, "Pushing acts 0.504 times as"),
        ("gain_asymmetry", "by the sign of the command", 0.5, "Positive commands act 1.5 times"),
        (
            "gain_asymmetry",
            "of what pulls the response back",
            -0.3,
            "gives way to the positive side 0.7 times as far as to the negative.",
        ),
        ("speed_scale", "", -0.016, "It moves 1.6 % slower than its speed says."),
        ("geometry_scale", "", 0.14, "as if its wheelbase were 14 % longer than told."),
    ],
)
def test_a_ratio_says_which_side_is_weaker(cause, form, size, told):
    ratio = {"ratio": Estimate(size, 0.01, "1")}
    assert told in sentence(replace(found(), cause=cause, form=form, parameters=ratio))


@pytest.mark.parametrize(
    ("before", "after", "told"),
    [(2.0, 1.0, "It costs 1 m of 2 m"), (1.0, 2.0, "The path gets worse with it, from 1 to 2 m")],
)
def test_the_path_is_told_either_way(before, after, told):
    assert told in said(80.0, 90.0, ate_before=before, ate_after=after)


def test_only_what_drives_on_a_road_is_disturbed_by_its_ground():
    shaken = Unexplained("v", 0.3, (), test="12 % of its error")
    assert disturbed(shaken, True).endswith("as wind or rough ground would not.")
    assert disturbed(shaken, False).endswith("as a load from outside would not.")


def test_a_rival_of_another_sensor_says_of_which():
    lags = [Rival("sensor_lag", "sensor", 50.0, False, channel) for channel in ("r", "delta")]
    late = replace(found(), cause="sensor_delay", where="sensor", channel="r")
    assert "Ruled out: sensor lag and sensor lag of delta." in sentence(
        replace(late, rivals=tuple(lags))
    )
    assert "Ruled out: sensor lag." in sentence(replace(found(), rivals=tuple(lags[:1])))


def test_what_is_minor_says_why():
    told = replace(found(), sentence="Limited.")
    assert apart(told, "it takes little").sentence == "Limited. It stands apart: it takes little."


def test_a_summary_says_how_far_the_path_is_off_with_causes_or_none():
    """What is small in a response may be much on the way."""
    off = {which: dict.fromkeys(("max", "mean", "rmse"), 1.46) for which in ("baseline", "model")}
    none = replace(made_up_diagnosis.no_effect(), ate=off)
    assert "Mean translation error on the held-out drive: 1.46 m." in summary(none)
    told = summary(made_up_diagnosis.explained())
    assert " m without, " in told and " m with the causes." in told


def test_a_path_that_hardly_changes_is_not_spoken_of():
    assert "translation" not in said(80.0, 90.0, ate_before=1.0, ate_after=1.01)


def test_what_costs_most_on_the_road_comes_first_and_then_what_takes_most():
    dear = found(share=0.1, ate_before=1.0, ate_after=0.4)
    cheap = found(share=0.9, ate_before=1.0, ate_after=0.9)
    fitted = found(share=0.6, ate_before=1.0, ate_after=0.995)  # less than a hundredth: nothing
    without_path = found(share=0.3)
    ordered = [dear, cheap, fitted, without_path]
    assert sorted(reversed(ordered), key=_rank) == ordered
