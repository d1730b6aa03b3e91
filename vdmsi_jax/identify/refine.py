"""Simulation-error refinement: Levenberg-Marquardt (optimistix) over poles and delay."""

import equinox as eqx
import jax
import jax.numpy as jnp
import optimistix as optx
from jaxtyping import Array, Float

from vdmsi_jax.identify.layout import Samples
from vdmsi_jax.identify.response import MAX_GROWTH, N_MAX, Order, compress, growth

MAX_STEPS = 12
_TOLERANCE = 1e-7
_DIVERGED = 1e3  # residual norm given to a model that blows up; a useful one has at most about 1
_DAMPING = 10.0  # norm of a scaled column: the first damping is its inverse square, 1 %


class Candidate(eqx.Module):
    """A point of the search: denominator `a` ascending without its leading 1, delay in samples."""

    a: Float[Array, "*lanes 5"]
    d: Float[Array, "*lanes"]


class Judged(eqx.Module):
    """A candidate with the norm of its projected residual, and the scale of a step from it."""

    candidate: Candidate
    cost: Float[Array, "*lanes"]
    scale: Float[Array, "*lanes 6"]


def judge(candidate: Candidate, order: Order, samples: Samples, longest: Array) -> Judged:
    """Simulate one candidate, its linear parameters at their best.

    `longest` bounds the delay, in samples. A step of size one in units of `scale` changes the
    residual by about a tenth of the output, whatever the parameter.
    """
    problem = (order, samples, jnp.ones(N_MAX + 1), longest)
    r, J = _residual_and_jacobian(jnp.append(candidate.a, candidate.d), problem)
    norm = jnp.linalg.norm(J, axis=0)
    scale = jnp.where(norm > 0, _DAMPING / jnp.where(norm > 0, norm, 1.0), 1.0)
    return Judged(candidate, jnp.linalg.norm(r), scale)


def refine(start: Judged, order: Order, samples: Samples, longest: Array) -> Judged:
    """At most `MAX_STEPS` Levenberg-Marquardt steps from one start; never worse than the start.

    Few steps and a new start from there, with a new scale, find a curved valley's end sooner than
    many. The residual is in units of the output's norm over the record, so that tolerances mean the
    same for every log.
    """
    solution = optx.least_squares(
        lambda x, problem: (lambda r: (r, jnp.linalg.norm(r)))(_residual(x, problem)),
        optx.LevenbergMarquardt(_TOLERANCE, _TOLERANCE),
        jnp.append(start.candidate.a, start.candidate.d) / start.scale,
        args=(order, samples, start.scale, longest),
        has_aux=True,
        max_steps=MAX_STEPS,
        throw=False,
    )
    found = solution.value * start.scale
    candidate = Candidate(found[:N_MAX], jnp.clip(found[N_MAX], 0.0, longest))
    better = solution.aux <= start.cost
    candidate = jax.tree.map(lambda a, b: jnp.where(better, a, b), candidate, start.candidate)
    return Judged(candidate, jnp.minimum(solution.aux, start.cost), start.scale)


@jax.custom_jvp
def _residual(x: Array, problem: tuple[Order, Samples, Array, Array]) -> Array:
    return _residual_and_jacobian(x, problem)[0]


@_residual.defjvp
def _residual_jvp(primals, tangents):
    r, J = _residual_and_jacobian(*primals)
    return r, J @ tangents[0]


@jax.jit  # traced once for all places that a solver calls it at
def _residual_and_jacobian(x: Array, problem: tuple[Order, Samples, Array, Array]):
    order, samples, scale, longest = problem
    p = x * scale
    _, r, J = compress(p[:N_MAX], jnp.clip(p[N_MAX], 0.0, longest), order, samples)
    inside = jnp.ones(N_MAX + 1).at[N_MAX].set((p[N_MAX] >= 0) & (p[N_MAX] <= longest))
    ok = jnp.all(jnp.isfinite(r)) & jnp.all(jnp.isfinite(J)) & (jnp.sum(r**2) < _DIVERGED**2)
    ok = ok & (growth(p[:N_MAX], order, samples) <= MAX_GROWTH)
    diverged = jnp.zeros_like(r).at[-1].set(_DIVERGED)
    return jnp.where(ok, r, diverged), jnp.where(ok, J * inside * scale, 0.0)
