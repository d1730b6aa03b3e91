"""The public logs: each is read with the configuration that the project ships, and means what it
should.

The floors are those of the data's own README: a free run of gain, offset, one lag and a delay, here
by a plain search. They fail when a channel is scaled, signed, shifted or cut wrongly.
"""

import json

import numpy as np
import pytest

from vdmsi_jax.data import DATASETS, data_folder, find_log, locate, read_log
from vdmsi_jax.errors import InputError

LOGS = [(name, log) for name, dataset in DATASETS.items() for log in dataset.logs]


@pytest.fixture(autouse=True)
def at_hand(shared_data, monkeypatch):
    monkeypatch.setenv("VDMSI_DATA", str(shared_data))


@pytest.mark.parametrize(("name", "log"), LOGS)
def test_every_log_is_read(name, log):
    path, config = locate(name, log)
    record = read_log(path, config)
    described = json.loads(path.with_suffix(".json").read_text())
    assert record.plants
    if "sampling_hz" in described:
        assert record.dt == pytest.approx(1.0 / described["sampling_hz"], rel=0.03)
    assert described.get("commit", "")[:8] in DATASETS[name].commit
    assert described["source_repo"].split()[0].rstrip("/") == DATASETS[name].repository
    assert 0.75 * described["rows"] < record.n < 1.02 * described["rows"]


VEHICLES = [(n, log) for n, log in LOGS if n in ("cpm_mucar", "f110_frictionmaps", "f1tenth_mocap")]


@pytest.mark.parametrize(("name", "log"), [*VEHICLES, ("genesis_sedan", "inner2_slow.csv")])
def test_vehicles_have_canonical_channels_that_agree(name, log):
    """Pose, speed, yaw rate and steering are measured apart and must tell of one motion."""
    record = read_log(*locate(name, log))
    assert {"v", "delta", "r", "x", "y", "psi", "a"} <= set(record.channels)
    assert record.vehicle is not None
    moved = np.concatenate([np.diff(x) for x in record.pieces("x")])
    aside = np.concatenate([np.diff(y) for y in record.pieces("y")])
    ahead = np.concatenate([v[:-1] for v in record.pieces("v")]) * record.dt
    psi = np.concatenate([p[:-1] for p in record.pieces("psi")])
    along = moved * np.cos(psi) + aside * np.sin(psi)
    assert np.sum(along * ahead) / np.sum(ahead**2) == pytest.approx(1.0, abs=0.07)
    turned = sum(p[-1] - p[0] for p in record.pieces("psi"))
    total = sum(np.sum(np.abs(np.diff(p))) for p in record.pieces("psi"))
    assert abs(record.dt * record["r"].sum() - turned) < 0.15 * total
    if "delta_cmd" in record:
        good = record.measured("delta")
        both = record["delta_cmd"][good], record["delta"][good]
        slope = np.polyfit(*both, 1)[0]
        assert np.corrcoef(*both)[0, 1] > 0.6 and 0.4 < slope < 1.1


def first_order_fit(record, plant, tau, delay):
    """FIT in percent of gain · lag · delay + offset, gain and offset by least squares."""
    step = 1.0 - np.exp(-record.dt / tau)
    lagged = []
    for u in record.pieces(plant.input):
        n = np.arange(u.size)
        held = np.interp(n - delay / record.dt, n, u)
        y, state = np.empty_like(u), held[0]
        for k, value in enumerate(held):
            y[k] = state
            state += step * (value - state)
        lagged.append(y)
    x, y = np.concatenate(lagged), record[plant.output]
    design = np.column_stack([x, np.ones_like(x)])
    error = y - design @ np.linalg.lstsq(design, y, rcond=None)[0]
    return 100.0 * (1.0 - np.linalg.norm(error) / np.linalg.norm(y - y.mean()))


FLOORS = [
    ("cpm_mucar", "run_a.csv", "powertrain", "cmd_speed_mps -> speed_mps"),
    ("cpm_mucar", "run_a.csv", "yaw", "cmd_curvature_1pm*speed_mps -> imu_yaw_rate_radps"),
    ("cpm_mucar", "run_a.csv", "motor", "act_throttle -> speed_mps"),
    ("cpm_mucar", "run_a.csv", "servo", "act_steer*speed_mps -> imu_yaw_rate_radps"),
    ("cpm_mucar", "run_b.csv", "motor", "act_throttle -> speed_mps"),
    ("cpm_mucar", "run_b.csv", "servo", "act_steer*speed_mps -> imu_yaw_rate_radps"),
    *(
        ("f110_frictionmaps", f"{log}.csv", plant, pair)
        for log in ("ds1", "ds3", "ds5")
        for plant, pair in (
            ("powertrain", "cmd_speed_mps -> odom_speed_mps"),
            ("yaw", "odom_speed*tan(cmd_steer)/0.33 -> imu_yaw_rate_radps"),
        )
    ),
    *(
        ("genesis_sedan", f"{log}.csv", "yaw", "v*tan(steer)/3.02 (v>2) -> yaw_rate")
        for log in ("cpg_slow_lap", "inner2_slow")
    ),
    ("norlab_skidsteer", "husky_unloaded.csv", "left", "cmd left wheel rad/s -> wheel_left_radps"),
    (
        "norlab_skidsteer",
        "husky_unloaded.csv",
        "right",
        "cmd right wheel rad/s -> wheel_right_radps",
    ),
    ("norlab_skidsteer", "steps_warthog_asphalt.csv", "left", "cmd_left_radps -> wheel_left_radps"),
    (
        "norlab_skidsteer",
        "steps_warthog_asphalt.csv",
        "right",
        "cmd_right_radps -> wheel_right_radps",
    ),
    ("norlab_skidsteer", "steps_warthog_asphalt.csv", "slip", "(wr-wl)*r/B -> imu_yaw_rate_radps"),
    ("ce109_hoop_motor", "fixedStepSequence.csv", "motor", "motor_command -> hoop_speed_V"),
]


@pytest.mark.parametrize(("name", "log", "plant", "pair"), FLOORS)
def test_the_published_floor_comes_out_of_the_channels(name, log, plant, pair):
    path, config = locate(name, log)
    described = json.loads(path.with_suffix(".json").read_text())
    key = "first_order_baseline (gain+offset+lag+delay, free run, fitted on the whole run)"
    floor = described[key][pair]
    record = read_log(path, config)
    found = first_order_fit(record, record.plant(plant), floor["tau_s"], floor["delay_s"])
    # half a point for lag and delay that were printed rounded and held in another way
    assert found == pytest.approx(floor["fit_percent"], abs=1.0)


def test_the_floor_of_the_runs_from_standstill():
    """The README's mean FIT over 15 starts is 92.6, each with a lag and a delay of its own.

    The median stands for it here: in two of the runs the speed jumps at the start, and their FIT
    depends on the initial state, which this floor model does not have.
    """
    path, config = locate("f1tenth_mocap", "runs.csv")
    record = read_log(path, config.with_name("f1tenth_mocap_starts.toml"))
    assert len(record.runs) == 15 and all(v[0] < 0.05 for v in record.pieces("v"))
    plant = record.plant("powertrain")
    fits = [
        max(
            first_order_fit(record.select([run]), plant, tau, delay)
            for tau in (0.09, 0.11, 0.13)
            for delay in (0.1, 0.1125, 0.125, 0.1375)
        )
        for run in record.segments
    ]
    assert np.median(fits) == pytest.approx(92.6, abs=1.0)


def test_a_sweep_finds_its_logs_beside_it_or_among_the_sets(tmp_path, shared_data):
    (tmp_path / "mine.csv").write_text("t,v\n")
    assert find_log("mine.csv", tmp_path) == tmp_path / "mine.csv"
    assert find_log("cpm_mucar/run_a.csv", tmp_path) == shared_data / "cpm_mucar" / "run_a.csv"
    with pytest.raises(InputError, match="no such log"):
        find_log("cpm_mucar/run_z.csv", tmp_path)


def test_a_log_that_is_not_here_says_where_to_get_it(tmp_path, monkeypatch):
    monkeypatch.setenv("VDMSI_DATA", str(tmp_path))
    with pytest.raises(InputError) as caught:
        locate("cpm_mucar", "run_a.csv")
    for part in (
        "github.com/embedded-software-laboratory/cpm_lab",
        "bbab3e4b",
        "MIT",
        "VDMSI_DATA",
    ):
        assert part in str(caught.value)
    with pytest.raises(InputError, match="did you mean 'cpm_mucar'"):
        locate("cpm_mucars", "run_a.csv")
    with pytest.raises(InputError, match="did you mean 'run_a.csv'"):
        locate("cpm_mucar", "run_a")
    monkeypatch.setenv("VDMSI_DATA", str(tmp_path / "nowhere"))
    assert data_folder() is None
