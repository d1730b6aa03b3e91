"""The state of the 1 ms loop, and what an effect in it is."""

import numpy as np

STAGES = (
    "command effort demand rate load limit output steer curve yaw sensor"  # in order of causation
).split()


class State:
    """All lanes at one instant: actuators flat (J n,), body (n,), measured channels m (7 or 1, n).

    u command, p filtered command, e error, demand and w rates, load (all of the response's unit,
    or that per second); x actuator, y behind the actuator (wheel); delta, curvature, ground speed,
    turning and r of the body; crab: course beside the bicycle's, rad; distance driven, m.
    """

    def __init__(self, n: int, actuators: int, h: float, kp: np.ndarray, gain: np.ndarray):
        flat = n * actuators
        self.n, self.h, self.kp, self.gain, self.k, self.t = n, h, kp, gain, 0, 0.0
        self.u, self.p, self.e, self.x, self.y = (np.zeros(flat) for _ in range(5))
        self.demand, self.w, self.before, self.load, self.rate = (np.zeros(flat) for _ in range(5))
        self.growth = np.zeros(flat)
        self.delta, self.curvature, self.ground, self.turning = (np.zeros(n) for _ in range(4))
        self.r, self.crab, self.distance = np.zeros(n), np.zeros(n), np.zeros(n)
        self.m = np.zeros((7 if actuators == 2 else 1, n))


class Effect:
    """Keeps its place, the lanes of that place, and its parameters as attributes."""

    def __init__(self, at: np.ndarray, parameters: dict[str, np.ndarray], s: State):
        self.at, self.lane = at, at % s.n
        self.__dict__.update(parameters)
        self.begin(s)

    def begin(self, s: State) -> None:
        """States of the effect's own."""


class Ring:
    """Past values of a signal, and the one from `late` steps ago."""

    def __init__(self, late: np.ndarray, first: np.ndarray):
        self.late, self.size = late, int(late.max()) + 1
        self.past, self.each = np.tile(first, (self.size, 1)), np.arange(len(first))

    def __call__(self, k: int, now: np.ndarray) -> np.ndarray:
        self.past[k % self.size] = now
        return self.past[(k - self.late) % self.size, self.each]
