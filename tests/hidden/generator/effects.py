"""What a cause does inside the 1 ms loop, for all lanes that have it at once.

An effect is given where it acts (`at`), its parameters as arrays, and the state; its methods are
named after the stage at which they are called. `at` counts lanes, plus n times the actuator (0
powertrain, 1 steering) or the measured channel. Units are those of the actuator: m/s, rad, or the
command of a single plant.
"""

import numpy as np

from .state import Effect, Ring

GRAVITY = 9.81
EPS = 1e-9


class TransportDelay(Effect):
    def begin(self, s):
        self.ring = Ring(np.round(self.delay / s.h).astype(int), s.x[self.at])

    def command(self, s):
        s.u[self.at] = self.ring(s.k, s.u[self.at])


class Dropout(Effect):
    """While `out` (10 ms pieces) the actuator keeps the last command that it took."""

    def begin(self, s):
        self.held = s.x[self.at].copy()

    def command(self, s):
        out = self.out[:, min(s.k // 10, self.out.shape[1] - 1)]
        self.held = np.where(out, self.held, s.u[self.at])
        s.u[self.at] = self.held


class Drift(Effect):
    def command(self, s):
        s.u[self.at] *= np.exp(self.growth_rate * s.t)


class Regime(Effect):
    def command(self, s):
        s.u[self.at] *= np.where(s.t >= self.time, self.factor, 1.0)


class Periodic(Effect):
    """A sine with a tenth of its second harmonic, as eccentric parts have it."""

    def command(self, s):
        phase = 2.0 * np.pi * self.frequency * s.t + self.phase
        s.u[self.at] += self.amplitude * (np.sin(phase) + 0.1 * np.sin(2.0 * phase + 1.0))


class SpeedGain(Effect):
    def command(self, s):
        s.u[self.at] /= 1.0 + self.fall * np.abs(s.y[self.lane])


class CrossIntoSteering(Effect):
    def command(self, s):
        s.u[self.at] += self.by_speed * s.y[self.lane] + self.by_acceleration * s.rate[self.lane]


class MemoryGain(Effect):
    """Gain falls with the mean |command| of the last `memory` seconds; 1 where it is typical."""

    def begin(self, s):
        self.mean = self.typical.copy()

    def command(self, s):
        u = s.u[self.at]
        self.mean += s.h / self.memory * (np.abs(u) - self.mean)
        s.u[self.at] = u * np.exp(self.strength * (1.0 - self.mean / self.typical))


class Thermal(Effect):
    """Effort heats the actuator, heat takes gain; it cools in `memory` seconds."""

    def begin(self, s):
        self.heat = np.zeros(len(self.at))

    def command(self, s):
        effort = s.e[self.at] / self.typical
        self.heat += s.h / self.memory * (effort * effort - self.heat)
        s.u[self.at] /= 1.0 + self.strength * self.heat


class EffortAsymmetry(Effect):
    """Drives with one gain and brakes with another."""

    def effort(self, s):
        e = s.e[self.at]
        s.e[self.at] = e * np.where(e > 0.0, self.up, self.down)


class StateLag(Effect):
    """Slower where the response is large."""

    def effort(self, s):
        beyond = np.clip((np.abs(s.x[self.at]) - self.middle) / self.typical, -1.5, 1.5)
        s.e[self.at] *= np.exp(-self.strength * beyond)


class TorqueLimit(Effect):
    """The demanded rate is limited, before the torque lag; the integral waits meanwhile."""

    def demand(self, s):
        wanted = s.demand[self.at]
        given = np.clip(wanted, -self.falling, self.rising)
        s.demand[self.at] = given
        s.growth[self.at] = np.where(given == wanted, s.growth[self.at], 0.0)


class SlewLimit(Effect):
    """The motor turns no faster."""

    def rate(self, s):
        w = s.w[self.at]
        given = np.clip(w, -self.falling, self.rising)
        s.w[self.at] = given
        s.growth[self.at] = np.where(given == w, s.growth[self.at], 0.0)


class RateFriction(Effect):
    """Dry friction of a positioner (Karnopp): it breaks away at `static`, slides at `level`."""

    def begin(self, s):
        self.scale = s.kp[self.at]
        self.direction = np.zeros(len(self.at))

    def demand(self, s):
        wanted, w = s.demand[self.at], s.w[self.at]
        resting = np.abs(w) < EPS
        self.direction = np.where(resting, np.sign(wanted), np.sign(w))
        sticks = resting & (np.abs(wanted) <= self.scale * self.static)
        self.direction[sticks] = 0.0
        sliding = wanted - self.scale * self.level * self.direction
        s.demand[self.at] = np.where(sticks, 0.0, sliding)

    def rate(self, s):
        w = s.w[self.at]
        s.w[self.at] = np.where(w * self.direction > 0.0, w, 0.0)


class LevelFriction(Effect):
    """Dry friction of a drive against its speed: it stands until `static` is overcome."""

    def begin(self, s):
        self.scale = s.kp[self.at]

    def load(self, s):
        x, w = s.x[self.at], s.w[self.at]
        resting = np.abs(x) < EPS
        self.direction = np.where(resting, np.sign(w), np.sign(x))
        self.sticks = resting & (np.abs(w) <= self.scale * self.static)
        friction = self.scale * self.level * self.direction
        s.load[self.at] += np.where(self.sticks, 0.0, friction)

    def limit(self, s):
        x = s.x[self.at]
        s.x[self.at] = np.where(self.sticks | (x * self.direction < 0.0), 0.0, x)
        s.rate[self.at] = np.where(self.sticks, 0.0, s.rate[self.at])


class Drag(Effect):
    """Air and rolling resistance of the moving vehicle."""

    def load(self, s):
        v = s.y[self.at]
        s.load[self.at] += self.quadratic * v * np.abs(v) + self.rolling * np.tanh(v / 0.05)


class Grade(Effect):
    """Hills of Gaussian height over the distance driven: `slope` is the steepest of each."""

    def load(self, s):
        away = (s.distance[self.lane][:, None] - self.centre) / self.width
        slope = -self.slope * away * np.exp(0.5 - 0.5 * away * away)
        s.load[self.at] += GRAVITY * slope.sum(1)


class CorneringLoss(Effect):
    """The front tyres' side force has a component against the motion."""

    def load(self, s):
        delta, v = s.y[self.lane + s.n], s.y[self.at]
        s.load[self.at] += self.strength * delta * delta * v * np.abs(v) / self.wheelbase


class Lock(Effect):
    """End stops of the steering, or a governor of speed that closes over 0.2 s."""

    def rate(self, s):
        top = (self.upper - s.x[self.at]) / np.where(self.soft, 0.2, s.h)
        bottom = (self.lower - s.x[self.at]) / np.where(self.soft, 0.2, s.h)
        s.w[self.at] = np.minimum(np.maximum(s.w[self.at], bottom), top)

    def limit(self, s):
        x = s.x[self.at]
        s.x[self.at] = np.where(self.soft, x, np.minimum(np.maximum(x, self.lower), self.upper))


class Backlash(Effect):
    """A mass-less output inside a play: it rests until a flank carries it."""

    def begin(self, s):
        self.follower = s.x[self.at].copy()

    def output(self, s):
        x = s.y[self.at]
        half = 0.5 * self.gap
        self.follower = np.minimum(np.maximum(self.follower, x - half), x + half)
        s.y[self.at] = self.follower


class BoucWen(Effect):
    """Smooth hysteresis whose width grows with the stroke."""

    def begin(self, s):
        self.z, self.last = np.zeros(len(self.at)), s.x[self.at].copy()

    def output(self, s):
        x = s.y[self.at]
        move, self.last = x - self.last, x.copy()
        full = np.abs(self.z) / self.range
        self.z += move * (1.0 - full * (0.3 + 0.7 * np.sign(move * self.z)))
        s.y[self.at] = x - self.share * self.z


class Resonance(Effect):
    """A light mass on a spring behind the actuator; `weight` of the output moves with it."""

    def begin(self, s):
        self.q, self.speed = s.x[self.at].copy(), np.zeros(len(self.at))
        self.omega = 2.0 * np.pi * self.frequency

    def output(self, s):
        x = s.y[self.at]
        force = self.omega * (self.omega * (x - self.q) - 2.0 * self.damping * self.speed)
        self.speed += s.h * force
        self.q += s.h * self.speed
        s.y[self.at] = x + self.weight * (self.q - x)


class Misalignment(Effect):
    """Wheels that stand otherwise than the sensor of the steering says."""

    def steer(self, s):
        s.delta[self.at] += self.bias


class Bank(Effect):
    """Gravity's pull to the left is borne by the tyres: the car crabs, and turns if they differ."""

    def steer(self, s):
        turn = 1.0 + self.swing * np.sin(2.0 * np.pi * s.distance[self.at] / self.wave + self.phase)
        pull = GRAVITY * self.slope * turn
        s.crab[self.at] += self.rear * pull
        s.delta[self.at] += (self.front - self.rear) * pull


class Understeer(Effect):
    def steer(self, s):
        v = s.y[self.at]
        s.delta[self.at] /= 1.0 + self.gradient * v * v


class Relaxation(Effect):
    """Tyres take up a new curvature over a distance, not a time."""

    def curve(self, s):
        now = s.curvature[self.at]
        if s.k == 0:
            self.taken = now.copy()
        share = -np.expm1(-s.h * np.abs(s.ground[self.at]) / self.length)
        self.taken += share * (now - self.taken)
        s.curvature[self.at] = self.taken


class TyreSaturation(Effect):
    def yaw(self, s):
        asked = np.abs(s.ground[self.at] * s.turning[self.at]) / self.most
        s.turning[self.at] /= np.sqrt(np.sqrt(1.0 + asked**4))


class Gust(Effect):
    def yaw(self, s):
        s.turning[self.at] += self.push[:, min(s.k // 10, self.push.shape[1] - 1)]


class SensorLag(Effect):
    def begin(self, s):
        self.share = -np.expm1(-s.h / self.time_constant)

    def sensor(self, s):
        flat = s.m.ravel()
        if s.k == 0:
            self.shown = flat[self.at].copy()
        self.shown += self.share * (flat[self.at] - self.shown)
        flat[self.at] = self.shown


class SensorDelay(Effect):
    def sensor(self, s):
        flat = s.m.ravel()
        if s.k == 0:
            self.ring = Ring(np.round(self.delay / s.h).astype(int), flat[self.at])
        flat[self.at] = self.ring(s.k, flat[self.at])


_ALL = (
    TransportDelay, Dropout, Drift, Regime, SpeedGain, MemoryGain, Thermal, CrossIntoSteering,
    Periodic, EffortAsymmetry, StateLag, TorqueLimit, RateFriction, SlewLimit, Lock, LevelFriction,
    Drag, Grade, CorneringLoss, Backlash, BoucWen, Resonance, Misalignment, Bank, Understeer,
    Relaxation, TyreSaturation, Gust, SensorLag, SensorDelay,
)  # fmt: skip
REGISTRY: dict[str, type[Effect]] = {kind.__name__: kind for kind in _ALL}
"""Effects by name, in the order in which they act within a stage."""
