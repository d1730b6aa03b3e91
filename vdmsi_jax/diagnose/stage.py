"""One response to one command, with every cause that may act on it: the simulation that a diagnosis
asks for again and again, compiled once.

A hypothesis is a vector of parameters in which those that are not its own are off. The plant is one
of up to four poles whose missing coefficients are zero, so every order and every cause is a lane of
the same program.
"""

from collections.abc import Collection
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, ArrayLike, Bool, Float, Int

from ..effects import AbstractEffect, Scales, Signals
from ..models.extended_plant import acts, respond
from ..models.observer_form import effort_of_steps, observer, slowness_of, steps_of
from ..models.state_space import StateSpace
from ..parameters import Parameter, parameters
from ..programs import Kept, Static
from ..threads import each
from .noise import Noise, OwnNoise

POLES = 4
LEADS = (2 * POLES, 2 * POLES + 1)  # where those of forces stand in a vector, by 1 / pace
PER_RUN = ("t", "v", "other", "distance", "begun")  # of the signals
FIRST_CAUSE = LEADS[-1] + 1  # where the parameters of causes begin
MOST_LEAD = 30.0
_PAIRS = 16  # of a vector and a run, that the compiled program simulates side by side: as quick a
# pair as twice as many, and fewer idle ones; the other processors take the next call
_START = 0.5  # s, in which a first measurement tells where a run began
_MOST_USUAL = 1e3  # sizes that a parameter usually has, beyond which none is looked for


@dataclass(frozen=True)
class Slot:
    """A cause of a stage, and where its parameters stand in the stage's vector."""

    effect: AbstractEffect
    where: str
    index: tuple[int, ...]
    names: tuple[str, ...]
    known: tuple[Parameter, ...]

    @property
    def cause(self) -> str:
        """The word of the contract."""
        return self.effect.cause

    @property
    def forces(self) -> bool:
        """Whether it acts as a force inside the dynamics."""
        return acts(self.effect, "effort") or acts(self.effect, "load")

    @property
    def rough(self) -> bool:
        """Whether its force depends on the motion, by laws with corners."""
        return acts(self.effect, "effort")

    @property
    def weight(self) -> float:
        """How many parameters it counts as."""
        return self.effect.weight or float(len(self.index))


@dataclass(frozen=True, eq=False)
class Stage:
    """A command, a response, and the causes between them.

    Attributes:
        name: `powertrain`, `steering` or the name of another plant.
        u, y: (runs, N) command and measured response, padded by their last value.
        mask: (runs, N) samples that count in a fit.
        held_out: (runs, N) samples that only judge one.
        signals: what else the effects look at, (runs, N) each.
        effects: all causes, off.
        allowed: numbers of the effects that may act here.
        wheres: where each effect sits, as the contract says it.
        scales: sizes of the signals.
        pace: inverse of the time unit of the coefficients, 1/s.
        dt: sample period, s.
        noise: what its colour is told by.
        within: (runs, N, k) the command inside each row, where rows are means of several; None
            where they are the log's own.
    """

    name: str
    u: Float[np.ndarray, "R N"]
    y: Float[np.ndarray, "R N"]
    mask: Bool[np.ndarray, "R N"]
    held_out: Bool[np.ndarray, "R N"]
    signals: Signals
    effects: tuple[AbstractEffect, ...]
    allowed: tuple[int, ...]
    wheres: tuple[str, ...]
    scales: Scales
    pace: float
    dt: float
    noise: Noise = OwnNoise()
    within: Float[np.ndarray, "R N k"] | None = None

    @cached_property
    def slots(self) -> tuple[Slot, ...]:
        """All causes, in the order of `effects`."""
        found, at = [], FIRST_CAUSE
        for effect, where in zip(self.effects, self.wheres, strict=True):
            index, names, known = [], [], []
            for name, parameter in parameters(effect).items():
                off = np.atleast_1d(parameter.off)
                for k in range(off.size):
                    index.append(at)
                    names.append(name if off.size == 1 else f"{name}_{k}")
                    known.append(parameter)
                    at += 1
            found.append(Slot(effect, where, tuple(index), tuple(names), tuple(known)))
        return tuple(found)

    @cached_property
    def off(self) -> Float[np.ndarray, " P"]:
        """The vector of a plant without poles and causes."""
        values = [np.atleast_1d(k.off) for e in self.effects for k in parameters(e).values()]
        return np.concatenate([np.zeros(FIRST_CAUSE), *values])

    @cached_property
    def bounds(self) -> tuple[Float[np.ndarray, " P"], Float[np.ndarray, " P"]]:
        """Lower and upper bounds, and no farther than `_MOST_USUAL` where there are none: a limit
        on a side that nothing reaches would run away."""
        low, high = np.full(self.off.size, -np.inf), np.full(self.off.size, np.inf)
        low[list(LEADS)] = 0.0, 1e-6  # the second is free where it is not off, and stays free
        high[list(LEADS)] = MOST_LEAD
        for slot in self.slots:
            for i, known in zip(slot.index, slot.known, strict=True):
                most = _MOST_USUAL * self.usual[i]
                low[i], high[i] = max(known.lower, -most), min(known.upper, most)
        return low, high

    @cached_property
    def ridge(self) -> Float[np.ndarray, " P"]:
        """Inverse variances that parameters are believed to have about off; zero for most."""
        weight = np.zeros(self.off.size)
        for slot in self.slots:
            weight[list(slot.index)] = [1.0 / known.spread**2 for known in slot.known]
        return weight

    @cached_property
    def usual(self) -> Float[np.ndarray, " P"]:
        """Sizes that the parameters usually have, for differences and damping."""
        size = np.ones(self.off.size)
        for number in self.allowed:
            slot = self.slots[number]
            probes = np.array(slot.effect.probes(self.scales))
            if probes.size:
                typical = np.array(
                    [np.median(np.abs(c[c != 0])) if np.any(c != 0) else 1.0 for c in probes.T]
                )
                size[list(slot.index)] = typical
        for slot in self.slots:
            if slot.cause == "periodic_disturbance":  # a difference must not turn it over
                size[slot.index[0]] = 1.0 / self.scales.duration
        return size

    def on(self, theta: Float[np.ndarray, "L P"]) -> Bool[np.ndarray, "L effects"]:
        """Which causes are on in each of the vectors."""
        differs = theta != self.off
        starts = [slot.index[0] for slot in self.slots]
        return np.logical_or.reduceat(differs, starts, axis=1)

    @cached_property
    def _kinds(self) -> tuple[Bool[np.ndarray, " effects"], Bool[np.ndarray, " effects"]]:
        """Which causes need sub-steps, and which are forces."""
        remembers = [slot.effect.remembers for slot in self.slots]
        return np.array(remembers), np.array([slot.forces for slot in self.slots])

    @cached_property
    def fitting(self) -> "Stage":
        """The runs of which something counts in a fit."""
        used = self.mask.any(axis=1)
        if used.all():
            return self
        signals = self.signals
        signals = replace(signals, **{name: getattr(signals, name)[used] for name in PER_RUN})
        parts = {name: getattr(self, name)[used] for name in ("u", "y", "mask", "held_out")}
        within = None if self.within is None else self.within[used]
        return replace(self, signals=signals, within=within, **parts)

    def but(self, numbers: Collection[int]) -> "Stage":
        """The same where some causes may not act."""
        return replace(self, allowed=tuple(k for k in self.allowed if k not in numbers))

    def simulate(self, theta: Float[np.ndarray, "L P"]) -> Float[np.ndarray, "L R N"]:
        """The response of each of the vectors to the commands of all runs.

        A linear plant answers a held command exactly from row to row, so only lanes in which an
        effect has memory take sub-steps. Lanes with the same causes run side by side, since the
        work of causes that none of them has is left out.
        """
        on = self.on(theta)
        remembers, forces = self._kinds
        fine = np.any(on & remembers, axis=1) & (self.signals.substeps > 1)
        numbers = np.where(on.any(axis=1), on.argmax(axis=1), -1)
        sequence = np.lexsort((numbers, np.any(on & forces, axis=1), fine))
        y = np.empty((len(theta), *self.u.shape))
        calls = []
        for stepped in (False, True):
            lanes = sequence[fine[sequence] == stepped]
            if not lanes.size:
                continue
            groups = self._by_substeps if stepped else self._by_rows
            plants = self._plants(theta[lanes], groups[0].h)
            for group in groups:
                for start in range(0, len(lanes), group.lanes):
                    part = slice(start, start + group.lanes)
                    calls.append((group, lanes[part], plants[part]))

        def run(call: "tuple[_Group, np.ndarray, np.ndarray]") -> None:
            group, own, plants = call
            y[np.ix_(own, group.runs)] = group.simulate(plants, theta[own], np.any(on[own], axis=0))

        each(run, calls)
        return y

    def impulse(
        self, theta: Float[np.ndarray, " P"], count: int, every: int
    ) -> Float[np.ndarray, " count"]:
        """What the plant of a vector, without causes, answers to a command of one that is held for
        a part of a row, one of `every`: at the beginning of each such part."""
        row = self._plants(theta[None], jnp.asarray(self.dt / every))[0]
        steps = _Plant.of_row(jnp.asarray(row))
        Ad, state = np.asarray(steps.Ad), np.asarray(steps.Bd)[:, 0]
        taps = np.zeros(count)
        for k in range(1, count):
            taps[k] = state[0]
            state = Ad @ state
        return taps

    def _plants(
        self, theta: Float[np.ndarray, "L P"], h: Float[ArrayLike, ""]
    ) -> Float[np.ndarray, "L K"]:
        """The plants of vectors, with steps over `h` seconds, a row of numbers each."""
        starts, pace = range(0, len(theta), _PAIRS), np.asarray(self.pace)
        parts = [_plants(_padded(theta[k : k + _PAIRS]), pace, h) for k in starts]
        return np.concatenate(parts)[: len(theta)]

    @cached_property
    def level(self) -> Float[np.ndarray, " R"]:
        """Measured response at the start of each run, where the plant is taken to have rested; NaN
        where it was not measured there."""
        known = (self.mask | self.held_out)[:, : max(1, round(_START / self.dt))]
        first = np.argmax(known, axis=1)
        return np.where(known.any(axis=1), self.y[np.arange(len(first)), first], np.nan)

    @cached_property
    def late(self) -> Bool[np.ndarray, " R"]:
        """The runs of which something counts, and not the first sample."""
        return self.mask.any(axis=1) & ~self.mask[:, 0]

    @cached_property
    def _by_rows(self) -> "tuple[_Group, ...]":
        """The runs as the program takes them, from row to row."""
        coarse = eqx.tree_at(lambda s: s.h, self.signals, jnp.asarray(self.dt, float))
        unravel = Unravel(self.effects, by_rows=self.signals.substeps > 1)
        return _Group.all_of(self, unravel, replace(coarse, substeps=1))

    @cached_property
    def _by_substeps(self) -> "tuple[_Group, ...]":
        """The same at sub-steps."""
        return _Group.all_of(self, Unravel(self.effects), self.signals)


@dataclass(frozen=True, eq=False)
class _Group:
    """Runs that share a call of the program, which takes pairs of a vector and a run, and lengths
    of a ladder: so it is the same for any number of runs, and for most logs of a length.

    Attributes:
        runs: their numbers.
        tree, leaves: effects and signals of the pairs, flat, since to take modules apart at each
            call would cost more than a small simulation.
        u, level: of the pairs, with rows after the last up to the ladder's length.
        h: length of a step, s.
        n: rows of the runs.
    """

    runs: Int[np.ndarray, " G"]
    tree: Static
    leaves: list
    u: Float[Array, "pairs N"]
    level: Float[Array, " pairs"]
    h: Float[Array, ""]
    n: int

    @staticmethod
    def all_of(stage: Stage, unravel: "Unravel", signals: Signals) -> "tuple[_Group, ...]":
        """The runs of a stage, told these signals."""
        every = np.arange(len(stage.u))
        parts = [every[start : start + _PAIRS] for start in range(0, len(every), _PAIRS)]
        return tuple(_Group.of(stage, unravel, signals, runs) for runs in parts)

    @staticmethod
    def of(
        stage: Stage, unravel: "Unravel", signals: Signals, runs: Int[np.ndarray, " G"]
    ) -> "_Group":
        """Some of them."""
        pairs = _padded(np.tile(runs, _PAIRS // len(runs)))
        rows = {name: _longer(np.asarray(getattr(signals, name))[pairs]) for name in PER_RUN}
        leaves, tree = jax.tree.flatten((unravel, replace(signals, **rows)))
        u, level = _longer(stage.u[pairs]), jnp.asarray(stage.level[pairs])
        return _Group(runs, Static(tree), leaves, u, level, signals.h, stage.u.shape[1])

    @property
    def lanes(self) -> int:
        """How many vectors a call takes."""
        return _PAIRS // len(self.runs)

    def simulate(
        self,
        plants: Float[np.ndarray, "L K"],
        theta: Float[np.ndarray, "L P"],
        on: Bool[np.ndarray, " effects"],
    ) -> Float[np.ndarray, "L G N"]:
        """The response of some vectors, no more than `lanes`, to the commands of the runs."""
        many = len(self.runs)
        plants, vectors = (_padded(np.repeat(rows, many, axis=0)) for rows in (plants, theta))
        y = _simulate(self.tree, self.leaves, plants, vectors, on, self.u, self.level)
        return np.asarray(y)[: len(theta) * many, : self.n].reshape(len(theta), many, self.n)


def _longer(rows: Float[np.ndarray, "pairs N"]) -> Float[Array, "pairs M"]:
    """Rows that go on by their last value up to a length of the ladder, of eight an octave; short
    ones stay as they are."""
    n = rows.shape[1]
    rung = 1 << max(n.bit_length() - 4, 0)
    return jnp.asarray(np.pad(rows, ((0, 0), (0, -n % rung)), mode="edge"))


def _padded(rows: np.ndarray) -> np.ndarray:
    """As many rows as the program takes, with the first again for those that lack."""
    return np.concatenate([rows, np.repeat(rows[:1], _PAIRS - len(rows), axis=0)])


class _Inert(AbstractEffect):
    """Stands for an effect that is off in every lane, so that nothing of it is compiled."""

    cause = ""

    def probes(self, scales: Scales) -> list[tuple[float, ...]]:
        """None."""
        return []


class Unravel(eqx.Module):
    """From the vector of a stage to its effects, whose constants travel with it.

    Attributes:
        effects: all of them, with any parameters.
        by_rows: those that act between the rows are off and left out.
    """

    effects: tuple[AbstractEffect, ...]
    by_rows: bool = eqx.field(static=True, default=False)

    def __call__(self, vector: Float[ArrayLike, " P"]) -> tuple[AbstractEffect, ...]:
        """The effects with the parameters in `vector`."""
        values, at, made = jnp.asarray(vector), 0, []
        for effect in self.effects:
            for name in parameters(effect):
                old = getattr(effect, name)
                new = values[at : at + old.size].reshape(old.shape)
                at += old.size
                effect = eqx.tree_at(lambda e, name=name: getattr(e, name), effect, new)
            made.append(_Inert() if self.by_rows and effect.remembers else effect)
        return tuple(made)


class _Plant(NamedTuple):
    """A plant as the program takes it: matrices, state at rest, slowness, and steps."""

    A: Array
    B: Array
    C: Array
    D: Array
    rest: Array
    slowness: Array
    Ad: Array
    Bd: Array

    def row(self) -> Float[Array, " K"]:
        """As a row of numbers: one array is passed on in less time than eight."""
        return jnp.concatenate([jnp.ravel(part) for part in self])

    @staticmethod
    def of_row(row: Float[Array, " K"]) -> "_Plant":
        """From such a row."""
        n = POLES
        shapes = ((n, n), (n,), (n,), (), (n,), (), (n, n), (n, 2))
        ends = np.cumsum([int(np.prod(shape)) for shape in shapes])
        parts = jnp.split(row, ends[:-1])
        return _Plant(*(x.reshape(shape) for x, shape in zip(parts, shapes, strict=True)))


@Kept
def _plants(theta, pace, h):
    """The plants of many vectors, with steps over `h` seconds."""

    def of(vector):
        return vector[:POLES], vector[POLES : 2 * POLES], vector[np.array(LEADS)]

    def effort(vector):
        a, b, leads = of(vector)
        return effort_of_steps(observer(a, b, pace)[0], leads, h)

    def one(vector):
        a, b, leads = of(vector)
        system, rest = observer(a, b, pace)
        slowness = slowness_of(a, b, pace, leads)
        steps = steps_of(system, leads, h, squarings)
        return _Plant(system.A, system.B, system.C, system.D, rest, slowness, *steps).row()

    squarings = jnp.max(jax.vmap(effort)(theta))
    return jax.vmap(one)(theta)


@Kept
def _simulate(tree, leaves, plants, theta, on, u, level):
    unravel, signals = jax.tree.unflatten(tree.value, leaves)

    def one(row, vector, u, signals, level):
        plant = _Plant.of_row(row)
        rest, steps = plant.rest, (plant.Ad, plant.Bd)
        known = ~jnp.isnan(level) & (jnp.abs(rest[0]) > 1e-9)
        before = jnp.where(known, level / jnp.where(known, rest[0], 1.0), u[0])
        leads = vector[np.array(LEADS)]
        told = replace(signals, slowness=plant.slowness, leads=leads, before=before)
        effects = unravel(vector[FIRST_CAUSE:])
        system = StateSpace(plant.A, plant.B, plant.C, plant.D)
        return respond(system, rest, effects, u, told, on, steps, rest * before)

    per_pair = jax.tree.map(lambda leaf: 0 if jnp.ndim(leaf) == 2 else None, signals)
    return jax.vmap(one, in_axes=(0, 0, 0, per_pair, 0))(plants, theta, u, signals, level)
