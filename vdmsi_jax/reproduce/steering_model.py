"""What the paper's steering model was fitting.

Table 2 gives the steering a pole at -6.7e-9 and a zero at +0.0212 rad/s beside a fast pole: an
integrator with a zero on the right, so that an angle that is held creeps back, and on through zero.
No steering does that. Here a steering that has the fast part only is measured with one plain fault
in it, and the paper's order P2Z2 is fitted as the paper does: without offset and delay, from rest,
and with stable poles. A fault that makes an integrator of the slow pole and puts the zero where the
paper has it is what may have been there. (A pole of -6.7e-9 is one that has run into the bound of
stability: the data would have it unstable.)
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from vdmsi_jax.metrics import fit as fit_percent
from vdmsi_jax.models.transfer_function import TransferFunction
from vdmsi_jax.reproduce.batch import Fitted, in_batches, least_squares
from vdmsi_jax.scenarios import PAPER_DT, PAPER_DURATION, random_steps

NUM, DEN = (0.47, 23.15, -0.49), (1.0, 25.44, 1.7e-7)
"""The paper's steering, table 2, in descending powers of s."""

AMPLITUDE = 0.52  # rad, figure 3b
NOISE = 0.01  # rad
EXCITATIONS: Mapping[str, tuple[float, ...]] = {
    "to one side": (0.0, AMPLITUDE),
    "to both sides": (0.0, AMPLITUDE, -AMPLITUDE),
}
"""Steps that figure 3b may show: the text tells their size and not their sides."""

_START = 0.05  # rad/s of the slow pole
_INTEGRATES = 0.3  # of its state, what an integrator may lose over the record
_SEEDS = 8
_LEAST = 1e-6  # rad/s: a pole within it lies on the bound of stability
_BATCH = 8


@dataclass(frozen=True)
class Fault:
    """A plain cause of what P2Z2 may have absorbed.

    Attributes:
        name: what it is.
        unit: of its size.
        sizes: to try, from small to large.
        act: measured angle from the true one (rad), the command (rad), time (s) and the size.
    """

    name: str
    unit: str
    sizes: tuple[float, ...]
    act: Callable[[Array, Array, Array, Array], Array]


def _crept(y: Array, u: Array, t: Array, size: Array) -> Array:
    """A held angle yields: part of it leaks away with a time constant of ten seconds."""
    lag = TransferFunction([0.1], [1.0, 0.1]).simulate(u, PAPER_DT).y
    return y - size * lag


FAULTS = (
    Fault("no fault", "-", (0.0,), lambda y, u, t, size: y),
    Fault("offset", "rad", (-0.03, 0.03), lambda y, u, t, size: y + size),
    Fault(
        "drift of the sensor",
        "rad/s",
        (-0.01, -5e-3, -2e-3, 2e-3),
        lambda y, u, t, size: y + size * t,
    ),
    Fault(
        "gain that falls",
        "1/s",
        (5e-3, 0.01, 0.02, 0.03),
        lambda y, u, t, size: y * (1.0 - size * t),
    ),
    Fault("creep under load", "-", (0.1, 0.3), _crept),
    Fault("bent gain", "1/rad", (0.3,), lambda y, u, t, size: y * (1.0 + size * abs(y))),
    Fault(
        "gain that differs by side",
        "-",
        (0.1,),
        lambda y, u, t, size: jnp.where(u > 0.0, 1.0 + size, 1.0) * y,
    ),
)


@dataclass(frozen=True)
class Middle:
    """Of a number over the seeds: its median and the interval of the middle 95 %."""

    median: float
    low: float
    high: float

    @staticmethod
    def of(values: Float[np.ndarray, " K"]) -> "Middle":
        """From one number per seed."""
        low, median, high = np.quantile(values, [0.025, 0.5, 0.975])
        return Middle(float(median), float(low), float(high))


@dataclass(frozen=True)
class Absorbed:
    """What the paper's order makes of one fault of one size.

    Attributes:
        fault, unit, size: the fault.
        excitation: the sides of the steps.
        slow_pole: the slower pole of P2Z2, rad/s, negative.
        slow_zero: its slower zero, rad/s.
        on_bound: share of the seeds in which the slow pole ran into the bound of stability.
        fit_p1z1: FIT of the order that the steering has, percent.
        fit_p1z1_offset: the same with an offset.
        fit_p2z2: FIT of the paper's order, percent.
    """

    fault: str
    unit: str
    size: float
    excitation: str
    slow_pole: Middle
    slow_zero: Middle
    on_bound: float
    fit_p1z1: Middle
    fit_p1z1_offset: Middle
    fit_p2z2: Middle

    @property
    def chooses_p2z2(self) -> bool:
        """Whether the paper's rule would take P2Z2: it fits better by more than half a point."""
        return self.fit_p2z2.median - self.fit_p1z1.median > 0.5

    @property
    def looks_like_the_paper(self) -> bool:
        """A slow pole that the record cannot tell from an integrator, a slow zero on the right in
        nineteen of twenty seeds, and P2Z2 chosen."""
        integrates = abs(self.slow_pole.median) * PAPER_DURATION < _INTEGRATES
        return bool(integrates and self.slow_zero.low > 0.0 and self.chooses_p2z2)


def paper_zero() -> float:
    """The slow zero of table 2, rad/s."""
    zeros = np.roots(NUM)
    return float(zeros[np.argmin(abs(zeros))])


def absorb(fault: Fault, size: float, excitation: str, *, seeds: int = _SEEDS) -> Absorbed:
    """Measure the steering with a fault, over seeds of steps and noise, and fit it as the paper.

    Args:
        fault: one of `FAULTS`, or another.
        size: in its unit.
        excitation: a key of `EXCITATIONS`.
        seeds: how many.
    """
    steps = partial(
        random_steps, EXCITATIONS[excitation], dwell=(1.0, 3.0), duration=PAPER_DURATION
    )
    u = jnp.asarray(np.stack([steps(dt=PAPER_DT, seed=seed) for seed in range(seeds)]))
    t = PAPER_DT * jnp.arange(u.shape[1])
    fast = TransferFunction(NUM[:2], DEN[:2])
    true = in_batches(lambda u: fast.simulate(u, PAPER_DT).y, _BATCH)(u)
    y = jax.vmap(lambda y, u: fault.act(y, u, t, jnp.asarray(size)))(true, u)
    y = y + NOISE * np.random.default_rng(seeds).standard_normal(y.shape)
    poles, zeros, fits = map(np.asarray, _fit_all(u, y))
    return Absorbed(
        fault.name,
        fault.unit,
        size,
        excitation,
        Middle.of(-poles),
        Middle.of(zeros),
        float(np.mean(poles <= _LEAST)),
        *(Middle.of(fits[:, i]) for i in range(3)),
    )


def absorbed(*, seeds: int = _SEEDS) -> list[Absorbed]:
    """Every fault at every size, for steps to one and to both sides."""
    return [
        absorb(fault, size, excitation, seeds=seeds)
        for excitation in EXCITATIONS
        for fault in FAULTS
        for size in fault.sizes
    ]


def explanations(rows: list[Absorbed], *, seeds: int = _SEEDS) -> list[Absorbed]:
    """Those faults that look like the paper's model, each at the size that puts the zero where the
    paper has it, found by interpolation between sizes and fitted again.

    Args:
        rows: what `absorbed` returned.
        seeds: how many.
    """
    found = []
    for excitation in EXCITATIONS:
        for fault in FAULTS:
            alike = [
                row
                for row in rows
                if (row.fault, row.excitation) == (fault.name, excitation)
                and row.looks_like_the_paper
            ]
            zeros = np.array([row.slow_zero.median for row in alike])
            if not alike or not zeros.min() <= paper_zero() <= zeros.max():
                continue
            order = np.argsort(zeros)
            size = np.interp(paper_zero(), zeros[order], np.array([r.size for r in alike])[order])
            again = absorb(fault, float(size), excitation, seeds=seeds)
            if again.looks_like_the_paper:
                found.append(again)
    return found


@dataclass(frozen=True)
class Alike:
    """A steering with a fault beside the paper's model, under the same command.

    Attributes:
        fault: which explains that model.
        t: (N,) s.
        command, sound, faulty, paper: (N,) rad; `sound` is the steering without the fault.
    """

    fault: str
    t: Float[np.ndarray, " N"]
    command: Float[np.ndarray, " N"]
    sound: Float[np.ndarray, " N"]
    faulty: Float[np.ndarray, " N"]
    paper: Float[np.ndarray, " N"]


def alike(row: Absorbed) -> Alike:
    """The steps of the first seed, as a steering with this fault answers them and as the paper's
    model of table 2 does.

    Args:
        row: one of the `explanations`.
    """
    fault = next(fault for fault in FAULTS if fault.name == row.fault)
    levels, dwell = EXCITATIONS[row.excitation], (1.0, 3.0)
    u = jnp.asarray(random_steps(levels, dwell=dwell, duration=PAPER_DURATION, dt=PAPER_DT, seed=0))
    t = PAPER_DT * jnp.arange(u.shape[0])
    sound = TransferFunction(NUM[:2], DEN[:2]).simulate(u, PAPER_DT).y
    faulty = fault.act(sound, u, t, jnp.asarray(row.size))
    paper = TransferFunction(NUM, DEN).simulate(u, PAPER_DT, jnp.zeros(2)).y
    return Alike(row.fault, *map(np.asarray, (t, u, sound, faulty, paper)))


def _fit_all(u: Array, y: Array) -> tuple[Array, Array, Array]:
    """Slow pole (positive for a stable one), slow zero and the FIT of P1Z1 without and with offset
    and of P2Z2, for every seed."""
    return _PROGRAM(u, y)


def _fit_one(u: Array, y: Array) -> tuple[Array, Array, Array]:
    def small(theta: Array) -> Array:
        pole, b1, b0, offset = theta
        plant = TransferFunction(jnp.stack([b1, b0]), jnp.stack([jnp.ones_like(pole), pole]))
        return plant.simulate(u, PAPER_DT, jnp.zeros(1)).y + offset

    def paper(theta: Array) -> Array:
        fast, slow, b2, b1, b0 = theta
        den = jnp.stack([jnp.ones_like(fast), fast + slow, fast * slow])
        plant = TransferFunction(jnp.stack([b2, b1, b0]), den)
        return plant.simulate(u, PAPER_DT, jnp.zeros(2)).y

    def p1z1(offset: Array) -> Array:
        start, sizes = jnp.array([15.0, 0.0, 15.0, 0.0]), jnp.array([5.0, 0.1, 5.0, 0.02])
        lower = jnp.array([1.0, -jnp.inf, -jnp.inf, -jnp.inf])
        free = jnp.ones(4, bool).at[3].set(offset)
        found = least_squares(lambda x: small(x) - y, start, sizes, lower, free, steps=8)
        return jnp.asarray(fit_percent(y, small(found.parameters)))

    def p2z2(found: Fitted, settles: Array) -> tuple[Fitted, None]:
        first = jnp.array([15.0, _START, 0.0, 15.0, 15.0 * _START])
        start = jnp.where(settles, found.parameters, first)
        # a bound that is met is kept, so that the others settle along it
        held = settles & (start[1] <= _LEAST)
        sizes = jnp.array([5.0, 0.02, 0.1, 5.0, 0.2])
        lower = jnp.array([1.0, 0.0, -jnp.inf, -jnp.inf, -jnp.inf])
        free = jnp.ones(5, bool).at[1].set(~held)
        fit = least_squares(lambda x: paper(x) - y, start, sizes, lower, free, steps=12)
        better = fit.cost < found.cost
        return Fitted(*(jnp.where(better, a, b) for a, b in zip(fit, found, strict=True))), None

    nothing = Fitted(jnp.zeros(5), jnp.zeros(5), jnp.asarray(jnp.inf))
    fitted, _ = jax.lax.scan(p2z2, nothing, jnp.array([False, True]))
    fast, slow, b2, b1, b0 = fitted.parameters
    # the smaller root of the numerator, without loss of digits
    zero = -2.0 * b0 / (b1 + jnp.sign(b1) * jnp.sqrt(jnp.maximum(b1 * b1 - 4.0 * b2 * b0, 0.0)))
    fits = jnp.append(
        jax.lax.map(p1z1, jnp.array([False, True])), fit_percent(y, paper(fitted.parameters))
    )
    return jnp.minimum(fast, slow), zero, fits


_PROGRAM = in_batches(_fit_one, _BATCH)
