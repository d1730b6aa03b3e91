"""What is asked again, of other parts of the logs."""

from dataclasses import replace

import pytest

import made_up_diagnosis
from vdmsi_jax.diagnose.answer.result import Diagnosis, Unexplained
from vdmsi_jax.diagnose.residual.elsewhere import only_where_judged
from vdmsi_jax.diagnose.signals.unexplained import BURSTS, WORSE


def left(*where: str, kind: str = BURSTS, size: float = 1.0) -> Unexplained:
    when = tuple((run, 1.0, 1.5) for run in where)
    return Unexplained("y", 0.2, ("t",), when, size=size, kind=kind)


def said(*unexplained: Unexplained, verdict="unexplained_structure", findings=()) -> Diagnosis:
    return replace(
        made_up_diagnosis.siso(),
        verdict=verdict,
        findings=tuple(findings),
        unexplained=tuple(unexplained),
    )


def test_structure_that_only_unseen_runs_show_is_asked_again():
    assert only_where_judged(said(left("run_3"), left(kind=WORSE)), ["run_3"])
    assert only_where_judged(said(left("run_3"), left("run_1", size=0.001)), ["run_3"])


@pytest.mark.parametrize(
    "found",
    [
        said(left("run_3", "run_1")),
        said(left(kind="")),
        said(left("run_3"), findings=made_up_diagnosis.siso().findings),
        said(left("run_3"), verdict="explained"),
    ],
    ids=["elsewhere too", "everywhere", "beside a finding", "that changes nothing"],
)
def test_other_structure_is_not(found):
    assert not only_where_judged(found, ["run_3"])
