"""Which causes are looked for in a stage, by what its signals can show."""

import numpy as np
import pytest

from vdmsi_jax.config import PlantSpec, VehicleGeometry
from vdmsi_jax.data.record import Record, Segment
from vdmsi_jax.diagnose.prepare import kind, stage_of
from vdmsi_jax.diagnose.signals.runs import lay_out

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


@pytest.mark.parametrize(
    ("spec", "role"),
    [
        (("drive", "v_cmd", "v"), "powertrain"),
        (("powertrain", "throttle", "v"), "powertrain"),
        (("drive", "throttle", "v"), "plant"),
        (("steering", "servo_cmd", "delta"), "steering"),
        (("wheels", "delta_cmd", "delta"), "steering"),
        (("yaw", "r_cmd", "r"), "plant"),
        (("steering", "r_cmd", "r"), "plant"),
    ],
)
def test_a_plant_is_what_its_channels_say(spec, role):
    assert PlantSpec(*spec).role == role


def test_the_same_causes_are_looked_for_whatever_a_plant_is_called():
    command = 5.0 + 2.0 * np.sin(2.0 * T)
    channels = {
        "v_cmd": command,
        "v": np.convolve(command, 0.1 * 0.9 ** np.arange(60))[: T.size],
        "delta_cmd": 0.2 * np.cos(T),
    }
    record = Record.from_arrays(dt=0.05, vehicle=VehicleGeometry(1.0, 1.0), **channels)
    named, drive = (
        stage_of(lay_out([record]), PlantSpec(name, "v_cmd", "v"))
        for name in ("powertrain", "drive")
    )
    assert drive.allowed == named.allowed and drive.wheres == named.wheres
    causes = {drive.effects[i].cause for i in drive.allowed}
    assert {"drag", "road_grade"} <= causes and "speed_dependent_gain" not in causes
