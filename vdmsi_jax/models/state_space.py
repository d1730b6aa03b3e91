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
from jaxtyping import Array, Float

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
        n = self.B.shape[0]
        augmented = (
            jnp.zeros((n + 1, n + 1), self.A.dtype).at[:n, :n].set(self.A).at[:n, n].set(self.B)
        )
        growth = _exponential_minus_identity(augmented * dt)
        return jnp.eye(n, dtype=self.A.dtype) + growth[:n, :n], growth[:n, n]

    def output(self, x: Float[Array, "*N n"], u: Float[Array, "*N"]) -> Float[Array, "*N"]:
        """`C x + D u`, for one instant or many."""
        return x @ self.C + self.D * u

    def output_rate(self, x: Float[Array, "*N n"], u: Float[Array, "*N"]) -> Float[Array, "*N"]:
        """`C (A x + B u)`: the exact time derivative of the output while `u` is held.

        Where `u` jumps by `du` the output jumps by `D du` besides; that is no part of this rate.
        """
        return x @ (self.C @ self.A) + (self.C @ self.B) * u


def propagate(
    Ad: Float[Array, "n n"], Bd: Float[Array, " n"], x0: Float[Array, " n"], u: Float[Array, " N"]
) -> Float[Array, "N+1 n"]:
    """States of `x[k+1] = Ad x[k] + Bd u[k]` from `x[0] = x0`, the start included.

    The same recursion as a loop, regrouped: within a block of `BLOCK` samples all states are one
    matrix product of the block's inputs plus one of the state at its head, and only the heads are
    scanned.
    """
    samples, n = u.shape[0], x0.shape[0]
    blocks = -(-samples // BLOCK)
    powers = _powers(Ad)
    impulse = powers[:-1] @ Bd
    lag = (
        np.arange(BLOCK)[None, :] - np.arange(BLOCK)[:, None]
    )  # state after sample j, input at sample i: j - i
    taps = jnp.where((lag >= 0)[..., None], impulse[np.maximum(lag, 0)], 0.0)
    inputs = jnp.pad(u, (0, blocks * BLOCK - samples)).reshape(blocks, BLOCK)
    forced = (inputs @ taps.reshape(BLOCK, BLOCK * n)).reshape(blocks, BLOCK, n)

    def to_next_head(head: Array, gained: Array) -> tuple[Array, Array]:
        return powers[-1] @ head + gained, head

    _, heads = lax.scan(to_next_head, x0, forced[:, -1])
    free = heads @ powers[1:].reshape(BLOCK * n, n).T
    states = (forced.reshape(blocks, BLOCK * n) + free).reshape(blocks * BLOCK, n)
    return jnp.concatenate([x0[None], states[:samples]])


def _powers(Ad: Float[Array, "n n"]) -> Float[Array, "BLOCK+1 n n"]:
    """`Ad^0 ... Ad^BLOCK` by doubling the list."""
    powers = jnp.eye(Ad.shape[0], dtype=Ad.dtype)[None]
    top = Ad
    while powers.shape[0] < BLOCK:
        powers = jnp.concatenate([powers, powers @ top])
        top = top @ top
    return jnp.concatenate([powers, top[None]])


def _exponential_minus_identity(M: Float[Array, "m m"]) -> Float[Array, "m m"]:
    """`exp(M) - I` by scaling and squaring of a Taylor series.

    Squaring the difference (`2 F + F F`) rather than the exponential keeps the small part of a slow
    pole beside a fast one. A fixed number of guarded squarings, instead of jax's branches over
    orders, compiles quickly, vmaps without cost and has both modes of differentiation.
    """
    norm = lax.stop_gradient(jnp.max(jnp.sum(jnp.abs(M), axis=1)))
    squarings = jnp.ceil(jnp.log2(jnp.maximum(norm / _SCALED_NORM, 1.0)))
    squarings = jnp.minimum(squarings, _MAX_SQUARINGS)
    scaled = M * jnp.exp2(-squarings)
    identity = jnp.eye(M.shape[0], dtype=M.dtype)
    series = scaled / _TAYLOR_DEGREE
    for k in range(_TAYLOR_DEGREE - 1, 0, -1):
        series = (scaled / k) @ (identity + series)

    def square(i: Array, grown: Array) -> Array:
        active = i < squarings
        guarded = jnp.where(
            active, grown, 0.0
        )  # an unused square may overflow and poison the gradient
        return jnp.where(active, 2 * guarded + guarded @ guarded, grown)

    return jax.lax.fori_loop(0, _MAX_SQUARINGS, square, series)
