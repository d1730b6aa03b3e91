"""The search for causes in the body, the road and the sensors, as the actuators' search does it."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TypeVar

import numpy as np
from jaxtyping import Bool

from ...effects.bank import STEEPEST
from ..actuator.refit import gone_on
from ..search.found import FEW, MARGIN
from ..search.judge import Scored, confirmed
from ..search.price import CAUSE_COST, PARAMETER_COST
from ..search.search import MADE_UP, SURE, SWAPPED, SWAPS, WORSENED, clearly_less, lasts
from .body import BANK, CAUSES, INDEX, NUISANCE, Body
from .fit import (
    BodyFit,
    Start,
    bounds,
    fit_body,
    logliks_at,
    polished,
    refit_body,
    residual,
    robust,
)
from .screen import may_join, screen_body

K = TypeVar("K")

_CHANNELS_COST = 8.0
_MOST = 7
_RESTS, _FITS_TO_REST = 1.0, 6  # gain of a fit more after which the plain body rests, and how many
_REFITTED = 5  # candidates of a screen that are refitted
_BEHIND = ("sensor_delay", "sensor_lag")
_TIMES = ("delay", "time_constant", "length", "lag")
_MUCH = 0.3  # of the error, that data held out bear out
_STRANGE = 40.0  # what a bank costs whose pull no slope makes, in twice the log-likelihood
_CONSTANT = {k for k, cause in enumerate(CAUSES) if cause.cause in ("sensor_bias", "offset")}
_BRIEF = 0.1  # s, that noise of the yaw rate may last where its own colour takes too much
_LATE = (0.03, 0.07, 0.15, 0.32)  # s, that are tried


@dataclass(frozen=True, eq=False)
class BodyFinding:
    """A cause, what it is worth in twice the log-likelihood, the model without it, what was tried
    in its place with what it lacks, the first step of a fit from where the screen leads, and
    whether a parameter lies at the upper end of its range."""

    number: int
    gain: float
    less: BodyFit
    others: tuple[tuple[int, float], ...]
    promised: BodyFit | None
    ends: bool = False

    @property
    def rivals(self) -> tuple[int, ...]:
        """The causes that explain the data as well."""
        return tuple(k for k, lack in self.others if lack < MARGIN)


@dataclass(frozen=True, eq=False)
class BodyFailed:
    """A cause that was taken out again, since it fails on data held out.

    Attributes:
        finding: the cause.
        channel, share: where it took most of the squared error that was fitted, and how much.
        usual: whether it is a lag that every vehicle has, by tyres and body.
    """

    finding: BodyFinding
    channel: str
    share: float
    usual: bool


@dataclass(frozen=True, eq=False)
class BodySearch:
    """What was found in the body."""

    body: Body
    plain: BodyFit
    final: BodyFit
    findings: tuple[BodyFinding, ...]
    failed: tuple[BodyFailed, ...] = ()

    @property
    def all_late(self) -> bool:
        """Whether angle, yaw rate and pose are all late: then it is the speed that goes ahead of
        the vehicle, as that of wheels that spin does, and no sensor's delay."""
        causes = (CAUSES[f.number] for f in self.findings)
        return {"delta", "r", "pose"} <= {c.channel for c in causes if c.cause in _BEHIND}


def body_price(active: Sequence[int]) -> float:
    """As in the actuators' search, and more for the several channels that a cause may please."""
    each = CAUSE_COST + _CHANNELS_COST
    return float(sum(each + PARAMETER_COST * CAUSES[i].weight for i in active))


def search_body(body: Body) -> BodySearch:
    """Find the causes that the body's channels support, as the actuators' search does; where noise
    of its own colour leaves an error of the yaw rate that is large and lasts, those by noise that
    is brief, if data held out bear these out."""
    found = _searched(body)
    if not _lasts(found):
        return found
    other = _searched(replace(body, memory=_BRIEF))
    return other if _bears_out(found, other) else found


def _lasts(found: BodySearch) -> bool:
    """As in the actuators' search: where a steady error of the yaw rate is taken for noise, what
    its onset is like tells the cause, which no form has exactly."""
    body, final = found.body, found.final
    if "r" not in body.measured or body.held_out["r"].sum() <= FEW:
        return False
    mask = body.mask["r"]
    error = float(np.mean(residual(body, final, "r", mask)[mask] ** 2))
    return lasts(error, final.variance["r"], body.measured["r"][mask])


def _bears_out(found: BodySearch, other: BodySearch) -> bool:
    """Whether data held out bear another search out: the error of the yaw rate is clearly less, and
    all channels together are likelier."""
    if not other.findings or _confirmed(found.body, other.final, found.final) <= 0.0:
        return False
    scored, use, _ = chained(found.body, other.final, found.final, "r")
    return clearly_less(scored, use, found.body.dt)


def _searched(body: Body) -> BodySearch:
    """What one kind of noise lets the channels support."""
    bare = fit_body(body, [()])[0]  # what each cause gains is told against it, at rest
    plain = now = gone_on(bare, lambda f: polished(body, [f])[0], _RESTS, _FITS_TO_REST)
    passed: Sequence[BodyFit] = ()
    for k in range(SWAPS):
        now, passed = _extended(body, now, timed=k == 0)
        now, less = _eliminated(body, now)
        findings, other = _findings(body, now, less)
        if other is None or body_score(other) < body_score(now) + SWAPPED:
            break
        now = polished(body, [other])[0]
    else:
        findings = _findings(body, now, _without_each(body, now))[0]
    failed: list[BodyFailed] = []
    while True:
        more = _borne_out(body, now, passed)
        if more is not None:
            now, findings = more, _findings(body, more, _without_each(body, more))[0]
        worth = [_confirmed(body, now, f.less) for f in findings]
        if min(worth, default=np.inf) > 0.0:
            break
        worst = worth.index(min(worth))
        usual = _usual(body, now, findings[worst].number)
        where = _taken(body, now, findings[worst].less)
        failed.append(BodyFailed(findings[worst], *where, usual))
        body = body.without(findings[worst].number)
        now, _ = _eliminated(body, polished(body, [findings[worst].less])[0])
        now, passed = _extended(body, now, timed=False)
        now, less = _eliminated(body, now)
        findings, _ = _findings(body, now, less)
    return BodySearch(body, plain, robust(body, now), findings, tuple(failed))


def _usual(body: Body, fit: BodyFit, number: int) -> bool:
    """Whether a cause is a lag that every vehicle has, by tyres and body."""
    if CAUSES[number].names[0] not in _TIMES:
        return False
    late = float(fit.theta[INDEX[number][0]]) * _seconds(body, number)
    return CAUSES[number].cause == "yaw_inertia" or late < max(NUISANCE["lag"][1], body.dt)


def _seconds(body: Body, number: int) -> float:
    """The time that a unit of a cause is worth at the usual speed, where it acts by one."""
    speed = max(float(np.mean(np.abs(body.v))), 1e-9)
    return {"m": 1.0 / speed, "s^2/m": speed}.get(CAUSES[number].units[0], 1.0)


def chained(
    body: Body, final: BodyFit, less: BodyFit, channel: str
) -> tuple[Scored, Bool[np.ndarray, "R N"], bool]:
    """A channel with and without a cause, what the chain rule passes on taken out; the samples that
    judge, and whether they are held out."""
    use, held = judges_of(body, channel)
    return _scored(body, final, less, channel, use), use, held


def judges_of(body: Body, channel: str) -> tuple[Bool[np.ndarray, "R N"], bool]:
    """The samples of a channel that judge, and whether they are held out: where none are, those of
    the fit."""
    held = bool(body.held_out[channel].sum() > FEW)
    return (body.held_out if held else body.mask)[channel], held


def _scored(
    body: Body, final: BodyFit, less: BodyFit, channel: str, use: Bool[np.ndarray, "R N"]
) -> Scored:
    y = body.measured[channel]
    left = [residual(body, f, channel, use) for f in (less, final)]
    if _CONSTANT & set(less.active) & set(final.active):  # data held out may have another one
        many = np.maximum(use.sum(axis=1, keepdims=True), 1)
        left = [np.where(use, e - e.sum(axis=1, keepdims=True) / many, 0.0) for e in left]
    before, after = (y - e for e in left)
    return Scored(channel, y, before, after, final.colour[channel])


def _confirmed(body: Body, final: BodyFit, less: BodyFit) -> float:
    """Twice the log-likelihood that a cause gains on data held out, in all channels, or as much
    less than nothing where the plain error of one gets clearly worse and that of none better;
    infinite where none is held out."""
    every = [chained(body, final, less, c) for c in body.measured]
    worth = [confirmed(scored, use, body.dt)[0] for scored, use, held in every if held]
    taken = [scored.taken(use) for scored, use, held in every if held]
    if not worth:
        return np.inf
    worse = min(taken) < -WORSENED and max(taken) < MADE_UP
    return -abs(sum(worth)) if worse else sum(worth)


def _taken(body: Body, final: BodyFit, less: BodyFit) -> tuple[str, float]:
    """The channel in which a cause takes the largest share of the squared error that was fitted,
    and that share."""
    shares = {c: _scored(body, final, less, c, m).taken(m) for c, m in body.mask.items()}
    return max(shares.items(), key=lambda pair: pair[1])


def body_score(fit: BodyFit) -> float:
    """Twice the log-likelihood less the price, and less what a bank costs that pulls more than its
    slope can: wheels that stand askew are as good where the paths are not exact."""
    leans = BANK in fit.active
    slope, pull = fit.theta[list(INDEX[BANK])]
    strange = _STRANGE if leans and abs(pull) > STEEPEST * abs(slope) else 0.0
    return 2.0 * fit.loglik - body_price(fit.active) - strange


def _borne_out(body: Body, now: BodyFit, passed: Sequence[BodyFit]) -> BodyFit | None:
    """The best of fits with a cause more that are not worth its price, and yet take much of the
    error in a channel, which lasts on data held out: of what is constant, an estimated colour takes
    most of the evidence, so that constants are always among them where the mean is much of an
    error. The best takes most of the errors of all channels."""

    def lasts(f: BodyFit, channel: str) -> bool:
        scored, use, held = chained(body, f, now, channel)
        parts = scored.parts(use, body.dt)
        sure = parts.mean() > SURE * parts.std(ddof=1) / np.sqrt(parts.size)
        worth = confirmed(scored, use, body.dt)[0]
        masks = (body.mask[channel], use)
        took = min(_scored(body, f, now, channel, mask).taken(mask) for mask in masks)
        return held and bool(sure) and worth > CAUSE_COST and took > _MUCH

    def takes(f: BodyFit) -> float:
        left = [1.0 - _scored(body, f, now, c, m).taken(m) for c, m in body.mask.items()]
        return -float(np.sum(np.log(np.maximum(left, 1e-300))))

    every = [*passed, *_constants(body, now, passed)]
    more = [f for f in every if set(now.active) < set(f.active) and f.loglik > now.loglik]
    fits = [f for f in more if any(lasts(f, channel) for channel in body.measured)]
    return max(fits, key=takes, default=None)


def _constants(body: Body, now: BodyFit, passed: Sequence[BodyFit]) -> list[BodyFit]:
    """Fits with a constant more that were not tried, where the mean is much of an error."""
    errors = [residual(body, now, c, m)[m] for c, m in body.mask.items()]
    if all(np.mean(e) ** 2 < _MUCH * np.mean(e**2) for e in errors):
        return []
    known = {frozenset(f.active) for f in passed}
    starts = [_with(now, k, theta) for _, k, theta in screen_body(body, now) if k in _CONSTANT]
    return refit_body(body, [s for s in starts if frozenset(s[0]) not in known])


def _extended(body: Body, now: BodyFit, timed: bool) -> tuple[BodyFit, Sequence[BodyFit]]:
    """Causes added for as long as they are worth their price, and the fits with one more, which are
    not. If `timed`, those that act by a time are tried at several, at first and before it ends: a
    slope tells of a time only where it is small."""
    fits: Sequence[BodyFit] = ()
    while len(now.active) < _MOST:
        promising = [s for s in screen_body(body, now) if s[0] > 8.0][:_REFITTED]
        fits = refit_body(body, [_with(now, k, theta) for _, k, theta in promising])
        short = [  # of its promise, and so not there yet: the colour was another's
            f
            for f, (gain, _, _) in zip(fits, promising, strict=True)
            if 2.0 * (f.loglik - now.loglik) < gain
        ]
        there = dict(zip(short, polished(body, short), strict=True))
        fits = [there.get(f, f) for f in fits]
        best = max(fits, key=body_score, default=now)
        if timed and (not now.active or body_score(best) <= body_score(now)):
            best = max([best, *refit_body(body, _timed(body, now))], key=body_score)
        if not body_score(best) > body_score(now):
            break
        now = polished(body, [best])[0]
    return now, fits


def _with(fit: BodyFit, number: int, theta: np.ndarray) -> Start:
    """The start of a fit with one more cause."""
    return tuple(sorted({*fit.active, number})), theta


def _timed(body: Body, now: BodyFit) -> list[Start]:
    """Each cause that acts by a time, or by what is one at the usual speed, at the best of several
    where that is better than without."""
    causes = [k for k in body.allowed if may_join(k, now) and CAUSES[k].names[0] in _TIMES]
    if not causes:
        return []
    thetas = np.repeat(now.theta[None], len(causes) * len(_LATE), axis=0)
    for i, k in enumerate(causes):
        own = slice(i * len(_LATE), (i + 1) * len(_LATE))
        thetas[own, INDEX[k][0]] = np.array(_LATE) / _seconds(body, k)
    logliks = logliks_at(body, now, thetas).reshape(len(causes), len(_LATE))
    best = np.argmax(logliks, axis=1)
    return [
        _with(now, k, thetas[i * len(_LATE) + best[i]])
        for i, k in enumerate(causes)
        if logliks[i, best[i]] > now.loglik
    ]


def _without_each(body: Body, now: BodyFit) -> list[BodyFit]:
    """The fits without one of the causes each."""
    return fit_body(body, [tuple(k for k in now.active if k != i) for i in now.active], now)


def _eliminated(body: Body, now: BodyFit) -> tuple[BodyFit, list[BodyFit]]:
    """Causes taken out that others have made needless; and the fits without one more of them."""
    while True:
        less = _without_each(body, now)
        best = max(less, key=body_score, default=None)
        if best is None or body_score(best) < body_score(now):
            return now, less
        now = best


def _findings(
    body: Body, now: BodyFit, less: Sequence[BodyFit]
) -> tuple[tuple[BodyFinding, ...], BodyFit | None]:
    """Each cause with what it is worth and what could stand in its place, from the fits with each
    left out; and the best fit with another in the place of one."""
    probed, close = [], []  # by number of the cause, with where a fit begins
    for i, without in zip(now.active, less, strict=True):
        gain = 2.0 * (now.loglik - without.loglik)
        screened = [(s[0], s[1], _with(without, *s[1:])) for s in screen_body(body, without)]
        probed += [(i, start) for _, k, start in screened if k == i]
        likely = [(i, k, start) for g, k, start in screened if k != i and g > 0.3 * gain]
        close += likely[:_REFITTED]
    promised = dict(_refitted(body, probed, steps=1))
    tried = _refitted(body, [((i, k), start) for i, k, start in close])
    found, (_, highest) = [], bounds(body)
    for i, without in zip(now.active, less, strict=True):
        others = [
            (k, 2.0 * (now.loglik - f.loglik) + 2.0 * (CAUSES[k].weight - CAUSES[i].weight))
            for (place, k), f in tried
            if place == i
        ]
        gain = 2.0 * (now.loglik - without.loglik)
        ranked = tuple(sorted(others, key=lambda o: o[1]))
        ends = bool(np.any(now.theta[list(INDEX[i])] >= highest[list(INDEX[i])]))
        found.append(BodyFinding(i, gain, without, ranked, promised.get(i), ends))
    best = max((f for _, f in tried), key=body_score, default=None)
    return tuple(sorted(found, key=lambda f: -f.gain)), best


def _refitted(body: Body, starts: Sequence[tuple[K, Start]], **how: int) -> list[tuple[K, BodyFit]]:
    """The fits from starts, each with what the start is told by."""
    fits = refit_body(body, [start for _, start in starts], **how)
    return [(key, fit) for (key, _), fit in zip(starts, fits, strict=True)]


def at_fixed(found: BodySearch, number: int, value: float) -> float:
    """What a cause at a given value lacks, in twice the log-likelihood, against the final fit."""
    theta = found.final.theta.copy()
    theta[INDEX[number][0]] = value
    return 2.0 * (found.final.loglik - float(logliks_at(found.body, found.final, theta[None])[0]))
