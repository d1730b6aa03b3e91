"""Which causes are looked for in a stage, by what its signals can show."""

import numpy as np
import pytest

from vdmsi_jax.config import PlantSpec
from vdmsi_jax.data.record import Record, Segment
from vdmsi_jax.diagnose.prepare import kind, stage_of
from vdmsi_jax.diagnose.runs import lay_out

T = 0.05 * np.arange(600)


def looked_for(command: np.ndarray) -> set[str]:
    response = np.convolve(command, 0.1 * 0.9 ** np.arange(60))[: T.size]
    channels, units = {"u": command, "y": response}, {"u": "V", "y": "V"}
    record = Record("log", 0.05, T, channels, units, (Segment(0, T.size),))
    stage = stage_of(lay_out([record]), PlantSpec("plant", "u", "y"))
    return {kind(stage.effects[i]) for i in stage.allowed}


@pytest.mark.parametrize(
    ("middle", "zone", "late"), [(0.0, True, True), (1.2, True, False), (9.0, False, False)]
)
def test_a_dead_zone_is_looked_for_where_the_command_may_enter_one(middle, zone, late):
    causes = looked_for(middle + np.sin(2.0 * T) * np.where(T > 15.0, 0.5, 1.0))
    assert ("dead_zone at command" in causes) is zone
    assert ("dead_zone at spool" in causes) is late
    assert "offset" in {c.split()[0] for c in causes}
