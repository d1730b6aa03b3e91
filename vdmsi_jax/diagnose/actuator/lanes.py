"""The compiled simulation of a diagnosis: plants of every order, with any causes, side by side.

A hypothesis is a vector: coefficients of the plant, its feed-through, leads of forces, then the
parameters of all causes, of which those that are not its own are off. Every order and every cause
is a lane of the same program.
"""

from dataclasses import dataclass, replace
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, ArrayLike, Bool, Float, Int

from ...effects import AbstractEffect, Scales, Signals
from ...models.extended_plant import respond
from ...models.observer_form import effort_of_steps, observer, slowness_of, steps_of
from ...models.state_space import StateSpace
from ...parameters import parameters, with_values
from ...programs import Kept, Static

POLES = 4
FEED = 2 * POLES  # where the feed-through stands in a vector, behind the numerator
NUMERATOR = slice(POLES, FEED + 1)  # what grows with the gain
LEADS = (FEED + 1, FEED + 2)  # where those of forces stand, by 1 / pace
PER_RUN = ("t", "v", "other", "distance", "begun")  # of the signals
FIRST_CAUSE = LEADS[-1] + 1  # where the parameters of causes begin
PAIRS = 16  # of a vector and a run, that the compiled program simulates side by side: as quick a
# pair as twice as many, and fewer idle ones; the other processors take the next call


@dataclass(frozen=True, eq=False)
class Group:
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
    def all_of(
        unravel: "Unravel",
        signals: Signals,
        u: Float[np.ndarray, "R N"],
        level: Float[np.ndarray, " R"],
    ) -> "tuple[Group, ...]":
        """The runs of a stage: their commands, and the response that each began at."""
        every = np.arange(len(u))
        parts = [every[start : start + PAIRS] for start in range(0, len(every), PAIRS)]
        return tuple(Group.of(unravel, signals, u, level, runs) for runs in parts)

    @staticmethod
    def of(
        unravel: "Unravel",
        signals: Signals,
        u: Float[np.ndarray, "R N"],
        level: Float[np.ndarray, " R"],
        runs: Int[np.ndarray, " G"],
    ) -> "Group":
        """Some of them."""
        pairs = _padded(np.tile(runs, PAIRS // len(runs)))
        rows = {name: _longer(np.asarray(getattr(signals, name))[pairs]) for name in PER_RUN}
        leaves, tree = jax.tree.flatten((unravel, replace(signals, **rows)))
        pairs_u, pairs_level = _longer(u[pairs]), jnp.asarray(level[pairs])
        return Group(runs, Static(tree), leaves, pairs_u, pairs_level, signals.h, u.shape[1])

    @property
    def lanes(self) -> int:
        """How many vectors a call takes."""
        return PAIRS // len(self.runs)

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
    return np.concatenate([rows, np.repeat(rows[:1], PAIRS - len(rows), axis=0)])


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
            new = []
            for name in parameters(effect):
                old = getattr(effect, name)
                new.append(values[at : at + old.size].reshape(old.shape))
                at += old.size
            effect = with_values(effect, new)
            made.append(_Inert() if self.by_rows and effect.remembers else effect)
        return tuple(made)


class Plant(NamedTuple):
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
    def of_row(row: Float[Array, " K"]) -> "Plant":
        """From such a row."""
        n = POLES
        shapes = ((n, n), (n,), (n,), (), (n,), (), (n, n), (n, 2))
        ends = np.cumsum([int(np.prod(shape)) for shape in shapes])
        parts = jnp.split(row, ends[:-1])
        return Plant(*(x.reshape(shape) for x, shape in zip(parts, shapes, strict=True)))


def plants(
    theta: Float[np.ndarray, "L P"], pace: float, h: Float[ArrayLike, ""]
) -> Float[np.ndarray, "L K"]:
    """The plants of vectors, with steps over `h` seconds, a row of numbers each."""
    starts = range(0, len(theta), PAIRS)
    parts = [_rows_of(_padded(theta[k : k + PAIRS]), np.asarray(pace), h) for k in starts]
    return np.concatenate(parts)[: len(theta)]


@Kept
def _rows_of(theta, pace, h):
    """The plants of many vectors, with steps over `h` seconds."""

    def of(vector):
        return vector[:POLES], vector[POLES:FEED], vector[np.array(LEADS)]

    def effort(vector):
        a, b, leads = of(vector)
        return effort_of_steps(observer(a, b, pace, vector[FEED])[0], leads, h)

    def one(vector):
        a, b, leads = of(vector)
        system, rest = observer(a, b, pace, vector[FEED])
        slowness = slowness_of(a, b, pace, leads)
        steps = steps_of(system, leads, h, squarings)
        return Plant(system.A, system.B, system.C, system.D, rest, slowness, *steps).row()

    squarings = jnp.max(jax.vmap(effort)(theta))
    return jax.vmap(one)(theta)


@Kept
def _simulate(tree, leaves, plants, theta, on, u, level):
    unravel, signals = jax.tree.unflatten(tree.value, leaves)

    def one(row, vector, u, signals, level):
        plant = Plant.of_row(row)
        rest, steps = plant.rest, (plant.Ad, plant.Bd)
        effects = unravel(vector[FIRST_CAUSE:])
        for effect in effects:
            level = effect.rested(level)
        gain = rest[0] + plant.D
        known = ~jnp.isnan(level) & (jnp.abs(gain) > 1e-9)
        before = jnp.where(known, level / jnp.where(known, gain, 1.0), u[0])
        leads = vector[np.array(LEADS)]
        told = replace(signals, slowness=plant.slowness, leads=leads, before=before)
        system = StateSpace(plant.A, plant.B, plant.C, plant.D)
        return respond(system, rest, effects, u, told, on, steps, rest * before)

    per_pair = jax.tree.map(lambda leaf: 0 if jnp.ndim(leaf) == 2 else None, signals)
    return jax.vmap(one, in_axes=(0, 0, 0, per_pair, 0))(plants, theta, u, signals, level)
