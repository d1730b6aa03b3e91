"""What repeats with the way: a torque that ripples once a turn, and hums that do not."""

import numpy as np
import pytest
from scipy.signal import lfilter

import vdmsi_jax as vj
from vdmsi_jax.diagnose.residual.travelled import line_over

DT, ROWS = 0.01, 4000
T = DT * np.arange(ROWS)
SPEED = np.stack([2.0 + 1.2 * np.sin(0.7 * T), 2.0 + np.sign(np.sin(0.5 * T + 1.0))])
WAY = np.cumsum(SPEED, axis=1) * DT
EVERYWHERE = np.ones(WAY.shape, bool)
NOISE = 0.1 * np.random.default_rng(8).standard_normal(WAY.shape)


def line(error, use=EVERYWHERE):
    e = NOISE + error
    return line_over(WAY, e, e, use, DT)


def test_a_ripple_over_the_way_is_told_by_its_period_and_share():
    phases = np.array([[0.3], [2.1]])  # each run begins at another
    found = line(0.05 * np.sin(2.0 * np.pi * WAY / 0.62 + phases))
    assert found is not None
    assert found.period == pytest.approx(0.62, rel=0.01)
    assert found.share == pytest.approx(0.00125 / 0.01125, rel=0.3)


def test_noise_and_a_hum_of_one_frequency_do_not_repeat_with_the_way():
    assert line(0.0) is None
    assert line(0.1 * np.sin(2.0 * np.pi * 3.1 * T)) is None


def test_what_stands_still_travels_nothing():
    still = np.zeros(WAY.shape)
    assert line_over(still, NOISE, NOISE, EVERYWHERE, DT) is None
    assert line_over(WAY, NOISE, NOISE, ~EVERYWHERE, DT) is None


PLACE = np.stack([0.8 * np.sin(0.21 * T + 0.4 * np.sin(T)), 0.7 * np.cos(0.37 * T)])


def place(error):
    e = NOISE + error
    return line_over(PLACE, e, e, EVERYWHERE, DT, place=True)


def test_detents_are_told_by_how_far_they_are_apart():
    found = place(0.08 * np.sin(2.0 * np.pi * PLACE / 0.25))
    assert found is not None
    assert found.period == pytest.approx(0.25, rel=0.07)  # few turns make a broad line


@pytest.mark.parametrize(
    "error",
    [0.0, 0.2 * PLACE**2, 0.2 * np.abs(PLACE), 0.1 * np.sin(2.0 * np.pi * 1.3 * T)],
    ids=["noise", "a bend", "a kink", "a hum"],
)
def test_what_bends_with_the_place_has_no_detents(error):
    assert place(error) is None


@pytest.mark.slow
@pytest.mark.parametrize("shake", [0.0, 0.01])
def test_a_wheel_out_of_balance_shakes_the_steering_once_a_turn(shake):
    rng, dt, fine, rows = np.random.default_rng(5), 0.02, 20, 2500
    h, n, noisy = dt / fine, rows * fine, 0.003
    records = []
    for run in range(3):
        u = np.repeat(rng.uniform(2.0, 6.0, 10), n // 10)
        w = np.repeat(rng.uniform(-0.2, 0.2, 50), n // 50)
        v, delta = (lfilter([h / lag], [1.0, h / lag - 1.0], x) for lag, x in ((0.5, u), (0.1, w)))
        turned = np.cumsum(v) * h / 0.3 + rng.uniform(0.0, 6.0)
        delta = delta + shake * (v / 4.0) ** 2 * np.sin(turned)
        u, w, v, delta = (x[::fine] for x in (u, w, v, delta))
        v, delta = v + 0.02 * rng.standard_normal(rows), delta + noisy * rng.standard_normal(rows)
        log = {"v_cmd": u, "delta_cmd": w, "v": v, "delta": delta}
        car = vj.VehicleGeometry(l_f=1.2, l_r=1.4)
        records.append(vj.Record.from_arrays(dt=dt, name=f"run_{run}", vehicle=car, **log))

    found = vj.diagnose(records)

    assert found.findings == ()
    told = [u for u in found.unexplained if u.channel == "delta"]
    assert bool(told) == (shake > 0.0)
    assert not told or "1.88 m of way" in told[0].test
