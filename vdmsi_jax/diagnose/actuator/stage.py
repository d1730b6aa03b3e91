"""One response to one command, with every cause that may act on it: the data of a search, and what
a hypothesis about them answers."""

import math
from collections.abc import Collection
from dataclasses import dataclass, field, replace
from functools import cached_property

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float

from ...data.noise import white_noise_std
from ...effects import FORCES, AbstractEffect, Scales, Signals
from ...parameters import Parameter, parameters
from ...threads import each
from ..signals.noise import Noise, OwnNoise
from .lanes import FIRST_CAUSE, LEADS, PER_RUN, Group, Plant, Unravel, plants

MOST_LEAD = 30.0
LASTS = 0.1
"""Of the time by which a gain drifts, that a drift must take to be one, and a change may: what is
over sooner is a start, and leaves another gain, or a change of regime."""
_START = 0.5  # s, in which a first measurement tells where a run began
_STRAYS = 2.0  # standard deviations, by which squares about a mean may be larger
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
        return not self.effect.ports.isdisjoint(FORCES)

    @property
    def rough(self) -> bool:
        """Whether its force depends on the motion, by laws with corners."""
        return "effort" in self.effect.ports

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
        mask: (runs, N) samples that count in a fit: those before the first of a run have no past,
            and their innovations are the residual itself, which holds the states at the start.
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
        in_loop: whether a controller makes the command of what is measured.
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
    in_loop: bool = False
    tried: dict = field(default_factory=dict, init=False, repr=False)

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
        on a side that nothing reaches would run away. A change that takes as long as a drift would
        be one."""
        low, high = np.full(self.off.size, -np.inf), np.full(self.off.size, np.inf)
        low[list(LEADS)] = 0.0, 1e-6  # the second is free where it is not off, and stays free
        high[list(LEADS)] = MOST_LEAD
        for slot in self.slots:
            for i, known in zip(slot.index, slot.known, strict=True):
                most = _MOST_USUAL * self.usual[i]
                low[i], high[i] = max(known.lower, -most), min(known.upper, most)
            if slot.cause == "regime_change":
                ramp = slot.index[slot.names.index("ramp")]
                high[ramp] = LASTS * self.scales.clock(getattr(slot.effect, "over", "run"))
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
        return self._with(allowed=tuple(k for k in self.allowed if k not in numbers))

    def looped(self) -> "Stage":
        """The same, told that a controller makes the command."""
        return self._with(in_loop=True)

    def _with(self, **changed: object) -> "Stage":
        other = replace(self, **changed)
        object.__setattr__(other, "tried", self.tried)  # the same data
        return other

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
            rows = plants(theta[lanes], self.pace, groups[0].h)
            for group in groups:
                for start in range(0, len(lanes), group.lanes):
                    part = slice(start, start + group.lanes)
                    calls.append((group, lanes[part], rows[part]))

        def run(call: tuple[Group, np.ndarray, np.ndarray]) -> None:
            group, own, rows = call
            y[np.ix_(own, group.runs)] = group.simulate(rows, theta[own], np.any(on[own], axis=0))

        each(run, calls)
        return y

    def impulse(
        self, theta: Float[np.ndarray, " P"], count: int, every: int
    ) -> Float[np.ndarray, " count"]:
        """What the plant of a vector, without causes, answers to a command of one that is held for
        a part of a row, one of `every`: at the beginning of each such part."""
        row = plants(theta[None], self.pace, jnp.asarray(self.dt / every))[0]
        steps = Plant.of_row(jnp.asarray(row))
        Ad, state = np.asarray(steps.Ad), np.asarray(steps.Bd)[:, 0]
        taps = np.zeros(count)
        taps[0] = steps.D
        for k in range(1, count):
            taps[k] = state[0]
            state = Ad @ state
        return taps

    @cached_property
    def level(self) -> Float[np.ndarray, " R"]:
        """Measured response at the start of each run, where the plant is taken to have rested; NaN
        where it was not measured there."""
        first = max(1, round(_START / self.dt))
        known = self.mask | self.held_out
        return np.array([
            _begins_at(row[use], int(use[:first].sum()))
            for row, use in zip(self.y, known, strict=True)
        ])  # fmt: skip

    @cached_property
    def late(self) -> Bool[np.ndarray, " R"]:
        """The runs of which something counts, and not the first sample."""
        return self.mask.any(axis=1) & ~self.mask[:, 0]

    @cached_property
    def _by_rows(self) -> tuple[Group, ...]:
        """The runs as the program takes them, from row to row."""
        coarse = eqx.tree_at(lambda s: s.h, self.signals, jnp.asarray(self.dt, float))
        unravel = Unravel(self.effects, by_rows=self.signals.substeps > 1)
        return Group.all_of(unravel, replace(coarse, substeps=1), self.u, self.level)

    @cached_property
    def _by_substeps(self) -> tuple[Group, ...]:
        """The same at sub-steps."""
        return Group.all_of(Unravel(self.effects), self.signals, self.u, self.level)


def _begins_at(y: Float[np.ndarray, " n"], most: int) -> float:
    """Where a response begins: the mean of as many of its first samples, no more than `most`, as
    rest to the noise, else the first. What sticks keeps the place where it begins, and a single
    sample is off by all of its noise. NaN where there are none."""
    if most == 0:
        return np.nan
    noise = white_noise_std([y])
    for many in (1 << k for k in reversed(range(2, most.bit_length()))):
        t, own = np.arange(many) - 0.5 * (many - 1), y[:many]
        middle, slope = float(np.mean(own)), float(t @ own) / float(t @ t)
        strays = noise**2 * (many - 1) * (1.0 + _STRAYS * math.sqrt(2.0 / (many - 1)))
        if np.sum((own - middle) ** 2) <= strays and abs(slope) * math.sqrt(t @ t) <= noise:
            return middle
    return float(y[0])
