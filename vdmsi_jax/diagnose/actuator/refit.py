"""Refitting hypotheses: plant and causes together, on the whitened simulation error, many at once.

Levenberg-Marquardt whose Jacobians are differences: the lanes of the one compiled simulation give a
difference for a third of the time of a forward-mode tangent, without a second program to compile,
and sticking and steps have useful differences where they have no derivative. Where many hypotheses
are fitted at once, a Jacobian is kept and corrected along the steps that are taken (Broyden, A
class of methods for solving nonlinear simultaneous equations, 1965) for as long as the steps it
proposes help; not with forces inside, whose sticking makes a response rough.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Protocol, TypeVar, runtime_checkable

import numpy as np

from ..signals.colour import filter_length, whiten
from ..signals.windows import inverse
from . import swing
from .hypothesis import (
    BEYOND,
    GROWTH,
    Hypothesis,
    Lane,
    Refit,
    free_states,
    growth,
    project,
    pulled,
    repaint,
    residual,
    responses,
    sensitivities,
    states_of,
    unlikely,
    white_states,
    whitened,
    with_states,
)
from .stage import Stage

PATIENT = 5
"""Rounds of a refit whose way is long."""
_SETTLED = 0.05  # gain of twice the log-likelihood by a step after which a lane rests
_HELPS = 2.0  # gain above which steps make slopes old, and old ones still help
_FAR = 10.0  # gain of a round, above which another follows
_KINDS = 3  # of causes, whose best starts are never given up
_FORMS = 3  # of the first of these, likewise
_FEW = 8  # lanes, for which differences cost next to nothing
_RESTS, _FITS_TO_REST = 0.1, 10  # gain of a fit more after which a model is at rest, and how many
_DAMPINGS = (0.1, 3.0, 100.0)


@runtime_checkable
class _Fitted(Protocol):
    """What has a log-likelihood."""

    @property
    def loglik(self) -> float: ...


F = TypeVar("F", bound=_Fitted)


@dataclass(frozen=True, eq=False)
class _Tried:
    """What came of a start.

    Attributes:
        value: its worth after the first round, where that was asked for.
        fit: None where it was given up.
    """

    value: float
    fit: Refit | None


def refit(
    stage: Stage,
    hypotheses: Sequence[Hypothesis],
    rounds: int = 3,
    steps: int = 3,
    further: int = 6,
    worth: Callable[[Hypothesis, float], float] | None = None,
    reach: float = np.inf,
) -> list[Refit]:
    """Fit all hypotheses, each under its own colour of noise. A stage remembers what came of each
    start: searches that go the same way again need not.

    Args:
        stage: the data.
        hypotheses: with starting values.
        rounds: how often the colour is estimated anew.
        steps: steps of Levenberg-Marquardt between.
        further: rounds more for those that the last one still took far.
        worth: of a hypothesis and its log-likelihood; with it, those that are more than `reach`
            below the best after the first round are given up, and missing in the answer, but for
            the best of each of the leading kinds of causes, and of forms of the first.
        reach: see `worth`.
    """
    starts = [_begun(stage, h) for h in hypotheses]
    keys = [(*h.key, rounds, steps, further, worth is None) for h in starts]
    tried: dict[tuple, _Tried] = stage.tried
    known = [tried[key] for key in keys if key in tried]
    most = max((t.value for t in known), default=-np.inf)
    new = {
        key: h
        for key, h in zip(keys, starts, strict=True)
        if key not in tried or (tried[key].fit is None and tried[key].value >= most - reach)
    }
    if new:
        lanes = _lanes(stage, list(new.values()))
        how = rounds, steps, further, worth, reach, most
        tried.update(zip(new, _fitted(stage, lanes, *how), strict=True))
    return [fit for key in keys if (fit := tried[key].fit) is not None]


def at_rest(stage: Stage, fit: Refit) -> Refit:
    """The same model at the end of its way, where it does not hang on the last digits of a
    computation: fitted among many, a model is left where slopes that are old helped no more."""
    return gone_on(fit, lambda f: refit(stage, [f.hypothesis])[0], _RESTS, _FITS_TO_REST)


def gone_on(fit: F, again: Callable[[F], F], least: float, most: int) -> F:
    """A fit gone on with, so many times at the most, until that gains less than `least` of twice
    the log-likelihood."""
    for _ in range(most):
        more = again(fit)
        gained = 2.0 * (more.loglik - fit.loglik)
        fit = more if gained > 0.0 else fit
        if gained < least:
            break
    return fit


def _lanes(stage: Stage, hypotheses: Sequence[Hypothesis]) -> list[Lane]:
    order = filter_length(stage.dt, int(stage.mask.sum()))
    start = responses(stage, hypotheses)
    lanes = [
        Lane(h, h.free(stage), y, states_of(stage, h), np.zeros(order))
        for h, y in zip(hypotheses, start, strict=True)
    ]
    for lane in lanes:
        repaint(stage, lane)
    return lanes


def _fitted(
    stage: Stage,
    lanes: list[Lane],
    rounds: int,
    steps: int,
    further: int,
    worth: Callable[[Hypothesis, float], float] | None,
    reach: float,
    most: float,
) -> list[_Tried]:
    """What comes of each lane, if others are worth so much already."""
    _recolour(stage, lanes)
    kept = under_way = lanes
    values = [-np.inf] * len(lanes)
    for k in range(rounds + further):
        gained = _round(stage, under_way, steps)
        if worth is not None and k == 0:
            values = [worth(f.hypothesis, f.loglik) for f in _finish(stage, lanes)]
            least, first = max(most, *values) - reach, _first_of_kind(stage, lanes, values)
            pairs = enumerate(zip(lanes, values, strict=True))
            kept = under_way = [x for i, (x, v) in pairs if v >= least or i in first]
        elif k + 1 >= rounds:
            under_way = [x for x, g in zip(under_way, gained, strict=True) if g > _FAR]
        if not under_way:
            break
    found = _finish(stage, kept) if kept else []
    fits = {id(x): f for x, f in zip(kept, found, strict=True)}
    return [_Tried(v, fits.get(id(x))) for x, v in zip(lanes, values, strict=True)]


def _first_of_kind(stage: Stage, lanes: Sequence[Lane], values: Sequence[float]) -> set[int]:
    """Numbers of the best lanes of the leading kinds of causes, and of the forms of the first: what
    comes slowly, as friction does, may be the best in the end."""
    best: dict[frozenset[str], dict[tuple[int, ...], int]] = {}
    for i in sorted(range(len(lanes)), key=lambda i: -values[i]):
        active = lanes[i].hypothesis.active
        causes = frozenset(stage.slots[k].cause for k in active)
        if not causes or not np.isfinite(values[i]):
            continue
        if causes not in best and len(best) == _KINDS:
            continue
        forms = best.setdefault(causes, {})
        if len(forms) < (_FORMS if causes == next(iter(best)) else 1):
            forms.setdefault(active, i)
    return {i for forms in best.values() for i in forms.values()}


def _round(stage: Stage, lanes: list[Lane], steps: int) -> list[float]:
    """Some steps of every lane and a new estimate of its colour; what the steps gained, in twice
    the log-likelihood."""
    before = []
    for lane in lanes:
        lane.cost = float(project(stage, lane, lane.white_error[None])[0, 0])
        lane.cost += unlikely(stage, lane, lane.hypothesis.theta)
        lane.settled = False
        before.append(lane.cost)
    for _ in range(steps):
        moving = [lane for lane in lanes if not lane.settled]
        if moving:
            _advance(stage, moving)
    gained = [
        float(stage.mask.sum() * np.log(cost / max(lane.cost, 1e-300)))
        for cost, lane in zip(before, lanes, strict=True)
    ]
    _recolour(stage, lanes)
    return gained


def _begun(stage: Stage, h: Hypothesis) -> Hypothesis:
    """With a swing of each run where there is a periodic disturbance, and without where none."""
    number = swing.number_of(stage, h.active)
    if number is None:
        return h if h.swing is None else replace(h, swing=None)
    theta, both = h.theta.copy(), list(stage.slots[number].index[1:])
    own = np.zeros((len(stage.u), 2)) if h.swing is None else h.swing
    theta[both], own = 0.0, own + h.theta[both]
    return replace(h, theta=theta, swing=own)


def _advance(stage: Stage, lanes: list[Lane]) -> None:
    """One step of Levenberg-Marquardt of every lane: differences where the old ones no longer
    serve, then three dampings tried."""
    low, high = stage.bounds
    stale = []
    for lane in lanes:
        rough = any(stage.slots[number].rough for number in lane.hypothesis.active)
        if lane.drift > 0.0 and (rough or len(lanes) <= _FEW):
            lane.slopes = None
        if lane.slopes is None:
            stale.append(lane)
    _differ(stage, stale)
    trials, scales = [], []
    for lane in lanes:
        assert lane.white_slopes is not None
        rows = np.concatenate([lane.white_error[None], lane.white_slopes])
        gram = project(stage, lane, rows)
        theta, pull = lane.hypothesis.theta, pulled(stage, lane)
        away = (theta - stage.off)[lane.free]
        normal, slope = gram[1:, 1:] + np.diag(pull), gram[1:, 0] - pull * away
        scale = np.sqrt(np.maximum(np.diag(normal), 1e-300))
        scales.append(scale)
        unit, rhs = normal / np.outer(scale, scale), slope / scale
        for factor in _DAMPINGS:
            step = np.linalg.solve(unit + lane.damping * factor * np.eye(len(unit)), rhs) / scale
            new = theta.copy()
            new[lane.free] = np.clip(theta[lane.free] + step, low[lane.free], high[lane.free])
            trials.append(replace(lane.hypothesis, theta=new))
    tried = len(_DAMPINGS)
    answers = responses(stage, trials).reshape(len(lanes), tried, *stage.y.shape)
    colours = np.stack([lane.colour for lane in lanes])
    errors = whiten(residual(stage, answers), colours) * stage.mask
    grown = np.where(growth(stage, trials) > GROWTH, np.inf, 0.0).reshape(len(lanes), tried)
    for i, lane in enumerate(lanes):
        own = trials[tried * i : tried * (i + 1)]
        costs = np.diag(project(stage, lane, errors[i]))
        costs = costs + [unlikely(stage, lane, h.theta) for h in own] + grown[i]
        best = int(np.argmin(np.where(np.isfinite(costs), costs, np.inf)))
        serves = lane.drift < _HELPS
        if costs[best] < lane.cost:
            gained = (lane.cost - costs[best]) / lane.cost * stage.mask.sum()
            theta = trials[tried * i + best].theta
            _move(stage, lane, scales[i], theta, answers[i, best], errors[i, best])
            lane.settled = bool(gained < _SETTLED) and serves
            lane.drift += gained
            lane.slopes = lane.slopes if serves or gained > _HELPS else None
            lane.damping = max(lane.damping * _DAMPINGS[best], 1e-9)
            lane.cost = float(costs[best])
        elif serves:
            lane.settled = lane.damping > 1e3
            lane.damping *= 300.0
        else:
            lane.slopes = None


def _differ(stage: Stage, lanes: list[Lane]) -> None:
    """Take the slopes of lanes anew."""
    slopes = sensitivities(stage, [lane.hypothesis for lane in lanes], [lane.y for lane in lanes])
    for lane, J in zip(lanes, slopes, strict=True):
        lane.slopes, lane.drift = np.where(stage.mask, J, 0.0), 0.0
        lane.white_slopes = whitened(stage, lane, lane.slopes)


def _move(
    stage: Stage,
    lane: Lane,
    scale: np.ndarray,
    theta: np.ndarray,
    y: np.ndarray,
    white: np.ndarray,
) -> None:
    """Move a lane to where a step led, and correct its slopes along the step by what came of it."""
    assert lane.slopes is not None and lane.white_slopes is not None
    step = (theta - lane.hypothesis.theta)[lane.free]
    weight = step * scale**2
    along = (weight / max(float(step @ weight), 1e-300))[:, None, None]
    surprise = np.where(stage.mask, y - lane.y, 0.0) - np.tensordot(step, lane.slopes, axes=1)
    lane.slopes = lane.slopes + along * surprise
    surprise = lane.white_error - white - np.tensordot(step, lane.white_slopes, axes=1)
    lane.white_slopes = lane.white_slopes + along * surprise
    lane.y = y
    lane.leave(white)
    lane.hypothesis = replace(lane.hypothesis, theta=theta)
    lane.states = states_of(stage, lane.hypothesis)
    lane.white_states = white_states(stage, lane)


def _recolour(stage: Stage, lanes: list[Lane]) -> None:
    """Estimate the colour of every lane's residual, free states taken out."""
    for lane in lanes:
        _swung(stage, lane)
    left = np.stack([residual(stage, with_states(stage, lane)) for lane in lanes])
    colours = stage.noise.colours(left, stage.mask, lanes[0].colour.size)
    for lane, colour in zip(lanes, colours, strict=True):
        lane.colour = colour
        repaint(stage, lane)


def _swung(stage: Stage, lane: Lane) -> None:
    """Give each run the swing that fits it best."""
    h, frequency = lane.hypothesis, lane.hypothesis.frequency(stage)
    if frequency is None or h.swing is None:
        return
    more = free_states(stage, lane)[:, -2:]
    lane.hypothesis = replace(h, swing=h.swing + more)
    lane.y = lane.y + more @ swing.columns(stage, frequency)
    lane.slopes = lane.white_slopes = None
    repaint(stage, lane)


def _finish(stage: Stage, lanes: list[Lane]) -> list[Refit]:
    found = []
    n = int(stage.mask.sum())
    _differ(stage, [lane for lane in lanes if lane.slopes is None])
    for lane in lanes:
        assert lane.white_slopes is not None
        y = with_states(stage, lane)
        innovations = whitened(stage, lane, residual(stage, y))
        variance = max(float(np.sum(innovations**2)) / n, 1e-300)
        left = residual(stage, y)
        plain = max(float(np.sum(left**2)) / n, 1e-300)
        slow = 0.5 * n / (BEYOND * lane.colour.size) * float(np.log(plain))
        away = lane.hypothesis.theta - stage.off
        loglik = -0.5 * (n * float(np.log(variance)) + float(stage.ridge @ away**2)) - slow
        normal = project(stage, lane, lane.white_slopes)
        covariance = inverse(normal + np.diag(pulled(stage, lane))) * variance
        found.append(
            Refit(
                lane.hypothesis, loglik, y, lane.y, lane.states, lane.colour, variance, covariance
            )
        )
    return found
