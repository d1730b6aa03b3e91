"""What `identification.py` is timed against: two ways to fit the order grid with scipy alone.

`by_lsim` is what a user would write: residuals of `scipy.signal.lsim` in `least_squares`, which
takes differences for the Jacobian. `by_lfilter` is written with care: exact zero-order hold,
`lfilter`, all linear parameters projected out (offset and initial state with them), sensitivities
by filtering, starts from equation errors and from the smaller orders.
"""

import math
import warnings
from collections.abc import Iterable, Iterator

import numpy as np
import scipy.linalg
import scipy.optimize
import scipy.signal
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Orders = Iterable[tuple[int, int]]

STARTS = 2  # how many of an order's candidates `by_lfilter` refines unless told otherwise
_DIVERGED = 1e3  # residual of a model that blows up, over the norm of the output


def fit_percent(y: Floats, predicted: Floats) -> float:
    """Eq. (3) of Yan, Hsu & Wen (ION 2023)."""
    return 100.0 * (1 - float(np.linalg.norm(y - predicted) / np.linalg.norm(y - y.mean())))


# -- what a user would write --------------------------------------------------------------------


def by_lsim(u: Floats, y: Floats, dt: float, orders: Orders) -> Iterator[tuple[str, float]]:
    """Name and FIT of each order: from all poles at 3 and at 10 rad/s, and from a smaller order.

    Coefficients are scaled by their start (`x_scale`), and an offset is fitted. The record starts
    at rest: no initial state is fitted, which leaves some 0.01 of FIT. Of a smaller order with one
    pole less, the best is taken up with a new pole at 50 rad/s.
    """
    t = np.arange(len(u)) * dt
    found: dict[tuple[int, int], Floats] = {}
    for n, m in orders:

        def predict(p: Floats, n=n, m=m) -> Floats:
            system = (p[: m + 1], np.append(1.0, p[m + 1 : m + 1 + n]))
            return scipy.signal.lsim(system, u, t, interp=False)[1] + p[-1]

        def residual(p: Floats, predict=predict) -> Floats:
            with warnings.catch_warnings(), np.errstate(all="ignore"):
                warnings.simplefilter("ignore")
                try:
                    r = predict(p) - y
                except (np.linalg.LinAlgError, ValueError):
                    return np.full(len(y), 1e6)
            return np.clip(np.nan_to_num(r, nan=1e6), -1e6, 1e6)

        starts = [np.concatenate([np.poly(np.full(n, -w)), [0.0]]) for w in (3.0, 10.0)]
        starts = [np.concatenate([np.zeros(m), [p[n]], p[1:]]) for p in starts]
        for smaller in ((n, m - 1), (n - 1, m), (n - 1, m - 1)):
            if smaller in found:
                starts.append(_grown(found[smaller], smaller, (n, m)))
        fitted = [
            scipy.optimize.least_squares(
                residual, p, x_scale=np.maximum(np.abs(p), 1e-2 * np.abs(p).max()), max_nfev=60
            )
            for p in starts
        ]
        best = min(fitted, key=lambda s: s.cost)
        found[n, m] = best.x
        yield f"P{n}Z{m}", fit_percent(y, y + best.fun)


def _grown(p: Floats, smaller: tuple[int, int], order: tuple[int, int]) -> Floats:
    """The same response as parameters of a larger order."""
    num, den = p[: smaller[1] + 1], np.append(1.0, p[smaller[1] + 1 : -1])
    if smaller[0] < order[0]:
        den = np.convolve(den, [1.0, 50.0])
        num = np.convolve(num, [1.0, 50.0] if smaller[1] < order[1] else [50.0])
    num = np.pad(num, (order[1] + 1 - len(num), 0))
    return np.concatenate([num, den[1:], p[-1:]])


# -- with care ----------------------------------------------------------------------------------


def by_lfilter(
    u: Floats, y: Floats, dt: float, orders: Orders, starts: int = STARTS
) -> Iterator[tuple[str, float]]:
    """Name and FIT of each order; orders come with those that they contain before them. Of an
    order's candidates, eleven at most, the best `starts` are refined."""
    lag = _first_order_lag(u, y, dt)
    problem = _Projected(u / u.std(), y / np.linalg.norm(y - y.mean()), dt / lag)
    found: dict[tuple[int, int], Floats] = {}
    for n, m in orders:
        candidates = [problem.equation_error(np.poly(np.full(n, -w))[1:], n, m) for w in (1.0, 4.0)]
        if (n, m - 1) in found:
            candidates.append(found[n, m - 1])
        more = (0.5, 5.0, 20.0 * lag / dt, 200.0 * lag / dt)  # a pole
        for smaller in ((n - 1, m), (n - 1, m - 1)):
            if smaller in found:
                known = np.append(1.0, found[smaller])
                candidates += [np.convolve(known, [1, w])[1:] for w in more]
        judged = sorted(((problem.cost(a, n, m), i) for i, a in enumerate(candidates)))
        refined = [problem.refine(candidates[i], n, m) for _, i in judged[:starts]]
        cost, a = min(refined, key=lambda pair: pair[0])
        found[n, m] = a
        yield f"P{n}Z{m}", 100.0 * (1.0 - cost)


def _first_order_lag(u: Floats, y: Floats, dt: float) -> float:
    """Time constant whose first-order response explains most of the output."""
    centred = y - y.mean()

    def unexplained(logarithm: float) -> float:
        pole = math.exp(-dt / math.exp(logarithm))
        x = scipy.signal.lfilter([0.0, 1 - pole], [1.0, -pole], u)
        x -= x.mean()
        return -float((x @ centred) ** 2 / (x @ x))

    span = np.log([dt / 2, dt * len(u) / 4])
    best = min(np.linspace(*span, 24), key=unexplained)
    return math.exp(best)


class _Projected:
    """Simulation error over the denominator alone, in scaled units."""

    def __init__(self, u: Floats, y: Floats, dt: float):
        self.u, self.y, self.dt = u, y, dt
        self.impulse = np.zeros_like(u)
        self.impulse[0] = 1.0

    def discretised(self, a: Floats) -> tuple[Floats, Floats, Floats]:
        """Denominator in z, numerators `(n, n + 1)` of s^i/A under zero-order hold, those of the
        free responses."""
        n = len(a)
        A = np.diag(np.ones(n - 1), 1)
        A[-1] = -a[::-1]
        block = np.zeros((n + 1, n + 1))
        block[:n, :n], block[n - 1, n] = A * self.dt, self.dt
        step = scipy.linalg.expm(block)
        Ad, Bd = step[:n, :n], step[:n, n]
        den = np.poly(Ad)
        powers = [np.eye(n)]
        for _ in range(n):
            powers.append(powers[-1] @ Ad)
        markov = np.stack([np.zeros(n), *(p @ Bd for p in powers[:n])], 1)
        free = np.stack([p[0] for p in powers], 1)
        numerators = np.stack([np.convolve(row, den)[: n + 1] for row in markov])
        return den, numerators, np.stack([np.convolve(row, den)[: n + 1] for row in free])

    def solved(self, a: Floats, n: int, m: int, *, slopes: bool):
        """Projected residual and its Jacobian over `a`, or None where the model blows up."""
        growth = np.roots(np.append(1.0, a)).real.max() if np.all(np.isfinite(a)) else np.inf
        if growth * self.dt * len(self.u) > 1.0 or np.abs(a).max() * self.dt**n > 1e6:
            return None
        den, numerators, free = self.discretised(a)
        X = [scipy.signal.lfilter(b, den, self.u) for b in numerators]
        if m == n:  # s^n/A u = u - sum a_i s^i/A u; a basis may take u for it
            X.append(self.u)
        columns = X[: m + 1] + [np.ones_like(self.u)]
        columns += [scipy.signal.lfilter(b, den, self.impulse) for b in free]
        basis = np.stack(columns, 1)
        size = np.linalg.norm(basis, axis=0)
        Q, R = scipy.linalg.qr(
            basis / np.where(size > 0, size, 1.0), mode="economic", check_finite=False
        )
        along = Q.T @ self.y
        r = Q @ along - self.y
        if not slopes:
            return r, None
        weights = scipy.linalg.lstsq(R, along, lapack_driver="gelsy")[0]
        output = self.y + r - weights[m + 1] / size[m + 1]
        # output is nearly linear between samples: hold its mean over each interval
        middle = 0.5 * (output + np.append(output[1:], output[-1]))
        S = np.stack([-scipy.signal.lfilter(b, den, middle) for b in numerators[::-1]], 1)
        return r, S - Q @ (Q.T @ S)

    def cost(self, a: Floats, n: int, m: int) -> float:
        solved = self.solved(a, n, m, slopes=False)
        return _DIVERGED if solved is None else float(np.linalg.norm(solved[0]))

    def refine(self, a: Floats, n: int, m: int) -> tuple[float, Floats]:
        """MINPACK's Levenberg-Marquardt, analytic Jacobian, scaled by its columns."""
        last: dict[bytes, tuple[Floats, Floats]] = {}

        def both(p: Floats) -> tuple[Floats, Floats]:
            key = p.tobytes()
            if key not in last:
                last.clear()
                solved = self.solved(p, n, m, slopes=True)
                worst = np.full(len(self.y), _DIVERGED / math.sqrt(len(self.y)))
                last[key] = (worst, np.zeros((len(worst), n))) if solved is None else solved
            return last[key]

        start = self.cost(a, n, m)
        done = scipy.optimize.least_squares(
            lambda p: both(p)[0],
            a,
            lambda p: both(p)[1],
            method="lm",
            x_scale="jac",
            xtol=1e-7,
            ftol=1e-7,
            gtol=1e-12,
            max_nfev=40,
        )
        cost = math.sqrt(2 * done.cost)
        return (cost, done.x) if cost < start else (start, a)

    def equation_error(self, a: Floats, n: int, m: int) -> Floats:
        """State-variable filters, iterated with the model found as filter and instrument."""
        best, least = a, self.cost(a, n, m)
        for iteration in range(4):
            den, numerators, _ = self.discretised(a)
            U = [scipy.signal.lfilter(b, den, self.u) for b in numerators]
            hold = 0.5 * (self.y + np.append(self.y[1:], self.y[-1]))
            Y = [scipy.signal.lfilter(b, den, hold) for b in numerators]
            top_u = self.u - sum(c * x for c, x in zip(a[::-1], U, strict=True))
            top_y = self.y - sum(c * x for c, x in zip(a[::-1], Y, strict=True))
            one = np.ones_like(self.u)
            exogenous = [*(U + [top_u])[: m + 1], one]
            regressors = np.stack([*(-x for x in Y), *exogenous], 1)
            instruments = regressors
            if iteration:
                r = self.solved(a, n, m, slopes=False)
                if r is None:
                    break
                simulated = self.y + r[0]
                hold = 0.5 * (simulated + np.append(simulated[1:], simulated[-1]))
                clean = [-scipy.signal.lfilter(b, den, hold) for b in numerators]
                instruments = np.stack([*clean, *exogenous], 1)
            try:
                theta = np.linalg.solve(instruments.T @ regressors, instruments.T @ top_y)
            except np.linalg.LinAlgError:
                break
            a = theta[n - 1 :: -1] if n > 1 else theta[:1]
            cost = self.cost(a, n, m)
            if cost < least:
                best, least = a, cost
            if cost >= _DIVERGED:
                break
        return best
