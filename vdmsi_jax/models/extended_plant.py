"""A plant with causes in it: a transfer function and a tuple of effects at its ports."""

import equinox as eqx
import jax
import jax.numpy as jnp
from jax import lax
from jaxtyping import Array, Float

from vdmsi_jax.effects.base import AbstractEffect, Effort, Signals
from vdmsi_jax.models.state_space import StateSpace


def respond(
    system: StateSpace,
    rest: Float[Array, " n"],
    effects: tuple[AbstractEffect, ...],
    u: Float[Array, " N"],
    signals: Signals,
) -> Float[Array, " N"]:
    """What is measured at the rows of a plant with effects, started at rest under its first
    command.

    Args:
        system: the dynamics in observer form: the first state, and a feed-through, are the output.
        rest: state at rest per unit of a constant command.
        effects: in the order in which they act.
        u: commands at the rows.
        signals: what else the effects look at.
    """
    y = fine_response(system, rest, effects, u, signals)[:: signals.substeps]
    for effect in effects:
        y = effect.measured(y, signals)
    return y


def fine_response(
    system: StateSpace,
    rest: Float[Array, " n"],
    effects: tuple[AbstractEffect, ...],
    u: Float[Array, " N"],
    signals: Signals,
) -> Float[Array, " M"]:
    """`respond` at the sub-steps, the rows among them."""
    for effect in effects:
        u = effect.command(u, signals)
    held = jnp.repeat(u, signals.substeps, total_repeat_length=u.shape[0] * signals.substeps)
    for effect in effects:
        held = effect.held(held, signals)
    y = _dynamics(system, rest, effects, held, signals)
    for effect in effects:
        y = effect.output(y, signals)
    for effect in effects:
        y = effect.sensor(y, signals)
    return y


def _dynamics(
    system: StateSpace,
    rest: Array,
    effects: tuple[AbstractEffect, ...],
    u: Float[Array, " M"],
    signals: Signals,
) -> Float[Array, " M"]:
    """The output at the start of each sub-step. The states are scalars of their own, so that a batch
    of plants is elementwise arithmetic."""
    inside = [e for e in effects if type(e).effort is not AbstractEffect.effort]
    Ad, Bd = system.discretise(signals.h)
    force = StateSpace(system.A, _led(system.B, signals.lead), system.C, system.D)
    Fd = force.discretise(signals.h)[1]
    gain = system.C @ system.A @ Bd + system.C @ system.B
    hold = system.C @ system.A @ Fd + system.C @ force.B
    hold = jnp.where(jnp.abs(hold) > 1e-12, hold, 1e-12)
    n = Bd.shape[0]
    A = [[Ad[i, j] for j in range(n)] for i in range(n)]
    B, F = [Bd[i] for i in range(n)], [Fd[i] for i in range(n)]
    slope = system.C @ system.A @ Ad
    m = [slope[i] for i in range(n)]

    def step(carry: tuple, u: Array) -> tuple[tuple, Array]:
        x, stuck = carry
        y = x[0] + system.D * u
        x = tuple(_sum(A[i][j] * x[j] for j in range(n)) + B[i] * u for i in range(n))
        if not inside:
            return (x, stuck), y
        before = carry[0]
        rate = _sum(m[j] * before[j] for j in range(n)) + gain * u
        total = jnp.zeros_like(u)
        for effect in inside:
            spent = effect.effort(Effort(u, y, rate, hold, stuck, signals.slowness))
            rate, total = rate - hold * spent, total + spent
        stuck = jnp.where(jnp.abs(rate) < 1e-9 * jnp.abs(hold), 1.0, 0.0)
        return (tuple(x[i] - F[i] * total for i in range(n)), stuck), y

    start = tuple(rest[i] * u[0] for i in range(n))
    return lax.scan(step, (start, jnp.zeros(())), u)[1]


def _led(B: Float[Array, " n"], lead: Float[Array, ""]) -> Float[Array, " n"]:
    """Input vector of a force that enters behind a part of the dynamics: `B` with the numerator
    times `1 + lead s`, in observer form."""
    return B + lead * jnp.append(B[1:], 0.0)


def _sum(terms) -> Array:
    total = None
    for term in terms:
        total = term if total is None else total + term
    assert total is not None
    return total


def observer(
    a: Float[Array, " n"], b: Float[Array, " n"], pace: Float[Array, ""]
) -> tuple[StateSpace, Float[Array, " n"], Float[Array, ""]]:
    """The observer form of `(b1 q^(n-1) + ... + bn) / (q^n + a1 q^(n-1) + ... + an)`, `q = s / pace`.

    Trailing zeros in both make a plant of lower order: their states stay exactly zero, so plants of
    every order are one batch.

    Returns:
        The system, its state at rest per unit of command, and its slowness (see `Effort`).
    """
    n = a.shape[0]
    A = (jnp.eye(n, k=1).at[:, 0].add(-a)) * pace
    system = StateSpace(A, b * pace, jnp.eye(n)[0], jnp.zeros(()))
    order = n - 1 - jnp.argmax((jax.lax.stop_gradient(a) != 0.0)[::-1])
    last, push = a[order], b[order]
    level = push / jnp.where(last == 0.0, 1.0, last)
    rest = jnp.concatenate([level[None], jnp.where(jnp.arange(n - 1) < order, a[:-1] * level - b[:-1], 0.0)])
    before = jnp.where(order > 0, a[order - 1], 1.0)
    slowness = before / (pace * jnp.where(push == 0.0, 1.0, push))
    return system, rest, slowness
