"""Identification of many vehicles at once, each from its own noisy logs, in one compiled program.

The order is given, the coefficients are sought: by Levenberg-Marquardt (Nocedal and Wright,
Numerical Optimization, 2006, sec. 10.3) on the simulation error, every vehicle with a damping of
its own. For one vehicle of unknown order there is `identify`.
"""

from collections.abc import Callable
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jax import lax
from jaxtyping import Array, Bool, Float

_DAMPING = 1e-2


class Fitted(NamedTuple):
    """One fit, or many in a leading axis.

    Attributes:
        parameters: (p,) estimates.
        std: (p,) their standard deviations for white noise; zero where a parameter was held.
        cost: sum of squared residuals.
    """

    parameters: Float[Array, "*K p"]
    std: Float[Array, "*K p"]
    cost: Float[Array, "*K"]


def least_squares(
    residual: Callable[[Float[Array, " p"]], Float[Array, " N"]],
    start: Float[Array, " p"],
    sizes: Float[Array, " p"],
    lower: Float[Array, " p"],
    free: Bool[Array, " p"],
    *,
    steps: int = 20,
) -> Fitted:
    """Least squares with a fixed number of steps, so that a batch of problems is one program.

    Args:
        residual: of the parameters; of the size of its noise or not, that is estimated.
        start: first parameters.
        sizes: by how much a parameter changes the residual noticeably; steps are scaled by it.
        lower: bounds; a step beyond is cut.
        free: which parameters are sought; the others stay at their start.
        steps: tried, whether they help or not.
    """
    each = jnp.eye(start.shape[0])

    def step(carry: tuple, _: None) -> tuple[tuple, None]:
        theta, damping, tried, H, g, cost = carry
        along = jnp.where(free, sizes, 0.0) * each
        r, J = jax.vmap(lambda e: jax.jvp(residual, (tried,), (e,)), out_axes=(None, 0))(along)
        better = r @ r < cost
        new, old = (tried, J @ J.T, J @ r, r @ r), (theta, H, g, cost)
        theta, H, g, cost = (jnp.where(better, x, y) for x, y in zip(new, old, strict=True))
        damping = jnp.where(better, 0.2, 5.0) * damping
        raised = H + jnp.diag(damping * jnp.diag(H) + jnp.where(free, 1e-12, 1.0))
        tried = jnp.maximum(theta - sizes * jnp.linalg.solve(raised, g), lower)
        return (theta, damping, jnp.where(free, tried, start), H, g, cost), None

    count, infinite = start.shape[0], jnp.asarray(jnp.inf)
    first = (
        start,
        jnp.asarray(_DAMPING),
        start,
        jnp.zeros((count, count)),
        jnp.zeros(count),
        infinite,
    )
    (theta, _, _, H, _, cost), _ = lax.scan(step, first, None, length=steps)
    rows = jax.eval_shape(residual, start).shape[0]
    inverse = jnp.linalg.inv(H + jnp.diag(jnp.where(free, 0.0, 1.0)))
    variance = jnp.where(free, jnp.diag(inverse), 0.0) * cost / (rows - jnp.sum(free))
    return Fitted(theta, sizes * jnp.sqrt(jnp.maximum(variance, 0.0)), cost)


def significant(fit: Fitted, may_go: Bool[Array, " p"], times: float) -> Bool[Array, " p"]:
    """Which parameters stay: all but those of `may_go` that are less than so many standard
    deviations from zero."""
    sure = jnp.abs(fit.parameters) > times * fit.std
    return jnp.logical_or(~may_go, sure & jnp.all(jnp.isfinite(fit.parameters)))


def in_batches(one: Callable, batch_size: int) -> Callable:
    """`one` over leading axes, about so many lanes at once, compiled. Batches are of one size where
    that can be, since a rest would be a program of its own."""

    def batched(*args: Any, **named: Any) -> Any:
        count = jax.tree.leaves((args, named))[0].shape[0]
        even = max(size for size in range(1, batch_size + 1) if count % size == 0)
        size = even if 2 * even >= min(batch_size, count) else batch_size
        return lax.map(lambda lane: one(*lane[0], **lane[1]), (args, named), batch_size=size)

    return eqx.filter_jit(batched)
