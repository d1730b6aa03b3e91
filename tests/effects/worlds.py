"""Plants of several sizes under rich commands, and programs that answer for the whole registry.

A program simulates a vector of all parameters of all causes, compiled once; a contract is a few of
its lanes, so a new cause is covered as soon as it is registered.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from vdmsi_jax.effects import ACTUATOR, SENSOR, VEHICLE, AbstractEffect, Scales, Signals
from vdmsi_jax.models.bicycle import Bicycle
from vdmsi_jax.models.extended_plant import respond
from vdmsi_jax.models.observer_form import observer, slowness_of
from vdmsi_jax.parameters import Parameter, parameters

REGISTRY = ACTUATOR + VEHICLE + SENSOR
ON_A_PLANT = ACTUATOR + SENSOR
ROWS, SUBSTEPS = 240, 4
LANES = 64
ORDER = 4  # of the padded plants


def label(effect: AbstractEffect) -> str:
    """The class and its form: `Saturation response`."""
    forms = [value for value in vars(effect).values() if isinstance(value, str)]
    return " ".join([type(effect).__name__, *forms])


@dataclass(frozen=True)
class World:
    """Where a plant lives: range of its commands, gain, sample period and time constant."""

    name: str
    low: float
    high: float
    gain: float
    dt: float
    tau: float
    speed: float

    @property
    def size(self) -> float:
        """The largest command."""
        return max(abs(self.low), abs(self.high))

    def rich(self) -> tuple[np.ndarray, Signals]:
        """Steps, a chirp and slow reversals over both signs, with a moving vehicle around."""
        rng = np.random.default_rng(7)
        k = np.arange(ROWS)
        u = np.repeat(rng.permutation(np.linspace(-0.8, 0.8, ROWS // 40)), 40)
        u = u + 0.2 * np.sin((0.05 + 0.002 * k) * k) + 0.1 * np.sin(0.03 * k)
        v = self.speed * (1.0 + 0.4 * np.sin(0.05 * k + 1.0))
        other = 0.3 * np.sin(0.11 * k + 0.4)
        distance = np.concatenate([[0.0], np.cumsum(v[:-1])]) * self.dt
        t = self.dt * k
        signals = Signals(
            *map(jnp.asarray, (t, v, other, distance)),
            jnp.ones(()), jnp.zeros(2), jnp.asarray(self.dt / SUBSTEPS), SUBSTEPS,
        )  # fmt: skip
        return self.size * u, signals

    @property
    def scales(self) -> Scales:
        """As a record of this world would have them."""
        low, high = sorted((self.gain * self.low, self.gain * self.high))
        return Scales(
            self.low, self.high, low, high,
            rate=0.5 * (high - low) / self.tau, speed=self.speed,
            distance=1.2 * self.speed * ROWS * self.dt, duration=ROWS * self.dt, dt=self.dt,
            time_constant=self.tau, noise=1e-3 * (high - low),
        )  # fmt: skip

    def plant(self, poles: int = 2) -> tuple[jax.Array, jax.Array, jax.Array]:
        """Coefficients of a padded plant, and its pace."""
        roots = [-1.0, -4.0, -9.0, -11.0][:poles]
        den = np.poly(roots)
        a, b = np.zeros(ORDER), np.zeros(ORDER)
        a[:poles], b[poles - 1] = den[1:], self.gain * den[-1]
        return jnp.asarray(a), jnp.asarray(b), jnp.asarray(1.0 / self.tau)


WORLDS = (
    World("speed of a vehicle", 2.0, 18.0, 1.0, 0.05, 0.6, 10.0),
    World("steering", -0.3, 0.3, 1.0, 0.01, 0.08, 12.0),
    World("plant of 0 to 1 V", 0.0, 1.0, 37.0, 0.001, 0.02, 1.0),
    World("negative commands", -8.0, -4.0, 0.5, 0.02, 0.3, 3.0),
    World("negative gain", -1.0, 2.0, -3.0, 0.02, 0.2, 3.0),
    World("slow tank", 0.0, 5.0, 2.0, 4.0, 60.0, 1.0),
    World("oven", 20.0, 80.0, 0.5, 60.0, 1800.0, 1.0),
)


@dataclass(frozen=True)
class Place:
    """Where an effect's parameters stand in the vector of all."""

    effect: AbstractEffect
    index: tuple[int, ...]
    known: tuple[Parameter, ...]


def places(effects: tuple[AbstractEffect, ...]) -> tuple[Place, ...]:
    """The place of each effect."""
    at, found = 0, []
    for effect in effects:
        index, known = [], []
        for parameter in parameters(effect).values():
            for _ in np.atleast_1d(parameter.off):
                index.append(at)
                known.append(parameter)
                at += 1
        found.append(Place(effect, tuple(index), tuple(known)))
    return tuple(found)


def off(effects: tuple[AbstractEffect, ...]) -> np.ndarray:
    """The vector at which every effect is off."""
    values = [np.atleast_1d(p.off) for e in effects for p in parameters(e).values()]
    return np.concatenate(values).astype(float)


def filled(effects: tuple[AbstractEffect, ...], vector) -> tuple[AbstractEffect, ...]:
    """The effects with the parameters in a vector."""
    at, made = 0, []
    for effect in effects:
        for name in parameters(effect):
            old = getattr(effect, name)
            new = vector[at : at + old.size].reshape(old.shape)
            effect = eqx.tree_at(lambda e, name=name: getattr(e, name), effect, new)
            at += old.size
        made.append(effect)
    return tuple(made)


class Program:
    """A function of a vector, its derivatives, and how often each was traced."""

    def __init__(self, answer: Callable):
        self.traced = dict.fromkeys(("one", "many", "forward", "reverse"), 0)

        def count(name, function):
            def counted(*arguments):
                self.traced[name] += 1
                return function(*arguments)

            return eqx.filter_jit(counted)

        def forward(world, vector, direction):
            return jax.jvp(lambda x: answer(world, x), (vector,), (direction,))[1]

        def reverse(world, vector, weights):
            return jax.grad(lambda x: jnp.vdot(weights, answer(world, x)))(vector)

        self.one = count("one", answer)
        self._many = count("many", jax.vmap(answer, (None, 0)))
        self._forward = count("forward", jax.vmap(forward, (None, 0, 0)))
        self._reverse = count("reverse", jax.vmap(reverse, (None, 0, None)))

    def many(self, world, vectors) -> np.ndarray:
        """Answers to many vectors."""
        return self._in_lanes(lambda x: self._many(world, x), vectors)

    def forward(self, world, vectors, directions) -> np.ndarray:
        """Change of each answer along a direction."""
        return self._in_lanes(lambda x, d: self._forward(world, x, d), vectors, directions)

    def reverse(self, world, vectors, weights) -> np.ndarray:
        """Gradients of the weighted answers."""
        return self._in_lanes(lambda x: self._reverse(world, x, weights), vectors)

    @staticmethod
    def _in_lanes(function, *arrays) -> np.ndarray:
        arrays, out = [np.asarray(a) for a in arrays], []
        for start in range(0, len(arrays[0]), LANES):
            parts = [a[start : start + LANES] for a in arrays]
            count = len(parts[0])
            padded = [np.concatenate([p, np.repeat(p[:1], LANES - count, 0)]) for p in parts]
            out.append(np.asarray(function(*map(jnp.asarray, padded)))[:count])
        return np.concatenate(out)


def answer_of_plant(world, vector):
    """Rows of a plant with all causes of actuators and sensors."""
    u, signals, a, b, pace, effects = world
    system, rest = observer(a, b, pace)
    slowness = slowness_of(a, b, pace, signals.leads)
    told = eqx.tree_at(lambda s: s.slowness, signals, slowness)
    return respond(system, rest, filled(effects, vector), u, told)


def answer_of_body(world, vector):
    """Speed (10 m/s), angle from heading to course (rad) and curvature (0.1/m) of a bicycle with
    all causes of the body."""
    v, delta, dt, effects = world
    effects = filled(effects, vector)
    bicycle = Bicycle(1.75, 1.2)
    for effect in effects:
        v, delta = effect.speed(v), effect.angle(delta)
    beta, kappa = bicycle.slip_angle(delta), bicycle.course(delta)[2]
    for effect in effects:
        beta, kappa = effect.course(beta), effect.curvature(kappa, v)
    for effect in effects:
        kappa = effect.relaxed(kappa, v, dt)
    return jnp.concatenate([0.1 * v, beta, 10.0 * kappa])


@dataclass(frozen=True, eq=False)
class Bench:
    """Effects in a world, with the program that answers for them."""

    name: str
    program: Program
    effects: tuple[AbstractEffect, ...]
    scales: Scales
    world: tuple

    @property
    def places(self) -> tuple[Place, ...]:
        """Where each effect stands."""
        return places(self.effects)

    @property
    def off(self) -> np.ndarray:
        """All off."""
        return off(self.effects)

    def probed(self, place: Place, factor: float = 1.0) -> np.ndarray:
        """The vectors of an effect's probes (times a factor), the others off."""
        probes = np.asarray(place.effect.probes(self.scales), float)
        vectors = np.repeat(self.off[None], len(probes), axis=0)
        vectors[:, place.index] = probes * factor
        return vectors


@cache
def _programs() -> tuple[Program, Program]:
    return Program(answer_of_plant), Program(answer_of_body)


@cache
def benches() -> tuple[Bench, ...]:
    """Every world with the causes of plants, and a drive with those of the body."""
    plant, body = _programs()
    made = []
    for world in WORLDS:
        u, signals = world.rich()
        effects = tuple(e.scaled(world.scales) for e in ON_A_PLANT)
        told = (jnp.asarray(u), signals, *world.plant(), effects)
        made.append(Bench(world.name, plant, effects, world.scales, told))
    road = WORLDS[0]
    u, signals = road.rich()
    effects = tuple(e.scaled(road.scales) for e in VEHICLE)
    told = (signals.v, jnp.asarray(0.02 * u), jnp.asarray(road.dt), effects)
    made.append(Bench("drive", body, effects, road.scales, told))
    return tuple(made)
