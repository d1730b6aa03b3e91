"""Drives and the logs that they leave."""

import numpy as np
import pytest

import vdmsi_jax as vj
from vdmsi_jax.scenarios import bend
from vdmsi_jax.testbed import ROW, Car, PoseSensor, drive, replay, vehicle_toml, write_log
from vdmsi_jax.testbed.picture import look, png


@pytest.fixture(scope="module")
def turning():
    pytest.importorskip("mujoco")
    rows = 801
    v = np.minimum(0.01 * np.arange(rows), 2.0)
    return drive(Car(), replay(v, np.full(rows, 0.2)), duration=8.0, seed=3)


def test_a_drive_is_the_same_again_and_another_seed_is_other_noise(turning):
    pytest.importorskip("mujoco")
    again, other = (
        drive(Car(), replay(turning.v_cmd, turning.delta_cmd), duration=8.0, seed=seed)
        for seed in (3, 4)
    )
    np.testing.assert_array_equal(turning.pose, again.pose)
    np.testing.assert_array_equal(turning.truth, other.truth)
    assert (turning.pose != other.pose).any()


def test_the_sensor_has_the_noise_that_is_stated(turning):
    off = (turning.pose - turning.truth[:, :3])[::2]  # its scans
    sensor = PoseSensor()
    level = np.array([sensor.place_noise, sensor.place_noise, sensor.heading_noise])
    np.testing.assert_allclose(off.std(axis=0), level, rtol=0.2)


def test_who_steers_hears_of_a_pose_after_its_latency():
    pytest.importorskip("mujoco")
    rows = []

    def driver(k, seen):
        rows.append(k - seen.row)
        return 1.0, 0.0

    drive(Car(), driver, duration=1.0, seed=0)
    assert set(rows[10:]) == {5, 6}  # 50 ms, and the row between two scans


def test_a_log_is_read_and_derives_what_the_car_did(turning, tmp_path):
    (tmp_path / "vehicle.toml").write_text(vehicle_toml(Car()))
    write_log(tmp_path / "log.csv", turning.log())
    record = vj.read_log(tmp_path / "log.csv")
    settled = slice(400, None)
    for column, channel in ((3, "v"), (4, "r"), (5, "delta")):
        truth = turning.truth[settled, column]
        assert np.mean(record[channel][settled]) == pytest.approx(truth.mean(), rel=0.02)
    assert record.dt == pytest.approx(ROW)


def test_direct_channels_are_the_truth(turning):
    log = turning.log(direct=True)
    np.testing.assert_array_equal(log["v"], turning.truth[:, 3])
    assert set(log) == {"t", "v_cmd", "delta_cmd", "v", "delta", "r", "x", "y", "psi"}


def test_a_png_file_is_read_by_others(tmp_path):
    image = pytest.importorskip("PIL.Image")
    pixels = np.random.default_rng(0).integers(0, 256, (5, 7, 3), dtype=np.uint8)
    (tmp_path / "a.png").write_bytes(png(pixels))
    np.testing.assert_array_equal(np.asarray(image.open(tmp_path / "a.png")), pixels)


def test_a_picture_is_made_or_it_is_said_why_not(tmp_path):
    track = bend().at(np.linspace(0.0, 60.0, 60))[:, :2]
    refused = look(tmp_path / "look.png", track, np.array([[5.0, 0.0, 0.0, 0.1]]))
    assert (refused is None) == (tmp_path / "look.png").is_file()
