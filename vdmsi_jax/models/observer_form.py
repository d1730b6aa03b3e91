"""Plants of every order in one form and one batch, and how a force inside one acts."""

import jax.numpy as jnp
from jax import lax
from jaxtyping import Array, ArrayLike, Float, Int

from vdmsi_jax.models.state_space import StateSpace, held, squarings_of


def observer(
    a: Float[Array, " n"],
    b: Float[Array, " n"],
    pace: Float[Array, ""],
    feed: Float[ArrayLike, ""] = 0.0,
) -> tuple[StateSpace, Float[Array, " n"]]:
    """The observer form of `(feed q^m + b1 q^(m-1) + ... + bm) / (q^m + a1 q^(m-1) + ... + am)`
    with `q = s / pace`, and its state at rest per unit of command.

    Trailing zeros in both make a plant of lower order: their states stay exactly zero, so plants of
    every order are one batch.
    """
    n = a.shape[0]
    A = (jnp.eye(n, k=1).at[:, 0].add(-a)) * pace
    feed = jnp.asarray(feed, float)
    system = StateSpace(A, (b - feed * a) * pace, jnp.eye(n)[0], feed)
    order = _last(a)
    level = b[order] / jnp.where(a[order] == 0.0, 1.0, a[order])
    others = jnp.where(jnp.arange(n - 1) < order, a[:-1] * level - b[:-1], 0.0)
    return system, jnp.concatenate([(level - feed)[None], others])


def slowness_of(
    a: Float[Array, " n"],
    b: Float[Array, " n"],
    pace: Float[Array, ""],
    leads: Float[Array, "2"],
) -> Float[Array, ""]:
    """Seconds of command that a unit of acceleration is worth (see `Effort`), of the plant that
    `observer` takes: its time constants together, as of a speed that a controller behind one lag
    holds. A force with a larger lead than there enters behind more of the dynamics (of a cascade,
    at the last lag alone; with an integrator in the controller, which makes up for it, behind all),
    and what counts is how fast the response gives way at first."""
    order = _last(a)
    before = jnp.where(order > 0, a[order - 1], 1.0)
    push = jnp.where(b[order] == 0.0, 1.0, b[order])
    plain = before / (pace * push)
    if a.shape[0] < 2:
        return plain
    ahead = led(b, leads) - b
    gives = jnp.maximum(abs(ahead[0]), abs(ahead[1]) / jnp.maximum(abs(a[0]), 1e-9))
    return plain / jnp.maximum(1.0, gives * abs(before / push))


def ramp_lag(system: StateSpace, rest: Float[Array, " n"]) -> Float[Array, ""]:
    """By how much of the command a plant lags behind one that rises, per rate of its response once
    that rises as fast, s: the sum of its time constants less those of its zeros, over its gain."""
    order, level = _last(system.B), jnp.where(jnp.abs(rest[0]) > 1e-12, rest[0], 1e-12)
    push = jnp.where(system.B[order] == 0.0, 1.0, system.B[order])
    return jnp.where(order > 0, rest[order] / level, 1.0) / push


def made_up_for(lead: Array | float) -> Array | float:
    """How far, 0 to 1, a controller makes up for a force that lasts, by the force's lead over the
    sum of the plant's time constants."""
    beyond = (0.5 * lead) ** 4
    return beyond / (1.0 + beyond)


def steps_of(
    system: StateSpace,
    leads: Float[Array, "2"],
    h: Float[Array, ""],
    squarings: Int[Array, ""] | None = None,
) -> tuple[Float[Array, "n n"], Float[Array, "n 2"]]:
    """A system's steps over `h` seconds: for a command, and for a force that leads it; `squarings`
    as in `held`."""
    return held(system.A, _both(system, leads), h, squarings)


def effort_of_steps(
    system: StateSpace, leads: Float[Array, "2"], h: Float[Array, ""]
) -> Int[Array, ""]:
    """The squarings that `steps_of` takes."""
    return squarings_of(system.A, _both(system, leads), h)


def _both(system: StateSpace, leads: Float[Array, "2"]) -> Float[Array, "n 2"]:
    return jnp.stack([system.B, led(system.B, leads)], axis=1)


def led(B: Float[Array, " n"], leads: Float[Array, "2"]) -> Float[Array, " n"]:
    """Input vector of a force that enters behind a part of the dynamics: in observer form, the
    numerator and `leads[0] q + leads[1] q^2` of what it is at rest. `q` is the form's own unit."""
    at_rest = jnp.where(jnp.arange(B.shape[0]) == _last(B), B, 0.0)
    once = jnp.append(at_rest[1:], 0.0)
    return B + leads[0] * once + leads[1] * jnp.append(once[1:], 0.0)


def ahead_of(system: StateSpace, leads: Float[Array, "2"]) -> Float[Array, " n"]:
    """By what the state at rest under a command is beyond that under a force that leads it."""
    if system.B.shape[0] < 2:
        return jnp.zeros_like(system.B)
    ahead = (led(system.B, leads) - system.B) / system.A[0, 1]
    return jnp.append(0.0, ahead[:-1])


def _last(a: Float[Array, " n"]) -> Int[Array, ""]:
    """Where the last coefficient stands that is not zero."""
    return a.shape[0] - 1 - jnp.argmax((lax.stop_gradient(a) != 0.0)[::-1])
