"""Comparisons against a vehicle integrated here, sample by sample, without the library."""

import dataclasses

import numpy as np
import pytest

from vdmsi_jax.compare import compare, write_trajectories
from vdmsi_jax.config import PlantSpec, VehicleGeometry
from vdmsi_jax.data.record import Record
from vdmsi_jax.errors import InputError
from vdmsi_jax.model_file import Model, Plant
from vdmsi_jax.models.transfer_function import TransferFunction

DT, FINE = 0.02, 40  # s; steps of the integration per sample
RATE = 5.0  # rad/s, of the steering lag
L_F, L_R = 1.0, 1.5
NEAR = 4e-3  # m; Euler at 0.5 ms drifts by 1 to 2.3 mm over 40 s


def drive(n: int = 2000, seed: int = 0, *, ahead: float = L_R, start: float = 0.0) -> dict:
    """A vehicle at the commanded speed whose wheel lags; pose and speed are those of a point
    `ahead` of the rear axle."""
    rng = np.random.default_rng(seed)
    command = np.repeat(rng.uniform(-0.3, 0.3, n // 100 + 1), 100)[:n]
    speed = np.repeat(rng.uniform(1.0, 4.0, n // 500 + 1), 500)[:n]
    rows, delta, x, y, psi = [], start, 3.0, -2.0, 0.7
    for k in range(n):
        rows.append((delta, x, y, psi))
        for _ in range(FINE):
            h = DT / FINE
            slip = np.arctan(ahead / (L_F + L_R) * np.tan(delta))
            x += h * speed[k] * np.cos(psi + slip)
            y += h * speed[k] * np.sin(psi + slip)
            psi += h * speed[k] * np.cos(slip) * np.tan(delta) / (L_F + L_R)
            delta += h * RATE * (command[k] - delta)
    delta, x, y, psi = np.array(rows).T
    return dict(v_cmd=speed, delta_cmd=command, v=speed, delta=delta, x=x, y=y, psi=psi)


def record(channels: dict, **options) -> Record:
    vehicle = VehicleGeometry(L_F, L_R, **options)
    return Record.from_arrays(dt=DT, name="drive", vehicle=vehicle, **channels)


@pytest.fixture(scope="module")
def model() -> Model:
    lag = Plant(PlantSpec("steering", "delta_cmd", "delta"), TransferFunction([RATE], [1.0, RATE]))
    return Model({"steering": lag})


@pytest.mark.parametrize(
    ("ahead", "options"),
    [
        (L_R, {}),
        (0.0, {"reference_point": "rear_axle"}),
        (L_R + 0.4, {"reference_point": "sensor", "lever_arm": 0.4}),
    ],
)
def test_the_true_model_meets_the_measured_path_at_any_reference_point(model, ahead, options):
    comparison = compare(record(drive(ahead=ahead), **options), model)
    vdm, vdm_si = comparison.predictions.values()
    assert vdm_si.whole.ate["max"] < NEAR
    assert vdm_si.windows.ate["max"] < NEAR
    assert vdm_si.scores["delta"].fit > 99.9
    assert vdm.whole.ate["mean"] > 50 * NEAR
    assert vdm.aligned["mean"] < vdm.whole.ate["mean"]


def test_a_plant_starts_where_the_measurement_starts(model):
    rolling = drive(start=-0.3)
    assert abs(rolling["delta_cmd"][0] - rolling["delta"][0]) > 0.3
    vdm_si = compare(record(rolling), model).predictions["VDM-SI"]
    assert vdm_si.channels["delta"][0] == pytest.approx(-0.3, abs=1e-3)
    assert vdm_si.whole.ate["max"] < NEAR


def test_windows_start_anew_at_the_measured_pose(model):
    log = record(drive())
    window = 10.0
    vdm = compare(log, model, window=window).predictions["VDM"]
    samples = round(window / DT)
    for start in range(0, log.n, samples):
        assert vdm.windows.translation[start] == pytest.approx(0.0, abs=1e-12)
        alone = compare(log.between(start * DT, (start + samples) * DT), model)
        np.testing.assert_allclose(
            vdm.windows.translation[start : start + samples],
            alone.predictions["VDM"].whole.translation,
            atol=1e-9,
        )


def test_every_segment_starts_at_its_own_measured_pose(model):
    parts = [record(drive(n=700, seed=1)), record(drive(n=500, seed=2))]
    both = compare(Record.concatenate(parts), model).predictions["VDM"]
    alone = [compare(part, model).predictions["VDM"].whole.translation for part in parts]
    np.testing.assert_allclose(both.whole.translation, np.concatenate(alone), atol=1e-9)
    assert both.aligned is None, "one rigid motion for two runs means nothing"


def test_the_floor_is_what_the_bicycle_gets_wrong(model):
    log = record(drive())
    comparison = compare(log, model)
    # Only that the angle is held between rows where it moved: centimetres after 40 s.
    assert comparison.floor.whole.ate["max"] < 0.2
    slippery = dict(log.channels) | {"x": 1.05 * log["x"], "y": 1.05 * log["y"]}
    worse = compare(record(slippery), model).floor
    assert worse.whole.ate["mean"] > 5 * comparison.floor.whole.ate["mean"]


def test_a_single_actuator_is_compared_by_its_response(model, tmp_path):
    channels = drive()
    log = Record.from_arrays(dt=DT, delta_cmd=channels["delta_cmd"], delta=channels["delta"])
    comparison = compare(log, model)
    assert comparison.predictions["VDM-SI"].scores["delta"].fit > 99.9
    assert all(p.whole is None for p in comparison.predictions.values())
    assert comparison.floor is None
    assert write_trajectories(tmp_path, comparison) == []


def test_samples_that_were_filled_in_do_not_count(model):
    channels = drive()
    bad = channels["delta"].copy()
    bad[500:600] = 7.0
    filled = np.zeros(len(bad), bool)
    filled[500:600] = True
    log = dataclasses.replace(record(channels | {"delta": bad}), filled={"delta": filled})
    assert compare(log, model).predictions["VDM-SI"].scores["delta"].fit > 99.9


def test_a_log_without_the_models_commands_is_refused(model):
    log = Record.from_arrays(dt=DT, v_cmd=np.ones(100), v=np.ones(100))
    with pytest.raises(InputError, match="delta_cmd"):
        compare(log, model)
