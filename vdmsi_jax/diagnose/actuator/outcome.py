"""What a refit is worth beside another, over all runs, and how sure its parameters are."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from jaxtyping import Float

from ..signals.colour import whiten
from ..signals.windows import block_sums, inverse, widening
from .hypothesis import (
    BEYOND,
    FREE_STATE,
    Hypothesis,
    Lane,
    Refit,
    project,
    pulled,
    repaint,
    residual,
    responses,
    sensitivities,
    whitened,
    with_states,
)
from .stage import Stage

_BAI = 11.03 / 1.96
"""From what a row moves the likelihood to standard errors of a jump's moment: the interval of 95 %
reaches to 11.03 times its inverse."""


def completed(stage: Stage, fits: Sequence[Refit]) -> list[Refit]:
    """Fits to the runs of a stage in which something counts, with the responses of all its runs,
    and the covariances from differences at the optimum."""
    used = np.asarray(stage.mask.any(axis=1))
    fits = [replace(f, hypothesis=_over(f.hypothesis, used)) for f in fits]
    simulated = responses(stage, [f.hypothesis for f in fits])
    slopes = sensitivities(stage, [f.hypothesis for f in fits], list(simulated))
    found = []
    for f, y, J in zip(fits, simulated, slopes, strict=True):
        free = f.hypothesis.free(stage)
        lane = Lane(f.hypothesis, free, y, f.states, f.colour)
        repaint(stage, lane)
        white = whitened(stage, lane, np.where(stage.mask, J, 0.0))
        normal = project(stage, lane, white) + np.diag(pulled(stage, lane))
        covariance = inverse(_as_jumps(stage, lane, normal)) * f.variance
        whole = y.copy()
        whole[used] = f.y
        own = f.hypothesis.swing
        for r in np.flatnonzero(~used):  # a start is no part of a model: it is told by its own run
            states = _begun(stage, lane, y[r], int(r))
            whole[r] = y[r] + lane.states @ states
            if own is not None:
                own[r] = states[-2:]
                y[r] += lane.states[:, -2:] @ states[-2:]
        covariance = _widened(stage, lane, white, covariance)
        covariance = _jumping(stage, lane, covariance, f.variance)
        found.append(replace(f, y=whole, simulated=y, covariance=covariance))
    return found


def _over(h: Hypothesis, used: np.ndarray) -> Hypothesis:
    """A hypothesis about the runs that were fitted, over all runs."""
    if h.swing is None:
        return h
    swing = np.zeros((len(used), 2))
    swing[used] = h.swing
    return replace(h, swing=swing)


def _widened(
    stage: Stage, lane: Lane, slopes: Float[np.ndarray, "p R N"],
    covariance: Float[np.ndarray, "p p"],
) -> Float[np.ndarray, "p p"]:  # fmt: skip
    """A covariance with what blocks of the data tell of the form."""
    white = whitened(stage, lane, residual(stage, with_states(stage, lane)))
    blocks, p = int(np.clip(stage.mask.sum() // (BEYOND * lane.colour.size), 1, 200)), len(slopes)
    variance = max(float(np.sum(white**2)) / stage.mask.sum(), 1e-300)
    scores = block_sums((slopes * white)[:, stage.mask], blocks) / variance
    factors = widening(covariance, scores * np.sqrt(blocks / max(blocks - p, 1)))
    return covariance * np.outer(factors, factors)


def _as_jumps(
    stage: Stage, lane: Lane, normal: Float[np.ndarray, "p p"]
) -> Float[np.ndarray, "p p"]:
    """Normal equations in which what changes within a row has no duration: one row cannot tell that
    from the moment."""
    normal = normal.copy()
    for slot in (stage.slots[number] for number in lane.hypothesis.active):
        if slot.cause != "regime_change":
            continue
        ramp = slot.index[slot.names.index("ramp")]
        if lane.hypothesis.theta[ramp] < stage.dt:
            at = list(lane.free).index(ramp)
            own = normal[at, at]
            normal[at], normal[:, at] = 0.0, 0.0
            normal[at, at] = own
    return normal


def _jumping(
    stage: Stage, lane: Lane, covariance: Float[np.ndarray, "p p"],
    variance: float,
) -> Float[np.ndarray, "p p"]:  # fmt: skip
    """A covariance with the moment of a jump as wide as such a moment is known: away from it, the
    likelihood falls as the distance, and not as its square.

    Source: Bai, Estimation of a change point in multiple regression models (1997), proposition 2.
    """
    factors = np.ones(len(covariance))
    for slot in (stage.slots[number] for number in lane.hypothesis.active):
        if slot.cause != "regime_change":
            continue
        theta, at = lane.hypothesis.theta.copy(), list(lane.free).index(slot.index[0])
        theta[slot.index[0]] += stage.dt
        moved = responses(stage, [replace(lane.hypothesis, theta=theta)])[0] - lane.y
        white = whitened(stage, lane, np.where(stage.mask, moved, 0.0))
        a_row = float(project(stage, lane, white[None])[0, 0]) / variance
        std = _BAI * stage.dt / max(a_row, 1e-300)
        factors[at] = max(std / max(float(np.sqrt(covariance[at, at])), 1e-300), 1.0)
    return covariance * np.outer(factors, factors)


def _begun(stage: Stage, lane: Lane, y: np.ndarray, run: int) -> np.ndarray:
    """The states at the start of a run that no fit has seen that fit best."""
    use = stage.held_out[run]
    e = whiten(np.where(use, stage.y[run] - y, 0.0)[None, None], lane.colour[None])[0, 0]
    rows = np.where(np.maximum.accumulate(use), lane.states.T, 0.0)
    f = whiten(rows[None], lane.colour[None])[0] * use
    prior = float(np.mean(e[use] ** 2)) / (FREE_STATE * stage.scales.response) ** 2
    return np.linalg.solve(f @ f.T + prior * np.eye(len(f)), f @ e)


def steadiness(stage: Stage, less: Refit, more: Refit) -> float:
    """By how many standard errors, over blocks, one fit is likelier than another. What a wrong form
    gains it gains in a moment or two, and the likelihood alone does not ask where."""
    parts = []
    for f in (less, more):
        white = whiten(residual(stage, f.y)[None], f.colour[None])[0]
        left = residual(stage, f.y)[stage.mask]
        plain = max(float(np.mean(left**2)), 1e-300)
        slow = (np.log(plain) + left**2 / plain) / (BEYOND * f.colour.size)
        parts.append(-0.5 * (np.log(f.variance) + white[stage.mask] ** 2 / f.variance + slow))
    gained = parts[1] - parts[0]
    blocks = int(np.clip(gained.size // (BEYOND * less.colour.size), 4, 60))
    sums = block_sums(gained, blocks)
    return float(sums.sum() / max(np.sqrt(blocks) * sums.std(ddof=1), 1e-300))
