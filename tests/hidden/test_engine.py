"""The hunt's second generator: the test vehicle on the physics engine, whose causes are physical.

A gap between servo and linkage, a servo that turns no faster, a drive without torque: none of them
is written as the effect that has to be named.
"""

import warnings
from dataclasses import dataclass, field

import numpy as np
import pytest

import vdmsi_jax
from vdmsi_jax.testbed import ROW, Car, Causes, Dimensions, drive, replay, write_log

pytest.importorskip("mujoco")
pytestmark = pytest.mark.slow  # 15 s each

DURATION = 40.0  # s
EVERY = 2  # rows of the engine to one of the log
SIGMA = {"v": 0.02, "delta": 0.003, "r": 0.004, "x": 0.02, "y": 0.02, "psi": 0.003}
NEUTRAL = Dimensions(front_softness=1.0)


@dataclass(frozen=True)
class Hidden:
    """What is hidden in the drives of a car, and what has to be said of it.

    Attributes:
        causes: switches of the test vehicle.
        truth: cause, where, parameter, and its size.
        near: relative error of that size that is allowed; physics and formula differ.
        brakes: whether somebody brakes at times, which no log tells.
    """

    causes: Causes = field(default_factory=Causes)
    truth: tuple[tuple[str, str, str, float], ...] = ()
    near: float = 0.15
    brakes: bool = False


EVERY_CASE = {
    "clean": Hidden(),
    "play": Hidden(Causes(steering_play=0.04), (("backlash", "steering", "gap", 0.04),)),
    "rate": Hidden(  # of the servo, which turns the wheels by 0.93 of its angle
        Causes(steering_rate=0.35), (("rate_limit", "steering", "rising", 0.93 * 0.35),)
    ),
    "offset": Hidden(Causes(steering_offset=0.02), (("offset", "steering", "bias", 0.02),)),
    "power": Hidden(
        Causes(drive_acceleration=0.9), (("rate_limit", "powertrain", "rising", 0.9),), near=0.3
    ),
    "delay": Hidden(
        Causes(command_delay=0.1),
        (
            ("transport_delay", "steering", "delay", 0.1),
            ("transport_delay", "powertrain", "delay", 0.1),
        ),
    ),
    "play and wheel": Hidden(
        Causes(steering_play=0.04, wheel_scale=1.05),
        (("backlash", "steering", "gap", 0.04), ("speed_scale", "vehicle", "scale", 0.05)),
    ),
    "unlogged brake": Hidden(brakes=True),
}


def commands(seed: int, swept: bool) -> tuple[np.ndarray, np.ndarray]:
    """Speeds that are held and ramped, and angles that are held, or a chirp of 0.1 to 2.5 Hz."""
    rng = np.random.default_rng(seed)
    n = round(DURATION / ROW) + 1
    t = ROW * np.arange(n)

    def held(low: float, high: float, seconds: tuple[float, float]) -> np.ndarray:
        out, k = np.empty(n), 0
        while k < n:
            more = int(rng.uniform(*seconds) / ROW)
            out[k : k + more] = rng.uniform(low, high)
            k += more
        return out

    target = np.minimum(held(2.5, 7.0, (2.0, 5.0)), t + 0.5)
    v = target.copy()
    for k in range(1, n):
        v[k] = v[k - 1] + np.clip(target[k] - v[k - 1], -1.5 * ROW, 1.5 * ROW)
    delta = held(-0.2, 0.2, (1.0, 3.0))
    if swept:
        delta = 0.08 * np.sin(2.0 * np.pi * (0.1 + 1.2 * t / DURATION) * t)
    return tuple(np.repeat(x[::EVERY], EVERY)[:n] for x in (v, delta))  # held over a row of the log


def logs(hidden: Hidden, folder, seed: int) -> list[vdmsi_jax.Record]:
    """Three drives of the car, with noise, through files."""
    for k in range(3):
        v, delta = commands(10 * seed + k, swept=k == 1)
        applied = v.copy()
        if hidden.brakes:
            for at in (8.0, 21.0, 33.0):
                start = round((at + k) / ROW)
                applied[start : start + 120] *= 0.6
        car = Car(dimensions=NEUTRAL, causes=hidden.causes)
        done = drive(car, replay(applied, delta), duration=DURATION, seed=seed + k)
        columns = done.log(direct=True)
        columns["v_cmd"] = v
        rng = np.random.default_rng(1000 + 10 * seed + k)
        for c, sigma in SIGMA.items():
            columns[c] = columns[c] + sigma * rng.standard_normal(len(v))
        columns["v"] = columns["v"] / hidden.causes.wheel_scale  # as an encoder counts
        write_log(folder / f"run_{k}.csv", {c: x[::EVERY] for c, x in columns.items()})
    config = folder / "vehicle.toml"
    config.write_text(f"[vehicle]\nl_f = {NEUTRAL.l_f}\nl_r = {NEUTRAL.l_r}\n")
    return vdmsi_jax.read_logs(sorted(folder.glob("*.csv")), config=config)


@pytest.mark.parametrize("which", EVERY_CASE)
def test_a_physical_cause_is_named_and_sized(which, tmp_path):
    hidden = EVERY_CASE[which]
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        told = vdmsi_jax.diagnose(logs(hidden, tmp_path, seed=0))
    if hidden.brakes:  # as a load that comes and goes: no cause of the library
        assert told.verdict == "unexplained_structure", told.summary
        assert any(u.channel == "v" for u in told.unexplained)
        return
    assert told.verdict == ("explained" if hidden.truth else "no_effect"), told.summary
    found = {(f.cause, f.where): f for f in told.findings}
    assert set(found) == {(cause, where) for cause, where, *_ in hidden.truth}, told.summary
    for cause, where, parameter, size in hidden.truth:
        own = found[cause, where].parameters[parameter]
        assert own.value == pytest.approx(size, rel=hidden.near), told.summary
        assert found[cause, where].gain.after > found[cause, where].gain.before
