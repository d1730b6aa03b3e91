"""The generator of hidden causes: sound before anything is judged by it."""

import numpy as np
import pytest

from hidden.generator import CATALOGUE, OUTSIDE, SIZES, Case, generate, siso, write

SHORT = {"runs": 2, "duration": 24.0}
ALL = [(word, where) for table in (CATALOGUE, OUTSIDE) for word in table for where in table[word]]
OF_VEHICLES = [cause for cause in ALL if cause[1] != "plant"]
OF_PLANTS = [cause for cause in ALL if cause[1] == "plant"]
LEAST, MOST = 0.7, 100.0  # of the noise's standard deviation: rms change by a middle cause
BY_WHERE = {"powertrain": ("v",), "steering": ("delta",), "vehicle": ("r",), "plant": ("y",)}
BY_WORD = {"drag": ("v",), "road_grade": ("v",), "bank": ("x", "y")}
UPSTREAM = {"powertrain": {"delta"}, "steering": {"v"}, "vehicle": {"v", "delta"}, "plant": set()}


def touched(word: str, where: str) -> tuple[str, ...]:
    """Channels that must show the cause."""
    place, _, channel = where.partition(":")
    if place == "sensor":
        return ("x", "y", "psi") if channel == "pose" else (channel,)
    return BY_WORD.get(word) or BY_WHERE[place]


@pytest.fixture(scope="module")
def middle():
    """A drive for every cause at every place, each with a vehicle of its own."""
    vehicles = [Case((cause,), "middle", 100 + i, **SHORT) for i, cause in enumerate(OF_VEHICLES)]
    plants = [Case((cause,), "middle", 300 + i, **SHORT) for i, cause in enumerate(OF_PLANTS)]
    drives = generate(vehicles) + siso(plants)
    return {drive.case.cause[0]: drive for drive in drives}


def change(drive, name: str) -> float:
    """Root mean square of what the cause did to a channel, in noise standard deviations."""
    moved = [
        run[name] - clean[name] for run, clean in zip(drive.runs, drive.clean_runs, strict=True)
    ]
    return float(np.sqrt(np.mean(np.square(moved)))) / drive.truth.noise_std[name]


@pytest.mark.parametrize("cause", ALL, ids="@".join)
def test_a_cause_changes_its_channel_and_nothing_upstream(middle, cause):
    drive = middle[cause]
    shown = {name: change(drive, name) for name in drive.runs[0] if name in drive.truth.noise_std}
    own = touched(*cause)
    assert all(LEAST < shown[name] for name in own), shown
    if not {"x", "y"} & set(own):  # errors of the pose pile up
        assert all(shown[name] < MOST for name in own), shown
    place = cause[1].partition(":")[0]
    still = set(shown) - set(own) if place == "sensor" else UPSTREAM[place] - set(own)
    assert all(shown[name] == 0.0 for name in still), shown


@pytest.mark.parametrize("cause", ALL, ids="@".join)
def test_columns_are_finite_and_time_increases(middle, cause):
    drive = middle[cause]
    columns = "t u y" if cause[1] == "plant" else "t v_cmd delta_cmd v delta r x y psi"
    for run in [*drive.runs, *drive.clean_runs, *drive.truth.response]:
        assert list(run) == columns.split()
        assert all(np.isfinite(column).all() for column in run.values())
        assert len({len(column) for column in run.values()}) == 1
        assert (np.diff(run["t"]) > 0.0).all()
    word, where = cause
    (truth,) = drive.truth.causes
    assert (truth.word, truth.where) == (word, where.partition(":")[0])
    assert (word in OUTSIDE) == (not truth.parameters)


def test_a_log_depends_on_its_case_alone():
    def same(one, other):
        pairs = zip(
            [*one.runs, *one.clean_runs, *one.truth.response],
            [*other.runs, *other.clean_runs, *other.truth.response],
            strict=True,
        )
        return all(np.array_equal(a[name], b[name]) for a, b in pairs for name in a)

    short = {"runs": 2, "duration": 4.0}
    for make, causes in ((generate, OF_VEHICLES[::3]), (siso, OF_PLANTS[::3])):
        cases = [Case((cause,), "large", 7 + i, **short) for i, cause in enumerate(causes)]
        together = make(cases)
        assert all(same(a, b) for a, b in zip(together[::5], make(cases[::5]), strict=True))
        assert same(together[1], make([cases[1]])[0])


def test_no_cause_leaves_the_drive_clean_and_noisy():
    for make in (generate, siso):
        (drive,) = make([Case(seed=5, **SHORT)])
        assert not drive.truth.causes
        for run, clean, ideal in zip(
            drive.runs, drive.clean_runs, drive.truth.response, strict=True
        ):
            assert all(np.array_equal(run[name], clean[name]) for name in run)
            for name, std in drive.truth.noise_std.items():
                if name in run and name not in ("x", "y", "psi"):
                    assert 0.7 * std < np.std(run[name] - ideal[name]) < 12.0 * std


def test_sizes_are_ordered():
    cause = (("backlash", "steering"),)
    drives = generate([Case(cause, size, 3, **SHORT) for size in SIZES])
    small, mid, large = (change(drive, "delta") for drive in drives)
    assert small < 0.7 * mid < 0.35 * large
    gaps = [drive.truth.causes[0].parameters["gap"][0] for drive in drives]
    np.testing.assert_allclose(gaps, np.array(list(SIZES.values())) * gaps[1])


def test_the_body_is_the_kinematic_bicycle_and_a_delay_delays():
    seeds = range(12)
    clean = generate([Case(seed=seed, runs=1, duration=6.0) for seed in seeds])
    rigid = [d for d in clean if not d.truth.machine.yaw_lag]
    assert rigid
    for drive in rigid:
        l_f, l_r = drive.geometry
        run = drive.truth.response[0]
        beta = np.arctan(l_r / (l_f + l_r) * np.tan(run["delta"]))
        np.testing.assert_allclose(run["r"], run["v"] * np.sin(beta) / l_r, atol=1e-12)
        turned = np.cumsum(np.r_[0.0, 0.01 * (run["r"][1:] + run["r"][:-1])])
        np.testing.assert_allclose(run["psi"] - run["psi"][0], turned, atol=2e-3)
    cause = (("transport_delay", "steering"),)
    (late,) = generate([Case(cause, seed=2, runs=1, duration=6.0, dt=0.01)])
    (prompt,) = generate([Case(seed=2, runs=1, duration=6.0, dt=0.01)])
    delay = late.truth.causes[0].parameters["delay"][0]
    t = prompt.runs[0]["t"]
    expected = np.interp(t - delay, t, prompt.truth.response[0]["delta"], left=0.0)
    # The response has kinks between the rows, where a delay of odd milliseconds puts them.
    np.testing.assert_allclose(late.truth.response[0]["delta"], expected, atol=3e-3)


def test_a_repeat_has_the_same_commands_and_other_noise():
    (drive,) = generate([Case(seed=1, runs=3, duration=5.0, repeat=True)])
    first, second, third = drive.runs
    assert np.array_equal(first["delta_cmd"], second["delta_cmd"])
    assert not np.array_equal(first["v"], second["v"])
    assert not np.array_equal(first["v_cmd"], third["v_cmd"])


@pytest.mark.parametrize("style", ["plain", "two_level"])
@pytest.mark.parametrize("dt", [0.01, 0.05])
def test_other_driving_and_other_periods(style, dt):
    pair = (("understeer", "vehicle"), ("backlash", "powertrain"))
    (drive,) = generate([Case(pair, "large", 4, style, runs=1, duration=20.0, dt=dt, imu=True)])
    run = drive.runs[0]
    assert len(drive.truth.causes) == 2
    assert len(run["a"]) == round(20.0 / dt) + 1
    assert change(drive, "r") > 0.0 < change(drive, "v")
    if style == "two_level":
        assert len(np.unique(run["v_cmd"])) <= 2


def test_written_logs_have_the_header_of_the_contract(tmp_path):
    (drive,) = generate([Case(seed=1, runs=2, duration=2.0)])
    paths = write(drive, tmp_path / "vehicle")
    assert [path.name for path in paths] == ["run_1.csv", "run_2.csv"]
    assert paths[0].read_text().splitlines()[0] == "t,v_cmd,delta_cmd,v,delta,r,x,y,psi"
    back = np.loadtxt(paths[0], delimiter=",", skiprows=1)
    np.testing.assert_allclose(back, np.column_stack(list(drive.runs[0].values())), rtol=1e-8)
    (drive,) = siso([Case(seed=1, runs=1, duration=2.0)])
    (path,) = write(drive, tmp_path / "plant")
    assert path.read_text().splitlines()[0] == "t,u,y"
    assert 'command = "u"' in (path.parent / "vehicle.toml").read_text()


def test_an_unknown_cause_or_place_is_refused():
    with pytest.raises(ValueError, match="unknown cause 'play'"):
        generate([Case((("play", "steering"),), duration=2.0)])
    with pytest.raises(ValueError, match="cannot sit at 'steering'"):
        generate([Case((("understeer", "steering"),), duration=2.0)])
    with pytest.raises(ValueError, match="one of small"):
        Case(size="huge")
