"""Sizes and physics of the causes inside an actuator or a single plant."""

from collections.abc import Callable

import numpy as np

from .causes import Drawn, Setting


def transport_delay(s: Setting) -> Drawn:
    time = 0.4 * s.actuator.time if s.where == "plant" else s.of(0.15, 0.06, 0.0)
    delay = max(round(time * s.size, 3), 0.002)
    truth = s.truth({"delay": (delay, "s")}, "commands queue, whole milliseconds")
    return Drawn(truth, effects=[("TransportDelay", s.place, {"delay": delay})])


def dead_zone(s: Setting) -> Drawn:
    width = s.of(0.5, 0.022, 0.1) * s.size
    smooth = 0.05 * width  # the edge is worn

    def zone(u):
        beyond = np.abs(u) - width
        return np.sign(u) * 0.5 * (beyond + np.sqrt(beyond**2 + smooth**2)) * (u != 0.0)

    truth = s.truth({"half_width": (width, s.unit)}, "on the command, edge worn over 5 %")
    return Drawn(truth, static=(s.place, zone))


def backlash(s: Setting) -> Drawn:
    gap = s.of(0.3, 0.022, 0.08) * s.size
    unit = "1" if s.where == "plant" else s.unit
    truth = s.truth({"gap": (gap * s.actuator.gain, unit)}, "play behind the actuator")
    return Drawn(truth, effects=[("Backlash", s.place, {"gap": gap})])


def saturation(s: Setting) -> Drawn:
    share = 1.0 - 0.26 * s.size**0.6
    one_sided = s.where == "powertrain"
    top = np.quantile(s.u if one_sided else np.abs(s.u), 0.97)
    upper = float(share * top)
    lower = -np.inf if one_sided else -upper * s.rng.uniform(0.9, 1.1)
    truth = {"upper": (upper, s.unit), "lower": (lower, s.unit)}
    if s.rng.random() < 0.5 or s.actuator.ki > 0.0:
        form = "the actuator takes commands up to a limit"
        return Drawn(s.truth(truth, form), static=(s.place, lambda u: np.clip(u, lower, upper)))
    form = "governor that closes over 0.2 s" if one_sided else "end stops of the response"
    if s.where == "plant":
        truth = {name: (value * s.actuator.gain, unit) for name, (value, unit) in truth.items()}
    effect = {"upper": upper, "lower": lower, "soft": one_sided}
    return Drawn(s.truth(truth, form), effects=[("Lock", s.place, effect)])


def rate_limit(s: Setting) -> Drawn:
    typical = s.u.std() / s.actuator.time
    rising = float(0.45 * typical * s.size**-0.7)
    falling = rising * s.rng.uniform(0.8, 1.25)
    gain = s.actuator.gain
    unit = f"{s.unit}/s" if s.where != "plant" else "1/s"
    form = "motor speed limit inside the servo"
    if s.where == "powertrain":
        form = "torque limit before the torque's lag"
    truth = s.truth({"rising": (rising * gain, unit), "falling": (falling * gain, unit)}, form)
    name = "TorqueLimit" if s.where == "powertrain" else "SlewLimit"
    return Drawn(truth, effects=[(name, s.place, {"rising": rising, "falling": falling})])


def coulomb_friction(s: Setting) -> Drawn:
    level = s.of(0.35, 0.02, 0.08) * s.size
    static = level * s.rng.uniform(1.15, 1.5)
    against_level = s.where == "powertrain" or (
        s.where == "plant" and (s.actuator.ki > 0.0 or s.rng.random() < 0.5)
    )
    name = "LevelFriction" if against_level else "RateFriction"
    form = "against the response's level" if against_level else "against the response's rate"
    truth = s.truth(
        {"level": (level, s.unit), "static": (static, s.unit)}, f"Karnopp stick-slip {form}"
    )
    return Drawn(truth, effects=[(name, s.place, {"level": level, "static": static})])


def gain_asymmetry(s: Setting) -> Drawn:
    more = 0.35 if s.where == "powertrain" else 0.16
    ratio = float(np.exp(s.sign() * np.log1p(more * s.size)))
    up, down = ratio**0.5, ratio**-0.5
    truth = {"ratio": (ratio - 1.0, "1")}
    if s.where == "powertrain":
        form = "gain of the effort v_cmd - v: driving over braking"
        effect = ("EffortAsymmetry", s.place, {"up": up, "down": down})
        return Drawn(s.truth(truth, form), effects=[effect])
    form = "gain by the sign of the command"
    return Drawn(s.truth(truth, form), static=(s.place, lambda u: u * np.where(u > 0.0, up, down)))


def gain_nonlinearity(s: Setting) -> Drawn:
    full = float(np.quantile(np.abs(s.u), 0.99))
    kind = str(s.rng.choice(["concave", "progressive", "linkage"]))
    if kind == "concave":
        bend = 0.75 * s.size**0.5

        def bent(u):
            return full / bend * np.tanh(bend * u / full)

    elif kind == "progressive":
        power = 1.0 + 0.25 * s.size**0.8

        def bent(u):
            return u * (0.01 + (u / full) ** 2) ** (0.5 * (power - 1.0))

    else:
        angle = s.sign() * 0.2 * s.size

        def bent(u):
            return u + angle * u * u / (full + 0.3 * np.abs(u))

    u = s.u
    level = (u @ bent(u)) / (u @ u)  # so that the mean gain stays one
    terms = np.column_stack([u / full, (u / full) ** 2, (u / full) ** 3])
    fitted = np.linalg.lstsq(terms, bent(u) / level, rcond=None)[0]
    k, quadratic, cubic = fitted / full ** np.array([1.0, 2.0, 3.0])
    unit = s.unit if s.where != "plant" else "unit"
    truth = {"quadratic": (quadratic / k, f"1/{unit}"), "cubic": (cubic / k, f"1/{unit}^2")}
    form = f"{kind} map; the polynomial k u (1 + quadratic u + cubic u^2) fits it"
    return Drawn(s.truth(truth, form, gain=k), static=(s.place, lambda u: bent(u) / level))


def quantization(s: Setting) -> Drawn:
    step = s.of(0.6, 0.02, 0.12) * s.size
    truth = s.truth({"step": (step, s.unit)}, "the command is rounded")
    return Drawn(truth, static=(s.place, lambda u: np.round(u / step) * step))


def offset(s: Setting) -> Drawn:
    bias = s.sign() * s.of(0.4, 0.015, 0.06) * s.size
    truth = s.truth({"bias": (bias * s.actuator.gain, s.unit)}, "added to the command")
    return Drawn(truth, static=(s.place, lambda u: u + bias))


def gain_drift(s: Setting) -> Drawn:
    rate = s.sign() * 0.2 * s.size / (s.t[-1] - s.t[0])
    truth = s.truth({"rate": (rate, "1/s")}, "exponential, from the start of each run")
    return Drawn(truth, effects=[("Drift", s.place, {"growth_rate": rate})])


def regime_change(s: Setting) -> Drawn:
    time = s.t[0] + s.rng.uniform(0.35, 0.65) * (s.t[-1] - s.t[0])
    factor = float(np.exp(s.sign() * np.log1p(0.13 * s.size)))
    truth = s.truth({"time": (time, "s"), "gain": (factor - 1.0, "1")}, "at once, in each run")
    return Drawn(truth, effects=[("Regime", s.place, {"time": time, "factor": factor})])


def resonance(s: Setting) -> Drawn:
    own = 1.0 / (2.0 * np.pi * s.actuator.time)
    low, high = {"powertrain": (0.7, 2.0), "steering": (2.5, 6.0)}.get(s.where, (own, 4.0 * own))
    frequency, damping = s.rng.uniform(low, high), s.rng.uniform(0.03, 0.1)
    weight = min(0.3 * s.size, 0.75)
    effect = {"frequency": frequency, "damping": damping, "weight": weight}
    truth = s.truth(
        {"frequency": (frequency, "Hz"), "damping": (damping, "1"), "weight": (weight, "1")},
        "light mass on a spring behind the actuator",
    )
    return Drawn(truth, effects=[("Resonance", s.place, effect)])


def periodic_disturbance(s: Setting) -> Drawn:
    own = 1.0 / (2.0 * np.pi * s.actuator.time)
    low, high = {"powertrain": (0.1, 0.6), "steering": (0.4, 2.0)}.get(s.where, (0.5 * own, own))
    effect = {
        "frequency": s.rng.uniform(low, high),
        "amplitude": s.of(0.25, 0.008, 0.05) * s.size,
        "phase": s.rng.uniform(-np.pi, np.pi),
    }
    units = {"frequency": "Hz", "amplitude": s.unit, "phase": "rad"}
    truth = s.truth(
        {name: (value, units[name]) for name, value in effect.items()},
        "added to the command as sin(2 pi f t + phase), with a tenth of the second harmonic",
    )
    return Drawn(truth, effects=[("Periodic", s.place, effect)])


def speed_dependent_gain(s: Setting) -> Drawn:
    fall, typical = 0.02 * s.size, 7.0
    slope = (1.0 / (1.0 + fall * typical) - 1.0) / typical
    truth = s.truth(
        {"slope": (slope, "s/m")}, "gain 1 / (1 + fall v); the slope is the chord to 7 m/s"
    )
    return Drawn(truth, effects=[("SpeedGain", s.place, {"fall": fall})])


def cross_coupling(s: Setting) -> Drawn:
    if s.where == "powertrain":
        assert s.vehicle is not None
        wheelbase = s.vehicle.l_f + s.vehicle.l_r
        strength = 1.2 * s.size
        truth = s.truth(
            {"strength": (strength, "1")}, "deceleration strength delta^2 v^2 / wheelbase"
        )
        effect = {"strength": strength, "wheelbase": wheelbase}
        return Drawn(truth, effects=[("CorneringLoss", s.place, effect)])
    if s.rng.random() < 0.5:
        strength, name, unit = s.sign() * 0.003 * s.size, "by_speed", "rad s/m"
    else:
        strength, name, unit = s.sign() * 0.008 * s.size, "by_acceleration", "rad s^2/m"
    effect = {"by_speed": 0.0, "by_acceleration": 0.0, name: strength}
    truth = s.truth({"strength": (strength, unit)}, f"steering shifted {name.replace('_', ' ')}")
    return Drawn(truth, effects=[("CrossIntoSteering", s.place, effect)])


def dropout(s: Setting) -> Drawn:
    pieces = int(np.ceil((s.t[-1] - s.t[0]) / 0.01)) + 1
    runs = []
    for command in s.commands:
        out, now = np.zeros(pieces, bool), 1.0
        while now < s.t[-1] - s.t[0]:
            takes = s.rng.uniform(0.3, 0.8)
            for _ in range(8):  # rather where there is a change to be missed
                start = now + s.rng.uniform(1.0, 8.0) / s.size
                u = command[(s.t >= start) & (s.t <= start + takes), s.place]
                if u.size and np.ptp(u) > 0.2 * s.u.std():
                    break
            out[int(start / 0.01) : int((start + takes) / 0.01)] = True
            now = start + takes
        runs.append([("Dropout", s.place, {"out": out})])
    return Drawn(s.truth({}, "keeps its last command for 0.3-0.8 s"), per_run=runs)


def hysteresis_smooth(s: Setting) -> Drawn:
    effect = {"share": min(0.2 * s.size, 0.7), "range": 0.8 * float(s.u.std())}
    truth = s.truth({}, "Bouc-Wen behind the actuator", **effect)
    return Drawn(truth, effects=[("BoucWen", s.place, effect)])


def thermal_power_loss(s: Setting) -> Drawn:
    effect = {
        "strength": 0.25 * s.size,
        "memory": s.rng.uniform(8.0, 20.0),
        "typical": 0.4 * float(s.u.std()),
    }
    truth = s.truth({}, "gain falls with past effort squared", **effect)
    return Drawn(truth, effects=[("Thermal", s.place, effect)])


def memory_gain(s: Setting) -> Drawn:
    effect = {
        "strength": 0.25 * s.size,
        "memory": s.rng.uniform(2.0, 6.0),
        "typical": float(np.abs(s.u).mean()),
    }
    truth = s.truth({}, "gain falls with the recent mean |command|", **effect)
    return Drawn(truth, effects=[("MemoryGain", s.place, effect)])


def state_dependent_lag(s: Setting) -> Drawn:
    effect = {
        "strength": 0.5 * s.size,
        "middle": float(np.abs(s.u).mean()),
        "typical": max(float(np.abs(s.u).std()), 0.3 * float(np.abs(s.u).mean())),
    }
    truth = s.truth({}, "slower at larger |response|", **effect)
    return Drawn(truth, effects=[("StateLag", s.place, effect)])


DRAWS: dict[str, Callable[[Setting], Drawn]] = {
    one.__name__: one
    for one in (
        transport_delay, dead_zone, backlash, saturation, rate_limit, coulomb_friction,
        gain_asymmetry, gain_nonlinearity, quantization, offset, gain_drift, regime_change,
        resonance, periodic_disturbance, speed_dependent_gain, cross_coupling, dropout,
        hysteresis_smooth, thermal_power_loss, memory_gain, state_dependent_lag,
    )
}  # fmt: skip
