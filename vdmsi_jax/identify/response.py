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
matrix. Signals stand as columns of blocks, `(k, m, signals)`.
"""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from vdmsi_jax.identify.layout import Samples
from vdmsi_jax.models.linear_plant import whole_and_rest
from vdmsi_jax.models.state_space import StateSpace

N_MAX = 5
N_LINEAR = N_MAX + 2  # b_0 ... b_5 and the offset
_RIDGE = 1e-13  # of equilibrated Gram matrices: about the resolution of float64 sums of squares

STEP = 16  # samples that a matrix product answers: fewer make the scan long, more the products dear
_NOT_DENORMAL = 1e-60  # keeps decayed states out of the range in which processors are slow
MAX_GROWTH = 1.0

# the signals: states s^i/A u; u; 1; y; states of 1/A driven by the first of these; the
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


def between(Phi: Array, early: Array, late: Array, signal: Array, samples: Samples) -> Array:
    """States (k, m, q) of `x[i+1] = Phi x[i] + early s[i] + late s[i+1]`, at rest where a segment
    begins.

    The recursion of a loop, regrouped: within `STEP` samples the states are one matrix product of
    the inputs and of the state at their head, and only heads are scanned.
    """
    powers = _powers(Phi)
    flat = signal.reshape(-1)
    inputs = flat.reshape(-1, STEP)
    beyond = jnp.append(flat[STEP::STEP], flat[-1])
    answers = jnp.stack([powers[:-1] @ early, powers[:-1] @ late])
    lag = np.arange(STEP)[None, :] - np.arange(STEP)[:, None]  # input at i, state at j: j - i
    by_early = jnp.where((lag > 0)[..., None], answers[0][np.maximum(lag - 1, 0)], 0.0)
    # what the first input does late is in the head
    known = (lag >= 0) & (np.arange(STEP) > 0)[:, None]
    forced = by_early + jnp.where(known[..., None], answers[1][np.maximum(lag, 0)], 0.0)
    at_end = answers[0][::-1] + jnp.concatenate([jnp.zeros((1, len(Phi))), powers[-2:0:-1] @ late])
    gained = inputs @ at_end + beyond[:, None] * late
    heads = _heads(powers[-1], gained, jnp.zeros(len(Phi)), samples)
    return _within(powers, heads, samples) + (inputs @ forced.reshape(STEP, -1)).reshape(
        *samples.u.shape, -1
    )


def free(Phi: Array, start: Array, samples: Samples) -> Array:
    """States (k, m, q) of `x[i+1] = Phi x[i]`, from `start` where a segment begins."""
    powers = _powers(Phi)
    nothing = jnp.zeros((samples.u.size // STEP, len(Phi)))
    return _within(powers, _heads(powers[-1], nothing, start, samples), samples)


def _powers(Phi: Array) -> Array:
    """`Phi^0 ... Phi^STEP` by doubling the list."""
    powers, top = jnp.eye(len(Phi))[None], Phi
    while len(powers) < STEP:
        powers, top = jnp.concatenate([powers, powers @ top]), top @ top
    return jnp.concatenate([powers, top[None]])


def _heads(top: Array, gained: Array, start: Array, samples: Samples) -> Array:
    """State at the first of every `STEP` samples."""
    gained = gained + _NOT_DENORMAL
    if samples.n_segments == 1:
        return jax.lax.scan(lambda x, push: (top @ x + push, x), start, gained)[1]
    first = jnp.zeros((len(samples.first), samples.u.shape[1] // STEP), bool)
    first = first.at[:, 0].set(samples.first).reshape(-1)

    def advance(x, inputs):
        push, begins = inputs
        x = jnp.where(begins, start, x)
        return top @ x + push, x

    return jax.lax.scan(advance, start, (gained, first))[1]


def _within(powers: Array, heads: Array, samples: Samples) -> Array:
    """What heads alone lead to."""
    steps = jnp.moveaxis(powers[:STEP], 2, 0).reshape(len(powers[0]), -1)
    return (heads @ steps).reshape(*samples.u.shape, -1)


def delayed(samples: Samples, d: Array) -> tuple[Array, Array]:
    """The held input after a delay of `d` samples.

    With d = i - g, i an integer and 0 <= g < 1, the input is that of a sample, `early` (k, m), for
    the first 1 - g of each sampling period and that of the next for the rest. Before a segment it
    is that of its first sample. Returns `early, g`.
    """
    whole, early = whole_and_rest(d, 1.0)
    flat = samples.u.reshape(-1)
    at = jnp.arange(flat.size).reshape(samples.u.shape) - whole
    return flat[jnp.maximum(at, samples.origin[:, None])], early


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
    weighted = jax.lax.optimization_barrier(rows * samples.weight[..., None])
    return _over_segments(jnp.swapaxes(weighted, 1, 2) @ rows, samples)


def segment_products(rows: Array, signal: Array, samples: Samples) -> Array:
    """Sums of products of the rows with one signal (k, m) over each segment, (s, rows)."""
    return _over_segments(jnp.einsum("km,kmp->kp", samples.weight * signal, rows), samples)


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
    """The signals of which everything else is a combination, (k, m, 23)."""
    A, B = companion(a, order)
    early, g = delayed(samples, d)
    H = _cascade(A, B)
    Phi, Gamma = hold(H, jnp.append(B, jnp.zeros(N_MAX)), jnp.stack([samples.dt, g * samples.dt]))
    driven = between(Phi[0], Gamma[0] - Gamma[1], Gamma[1], early, samples)
    # transposed, the second of the cascade drives the first
    apart = free(Phi[0].T, jnp.eye(2 * N_MAX)[N_MAX], samples)
    live = order.has_pole
    one = jnp.broadcast_to(order.offset.astype(early.dtype), early.shape)
    plain = jnp.stack([early, one, samples.y], -1)
    X, W = driven[..., :N_MAX], driven[..., N_MAX:]
    M, F = apart[..., :N_MAX] * live, apart[..., N_MAX:] * live
    # the barrier keeps XLA from making the rows again wherever they are used
    return jax.lax.optimization_barrier(jnp.concatenate([X, plain, W, M, F], -1))


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

    def solved(along: Array) -> tuple[Linear, Array]:
        """Linear parameters by products with what is to be explained, and products with the rest"""
        reduced = along[:, :KEPT] - jnp.einsum("sfp,sf->sp", into, along[:, KEPT:])
        beta = solve(normal, (L @ (of_segments @ reduced))[:, None])[:, 0]
        start = jax.vmap(lambda G, v: solve(G[F_, F_], v[:, None])[:, 0])(raw, along[:, KEPT:])
        linear = Linear(beta, start - into @ (beta @ L))
        return linear, along - jnp.einsum("spq,sq->sp", raw, _weights(linear, L))

    first, _ = solved(raw[:, :, Y])
    # barriers, lest XLA make the residual again for each row that it is multiplied with
    left = jax.lax.optimization_barrier(samples.y - _output(first, L, rows, samples))
    more, along = solved(segment_products(rows, left, samples))
    linear = Linear(first.beta + more.beta, first.free + more.free)
    residual = jax.lax.optimization_barrier(samples.y - _output(linear, L, rows, samples))
    reduced = along[:, :KEPT] - jnp.einsum("sfp,sf->sp", into, along[:, KEPT:])
    return Projected(linear, residual, grams, into, reduced)


def _weights(linear: Linear, L: Array) -> Array:
    """Weights of the rows in the simulated output, (s, 23)."""
    both = jnp.broadcast_to(linear.beta @ L, (len(linear.free), KEPT))
    return jnp.concatenate([both, linear.free], 1)


def _output(linear: Linear, L: Array, rows: Array, samples: Samples) -> Array:
    """Simulated output (k, m)."""
    return jnp.einsum("kmp,kp->km", rows, _weights(linear, L)[samples.segment])


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

    `predicted` (k, m) is the simulated output. `sensitivities` (k, m, 13) are its derivatives with
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
    projected = rows[..., :KEPT] - rows[..., F_] @ p.into[samples.segment]
    sensitivities = projected @ jnp.swapaxes(T, 1, 2)[samples.segment]
    return Details(p.linear.beta, samples.y - p.residual, sensitivities)
