"""Projected residual and Jacobian against finite differences and simulations made elsewhere."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import known_plants as known
from vdmsi_jax.identify import response as rs
from vdmsi_jax.identify.layout import Scale, lay_out

# central differences with relative steps of 1e-5: truncation 1e-10, rounding 1e-16 / 1e-5, both
# times the conditioning of the projection (up to 1e3 here)
DIFFERENCES = 2e-6
STEP = 1e-5
# two exact simulations of the same thing: rounding, times the growth of errors over the record
EXACT = 1e-8
# normal equations square the conditioning of the projected columns
NORMAL = 1e-7
DT = 0.05
N = 256

CASES = {
    # name: (numerator, denominator) descending, delay in samples, edges of the segments
    "first order": ((1.5,), (1.0, 2.0), 0.0, []),
    "fractional delay": ((2.0, 3.0), (1.0, 1.2, 3.0), 2.4, []),
    "whole delay": ((3.0,), (1.0, 1.2, 3.0), 3.0, []),
    "feed-through": ((0.3, 1.0, 4.0), (1.0, 2.0, 5.0), 0.0, []),
    "segments": ((1.0, 4.0), (1.0, 2.5, 7.0, 4.0), 1.3, [100, 170]),
    "five poles": ((1.0, 9.0, 20.0), (1.0, 6.0, 20.0, 40.0, 45.0, 20.0), 0.6, [100, 170]),
}


@pytest.fixture(params=CASES, scope="module")
def case(request):
    """The point at which to look, and data of a plant that is somewhere else."""
    num, den, delay, edges = CASES[request.param]
    n, m = len(den) - 1, len(num) - 1
    other = known.Truth(tuple(1.1 * b for b in num), tuple(0.9 * a + 0.1 for a in den))
    u = known.steps(N, 17, seed=1)
    y = known.response(other, u, DT) + known.white(N, 0.05, seed=2) + 0.3
    record = known.cut(known.log(u, y, DT), edges)
    counts = np.ones(N, bool)
    counts[40:60] = False  # filled in, or held out
    samples, where = lay_out(record, known.PLANT, Scale(1.0, 1.0, 1.0, DT), counts)
    a = np.zeros(rs.N_MAX)
    a[:n] = den[:0:-1]
    order = rs.Order(jnp.asarray(n), jnp.asarray(m), jnp.asarray(True), jnp.asarray(True))
    return record, samples, where, counts, order, jnp.asarray(a), jnp.asarray(delay)


@jax.jit
def _compress(a, d, order, samples):
    return rs.compress(a, d, order, samples)


@jax.jit
def _detail(a, d, order, samples):
    return rs.detail(a, d, order, samples, jnp.ones(samples.n_segments))


def _free_parameters(order, d):
    """Directions in (a, delay) that the order has; no delay at a jump of the loss."""
    n = int(order.n)
    smooth = float(d) % 1.0 != 0.0 and int(order.m) < n
    return [*range(n)] + [rs.N_MAX] * smooth


def test_gradient_of_the_projected_loss(case):
    _, samples, _, _, order, a, d = case
    _, r, J = _compress(a, d, order, samples)
    gradient = np.asarray(J.T @ r)
    for i in _free_parameters(order, d):
        at = np.append(a, d)
        step = STEP * max(abs(at[i]), 1.0)

        def loss(by, i=i, at=at):
            x = at.copy()
            x[i] += by
            return 0.5 * float(jnp.sum(_compress(x[:-1], x[-1], order, samples)[1] ** 2))

        slope = (loss(step) - loss(-step)) / (2.0 * step)
        size = float(jnp.linalg.norm(J[:, i]) * jnp.linalg.norm(r))
        assert gradient[i] == pytest.approx(slope, abs=DIFFERENCES * size)


def test_prediction_is_the_best_of_independent_simulations(case):
    """Linear least squares over columns that scipy makes gives the same prediction and residual."""
    record, samples, where, counts, order, a, d = case
    columns, y = _columns(record, order, a, d), record["out"]
    best = np.linalg.lstsq(columns[counts], y[counts], rcond=None)[0]
    predicted = np.asarray(_detail(a, d, order, samples).predicted)[where >= 0]
    np.testing.assert_allclose(predicted, columns @ best, atol=EXACT)
    _, r, _ = _compress(a, d, order, samples)
    assert float(r @ r) == pytest.approx(np.sum((y - columns @ best)[counts] ** 2), rel=EXACT)


def test_sensitivities_against_differences_of_independent_simulations(case):
    """Each with the linear parameters held still, up to free responses, which are projected out."""
    record, samples, where, counts, order, a, d = case
    columns, y = _columns(record, order, a, d), record["out"]
    best = np.linalg.lstsq(columns[counts], y[counts], rcond=None)[0]
    n_free = int(order.n) * len(record.segments)
    free = columns[:, :n_free] * counts[:, None]
    found = np.asarray(_detail(a, d, order, samples).sensitivities)[where >= 0]
    for i in _free_parameters(order, d):
        at = np.append(a, d)
        step = STEP * max(abs(at[i]), 1.0)
        moved = []
        for by in (step, -step):
            x = at.copy()
            x[i] += by
            moved.append(_columns(record, order, x[:-1], x[-1]) @ best)
        slope = (moved[0] - moved[1]) / (2.0 * step)
        # projected with the weights of the fit, as the package does
        away = slope - columns[:, :n_free] @ np.linalg.lstsq(free, slope * counts, rcond=None)[0]
        np.testing.assert_allclose(
            found[:, i], away, atol=DIFFERENCES * np.linalg.norm(slope), err_msg=f"parameter {i}"
        )


def test_normal_matrix_is_that_of_the_projected_sensitivities(case):
    _, samples, where, counts, order, a, d = case
    _, _, J = _compress(a, d, order, samples)
    S = np.asarray(_detail(a, d, order, samples).sensitivities)[where >= 0]
    S = S[counts]
    # with a feed-through the delay's column lies among those of the numerator: none is left of it
    live = [*range(int(order.n))] + [rs.N_MAX] * (int(order.m) < int(order.n))
    nonlinear, linear = S[:, live], S[:, rs.N_MAX + 1 :]
    away = nonlinear - linear @ np.linalg.lstsq(linear, nonlinear, rcond=1e-12)[0]
    size = np.linalg.norm(away, axis=0)
    normal = np.asarray(J.T @ J)[np.ix_(live, live)]
    np.testing.assert_allclose(
        normal / size[:, None] / size, away.T @ away / size[:, None] / size, atol=NORMAL
    )


def _columns(record, order, a, d):
    """Free responses of each segment, powers of s over A applied to the delayed input, and one."""
    n, m = int(order.n), int(order.m)
    den = np.append(1.0, np.asarray(a, float)[:n][::-1])
    pieces = record.pieces("u_cmd")
    free = np.zeros((record.n, n * len(pieces)))
    for i, segment in enumerate(record.segments):
        free[segment.samples, i * n : (i + 1) * n] = known.free_responses(den, len(segment), DT)
    forced = [
        np.concatenate(
            [
                known.response(
                    known.Truth(tuple(np.eye(p + 1)[0]), tuple(den), float(d) * DT), u, DT
                )
                for u in pieces
            ]
        )
        for p in range(m + 1)
    ]
    return np.column_stack([free, *forced, np.ones(record.n)])
