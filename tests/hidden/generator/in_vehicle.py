"""Sizes and physics of the causes of the body, the road and the sensors."""

from collections.abc import Callable

import numpy as np

from .causes import SENSED, Drawn, Setting

UNITS = {"v": "m/s", "delta": "rad", "r": "rad/s"}


def offset(s: Setting) -> Drawn:
    bias = s.sign() * 0.008 * s.size
    truth = s.truth({"bias": (bias, "rad")}, "wheels misaligned against the steering sensor")
    return Drawn(truth, effects=[("Misalignment", 0, {"bias": bias})])


def understeer(s: Setting) -> Drawn:
    gradient = 0.0012 * s.size
    truth = s.truth({"gradient": (gradient, "s^2/m^2")}, "road-wheel angle over 1 + K v^2")
    return Drawn(truth, effects=[("Understeer", 0, {"gradient": gradient})])


def tyre_relaxation(s: Setting) -> Drawn:
    length = 0.5 * s.size
    truth = s.truth({"length": (length, "m")}, "curvature follows over a distance")
    return Drawn(truth, effects=[("Relaxation", 0, {"length": length})])


def geometry_scale(s: Setting) -> Drawn:
    scale = float(np.exp(s.sign() * np.log1p(0.08 * s.size)))
    truth = s.truth({"scale": (scale - 1.0, "1")}, "true lengths over told lengths")
    return Drawn(truth, lane={"stretch": scale})


def speed_scale(s: Setting) -> Drawn:
    scale = float(np.exp(s.sign() * np.log1p(0.05 * s.size)))
    truth = s.truth(
        {"scale": (scale - 1.0, "1")}, "true wheel radius over told: speed on the ground over v"
    )
    return Drawn(truth, lane={"speed_scale": scale})


def road_grade(s: Setting) -> Drawn:
    step = s.t[1] - s.t[0]
    least = min(float(np.abs(c[:, 0]).sum()) * step for c in s.commands)
    hills = int(s.rng.integers(2, 4))
    centre = np.array([0.2, 0.5, 0.8]) * least + s.rng.uniform(-0.06, 0.06, 3) * least
    width = s.rng.uniform(0.04, 0.08, 3) * least
    slope = s.rng.uniform(0.03, 0.06, 3) * s.size * s.rng.choice([-1.0, 1.0], 3)
    slope[hills:] = 0.0
    shown = {}
    for i in range(hills):
        shown |= {
            f"slope_{i + 1}": (slope[i], "1"),
            f"centre_{i + 1}": (centre[i], "m"),
            f"width_{i + 1}": (width[i], "m"),
        }
    truth = s.truth(shown, "Gaussian hills over the distance driven, steepest slopes given")
    effect = {"centre": centre, "width": width, "slope": slope}
    return Drawn(truth, effects=[("Grade", 0, effect)])


def bank(s: Setting) -> Drawn:
    assert s.vehicle is not None
    effect = {
        "slope": s.sign() * 0.04 * s.size,
        "swing": s.rng.choice([0.0, s.rng.uniform(0.2, 0.5)]),
        "wave": s.rng.uniform(150.0, 400.0),
        "phase": s.rng.uniform(-np.pi, np.pi),
        "front": s.vehicle.front_compliance,
        "rear": s.vehicle.rear_compliance,
    }
    truth = s.truth(
        {"slope": (effect["slope"], "1")}, "pull to the left borne by compliant tyres", **effect
    )
    return Drawn(truth, effects=[("Bank", 0, effect)])


def drag(s: Setting) -> Drawn:
    effect = {"quadratic": 0.008 * s.size, "rolling": 0.15 * s.size * s.rng.uniform(0.3, 1.5)}
    units = {"quadratic": "1/m", "rolling": "m/s^2"}
    truth = s.truth({k: (v, units[k]) for k, v in effect.items()}, "deceleration")
    return Drawn(truth, effects=[("Drag", 0, effect)])


def gust(s: Setting) -> Drawn:
    t = np.arange(s.t[0], s.t[-1] + 0.01, 0.01)
    runs = []
    for _ in s.commands:
        push, now = np.zeros_like(t), s.t[0] + s.rng.uniform(1.0, 5.0)
        while now < t[-1]:
            width, height = s.rng.uniform(0.2, 0.6), s.rng.uniform(0.5, 1.5)
            push += s.sign() * 0.06 * s.size * height * np.exp(-0.5 * ((t - now) / width) ** 2)
            now += s.rng.uniform(3.0, 9.0)
        runs.append([("Gust", 0, {"push": push})])
    return Drawn(s.truth({}, "yaw pulses at random times"), per_run=runs)


def tyre_saturation(s: Setting) -> Drawn:
    most = 2.6 * s.size**-0.4
    truth = s.truth({}, "lateral acceleration limited by friction", most=most)
    return Drawn(truth, effects=[("TyreSaturation", 0, {"most": most})])


def _per_channel(s: Setting, v: float, delta: float, r: float, pose: float = 0.0) -> float:
    return s.size * {"v": v, "delta": delta, "r": r, "pose": pose}[s.channel or ""]


def sensor_delay(s: Setting) -> Drawn:
    delay = max(round(_per_channel(s, 0.15, 0.06, 0.06, 0.15), 3), 0.002)
    truth = s.truth({"delay": (delay, "s")}, "whole milliseconds")
    channels = SENSED[s.channel or ""]
    return Drawn(truth, effects=[("SensorDelay", c, {"delay": delay}) for c in channels])


def sensor_lag(s: Setting) -> Drawn:
    lag = _per_channel(s, 0.2, 0.06, 0.08)
    truth = s.truth({"time_constant": (lag, "s")}, "first order, before the noise")
    channels = SENSED[s.channel or ""]
    return Drawn(truth, effects=[("SensorLag", c, {"time_constant": lag}) for c in channels])


def sensor_bias(s: Setting) -> Drawn:
    bias = s.sign() * _per_channel(s, 0.2, 0.008, 0.012)
    truth = s.truth({"bias": (bias, UNITS[s.channel or ""])}, "constant")
    return Drawn(truth, bias={c: bias for c in SENSED[s.channel or ""]})


def quantization(s: Setting) -> Drawn:
    step = _per_channel(s, 0.2, 0.01, 0.03)
    truth = s.truth({"step": (step, UNITS[s.channel or ""])}, "rounded after the noise")
    return Drawn(truth, step={c: step for c in SENSED[s.channel or ""]})


DRAWS: dict[str, Callable[[Setting], Drawn]] = {
    one.__name__: one
    for one in (
        offset, understeer, tyre_relaxation, geometry_scale, speed_scale, road_grade, bank, drag,
        gust, tyre_saturation, sensor_delay, sensor_lag, sensor_bias, quantization,
    )
}  # fmt: skip
