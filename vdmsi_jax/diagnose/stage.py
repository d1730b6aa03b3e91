"""One response to one command, with every cause that may act on it: the simulation that a diagnosis
asks for again and again, compiled once.

A hypothesis is a vector of parameters in which those that are not its own are off. The plant is one
of up to four poles whose missing coefficients are zero, so every order and every cause is a lane of
the same program.
"""

from dataclasses import dataclass
from functools import cached_property

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float

from ..effects import AbstractEffect, Scales, Signals
from ..models.extended_plant import observer, respond
from ..parameters import Parameter, parameters

POLES = 4
LEAD = 2 * POLES  # where the lead of forces stands in a vector
_LANES = (16, 64)  # lanes of a compiled program


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
        return type(self.effect).effort is not AbstractEffect.effort

    @property
    def weight(self) -> float:
        """How many parameters it counts as."""
        return max(self.effect.weight, float(len(self.index)))


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

    @cached_property
    def slots(self) -> tuple[Slot, ...]:
        """All causes, in the order of `effects`."""
        found, at = [], LEAD + 1
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
        return np.concatenate([np.zeros(LEAD + 1), *values])

    @cached_property
    def bounds(self) -> tuple[Float[np.ndarray, " P"], Float[np.ndarray, " P"]]:
        """Lower and upper bounds."""
        low, high = np.full(self.off.size, -np.inf), np.full(self.off.size, np.inf)
        low[LEAD], high[LEAD] = 0.0, 30.0 * self.scales.time_constant
        for slot in self.slots:
            for i, known in zip(slot.index, slot.known, strict=True):
                low[i], high[i] = known.lower, known.upper
        return low, high

    @cached_property
    def usual(self) -> Float[np.ndarray, " P"]:
        """Sizes that the parameters usually have, for differences and damping."""
        size = np.ones(self.off.size)
        size[LEAD] = self.scales.time_constant
        for number in self.allowed:
            slot = self.slots[number]
            probes = np.array(slot.effect.probes(self.scales))
            if probes.size:
                typical = np.array(
                    [np.median(np.abs(c[c != 0])) if np.any(c != 0) else 1.0 for c in probes.T]
                )
                size[list(slot.index)] = typical
        periodic = [s for s in self.slots if s.cause == "periodic_disturbance"]
        for slot in periodic:
            size[list(slot.index)] = [1.0 / self.scales.duration, self.scales.noise, self.scales.noise]
        return size

    @cached_property
    def _remembering(self) -> list[int]:
        """Parameters of the effects that need sub-steps."""
        return [i for slot in self.slots if slot.effect.remembers for i in slot.index]

    def simulate(self, theta: Float[np.ndarray, "L P"]) -> Float[np.ndarray, "L R N"]:
        """The response of each of the vectors to the commands of all runs.

        A linear plant answers a held command exactly from row to row, so only lanes in which an
        effect has memory take sub-steps.
        """
        fine = np.any(theta[:, self._remembering] != self.off[self._remembering], axis=1)
        y = np.empty((len(theta), *self.u.shape))
        for stepped in (False, True):
            lanes = np.flatnonzero(fine == stepped)
            if lanes.size:
                y[lanes] = self._simulate(theta[lanes], stepped)
        return y

    def _simulate(self, theta: np.ndarray, stepped: bool) -> np.ndarray:
        signals = self.signals
        if not stepped:
            signals = eqx.tree_at(lambda s: s.h, signals, jnp.asarray(self.dt, float))
            signals = Signals(*(getattr(signals, n) for n in _SIGNALS), substeps=1)
        done, out = 0, []
        while done < len(theta):
            left = len(theta) - done
            lanes = _LANES[0] if left <= _LANES[0] else _LANES[1]
            part = theta[done : done + lanes]
            padded = np.concatenate([part, np.repeat(part[:1], lanes - len(part), axis=0)])
            y = _simulate(Unravel(self.effects), padded, self.u, signals, self.pace, stepped)
            out.append(np.asarray(y)[: len(part)])
            done += len(part)
        return np.concatenate(out)


_SIGNALS = ("t", "v", "other", "distance", "slowness", "lead", "h")


class Unravel(eqx.Module):
    """From the vector of a stage to its effects, whose constants travel with it."""

    effects: tuple[AbstractEffect, ...]

    def __call__(self, vector: Float[np.ndarray, " P"]) -> tuple[AbstractEffect, ...]:
        """The effects with the parameters in `vector`."""
        at, made = 0, []
        for effect in self.effects:
            for name in parameters(effect):
                old = getattr(effect, name)
                new = vector[at : at + old.size].reshape(old.shape)
                at += old.size
                effect = eqx.tree_at(lambda e, name=name: getattr(e, name), effect, new)
            made.append(effect)
        return tuple(made)


@eqx.filter_jit
def _simulate(unravel: Unravel, theta, u, signals: Signals, pace, stepped: bool):
    def one(vector, u, signals):
        a, b, own = vector[:POLES], vector[POLES : 2 * POLES], vector[LEAD + 1 :]
        system, rest, slowness = observer(a, b, pace)
        told = eqx.tree_at(lambda s: (s.slowness, s.lead), signals, (slowness, vector[LEAD]))
        effects = tuple(e for e in unravel(own) if stepped or not e.remembers)
        return respond(system, rest, effects, u, told)

    per_run = Signals(0, 0, 0, 0, None, None, None, signals.substeps)  # axes to map over
    over_runs = jax.vmap(one, in_axes=(None, 0, per_run))
    return jax.vmap(over_runs, in_axes=(0, None, None))(jnp.asarray(theta), jnp.asarray(u), signals)
