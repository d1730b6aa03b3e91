"""Something that turns the vehicle, a gyroscope with a bias, and wheels that stand askew are three
offsets of a yaw rate: where the pose was logged at several speeds, they are told apart."""

import numpy as np
import pytest

import vdmsi_jax as vj
from vdmsi_jax.data.derive import steering_from_yaw_rate

DT, FINE = 0.02, 20
CAR = vj.VehicleGeometry(0.8, 0.7, reference_point="rear_axle")


def drive(seed, pulls=0.0, gyroscope=0.0, wheels=0.0):
    """30 s at three speeds, by steps of a millisecond."""
    rng, n = np.random.default_rng(seed), 1500
    v_cmd = np.repeat(rng.permutation([1.0, 2.2, 4.0]), n // 3)
    delta_cmd = np.repeat(rng.uniform(-0.15, 0.15, n // 60), 60)
    rows, v, delta, x, y, psi = [], v_cmd[0], delta_cmd[0], 0.0, 0.0, 0.0
    for k in range(n):
        r = v * np.tan(delta + wheels) / CAR.wheelbase + pulls
        rows.append((v, delta, r + gyroscope, x, y, psi))
        for _ in range(FINE):
            h = DT / FINE
            r = v * np.tan(delta + wheels) / CAR.wheelbase + pulls
            x, y, psi = x + h * v * np.cos(psi), y + h * v * np.sin(psi), psi + h * r
            v += h / 0.5 * (v_cmd[k] - v)
            delta += h / 0.12 * (delta_cmd[k] - delta)
    noise = rng.standard_normal((6, n)) * [[0.02], [0.002], [0.004], [0.01], [0.01], [0.002]]
    names = ("v", "delta", "r", "x", "y", "psi")
    measured = dict(zip(names, np.array(rows).T + noise, strict=True))
    return vj.Record.from_arrays(
        dt=DT, name=f"run_{seed}", vehicle=CAR, v_cmd=v_cmd, delta_cmd=delta_cmd, **measured
    )


@pytest.mark.slow
@pytest.mark.parametrize(
    ("hidden", "cause", "where", "unit"),
    [
        ({"pulls": 0.03}, "offset", "vehicle", "rad/s"),
        ({"gyroscope": 0.03}, "sensor_bias", "sensor", "rad/s"),
        ({"wheels": 0.02}, "offset", "vehicle", "rad"),
    ],
)
def test_each_is_named_with_its_size(hidden, cause, where, unit):
    found = vj.diagnose([drive(seed, **hidden) for seed in (1, 2, 3)])
    assert found.verdict == "explained"
    (finding,) = found.findings
    bias = finding.parameters["bias"]
    assert (finding.cause, finding.where, bias.unit) == (cause, where, unit)
    assert bias.value == pytest.approx(next(iter(hidden.values())), abs=max(4 * bias.std, 5e-4))
    assert ("of the yaw rate" in finding.sentence) == ("pulls" in hidden)


@pytest.mark.slow
@pytest.mark.parametrize("logged", [False, True])
def test_a_gyroscope_s_bias_is_not_handed_on_by_an_angle_that_was_made_of_it(logged):
    """Whether the angle is left to the diagnosis, or stands in the log as what it was made of."""
    made = []
    for seed in (1, 2, 3):
        record = drive(seed, gyroscope=0.05)
        channels = {name: values for name, values in record.channels.items() if name != "delta"}
        if logged:
            channels["delta"], _ = steering_from_yaw_rate(record["r"], record["v"], CAR, 0.3)
        made.append(vj.Record.from_arrays(dt=DT, name=f"run_{seed}", vehicle=CAR, **channels))
    (finding,) = vj.diagnose(made).findings
    bias = finding.parameters["bias"]
    assert (finding.cause, finding.channel) == ("sensor_bias", "r")
    assert bias.value == pytest.approx(0.05, abs=max(4 * bias.std, 1e-3))


@pytest.mark.slow
@pytest.mark.parametrize("bias", [0.0, 0.02])
def test_a_bias_beside_noise_that_wanders_is_told_by_what_data_held_out_say(bias):
    """Noise of its own colour takes a constant for noise, and hardly anything tells it then."""
    made, keep = [], np.exp(-DT / 4.0)
    for seed in (1, 2, 3):
        record, rng = drive(seed, gyroscope=bias), np.random.default_rng(50 + seed)
        pushed, wander = rng.standard_normal(record.n), np.zeros(record.n)
        for k in range(1, record.n):
            wander[k] = keep * wander[k - 1] + 0.01 * np.sqrt(1.0 - keep**2) * pushed[k]
        channels = {**record.channels, "r": record["r"] + wander}
        made.append(vj.Record.from_arrays(dt=DT, name=record.name, vehicle=CAR, **channels))
    found = vj.diagnose(made)
    assert [(f.cause, f.channel) for f in found.findings] == [("sensor_bias", "r")] * (bias > 0.0)
    if bias > 0.0:
        told = found.findings[0].parameters["bias"]
        assert told.value == pytest.approx(bias, abs=2.5 * told.std)
