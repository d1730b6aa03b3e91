"""Equation-error least squares by state-variable filters, refined by instruments (SRIVC).

Filtering `A y = B u` by `1 / F` makes it linear in the coefficients without a derivative of data
(Young & Jakeman 1980; Garnier & Wang, Identification of Continuous-time Models from Sampled Data,
2008, ch. 4). Iterating with F = A and the simulated output as instrument removes the bias that
noise on y causes. What comes out starts the refinement of the simulation error.
"""

import jax
import jax.numpy as jnp
from jaxtyping import Array

from vdmsi_jax.identify import response as rs
from vdmsi_jax.identify.layout import Samples
from vdmsi_jax.identify.refine import Candidate
from vdmsi_jax.identify.response import N_MAX, Order

_STEPS = 4


def equation_error(start: Candidate, order: Order, samples: Samples) -> Candidate:
    """Denominator by least squares at the delay of `start`, whose `a` is the first filter.

    Keeps the iterate of least simulation error; a step to a useless one restarts from it.
    """
    a, d = start.a, start.d

    def step(carry, instrumental):
        a, best, least = carry
        following, cost = _step(a, d, order, samples, instrumental)
        stable = rs.growth(a, order, samples) <= rs.MAX_GROWTH
        cost = jnp.where(stable, cost, jnp.inf)
        improved = cost < least
        best, least = jnp.where(improved, a, best), jnp.where(improved, cost, least)
        usable = jnp.all(jnp.isfinite(following)) & jnp.isfinite(cost)
        return (jnp.where(usable, following, best), best, least), None

    first = (a, a, jnp.array(jnp.inf))
    (_, best, _), _ = jax.lax.scan(step, first, jnp.arange(_STEPS + 1) > 0)
    return Candidate(best, d)


def _step(a: Array, d: Array, order: Order, samples: Samples, instrumental: Array):
    """One least-squares step with filter 1/A; also the norm of the simulation error of A itself."""
    rows = rs.signals(a, d, order, samples)
    A, B = rs.companion(a, order)
    filtered = _filter_output(A, B, samples)
    raw = rs.segment_grams(jnp.concatenate([rows, filtered], -1), samples)
    count = rows.shape[-1]
    best = rs.project(a, order, rows, samples, raw=raw[:, :count, :count])
    linear, cost = best.linear, jnp.sqrt(jnp.sum(samples.weight * best.residual**2))
    free_last = jnp.array([*range(rs.KEPT), *range(count, raw.shape[1]), *range(rs.KEPT, count)])
    raw = raw[:, free_last][:, :, free_last]
    grams, _ = jax.vmap(lambda G: rs.eliminate(G, N_MAX))(raw)
    width = rs.KEPT + N_MAX
    L = jnp.pad(rs.linear_rows(a, order), ((0, 0), (0, N_MAX)))
    Y = jnp.eye(N_MAX, width, k=rs.KEPT) * order.has_pole[:, None]
    highest = jnp.zeros(width).at[rs.Y].set(1.0) - a @ Y
    simulated = -rs.nonlinear_rows(a, order, linear, samples.dt)[:, :N_MAX]
    simulated = jnp.pad(simulated, ((0, 0), (0, 0), (0, N_MAX)))
    regressors = jnp.concatenate([-Y, L])

    def of_segment(Z, G):
        instruments = jnp.concatenate([jnp.where(instrumental, -Z, -Y), L])
        return instruments @ G @ jnp.concatenate([regressors, highest[None]]).T

    M = jnp.sum(jax.vmap(of_segment)(simulated, grams), 0)
    size = jnp.sqrt(jnp.abs(jnp.diag(M[:, :-1])))
    inverse = jnp.where(size > 0, 1 / jnp.where(size > 0, size, 1.0), 0.0)
    H = M[:, :-1] * inverse[:, None] * inverse[None, :]
    H = H + jnp.diag(jnp.where(size > 0, 1e-12, 1.0))
    theta = inverse * jnp.linalg.solve(H, inverse * M[:, -1])
    return jnp.where(order.has_pole, theta[:N_MAX], 0.0), cost


def _filter_output(A: Array, B: Array, samples: Samples) -> Array:
    """States s^i/A y (k, m, 5) of the measured output, linear between samples."""
    ramp = jnp.zeros((N_MAX + 1, N_MAX + 1)).at[:N_MAX, :N_MAX].set(A).at[:N_MAX, N_MAX].set(B)
    Phi, Gamma = rs.hold(ramp, jnp.eye(N_MAX + 1)[N_MAX], samples.dt[None])
    level, slope = Phi[0, :N_MAX, N_MAX], Gamma[0, :N_MAX] / samples.dt
    return rs.between(Phi[0, :N_MAX, :N_MAX], level - slope, slope, samples.y, samples)
