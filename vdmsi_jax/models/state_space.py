"""Linear state space in continuous time, eq. (5) of the paper, and its exact response to held
commands.

A command is held between samples, so the response needs no integrator: the matrix exponential gives
it exactly at any instant. Records are simulated in blocks of samples as matrix products, which is
fast alone, in batches, and in both modes of differentiation; a scan sample by sample is none of
these in reverse mode.
"""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax import lax
from jaxtyping import Array, Float, Int

BLOCK = 16  # samples a block: fewer make the scan long, more make the products within a block dear

_TAYLOR_DEGREE = (
    12  # 0.25^13 / 13! < 3e-18: the series is exact to float64 within the scaled norm below
)
_SCALED_NORM = 0.25
_MAX_SQUARINGS = 24  # norms up to 4e6 stay exact: a pole of 1e6 rad/s sampled every 4 s


class StateSpace(eqx.Module):
    """`dx/dt = A x + B u`, `y = C x + D u`: one input, one output, continuous time.

    Padding states (decoupled from input and output, and stable) are allowed: with them systems of
    different order share one shape and run under one `jax.vmap`.
    """

    A: Float[Array, "n n"]
    B: Float[Array, " n"]
    C: Float[Array, " n"]
    D: Float[Array, ""]

    def discretise(
        self, dt: Float[Array, ""] | float
    ) -> tuple[Float[Array, "n n"], Float[Array, " n"]]:
        """Exact zero-order hold over `dt` seconds: `x(t + dt) = Ad x(t) + Bd u` while `u` is held.

        From the exponential of the augmented matrix `[[A, B], [0, 0]] dt`, so a singular `A` (an
        integrator) needs no special case. At `dt = 0` the result is the identity and zero, bit for
        bit. Differentiable in `dt`.
        """
        Ad, Bd = held(self.A, self.B[:, None], dt)
        return Ad, Bd[:, 0]

    def ahead(self, tau: Float[Array, " J"]) -> tuple[Float[Array, "n J"], Float[Array, " J"]]:
        """Output after `tau` seconds of a held command: functions of the state, gains of the
        command now."""
        Ad, Bd = jax.vmap(self.discretise)(tau)
        return (self.C @ Ad).T, Bd @ self.C + self.D

    def area_ahead(self, span: Float[Array, ""]) -> tuple[Float[Array, "n 1"], Float[Array, " 1"]]:
        """Integral of the output over the next `span` seconds of a held command, in the form of
        `ahead`: the output of the system with one integrator more."""
        n = self.B.shape[0]
        A = jnp.zeros((n + 1, n + 1), self.A.dtype).at[:n, :n].set(self.A).at[n, :n].set(self.C)
        integrated = StateSpace(A, jnp.append(self.B, self.D), jnp.eye(n + 1)[n], jnp.zeros(()))
        functions, gains = integrated.ahead(span[None])
        return functions[:n], gains


def held(
    A: Float[Array, "n n"],
    inputs: Float[Array, "n m"],
    dt: Float[Array, ""] | float,
    squarings: Int[Array, ""] | int | None = None,
) -> tuple[Float[Array, "n n"], Float[Array, "n m"]]:
    """`StateSpace.discretise` for several inputs at once.

    `squarings` are at least those that `squarings_of` asks for: the largest of a batch saves the
    time of those that none of it needs, and the derivative in reverse.
    """
    n, m = inputs.shape
    growth = _exponential_minus_identity(_augmented(A, inputs) * dt, squarings)
    return jnp.eye(n, dtype=A.dtype) + growth[:n, :n], growth[:n, n:]


def squarings_of(
    A: Float[Array, "n n"], inputs: Float[Array, "n m"], dt: Float[Array, ""] | float
) -> Int[Array, ""]:
    """How often the exponential of `held` is squared."""
    return _squarings(_augmented(A, inputs) * dt).astype(int)


def _augmented(A: Float[Array, "n n"], inputs: Float[Array, "n m"]) -> Float[Array, "p p"]:
    n, m = inputs.shape
    return jnp.zeros((n + m, n + m), A.dtype).at[:n, :n].set(A).at[:n, n:].set(inputs)


class Motion(eqx.Module):
    """The states of `x[k+1] = Ad x[k] + Bd u[k]` over a record, to be read and not listed.

    The recursion of a loop, regrouped: within a block of `BLOCK` samples the states are one matrix
    product of the block's inputs plus one of the state at its head, and only heads are scanned. Few
    linear functions of the states are wanted and they are read directly, since the states
    themselves would be the largest arrays of a simulation and cost more time than all else.
    """

    inputs: Float[Array, "blocks BLOCK"]
    heads: Float[Array, "blocks n"]
    powers: Float[Array, "powers n n"]  # Ad^0 ... Ad^BLOCK
    impulse: Float[Array, "BLOCK n"]  # Ad^j Bd
    samples: int = eqx.field(static=True)

    def read(self, functions: Float[Array, "n J"]) -> Float[Array, "N J"]:
        """`x[k] @ functions` for `k = 0 ... N-1`: each before its own input."""
        count = functions.shape[1]
        free = jnp.einsum("jmn,mf->njf", self.powers[:BLOCK], functions)
        lag = np.arange(BLOCK)[None, :] - np.arange(BLOCK)[:, None]  # input at i, state at j: j - i
        answer = self.impulse @ functions
        forced = jnp.where((lag > 0)[..., None], answer[np.maximum(lag - 1, 0)], 0.0)
        values = self.inputs @ forced.reshape(BLOCK, BLOCK * count)
        values = values + self.heads @ free.reshape(-1, BLOCK * count)
        return values.reshape(-1, count)[: self.samples]

    def last(self) -> Float[Array, " n"]:
        """`x[N-1]`, the state before the last input."""
        within = (self.samples - 1) % BLOCK
        gained = self.inputs[-1, :within][::-1] @ self.impulse[:within]
        return self.powers[within] @ self.heads[-1] + gained


def propagate(
    Ad: Float[Array, "n n"], Bd: Float[Array, " n"], x0: Float[Array, " n"], u: Float[Array, " N"]
) -> Motion:
    """The motion of `x[k+1] = Ad x[k] + Bd u[k]` from `x[0] = x0`."""
    blocks = -(-u.shape[0] // BLOCK)
    powers = _powers(Ad)
    impulse = powers[:-1] @ Bd
    inputs = jnp.pad(u, (0, blocks * BLOCK - u.shape[0])).reshape(blocks, BLOCK)

    def to_next_head(head: Array, gained: Array) -> tuple[Array, Array]:
        return powers[-1] @ head + gained, head

    _, heads = lax.scan(to_next_head, x0, inputs @ impulse[::-1])
    return Motion(inputs, heads, powers, impulse, u.shape[0])


def _powers(Ad: Float[Array, "n n"]) -> Float[Array, "powers n n"]:
    """`Ad^0 ... Ad^BLOCK` by doubling the list."""
    powers = jnp.eye(Ad.shape[0], dtype=Ad.dtype)[None]
    top = Ad
    while powers.shape[0] < BLOCK:
        powers = jnp.concatenate([powers, powers @ top])
        top = top @ top
    return jnp.concatenate([powers, top[None]])


def _squarings(M: Float[Array, "m m"]) -> Float[Array, ""]:
    norm = lax.stop_gradient(jnp.max(jnp.sum(jnp.abs(M), axis=1)))
    squarings = jnp.ceil(jnp.log2(jnp.maximum(norm / _SCALED_NORM, 1.0)))
    return jnp.minimum(squarings, _MAX_SQUARINGS)


def _exponential_minus_identity(
    M: Float[Array, "m m"], most: Int[Array, ""] | int | None = None
) -> Float[Array, "m m"]:
    """`exp(M) - I` by scaling and squaring of a Taylor series.

    Squaring the difference (`2 F + F F`) rather than the exponential keeps the small part of a slow
    pole beside a fast one. A fixed number of guarded squarings, instead of jax's branches over
    orders, compiles quickly, vmaps without cost and has both modes of differentiation.
    """
    squarings = _squarings(M)
    scaled = M * jnp.exp2(-squarings)
    identity = jnp.eye(M.shape[0], dtype=M.dtype)

    def next_term(i: Array, series: Array) -> Array:
        return (scaled / (_TAYLOR_DEGREE - 1 - i)) @ (identity + series)

    series = lax.fori_loop(0, _TAYLOR_DEGREE - 1, next_term, scaled / _TAYLOR_DEGREE)

    def square(i: Array, grown: Array) -> Array:
        active = i < squarings
        guarded = jnp.where(
            active, grown, 0.0
        )  # an unused square may overflow and poison the gradient
        return jnp.where(active, 2 * guarded + guarded @ guarded, grown)

    return lax.fori_loop(0, _MAX_SQUARINGS if most is None else most, square, series)
