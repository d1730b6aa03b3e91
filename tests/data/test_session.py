"""When in its session a log began."""

import numpy as np
import pytest

from vdmsi_jax.data.record import Record
from vdmsi_jax.data.session import in_session


def logs(*starts, rows=100, dt=0.1):
    return [
        Record.from_arrays(dt=dt, name=f"run_{k}", t0=t, u=np.arange(float(rows)))
        for k, t in enumerate(starts)
    ]


@pytest.mark.parametrize(
    ("starts", "begun"),
    [
        ((0.0, 12.0, 25.0), (0.0, 12.0, 25.0)),  # one clock
        ((3.0, 15.0), (0.0, 12.0)),
        ((0.0, 0.0, 0.0), (0.0, 10.0, 20.0)),  # a clock of its own each
        ((0.0, 86400.0), (0.0, 10.0)),  # another day
        ((25.0, 12.0, 0.0), (0.0, 10.0, 20.0)),  # as they are given
        ((7.0,), (0.0,)),
    ],
)
def test_logs_go_on_by_their_clocks_or_one_after_another(starts, begun):
    assert [r.session for r in in_session(logs(*starts))] == pytest.approx(list(begun))
