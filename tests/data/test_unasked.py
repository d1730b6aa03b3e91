"""Speed, yaw rate and steering angle of a log that holds poses alone."""

import numpy as np
import pytest

import vdmsi_jax as vj

WHEELBASE, DT = 0.5, 0.05


@pytest.fixture(scope="module")
def drive():
    """A rear-axle bicycle along steps of speed and angle, at a millisecond."""
    rng = np.random.default_rng(2)
    v_cmd, delta_cmd = (np.repeat(rng.uniform(*ends, 8), 50) for ends in ((0.8, 2.0), (-0.3, 0.3)))
    v = delta = x = y = psi = 0.0
    rows = []
    for k in range(400):
        rows.append((k * DT, v_cmd[k], delta_cmd[k], v, delta, x, y, psi))
        for _ in range(50):
            v += 0.001 / 0.4 * (v_cmd[k] - v)
            delta += 0.001 / 0.3 * (delta_cmd[k] - delta)
            x, y = x + 0.001 * v * np.cos(psi), y + 0.001 * v * np.sin(psi)
            psi += 0.001 * v * np.tan(delta) / WHEELBASE
    return np.array(rows)


def read(drive, tmp_path, columns, extra="", noise=0.0):
    names = ("t", "v_cmd", "delta_cmd", "v", "delta", "x", "y", "psi")
    table = drive + noise * np.random.default_rng(3).standard_normal(drive.shape) * (
        np.arange(len(names)) > 2
    )
    kept = [names.index(c) for c in columns]
    head = ",".join(columns)
    log, config = tmp_path / "run.csv", tmp_path / "vehicle.toml"
    np.savetxt(log, table[:, kept], delimiter=",", header=head, comments="", fmt="%.7f")
    half = 0.5 * WHEELBASE
    vehicle = f'[vehicle]\nl_f = {half}\nl_r = {half}\nreference_point = "rear_axle"\n'
    config.write_text(vehicle + extra)
    return vj.read_log(log, config=config)


POSED = ("t", "v_cmd", "delta_cmd", "x", "y", "psi")


def test_poses_alone_tell_speed_and_angle(drive, tmp_path):
    record = read(drive, tmp_path, POSED)
    assert [p.name for p in record.plants] == ["powertrain", "steering"]
    for name, column in (("v", 3), ("delta", 4)):
        use = record.measured(name)
        assert use.mean() > 0.95
        error = (record[name] - drive[:, column])[use]
        assert np.sqrt(np.mean(error**2)) < 0.05 * np.std(drive[:, column])
    assert any("derived v, r, delta from the pose" in told for told in record.repairs)


def test_noisy_poses_are_differentiated_over_longer_windows(drive, tmp_path):
    quiet, noisy = (read(drive, tmp_path, POSED, noise=n).repairs for n in (0.0, 0.02))
    said = [next(told for told in repairs if "derived v" in told) for repairs in (quiet, noisy)]
    window = [float(told.split("over ")[1].split(" s")[0]) for told in said]
    assert window[0] == pytest.approx(4 * DT) and window[0] < window[1] <= 0.5


def test_what_was_measured_or_configured_is_left_alone(drive, tmp_path):
    measured = read(drive, tmp_path, ("t", "v_cmd", "delta_cmd", "v", "delta", "x", "y", "psi"))
    assert "r" not in measured and not measured.repairs
    paired = '[[plants]]\nname = "course"\ninput = "delta_cmd"\noutput = "psi"\n'
    assert "v" not in read(drive, tmp_path, POSED, paired)


def test_logs_of_one_vehicle_are_differentiated_alike(drive, tmp_path):
    """Or else their noise would differ, which looks like a fault in some of them."""
    paths = []
    for name, noise in (("quiet", 0.0), ("noisy", 0.02)):
        (tmp_path / name).mkdir()
        read(drive, tmp_path / name, POSED, noise=noise)
        paths.append(tmp_path / name / "run.csv")
    alone = [vj.read_log(path).windows for path in paths]
    assert alone[0]["v"] < alone[1]["v"] and alone[0]["r"] < alone[1]["r"]
    assert [record.windows for record in vj.read_logs(paths)] == [alone[1]] * 2


def test_a_position_beside_a_yaw_rate_tells_a_heading(drive, tmp_path):
    """Which is no measurement, and is left alone where the log has one or nothing moves. Without
    such a rate the steering angle stands for it."""
    made = np.column_stack([drive, drive[:, 3] * np.tan(drive[:, 4]) / WHEELBASE])
    names = ("t", "v_cmd", "delta_cmd", "v", "delta", "x", "y", "psi", "r")
    log, config = tmp_path / "run.csv", tmp_path / "vehicle.toml"
    config.write_text('[vehicle]\nl_f = 0.25\nl_r = 0.25\nreference_point = "rear_axle"\n')

    def read_with(columns, dead=()):
        kept = [names.index(c) for c in columns]
        table = made[:, kept] * ~np.isin(columns, dead)
        np.savetxt(log, table, delimiter=",", header=",".join(columns), comments="", fmt="%.7f")
        return vj.read_log(log, config=config)

    without = [c for c in names if c != "psi"]
    record = read_with(without)
    assert np.abs(np.angle(np.exp(1j * (record["psi"] - made[:, 7])))).max() < 0.05
    assert not record.measured("psi").any()
    assert any("derived psi from r" in told for told in record.repairs)
    assert read_with(names).measured("psi").all()
    assert "psi" not in read_with(without, dead=["x", "y"])
    wheels = [c for c in without if c != "r"]
    for record in (read_with(without, dead=["r"]), read_with(wheels)):
        assert np.abs(np.angle(np.exp(1j * (record["psi"] - made[:, 7])))).max() < 0.05
        assert not record.measured("psi").any()
        assert any("derived psi from delta and v" in told for told in record.repairs)
    assert "psi" not in read_with([c for c in wheels if c != "delta"])
