"""Responses of PxZy plants and their sensitivities, for all orders in one program.

Every order is embedded in `N_MAX` states by masks, so that one compiled program serves the whole
grid. With `A(s) = s^n + ... + a_0` the plant is

    y = (b_m s^m + ... + b_0) / A(s) u(t - d) + offset + free response,

which is linear in `b`, the offset and the initial state of each segment. Those are eliminated by
projection (variable projection: Golub & Pereyra 1973, with the Jacobian of Kaufman 1975), so that
only `a` and the delay remain to be searched.

Residual and sensitivities are all linear combinations of a few signals, since dy/da_i = -(s^i / A)
(y - offset) and since in companion form the next state is the derivative of the one before. So the
record is passed once, its signals are summed up in one Gram matrix, and the rest is algebra on that
matrix. Signals stand as rows of blocks, `(k, rows, m)`.
"""

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from vdmsi_jax.identify.layout import Samples
from vdmsi_jax.models.state_space import StateSpace

N_MAX = 5
N_LINEAR = N_MAX + 2  # b_0 ... b_5 and the offset
_RIDGE = 1e-13  # of equilibrated Gram matrices: about the resolution of float64 sums of squares

_NOT_DENORMAL = 1e-60  # keeps decayed states out of the range in which processors are slow
MAX_GROWTH = 1.0

# the rows of the signals: states s^i/A u; u; 1; y; states of 1/A driven by the first of these; the
# same for free responses; free responses
X_, U, ONE, Y, W_, M_, F_ = slice(0, 5), 5, 6, 7, slice(8, 13), slice(13, 18), slice(18, 23)
KEPT = 18  # rows left when the free responses are projected out


class Order(eqx.Module):
    """Which parameters are free: `n` poles, `m` zeros, and whether delay and offset are."""

    n: Int[Array, "*lanes"]
    m: Int[Array, "*lanes"]
    delay: Bool[Array, "*lanes"]
    offset: Bool[Array, "*lanes"]

    @property
    def has_pole(self) -> Bool[Array, " 5"]:
        return jnp.arange(N_MAX) < self.n

    @property
    def has_zero(self) -> Bool[Array, " 6"]:
        return jnp.arange(N_MAX + 1) <= self.m


class Linear(eqx.Module):
    """The eliminated parameters: `beta` is `b` ascending, then the offset.

    `free[s]` weighs the responses of segment s from unit initial conditions of the companion form.
    """

    beta: Float[Array, " 7"]
    free: Float[Array, "segments 5"]


def companion(a: Float[Array, " 5"], order: Order) -> tuple[Array, Array]:
    """Companion matrix (5, 5) and input vector (5,); states beyond `n` are idle and decoupled."""
    i = jnp.arange(N_MAX)
    last = (i == order.n - 1).astype(a.dtype)
    chain = jnp.eye(N_MAX, k=1) * (i[:, None] + 1 < order.n)
    feedback = last[:, None] * jnp.where(order.has_pole, a, 0.0)
    return chain - feedback - jnp.diag(jnp.where(order.has_pole, 0.0, 1.0)), last


def growth(a: Array, order: Order, samples: Samples) -> Array:
    """Logarithm of how much the least stable pole grows over the longest segment.

    `MAX_GROWTH` admits integrators and poles that are unstable within their uncertainty, no more.
    """
    rates = jnp.linalg.eigvals(companion(a, order)[0]).real
    return jnp.max(rates) * samples.dt * samples.longest


def hold(F: Array, G: Array, times: Array) -> tuple[Array, Array]:
    """Exact zero-order hold of x' = F x + G u over each of `times`."""
    system = StateSpace(F, G, jnp.zeros_like(G), jnp.zeros(()))
    return jax.vmap(system.discretise)(times)


def recurrence(Phi: Array, drive: Array, start: Array, samples: Samples) -> Array:
    """States (k, q, m) of x[i+1] = Phi x[i] + drive[i], x = `start` where a segment begins."""

    def advance(x, push):
        return Phi @ x + push, x

    def block(x, inputs):
        push, first = inputs
        return jax.lax.scan(advance, jnp.where(first, start, x), push)

    push = jnp.swapaxes(drive, 1, 2) + _NOT_DENORMAL
    if samples.n_segments == 1:
        states = jax.lax.scan(advance, start, push.reshape(-1, start.size))[1]
        return jnp.swapaxes(states.reshape(push.shape), 1, 2)
    states = jax.lax.scan(block, jnp.zeros_like(start), (push, samples.first))[1]
    return jnp.swapaxes(states, 1, 2)


def delayed(samples: Samples, d: Array) -> tuple[Array, Array, Array]:
    """The held input after a delay of `d` samples.

    With d = i - g, i an integer and 0 <= g < 1, the input is `early` (k, m) for the first 1 - g of
    each sampling period and `late` (k, m) for the rest. Before a segment it is that of its first
    sample. Returns `early, late, g`.
    """
    whole = jnp.ceil(d)
    flat = samples.u.reshape(-1)
    at = jnp.arange(flat.size).reshape(samples.u.shape) - whole.astype(int)
    origin = samples.origin[:, None]
    early = flat[jnp.maximum(at, origin)]
    late = flat[jnp.clip(at + 1, origin, flat.size - 1)]
    return early, late, whole - d


def solve(G: Array, rhs: Array) -> Array:
    """Solve a symmetric positive semidefinite system; directions without data stay at zero."""
    L, scale = _factor(G)
    return scale[:, None] * jax.scipy.linalg.cho_solve((L, True), scale[:, None] * rhs)


def _factor(G: Array) -> tuple[Array, Array]:
    d = jnp.diag(G)
    live = d > 0
    scale = jnp.where(live, jax.lax.rsqrt(jnp.where(live, d, 1.0)), 0.0)
    H = G * scale[:, None] * scale[None, :] + jnp.diag(jnp.where(live, _RIDGE, 1.0))
    return jnp.linalg.cholesky(H), scale


def segment_grams(rows: Array, samples: Samples) -> Array:
    """Sums of products of the rows over each segment, (s, rows, rows)."""
    # the same for the weighted rows, which would become a slow loop of products
    weighted = jax.lax.optimization_barrier(rows * samples.weight[:, None])
    return _over_segments(weighted @ jnp.swapaxes(rows, 1, 2), samples)


def segment_products(rows: Array, signal: Array, samples: Samples) -> Array:
    """Sums of products of the rows with one signal (k, m) over each segment, (s, rows)."""
    return _over_segments(jnp.sum(rows * (samples.weight * signal)[:, None], -1), samples)


def _over_segments(blocks: Array, samples: Samples) -> Array:
    if samples.n_segments == 1:
        return jnp.sum(blocks, 0, keepdims=True)
    return jax.ops.segment_sum(blocks, samples.segment, samples.n_segments)


def eliminate(G: Array, count: int) -> tuple[Array, Array]:
    """Schur complement that eliminates the last `count` of `p` rows and columns.

    Also returns the map (count, p - count) whose negative gives the eliminated parameters from the
    others.
    """
    keep = G.shape[0] - count
    into = solve(G[keep:, keep:], G[keep:, :keep])
    return G[:keep, :keep] - G[:keep, keep:] @ into, into


def signals(a: Array, d: Array, order: Order, samples: Samples) -> Array:
    """The signals of which everything else is a combination, (k, 23, m)."""
    A, B = companion(a, order)
    first = jnp.eye(N_MAX)[0]
    early, late, g = delayed(samples, d)
    H = _cascade(A, B)
    Phi, Gamma = hold(H, jnp.append(B, jnp.zeros(N_MAX)), jnp.stack([samples.dt, g * samples.dt]))
    state, coupling = Phi[0, :N_MAX, :N_MAX], Phi[0, N_MAX:, :N_MAX]
    drive = (Gamma[0] - Gamma[1])[:, None] * early[:, None] + Gamma[1][:, None] * late[:, None]
    zero = jnp.zeros(N_MAX)
    X = recurrence(state, drive[:, :N_MAX], zero, samples)
    W = recurrence(state, coupling @ X + drive[:, N_MAX:], zero, samples)
    F = recurrence(state.T, jnp.zeros_like(X), first, samples)
    M = recurrence(state.T, coupling.T @ F, zero, samples)
    live = order.has_pole[:, None]
    one = jnp.broadcast_to(order.offset.astype(X.dtype), early.shape)
    plain = jnp.stack([early, one, samples.y], 1)
    rows = jnp.concatenate([X, plain, W, M * live, F * live], 1)
    # the barrier keeps XLA from making the rows again wherever they are used
    return jax.lax.optimization_barrier(rows)


def _cascade(A: Array, B: Array) -> Array:
    """1/A twice: the first state of the first drives the second."""
    zero = jnp.zeros_like(A)
    return jnp.block([[A, zero], [jnp.outer(B, jnp.eye(N_MAX)[0]), A]])


def linear_rows(a: Array, order: Order) -> Array:
    """What the columns of the linear parameters are made of, (7, 18)."""
    power = jnp.eye(N_MAX + 1, KEPT)
    highest = jnp.zeros(KEPT).at[X_].set(-jnp.where(order.has_pole, a, 0.0)).at[U].set(1.0)
    is_highest = (jnp.arange(N_MAX + 1) == order.n)[:, None]
    below = (jnp.arange(N_MAX + 1) < order.n)[:, None]
    power = jnp.where(is_highest, highest, jnp.where(below, power, 0.0)) * order.has_zero[:, None]
    return jnp.concatenate([power, jnp.zeros((1, KEPT)).at[0, ONE].set(1.0)])


def nonlinear_rows(a: Array, order: Order, linear: Linear, dt: Array) -> Array:
    """What the sensitivities to `a` and the delay are made of in each segment, (s, 6, 18).

    They hold up to free responses, which are projected out anyway.
    """
    A, B = companion(a, order)
    b = linear.beta[: N_MAX + 1]
    D = jnp.sum(jnp.where(jnp.arange(N_MAX + 1) == order.n, b, 0.0))
    c = jnp.where(order.has_pole, b[:N_MAX] - D * a, 0.0)

    # how a combination of the signals is differentiated in time: states of companion form are each
    # other's derivatives
    none = jnp.zeros((N_MAX, N_MAX))
    into_input = jnp.stack([B, jnp.zeros(N_MAX), jnp.zeros(N_MAX)], 1)
    derivative = jnp.block(
        [
            [A, into_input, none, none],
            [jnp.zeros((3, KEPT))],
            [jnp.outer(B, jnp.eye(N_MAX)[0]), jnp.zeros((N_MAX, 3)), A, none],
            [jnp.zeros((N_MAX, 3 + 2 * N_MAX)), A.T],
        ]
    )
    slope = jnp.concatenate([c @ A, (c @ B)[None], jnp.zeros(KEPT - N_MAX - 1)])
    by_delay = jnp.where(order.delay, -dt * slope, 0.0)
    forced = jnp.concatenate([D[None], jnp.zeros(7), c])

    def of_segment(free):
        filtered = jnp.concatenate([forced, free])
        _, rows = jax.lax.scan(lambda row, _: (row @ derivative, row), filtered, length=N_MAX)
        return jnp.concatenate([-rows * order.has_pole[:, None], by_delay[None]])

    return jax.vmap(of_segment)(linear.free)


class Projected(eqx.Module):
    """The signals of one candidate with all linear parameters at their best.

    `residual` (k, m) is measurement minus prediction. `grams` (s, 18, 18) are those of the signals
    with the free responses projected out, `into` (s, 5, 18) the map that does it, and `along`
    (s, 18) the products of these signals with the residual.
    """

    linear: Linear
    residual: Array
    grams: Array
    into: Array
    along: Array


def project(
    a: Array,
    order: Order,
    rows: Array,
    samples: Samples,
    *,
    raw: Array | None = None,
    fitted: Array | None = None,
) -> Projected:
    """Solve for `b`, offset and the free response of each segment.

    The residual is computed sample by sample, and the solution corrected by it once, so that an
    ill-conditioned candidate is judged by what it really predicts. `fitted` (s,) weighs the
    segments that `b` and the offset may see; all by default. `raw` are the Gram matrices of the
    rows where they are known already.
    """
    raw = segment_grams(rows, samples) if raw is None else raw
    grams, into = jax.vmap(lambda G: eliminate(G, N_MAX))(raw)
    L = linear_rows(a, order)
    of_segments = jnp.ones(raw.shape[0]) if fitted is None else fitted
    normal = L @ jnp.einsum("s,spq->pq", of_segments, grams) @ L.T
    linear = Linear(jnp.zeros(N_LINEAR), jnp.zeros((raw.shape[0], N_MAX)))
    residual = samples.y
    for _ in range(2):
        along = segment_products(rows, residual, samples)
        reduced = along[:, :KEPT] - jnp.einsum("sfp,sf->sp", into, along[:, KEPT:])
        step = solve(normal, (L @ (of_segments @ reduced))[:, None])[:, 0]
        start = jax.vmap(lambda G, v: solve(G[F_, F_], v[:, None])[:, 0])(raw, along[:, KEPT:])
        linear = Linear(linear.beta + step, linear.free + start - into @ (step @ L))
        # a barrier, lest XLA make the residual again for each row that it is multiplied with
        residual = jax.lax.optimization_barrier(samples.y - _output(linear, L, rows, samples))
    along = segment_products(rows, residual, samples)
    reduced = along[:, :KEPT] - jnp.einsum("sfp,sf->sp", into, along[:, KEPT:])
    return Projected(linear, residual, grams, into, reduced)


def _output(linear: Linear, L: Array, rows: Array, samples: Samples) -> Array:
    """Simulated output (k, m)."""
    of_block = jnp.broadcast_to(linear.beta @ L, (samples.segment.shape[0], KEPT))
    weights = jnp.concatenate([of_block, linear.free[samples.segment]], 1)
    return jnp.sum(weights[:, :, None] * rows, 1)


def compress(a: Array, d: Array, order: Order, samples: Samples) -> tuple[Linear, Array, Array]:
    """The projected least-squares problem in 7 rows, with the same Gauss-Newton structure.

    Returns the linear parameters, `r` (7,) and `J` (7, 6) such that `J.T @ J`, `J.T @ r` and
    `r @ r` equal those of the projected residual (prediction minus measurement) over the record.
    """
    p = project(a, order, signals(a, d, order, samples), samples)
    L = linear_rows(a, order)

    def of_segment(J, G, along):
        T = jnp.concatenate([J, L])
        return T @ G @ T.T, T @ along

    J = nonlinear_rows(a, order, p.linear, samples.dt)
    normal, along = jax.tree.map(lambda x: jnp.sum(x, 0), jax.vmap(of_segment)(J, p.grams, p.along))
    size = jnp.sum(samples.weight * p.residual**2)
    count = N_MAX + 1
    G = jnp.zeros((count + 1 + N_LINEAR,) * 2)
    at = jnp.array([*range(count), *range(count + 1, count + 1 + N_LINEAR)])
    G = G.at[at[:, None], at[None, :]].set(normal).at[at, count].set(-along)
    G = G.at[count, at].set(-along).at[count, count].set(size)
    G, _ = eliminate(G, N_LINEAR)
    lower, scale = _factor(G)
    R = lower.T * jnp.where(scale > 0, 1 / jnp.where(scale > 0, scale, 1.0), 0.0)
    return p.linear, R[:, -1], R[:, :-1]


class Details(eqx.Module):
    """A finished fit, sample by sample.

    `predicted` (k, m) is the simulated output. `sensitivities` (k, 13, m) are its derivatives with
    respect to `a`, delay, `b` and offset, free responses projected out.
    """

    beta: Array
    predicted: Array
    sensitivities: Array


def detail(a: Array, d: Array, order: Order, samples: Samples, fitted: Array) -> Details:
    """Simulate a finished fit. `b` and the offset come from the segments with `fitted` (s,) = 1
    alone, the free response of each segment from its own samples; both as they are weighed.
    """
    rows = signals(a, d, order, samples)
    p = project(a, order, rows, samples, fitted=fitted)
    L = linear_rows(a, order)
    J = nonlinear_rows(a, order, p.linear, samples.dt)
    T = jnp.concatenate([J, jnp.broadcast_to(L, (J.shape[0], *L.shape))], 1)
    kept, F = rows[:, :KEPT], rows[:, F_]
    projected = kept - jnp.swapaxes(p.into[samples.segment], 1, 2) @ F
    return Details(p.linear.beta, samples.y - p.residual, T[samples.segment] @ projected)
