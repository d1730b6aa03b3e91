"""What logs could have shown: the smallest size of each cause, and which causes look alike."""

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from ...effects import AbstractEffect
from ..actuator import swing
from ..actuator.hypothesis import Refit, responses, sensitivities
from ..actuator.manoeuvres import better
from ..actuator.screen import absorbable
from ..actuator.stage import Stage
from ..answer.result import Detectable
from ..signals.colour import whiten
from .naming import told_unit

SURE = 32.0
"""Non-centrality at which a cause is found in about half of logs; 49 makes 95 %."""

ALIKE = 0.95
"""Cosine of two effects above which they look alike."""
_LADDER = (0.25, 0.35, 0.5, 0.6, 0.7, 0.8, 0.9, 1.0, 1.2, 1.5, 2.0)
_TOLD_BY = {"resonance": "share", "regime_change": "gain", swing.CAUSE: "sine"}


def detectable(stage: Stage, at: Refit, units: tuple[str, str]) -> list[Detectable]:
    """Every cause that is not on: its first parameter at the smallest size that these logs would
    have shown, and the causes whose effects look alike."""
    off = [
        number
        for number in stage.allowed
        if number not in at.hypothesis.active and stage.slots[number].effect.probes(stage.scales)
    ]
    rungs = [(number, rung) for number in off for rung in _rungs(stage, number)]
    thetas = [_at_size(stage, at, number, rung) for number, rung in rungs]
    y = responses(stage, [replace(at.hypothesis, theta=theta) for theta in thetas])
    J = sensitivities(stage, [at.hypothesis], [at.simulated])[0]
    directions = np.where(stage.mask, y - at.simulated, 0.0)
    white = whiten(directions[None], at.colour[None])[0][:, stage.mask]
    nuisance = whiten(absorbable(stage, at, J)[None], at.colour[None])[0][:, stage.mask]
    Q, _ = np.linalg.qr(nuisance.T)
    away = white - (white @ Q) @ Q.T
    energy, whole = np.sum(away**2, axis=1), np.sum(white**2, axis=1)
    seen = energy / max(at.variance, 1e-300)
    usual = [rungs.index((number, 1.0)) for number in off]
    unit = away[usual] / np.sqrt(np.maximum(energy[usual], 1e-300))[:, None]
    cosines = np.abs(unit @ unit.T)
    best: dict[str, Detectable] = {}
    for k, number in enumerate(off):
        slot, row = stage.slots[number], usual[k]
        main = _main(stage, number, thetas[row])
        visible = bool(energy[row] > 1e-12 * whole[row] and seen[row] > 1e-9)
        own = [i for i, (other, _) in enumerate(rungs) if other == number]
        size = abs(thetas[row][slot.index[main]])
        smallest = size * _smallest([rungs[i][1] for i in own], seen[own]) if visible else np.inf
        inverse = slot.known[main].shown == "inverse"
        if inverse:
            smallest = 1.0 / smallest if np.isfinite(smallest) and smallest > 0 else np.inf
        others = [stage.slots[off[j]].cause for j in np.flatnonzero(cosines[k] > ALIKE)]
        names, hint = open_about(slot.effect, others, visible)
        name = "amplitude" if slot.cause == swing.CAUSE else slot.names[main]
        told = told_unit(slot, main, units)
        new = Detectable(slot.cause, slot.where, name, float(smallest), told, names, hint)
        old = best.get(slot.cause)
        if old is None or not np.isfinite(old.smallest):
            best[slot.cause] = new
        elif smallest < old.smallest and not inverse:  # of limits the first form, a sharp one
            best[slot.cause] = new
    return list(best.values())


def open_about(
    effect: AbstractEffect, others: Sequence[str], seen: bool
) -> tuple[tuple[str, ...], str]:
    """Of the causes whose effects look like one the others, each once, if it is seen at
    all; and what to drive where there are any, or where it is not seen."""
    names = tuple(dict.fromkeys(o for o in others if seen and o != effect.cause))
    return names, better(effect, names) if names or not seen else ""


def _rungs(stage: Stage, number: int) -> tuple[float, ...]:
    """Sizes to try, of the usual probe. A limit does nothing until the signal comes to it, so that
    what one size shows does not tell what another would."""
    inverse = any(known.shown == "inverse" for known in stage.slots[number].known)
    return _LADDER if inverse else (1.0,)


def _at_size(stage: Stage, at: Refit, number: int, rung: float) -> np.ndarray:
    """Parameters with a cause at its usual probe, whose limits are tightened by a factor."""
    slot = stage.slots[number]
    probes = slot.effect.probes(stage.scales)
    usual = np.asarray(probes[min(1, len(probes) - 1)], dtype=float)
    limits = np.array([known.shown == "inverse" for known in slot.known])
    theta = at.hypothesis.theta.copy()
    theta[list(slot.index)] = np.where(limits, rung * usual, usual)
    return theta


def _main(stage: Stage, number: int, theta: np.ndarray) -> int:
    """The parameter of a cause that its size is told by."""
    slot = stage.slots[number]
    if slot.cause in _TOLD_BY:
        return slot.names.index(_TOLD_BY[slot.cause])
    return max(range(len(slot.index)), key=lambda j: theta[slot.index[j]] != 0)


def _smallest(rungs: Sequence[float], seen: np.ndarray) -> float:
    """The factor at which a non-centrality reaches `SURE`: between two rungs by their logarithms,
    beyond the last, and of a single one, as what grows in proportion."""
    above = np.flatnonzero(seen >= SURE)
    if len(rungs) == 1 or not len(above):
        return rungs[-1] * math.sqrt(SURE / max(seen[-1], 1e-300))
    k = int(above[0])
    if k == 0:
        return rungs[0]
    low, high = math.log(max(seen[k - 1], 1e-3 * SURE)), math.log(seen[k])
    part = (math.log(SURE) - low) / max(high - low, 1e-12)
    return rungs[k - 1] * (rungs[k] / rungs[k - 1]) ** min(max(part, 0.0), 1.0)
