"""The machines: random vehicles and single plants, and one loop of 1 ms that drives all lanes.

Both actuators of a vehicle, and a single plant, have the same structure. A prefilter follows the
command, a controller demands a rate of the response from the error, and the rate follows late:

    p' = (u - p) / tau_p,   e = p - x,   w' = (kp e + ki int(e) - b x - w) / tau_w,   x' = w - load

so that one real pole, two real or complex poles, a loop with PI, and one with torque lag are all
values of `kp, ki, b, tau_w, tau_p`. x is the speed (m/s), the road-wheel angle (rad) or a plant's
response; the load is an acceleration. The body is a kinematic bicycle at the centre of gravity
whose yaw rate may lag.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from .effects import REGISTRY
from .noise import COARSE
from .state import STAGES, State

H = 0.001  # s: the step of all physics


@dataclass(frozen=True)
class Actuator:
    """Gains (1/s, 1/s^2, 1/s), lags (s; 0: none) and the time in which it responds (s)."""

    kind: str
    kp: float
    ki: float = 0.0
    b: float = 0.0
    tau_w: float = 0.0
    tau_p: float = 0.0
    time: float = 0.5
    gain: float = 1.0  # of a single plant only: response per unit of x


@dataclass(frozen=True)
class Vehicle:
    """Told geometry (m), actuators, yaw lag (s; 0: none) and lateral compliances (rad s^2/m)."""

    l_f: float
    l_r: float
    powertrain: Actuator
    steering: Actuator
    yaw_lag: float
    front_compliance: float
    rear_compliance: float
    rolling_start: bool


def _first(rng, low: float, high: float) -> Actuator:
    tau = rng.uniform(low, high)
    return Actuator("first_order", 1.0 / tau, time=tau)


def _two_poles(rng, low: float, high: float) -> Actuator:
    tau = rng.uniform(low, high)
    second = tau * rng.uniform(0.1, 0.6)
    return Actuator("two_poles", 1.0 / tau, tau_p=second, time=tau + second)


def _lagged(rng, low: float, high: float) -> Actuator:
    tau = rng.uniform(low, high)
    lag = tau * rng.uniform(0.1, 0.5)
    return Actuator("torque_lag", 1.0 / tau, tau_w=lag, time=tau)


def _loop(rng, low: float, high: float) -> Actuator:
    time = rng.uniform(low, high)
    omega, zeta, b = 1.0 / time, rng.uniform(0.5, 1.3), rng.uniform(0.02, 0.1) / time
    lag = rng.choice([0.0, rng.uniform(0.05, 0.2)]) * time
    return Actuator("pi_loop", 2.0 * zeta * omega - b, omega**2, b, tau_w=float(lag), time=time)


def _second(rng, low: float, high: float) -> Actuator:
    omega, zeta = rng.uniform(low, high), rng.uniform(0.5, 1.1)
    return Actuator(
        "second_order", omega / (2 * zeta), tau_w=0.5 / (zeta * omega), time=2 * zeta / omega
    )


def random_vehicle(seed: int) -> Vehicle:
    rng = np.random.default_rng([seed, 10])
    make = (_first, _two_poles, _lagged, _loop)[rng.integers(4)]
    powertrain = make(rng, 0.3, 1.2)
    steering = _first(rng, 0.05, 0.3) if rng.random() < 0.5 else _second(rng, 8.0, 25.0)
    front = 1.0 / rng.uniform(50.0, 110.0)
    return Vehicle(
        l_f=round(rng.uniform(0.8, 1.8), 2),
        l_r=round(rng.uniform(0.8, 1.8), 2),
        powertrain=powertrain,
        steering=steering,
        yaw_lag=rng.uniform(0.006, 0.018) if rng.random() < 0.7 else 0.0,
        front_compliance=front,
        rear_compliance=front * rng.uniform(0.6, 0.85),
        rolling_start=bool(rng.random() < 0.65),
    )


def random_plant(seed: int) -> tuple[Actuator, float]:
    """A single plant, and the amplitude of the commands it is used to."""
    rng = np.random.default_rng([seed, 11])
    make = (_first, _two_poles, _lagged, _loop)[rng.integers(4)]
    plant = make(rng, 0.1, 0.8)
    gain, amplitude = np.exp(rng.uniform(np.log(0.3), np.log(4.0), 2))
    return Actuator(**{**plant.__dict__, "gain": float(gain)}), float(amplitude)


@dataclass
class Lane:
    """One run as it is simulated.

    Attributes:
        actuators: powertrain and steering, or one plant.
        commands: (rows, actuator), what reaches each actuator, held between rows.
        disturbance: (steps of 10 ms, 3 or 1): acceleration, steering, yaw; or the plant's command.
        start: states x of the actuators at the first row.
        effects: (name, where it sits: actuator, channel or 0, parameters).
        vehicle: None for a single plant.
        speed_scale, stretch: true over told wheel radius and lengths.
        heading: initial psi, rad.
    """

    actuators: Sequence[Actuator]
    commands: np.ndarray
    disturbance: np.ndarray
    start: Sequence[float]
    effects: list[tuple[str, int, dict]]
    vehicle: Vehicle | None = None
    speed_scale: float = 1.0
    stretch: float = 1.0
    heading: float = 0.0


def simulate(lanes: Sequence[Lane], dt: float) -> np.ndarray:
    """Channels (rows, channel, lane) without measurement noise, all lanes in one loop."""
    n, J = len(lanes), len(lanes[0].actuators)
    rows, every = len(lanes[0].commands), round(dt / H)
    steps, coarse = (rows - 1) * every, round(COARSE / H)
    assert abs(every * H - dt) < 1e-12, f"dt = {dt} s is no multiple of {H} s"
    commands = np.stack([x.commands for x in lanes], axis=-1).reshape(rows, J * n)
    disturbed = np.stack([x.disturbance for x in lanes], axis=-1)

    def of(name):
        return np.array([[getattr(x.actuators[j], name) for x in lanes] for j in range(J)]).ravel()

    kp, ki, b = of("kp"), of("ki"), of("b")
    a_w, a_p = _follow(of("tau_w")), _follow(of("tau_p"))
    middle = np.where(a_w < 1.0, 0.5, 0.0)
    s = State(n, J, H, kp, of("gain"))
    s.x[:] = np.array([[x.start[j] for x in lanes] for j in range(J)]).ravel()
    s.p[:], s.y[:] = s.x, s.x
    integral = np.where(ki > 0.0, b * s.x, 0.0)
    s.u[:] = s.x
    effects = _gathered(lanes, n, s)
    hooks = {stage: [getattr(e, stage) for e in effects if hasattr(e, stage)] for stage in STAGES}
    body = _Body(lanes, s) if J == 2 else None
    out = np.empty((rows, len(s.m), n))
    held = np.empty(J * n)
    for k in range(steps + 1):
        s.k, s.t = k, k * H
        now = disturbed[min(k // coarse, len(disturbed) - 1)]
        if body:
            body.turn(hooks, now[2])
        if k % every == 0:
            if not body:
                s.m[0] = s.y * s.gain
            out[k // every] = s.m
            held = commands[k // every]
        if k == steps:
            return out
        if body:
            body.move()
        np.copyto(s.u, held)
        for hook in hooks["command"]:
            hook(s)
        s.u[-n:] += now[1] if body else now[0]
        s.p += a_p * (s.u - s.p)
        np.subtract(s.p, s.x, out=s.e)
        for hook in hooks["effort"]:
            hook(s)
        s.growth = ki * H * s.e
        np.copyto(s.demand, kp * s.e + integral - b * s.x)
        for hook in hooks["demand"]:
            hook(s)
        integral += s.growth
        w = s.w + a_w * (s.demand - s.w)
        s.w, s.before = w, s.w
        for hook in hooks["rate"]:
            hook(s)
        s.load[:] = 0.0
        if body:
            s.load[:n] = now[0]
        for hook in hooks["load"]:
            hook(s)
        s.rate = s.w - middle * (s.w - s.before) - s.load
        s.x += H * s.rate
        for hook in hooks["limit"]:
            hook(s)
        np.copyto(s.y, s.x)
        for hook in hooks["output"]:
            hook(s)
    raise AssertionError("the loop ends at its last row")


def _follow(tau: np.ndarray) -> np.ndarray:
    """Share of the way that a first-order lag goes in one step; 1 where there is no lag."""
    return np.where(tau > 0.0, -np.expm1(-H / np.where(tau > 0.0, tau, 1.0)), 1.0)


def _gathered(lanes: Sequence[Lane], n: int, s: State) -> list:
    """One object for each kind of effect, which acts on all the lanes that have it."""
    found: dict[str, list] = {}
    for lane, one in enumerate(lanes):
        for name, where, parameters in one.effects:
            found.setdefault(name, []).append((where * n + lane, parameters))
    effects = []
    for name in REGISTRY:
        if name in found:
            at = np.array([place for place, _ in found[name]])
            assert len(set(at)) == len(at), f"{name} twice at one place"
            keys = found[name][0][1]
            columns = {key: np.array([p[key] for _, p in found[name]]) for key in keys}
            effects.append(REGISTRY[name](at, columns, s))
    assert set(found) <= set(REGISTRY), f"unknown effects {set(found) - set(REGISTRY)}"
    return effects


class _Body:
    """The kinematic bicycle with a yaw lag, and what its sensors see."""

    def __init__(self, lanes: Sequence[Lane], s: State):
        vehicles = [x.vehicle for x in lanes]
        stretch = np.array([x.stretch for x in lanes])
        front = np.array([v.l_f for v in vehicles if v]) * stretch
        rear = np.array([v.l_r for v in vehicles if v]) * stretch
        self.s, self.wheelbase, self.ratio = s, front + rear, rear / (front + rear)
        self.scale = np.array([x.speed_scale for x in lanes])
        self.follow = _follow(np.array([v.yaw_lag for v in vehicles if v]))
        self.psi = np.array([x.heading for x in lanes])
        self.east, self.north = np.zeros(s.n), np.zeros(s.n)

    def turn(self, hooks: dict, disturbance: np.ndarray) -> None:
        """Yaw rate at this instant, and the measured channels."""
        s, n = self.s, self.s.n
        s.delta = s.y[n:].copy()
        s.crab[:] = 0.0
        for hook in hooks["steer"]:
            hook(s)
        tangent = np.tan(s.delta)
        self.slope = self.ratio * tangent
        s.curvature = tangent / self.wheelbase / np.sqrt(1.0 + self.slope * self.slope)
        s.ground = s.y[:n] * self.scale
        for hook in hooks["curve"]:
            hook(s)
        s.turning = s.ground * s.curvature
        for hook in hooks["yaw"]:
            hook(s)
        target = s.turning + disturbance
        s.r = target if s.k == 0 else s.r + self.follow * (target - s.r)
        s.m[0], s.m[1], s.m[2] = s.y[:n], s.y[n:], s.r
        s.m[3], s.m[4], s.m[5], s.m[6] = self.east, self.north, self.psi, s.rate[:n]
        for hook in hooks["sensor"]:
            hook(s)

    def move(self) -> None:
        s = self.s
        course = self.psi + np.arctan(self.slope) + s.crab + 0.5 * H * s.r
        self.east = self.east + H * s.ground * np.cos(course)
        self.north = self.north + H * s.ground * np.sin(course)
        self.psi = self.psi + H * s.r
        s.distance += H * s.ground
