"""How much of an error each kind explains that has no cause in the library.

Generalised least squares with the noise's colour estimated anew under each kind: under one that is
true the noise is smaller and plainer than without. It is judged beside what every linear plant
would do with more freedom, and on data held out.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float

from ..signals.colour import autoregression, filter_length, whiten
from .families import EACH, MEMORY, RIDGE, Family

_ROUNDS = 4
_SETTLED = 1.0  # gain of twice the log-likelihood by a round, after which another is not worth it
_IDLE = 5.0  # gain by the first round, below which there is no second
SURE, HELD = 30.0, 12.0
"""Twice the gain in log-likelihood, beyond two for each weight, and on data held out, from which on
a kind of error is told."""

PLAIN = 100.0
"""The same, from which on an error is plainly some function of inputs and states, whatever data
held out say of that function: 30 clean responses had -65 to 11."""

_RUINED = 2.0  # times the innovations' variance on data held out, from which on they refute even
# that: right ones had up to 1.3, that clean one 2.9
_WORTH = 0.05  # share of the squared error, fitted and held out, below which it is not told
_START = 2.0  # s at the start of what is held out, where the states at the start are guessed
_BETTER = (1.2, 20.0)  # times a cause's gain, and beyond, from which a kind tells it better
_ELSE = (2.0, 0.3, 100.0)  # times what its own kind has, of a cause's gain, and at the least; and
_ELSE_SHARE = (0.3, 0.6)  # of the error, likewise, from which on a gain that remembers tells what
# a cause owes to none of its own kind: of 60 right names none had it
_OF_FORM = (0.5, 0.7)  # of the best statistic and its share, from which on a known kind is told


@dataclass(frozen=True, eq=False)
class Explained:
    """How much of an error a family explains.

    Attributes:
        family: the kind.
        statistic: twice the gain in log-likelihood, less two for each weight that is free.
        held_out: twice the gain on data held out; infinite where there is none, or none is asked.
        share: of the squared error, where it was fitted or held out, whichever is less; of the
            innovations', where that is more and it is any function at all.
        by_fit_alone: whether the fit is so plain that no data held out are asked.
    """

    family: Family
    statistic: float
    held_out: float
    share: float
    by_fit_alone: bool = False

    def sure(self, least: float = _WORTH) -> bool:
        """Whether it is sure, borne out on data held out, and more than a share."""
        return self.statistic > SURE and self.held_out > HELD and self.share > least


def weighed(
    e: Float[np.ndarray, "R N"],
    linear: Float[np.ndarray, "k R N"],
    families: Sequence[Family],
    mask: Bool[np.ndarray, "R N"],
    held_out: Bool[np.ndarray, "R N"],
    dt: float,
) -> list[Explained]:
    """What each family explains of an error, but of those that have too many weights to tell.

    Args:
        e: the error.
        linear: what is no news.
        families: the kinds.
        mask: samples that were fitted; `held_out`: those that were not.
        dt: sample period, s.
    """
    settled = held_out.copy()
    settled[:, : round(_START / dt)] = False
    uses = (mask, settled) if settled.sum() > 200 else (mask,)
    plain = _squares(e, linear, uses, dt)
    found = []
    for family in families:
        if mask.sum() < EACH * (len(family.features) + len(linear)):
            continue
        ridges = np.repeat([RIDGE, family.ridge], [len(linear), len(family.features)])
        freer = _squares(e, np.concatenate([linear, family.features]), uses, dt, ridges)
        news = [u.sum() * np.log(a / b) for u, a, b in zip(uses, plain[0], freer[0], strict=True)]
        fitted = float(news[0]) - 2.0 * (freer[2] - plain[2])
        # other data may be where no shape has learnt, and a little worse with it
        borne = all(b < _RUINED * a for a, b in zip(plain[0], freer[0], strict=True))
        alone = family.causes is None and fitted > PLAIN and borne
        asked = slice(1) if alone else slice(None)
        share = _share(plain[1][asked], freer[1][asked])
        if family.causes is None:  # of what is fast, where most of the error is slow
            share = max(share, _share(plain[0][asked], freer[0][asked]))
        held = float(min(news[asked][1:], default=np.inf))
        found.append(Explained(family, fitted, held, float(share), alone))
    return found


def explained(found: Sequence[Explained], causes: Sequence[str] = ()) -> Explained | None:
    """The family that explains most, where one does so surely and enough of it to matter: one of
    the kind of `causes` that are known rather than another that explains little more, since what is
    left of a cause is first of all what its form leaves."""
    sure = [f for f in found if f.sure()]
    best = max(sure, key=lambda f: f.statistic, default=None)
    if best is None:
        return None
    nearly, alike = _OF_FORM
    known = [
        f
        for f in sure
        if set(f.family.causes or ()) & set(causes)
        if f.statistic > nearly * best.statistic and f.share > alike * best.share
    ]
    return max(known, key=lambda f: f.statistic, default=best)


def better_than(
    cause: str, gain: float, found: Sequence[Explained], *, doubted: bool = False
) -> Explained | None:
    """The family that explains what a cause explains, and clearly better than it and than all of
    its own kind, where one of another kind does: the cause only stands in for it.

    Args:
        cause: its name.
        gain: twice the log-likelihood that it gains.
        found: what each family explains of the error of the model without it.
        doubted: whether a kind has told another cause beside it better; what it takes of the plain
            error counts no longer then.
    """
    times, beyond = _BETTER
    named = [f for f in found if f.family.causes is not None]
    own = [f for f in named if cause in (f.family.causes or ())]
    most = max([gain, *(f.statistic for f in own)])
    share = -np.inf if doubted else max((f.share for f in own), default=0.0)
    others = [f for f in named if f not in own and f.sure(share)]
    better = [f for f in others if f.statistic > times * most + beyond or _is_memory(f, gain, own)]
    return max(better, key=lambda f: f.statistic, default=None)


def _is_memory(kind: Explained, gain: float, own: Sequence[Explained]) -> bool:
    """Whether a gain that remembers tells an error so much better than the kinds of a cause do that
    the cause can only gain by what else it does. No other kind: what limits a command changes how
    fast a response moves as well."""
    if kind.family.words != MEMORY or not own:
        return False
    times, part, least = _ELSE
    more, much = _ELSE_SHARE
    told, held, share = (
        max(getattr(f, x) for f in own) for x in ("statistic", "held_out", "share")
    )
    clear = kind.statistic > max(times * told, part * gain, least) and kind.held_out > times * held
    return clear and kind.share > max(share + more, much)


def _squares(
    e, X, uses, dt, ridges: float | np.ndarray = RIDGE
) -> tuple[list[float], list[float], float]:
    """Mean squares of the innovations, and of the error, that the features leave in each part, and
    how many of their weights are free."""
    mask = uses[0]
    n, order = int(mask.sum()), filter_length(dt, int(mask.sum()))
    left, before, free = e, None, 0.0
    for turn in range(_ROUNDS + 1):
        colour = autoregression(np.where(mask, left, 0.0)[None], mask, order)
        white = whiten(left[None], colour)[0]
        now = _power(white[mask])
        gain = np.inf if before is None else n * np.log(before / now)
        before = now
        if turn == _ROUNDS or gain < (_IDLE if turn == 1 else _SETTLED):
            break
        Z = whiten(X[None], colour)[0][:, mask]
        sizes = np.sqrt(np.mean(Z**2, axis=1)) + 1e-300
        Z /= sizes[:, None]
        own = Z @ Z.T
        weights = np.linalg.inv(own + np.diag(n * np.broadcast_to(ridges, len(X))))
        target, free = whiten(e[None], colour)[0][mask], float(np.sum(weights * own))
        left = e - np.tensordot(weights @ (Z @ target) / sizes, X, 1)
    innovations, errors = ([_power(z[u]) for u in uses] for z in (white, left))
    return innovations, errors, free


def _share(before: Sequence[float], after: Sequence[float]) -> float:
    """The least share of a mean square that is taken, of several."""
    return min(1.0 - b / a for a, b in zip(before, after, strict=True))


def _power(z: np.ndarray) -> float:
    """Mean square, and never nothing: a log may be its model's own simulation."""
    return max(float(np.mean(z**2)), 1e-300)
