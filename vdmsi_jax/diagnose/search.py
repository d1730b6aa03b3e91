"""From a stage to the causes that explain it: baseline, forward selection, elimination, rivals."""

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from ..effects import AbstractEffect
from .outcome import completed, steadiness
from .refit import Hypothesis, Refit, refit
from .screen import RAGGED, Candidate, screen
from .stage import LEAD, POLES, Stage

ORDERS = ((1, 0), (2, 0), (2, 1), (3, 0), (3, 1), (3, 2), (4, 1), (4, 2), (4, 3))
"""Orders that a baseline may have. The plant comes first: a missing pole must not be called a
delay."""

ORDER_COST = 10.0  # of each coefficient of the plant, in twice the log-likelihood
CAUSE_COST = 20.0  # of a cause, beside
PARAMETER_COST = 8.0  # of each of its parameters
MARGIN = 7.5
"""Two explanations whose log-likelihoods differ by less than half of this are not told apart: with
it the truth stands in the set in 99.7 % of cases."""

_REFITTED = 10  # candidates of a screen that are refitted
_SMALLER = 2  # smaller plants that are screened
_FROM_SMALLER = 4  # candidates of the screens of smaller plants that are refitted
_SMALL = ((1, 0), (2, 0), (2, 1), (3, 1))
_MOST_CAUSES = 4
_STATIC = ("saturation", "dead_zone", "gain_nonlinearity", "gain_asymmetry")
_STEADY = 1.5  # standard errors over blocks that a second cause must be likelier by
_GROWS = 50.0  # that a cause in a small plant must gain for larger ones to be tried with it
_REACH = 60.0  # that a candidate may lie behind the best after a few steps


@dataclass(frozen=True, eq=False)
class Finding:
    """A cause that the evidence supports.

    Attributes:
        number: of the effect in its stage.
        gain: twice the log-likelihood that it is worth in the final model.
        less: the final model without it, refitted.
        others: numbers of the effects that were tried in its place, with what they lack in twice
            the log-likelihood; those within `MARGIN` explain the data as well.
        promised: what the screen had predicted for it.
    """

    number: int
    gain: float
    less: Refit
    others: tuple[tuple[int, float], ...] = ()
    promised: float = 0.0

    @property
    def rivals(self) -> tuple[int, ...]:
        """The effects that explain the data as well."""
        return tuple(k for k, lack in self.others if lack < MARGIN)


@dataclass(frozen=True, eq=False)
class Search:
    """What was found in a stage.

    Attributes:
        stage: the data.
        plain: the best plant without causes.
        baseline: the plant of the final order without causes.
        final: the plant with its causes.
        findings: the strongest first.
        screened: the screen of the baseline, best first.
    """

    stage: Stage
    plain: Refit
    baseline: Refit
    final: Refit
    findings: tuple[Finding, ...]
    screened: tuple[Candidate, ...]


def price(stage: Stage, h: Hypothesis) -> float:
    """What a hypothesis must gain in twice the log-likelihood to be worth its parameters."""
    slots = [stage.slots[number] for number in h.active]
    causes = sum(CAUSE_COST + PARAMETER_COST * slot.weight for slot in slots)
    return ORDER_COST * (h.poles + h.zeros + 1) + causes


def score(stage: Stage, fit: Refit) -> float:
    """Twice the log-likelihood less the price."""
    return 2.0 * fit.loglik - price(stage, fit.hypothesis)


def search(stage: Stage) -> Search:
    """Find the causes that a stage's data support."""
    whole, stage = stage, stage.fitting

    def worth(h: Hypothesis, loglik: float) -> float:
        return 2.0 * loglik - price(stage, h)

    grid = baselines(stage)
    plain = max(grid.values(), key=lambda f: score(stage, f))
    now = plain
    screened: list[Candidate] = []
    seen: dict[tuple, Refit] = {_key(f.hypothesis): f for f in grid.values()}
    while len(now.hypothesis.active) < _MOST_CAUSES:
        candidates = screen(stage, now)
        screened = screened or candidates
        promising = [c for c in candidates if c.gain > 4.0][:_REFITTED]
        starts = [joined(now.hypothesis, c) for c in promising]
        if now.hypothesis.active:
            starts += _promising(stage, list(nested(stage, now.hypothesis)), 1)
        if now is plain:  # a cause may make a smaller plant enough
            coefficients = sum(_order(plain.hypothesis))
            orders = [o for o in _SMALL if sum(o) < coefficients]
            starts += [h for order in orders for h in _late(stage, plain, order)]
            starts += _ringing(stage, plain)
            for smaller in _smaller(stage, grid, plain):
                own = screen(stage, smaller, fine=False)[:_FROM_SMALLER]
                starts += [joined(smaller.hypothesis, c) for c in own]
        most = max((c.gain for c in promising), default=0.0)
        fits = _best_of_each(refit(stage, starts, worth=worth, reach=max(_REACH, 0.5 * most)))
        if now is plain:
            fits += refit(stage, _bent(stage, grid[1, 0]))
            fits += [f for small in _strongest(stage, fits, grid) for f in _grown(stage, small)]
        if not fits:
            break
        seen |= {_key(f.hypothesis): f for f in fits}
        better = [f for f in fits if score(stage, f) > score(stage, now)]
        first = not now.hypothesis.active
        steady = [f for f in better if first or steadiness(stage, now, f) > _STEADY]
        if not steady:
            break
        now = max(steady, key=lambda f: score(stage, f))
    now = _eliminate(stage, now, seen)
    findings = _findings(stage, now)
    bare = replace(now.hypothesis, active=(), theta=_cleared(stage, now.hypothesis))
    order = (now.hypothesis.poles, now.hypothesis.zeros)
    baseline = grid[order] if order in grid else refit(stage, [bare])[0]
    if score(stage, plain) > score(stage, baseline) or not findings:
        baseline = plain
    if not findings:
        now = plain
    kept = [plain, baseline, now, *(f.less for f in findings)]
    plain, baseline, now, *less = completed(whole, kept)
    findings = tuple(replace(f, less=k) for f, k in zip(findings, less, strict=True))
    return Search(whole, plain, baseline, now, findings, tuple(screened))


def baselines(stage: Stage) -> dict[tuple[int, int], Refit]:
    """The plain plant at every order, each from its neighbours with less."""
    first = refit(stage, _first_order(stage))
    grid = {(1, 0): max(first, key=lambda f: f.loglik)}
    for poles in range(2, POLES + 1):
        wanted = [order for order in ORDERS if order[0] == poles]
        starts = []
        for order in wanted:
            simpler = [f.hypothesis for key, f in grid.items() if key[0] == poles - 1]
            starts += [h for less in simpler for h in nested(stage, less) if _order(h) == order]
        fits = _best_of_each(refit(stage, _promising(stage, starts)))
        grid |= {_order(f.hypothesis): f for f in fits}
        for order in wanted:  # a zero more, from the same number of poles
            if (poles, order[1] - 1) in grid:
                below = grid[poles, order[1] - 1].hypothesis
                more = [h for h in nested(stage, below) if _order(h) == order]
                known = [grid[order]] if order in grid else []
                again = _best_of_each([*refit(stage, _promising(stage, more)), *known])
                grid |= {_order(f.hypothesis): f for f in again}
        best = max(grid.values(), key=lambda f: score(stage, f))
        if best.hypothesis.poles < poles:
            break
    return grid


def _first_order(stage: Stage) -> list[Hypothesis]:
    """Plants of one pole over a ladder of time constants, the gain by least squares."""
    duration = stage.u.shape[1] * stage.dt
    ladder = np.geomspace(2.0 * stage.dt, 0.5 * duration, 16)
    thetas = np.repeat(stage.off[None], len(ladder), axis=0)
    thetas[:, 0] = thetas[:, POLES] = 1.0 / (ladder * stage.pace)
    errors, gains = _scaled_errors(stage, thetas)
    picked = np.argsort(errors)[:2]
    made = []
    for k in picked:
        theta = thetas[k].copy()
        theta[POLES] *= gains[k]
        made.append(Hypothesis(1, 0, (), theta))
    return made


def nested(stage: Stage, h: Hypothesis) -> Iterable[Hypothesis]:
    """The same plant with a pole, a zero, or both more, from several places."""
    den = np.concatenate([[1.0], h.theta[: h.poles]])
    num = h.theta[POLES + h.poles - 1 - h.zeros : POLES + h.poles]
    slow = float(np.abs(np.roots(den)).min())
    fast = float(np.abs(np.roots(den)).max())
    limit = 1.0 / (stage.dt * stage.pace)
    for p in {min(3.0 * fast, limit), min(fast, limit), slow / 3.0}:
        if h.poles < POLES:
            yield _of(h, stage, np.polymul(den, [1.0, p]), num * p)
            for near in (0.8, 1.3):
                yield _of(h, stage, np.polymul(den, [1.0, p]), np.polymul(num, [1.0, p * near]))
    if h.zeros < h.poles - 1:
        for tau in (0.1 / fast, -0.1 / fast):
            yield _of(h, stage, den, np.polymul(num, [tau, 1.0]))


def _reduced(stage: Stage, h: Hypothesis, order: tuple[int, int]) -> tuple[Hypothesis, float]:
    """The slowest poles and stable zeros of a plant, and the delay that what is left out amounts
    to, s."""
    poles = np.roots(np.concatenate([[1.0], h.theta[: h.poles]]))
    zeros = np.roots(h.theta[POLES + h.poles - 1 - h.zeros : POLES + h.poles])
    level = h.theta[POLES + h.poles - 1] / h.theta[h.poles - 1]
    poles = poles[np.argsort(np.abs(poles) + 1e-6 * poles.imag)]
    zeros = zeros[np.argsort(np.where(zeros.real < 0, np.abs(zeros), np.inf))]
    n, m = order
    kept, led = poles[:n], zeros[: min(m, int(np.sum(zeros.real < 0)))]
    den, num = (np.atleast_1d(np.real(np.poly(roots))) for roots in (kept, led))
    num = np.concatenate([np.zeros(m + 1 - len(num)), num * level * den[-1] / num[-1]])
    gone = np.sum(-1.0 / poles[n:]) - np.sum(-1.0 / zeros[len(led) :])
    return _of(h, stage, den, num), float(np.real(gone)) / stage.pace


def _late(stage: Stage, plain: Refit, order: tuple[int, int]) -> Iterable[Hypothesis]:
    """The plain plant reduced to an order, with and without the delay that is lost."""
    if order[0] > plain.hypothesis.poles or order[1] > plain.hypothesis.zeros:
        return
    h, delay = _reduced(stage, plain.hypothesis, order)
    number = next(i for i, s in enumerate(stage.slots) if s.cause == "transport_delay")
    theta = h.theta.copy()
    theta[stage.slots[number].index[0]] = max(delay, 0.5 * stage.dt)
    yield h
    yield Hypothesis(h.poles, h.zeros, (number,), theta)


def _ringing(stage: Stage, plain: Refit) -> list[Hypothesis]:
    """The plain plant with its lightly damped poles, and the zeros nearest to them, told as a
    resonance."""
    h = plain.hypothesis
    poles = np.roots(np.concatenate([[1.0], h.theta[: h.poles]]))
    zeros = np.roots(h.theta[POLES + h.poles - 1 - h.zeros : POLES + h.poles])
    level = h.theta[POLES + h.poles - 1] / h.theta[h.poles - 1]
    number = next(i for i, s in enumerate(stage.slots) if s.cause == "resonance")
    made = []
    for p in poles[(poles.imag > 0) & (-poles.real < 0.4 * np.abs(poles)) & (poles.real < 0)]:
        kept = poles[(np.abs(poles - p) > 1e-9) & (np.abs(poles - np.conj(p)) > 1e-9)]
        if not kept.size:
            continue
        far = np.argsort(-np.minimum(np.abs(zeros - p), np.abs(zeros - np.conj(p))))
        led = zeros[far[: max(min(zeros.size - 2, kept.size - 1), 0)]]
        den, num = (np.atleast_1d(np.real(np.poly(roots))) for roots in (kept, led))
        if num[-1] == 0.0:
            continue
        start = _of(h, stage, den, num * level * den[-1] / num[-1])
        for share in (0.3, -0.2):
            theta = start.theta.copy()
            theta[list(stage.slots[number].index)] = (
                abs(p) * stage.pace / (2.0 * np.pi), max(-p.real / abs(p), 0.01), share,
            )  # fmt: skip
            made.append(Hypothesis(start.poles, start.zeros, (number,), theta))
    return made


def _bent(stage: Stage, first: Refit) -> list[Hypothesis]:
    """Plants of one pole with a cause that acts on the command, the gain by least squares: what a
    characteristic bends, a linear fit took for another gain, from which no refit finds back."""
    thetas, numbers = [], []
    for number in stage.allowed:
        slot = stage.slots[number]
        if type(slot.effect).command is AbstractEffect.command or slot.cause not in _STATIC:
            continue
        for probe in slot.effect.probes(stage.scales):
            for pace in (1.0, 4.0):
                theta = stage.off.copy()
                theta[0] = theta[POLES] = pace * abs(first.hypothesis.theta[0])
                theta[list(slot.index)] = probe
                thetas.append(theta)
                numbers.append(number)
    best: dict[int, tuple[float, np.ndarray]] = {}
    errors, gains = _scaled_errors(stage, np.stack(thetas))
    for number, theta, error, gain in zip(numbers, thetas, errors, gains, strict=True):
        if np.isfinite(error) and (number not in best or error < best[number][0]):
            scaled = theta.copy()
            scaled[POLES] *= gain
            best[number] = (error, scaled)
    return [Hypothesis(1, 0, (number,), theta) for number, (_, theta) in best.items()]


def _scaled_errors(stage: Stage, thetas: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Squared errors of responses with gain and level by least squares, and the gains."""
    seen = stage.y[stage.mask]
    errors, gains = [], []
    for row in stage.simulate(thetas)[:, stage.mask]:
        shape = np.stack([row, np.ones_like(row)], axis=1)
        found, *_ = np.linalg.lstsq(shape, seen, rcond=None)
        errors.append(float(np.sum((seen - shape @ found) ** 2)))
        gains.append(float(found[0]))
    return np.array(errors), np.array(gains)


def _strongest(stage: Stage, fits: Sequence[Refit], grid: dict) -> list[Refit]:
    """The small plants with a cause that gained most over the same plants without."""
    gained = []
    for f in fits:
        bare = grid.get(_order(f.hypothesis))
        if bare is not None and f.hypothesis.active and f.hypothesis.poles < POLES:
            gained.append((score(stage, f) - score(stage, bare), f))
    gained = [(g, f) for g, f in gained if g > _GROWS]
    picked: dict[tuple[int, ...], Refit] = {}
    for _, f in sorted(gained, key=lambda pair: -pair[0]):
        picked.setdefault(f.hypothesis.active, f)
    return list(picked.values())[:2]


def _grown(stage: Stage, fit: Refit) -> list[Refit]:
    """The same with more poles and zeros, for as long as they are worth their price."""
    found = []
    while True:
        starts = _promising(stage, list(nested(stage, fit.hypothesis)), 1)
        better = max(refit(stage, starts), key=lambda f: score(stage, f), default=fit)
        if score(stage, better) <= score(stage, fit):
            return found
        found.append(better)
        fit = better


def _of(h: Hypothesis, stage: Stage, den: np.ndarray, num: np.ndarray) -> Hypothesis:
    theta = h.theta.copy()
    theta[: 2 * POLES] = 0.0
    poles, zeros = len(den) - 1, len(num) - 1
    theta[:poles] = den[1:]
    theta[POLES + poles - 1 - zeros : POLES + poles] = num
    return Hypothesis(poles, zeros, h.active, theta)


def _promising(stage: Stage, starts: Sequence[Hypothesis], kept: int = 2) -> list[Hypothesis]:
    """The starts of each order whose responses come closest as they stand, gain left open."""
    if len(starts) <= kept:
        return list(starts)
    y = stage.simulate(np.stack([h.theta for h in starts]))[:, stage.mask]
    seen = stage.y[stage.mask]
    errors = np.sum((y - seen) ** 2, axis=1)
    picked: dict[tuple, list[int]] = {}
    for k in np.argsort(np.where(np.isfinite(errors), errors, np.inf)):
        own = picked.setdefault(_key(starts[k]), [])
        if len(own) < kept:
            own.append(int(k))
    return [starts[k] for own in picked.values() for k in own]


def _order(h: Hypothesis) -> tuple[int, int]:
    return h.poles, h.zeros


def _key(h: Hypothesis) -> tuple:
    return h.poles, h.zeros, frozenset(h.active)


def _best_of_each(fits: Sequence[Refit]) -> list[Refit]:
    best: dict[tuple, Refit] = {}
    for f in fits:
        key = _key(f.hypothesis)
        if math.isfinite(f.loglik) and (key not in best or f.loglik > best[key].loglik):
            best[key] = f
    return list(best.values())


def joined(h: Hypothesis, candidate: Candidate) -> Hypothesis:
    theta = candidate.theta.copy()
    theta[: LEAD + 1] = h.theta[: LEAD + 1]
    return Hypothesis(h.poles, h.zeros, tuple(sorted({*h.active, candidate.number})), theta)


def _smaller(stage: Stage, grid: dict[tuple[int, int], Refit], plain: Refit) -> list[Refit]:
    """The best of the smaller plants, which a cause may make enough."""
    coefficients = sum(_order(plain.hypothesis))
    small = [f for o, f in grid.items() if sum(o) < coefficients and o in _SMALL]
    return sorted(small, key=lambda f: -score(stage, f))[:_SMALLER]


def _cleared(stage: Stage, h: Hypothesis, keep: Iterable[int] = ()) -> np.ndarray:
    """The vector with all causes off but those to keep."""
    theta = stage.off.copy()
    theta[: LEAD + 1] = h.theta[: LEAD + 1]
    for number in keep:
        index = list(stage.slots[number].index)
        theta[index] = h.theta[index]
    return theta


def _without(stage: Stage, h: Hypothesis, number: int) -> Hypothesis:
    kept = tuple(k for k in h.active if k != number)
    return Hypothesis(h.poles, h.zeros, kept, _cleared(stage, h, kept))


def _eliminate(stage: Stage, now: Refit, seen: dict[tuple, Refit]) -> Refit:
    """Take causes out again that others have made needless."""
    while now.hypothesis.active:
        starts = [_without(stage, now.hypothesis, number) for number in now.hypothesis.active]
        known = [seen[_key(h)] for h in starts if _key(h) in seen]
        fits = _best_of_each([*refit(stage, starts), *known])
        best = max(fits, key=lambda f: score(stage, f))
        if score(stage, best) < score(stage, now):
            return now
        now = best
    return now


def _findings(stage: Stage, final: Refit) -> tuple[Finding, ...]:
    """Each cause of the final model with what it is worth there and what could stand in its
    place."""
    found = []
    for number in final.hypothesis.active:
        less = refit(stage, [_without(stage, final.hypothesis, number)])[0]
        gain = 2.0 * (final.loglik - less.loglik)
        screened = screen(stage, less, fine=stage.slots[number].cause in RAGGED)
        promised = next((c.gain for c in screened if c.number == number), 0.0)
        others = [c for c in screened if c.number != number and c.gain > 0.2 * gain][:6]
        starts = [joined(less.hypothesis, c) for c in others]
        own = stage.slots[number]
        rivals = []
        for f in _best_of_each(refit(stage, starts)):
            other = next(k for k in f.hypothesis.active if k not in less.hypothesis.active)
            slot = stage.slots[other]
            more = 2.0 * (len(slot.index) - len(own.index))
            if slot.cause != own.cause:
                rivals.append((other, 2.0 * (final.loglik - f.loglik) + more))
        rivals.sort(key=lambda pair: pair[1])
        found.append(Finding(number, gain, less, tuple(rivals), promised))
    return tuple(sorted(found, key=lambda f: -f.gain))
