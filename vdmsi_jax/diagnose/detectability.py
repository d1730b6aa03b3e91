"""What logs could have shown: the smallest size of each cause, and which causes look alike."""

from dataclasses import replace

import numpy as np

from . import swing
from .colour import whiten
from .hypothesis import Refit, responses, sensitivities
from .manoeuvres import better
from .naming import told_unit
from .result import Detectable
from .screen import absorbable
from .stage import Stage

SURE = 32.0
"""Non-centrality at which a cause is found in about half of logs; 49 makes 95 %."""

_ALIKE = 0.95


def detectable(stage: Stage, at: Refit, units: tuple[str, str]) -> list[Detectable]:
    """Every cause that is not on: its first parameter at the smallest size that these logs would
    have shown, and the causes whose effects look alike."""
    numbers, thetas, held = [], [], at.hypothesis
    for number in stage.allowed:
        slot = stage.slots[number]
        if number in at.hypothesis.active:
            continue
        probes = slot.effect.probes(stage.scales)
        theta = at.hypothesis.theta.copy()
        theta[list(slot.index)] = probes[min(1, len(probes) - 1)]
        numbers.append(number)
        thetas.append(theta)
    y = responses(stage, [replace(held, theta=theta) for theta in thetas])
    J = sensitivities(stage, [at.hypothesis], [at.simulated])[0]
    directions = np.where(stage.mask, y - at.simulated, 0.0)
    white = whiten(directions[None], at.colour[None])[0][:, stage.mask]
    nuisance = whiten(absorbable(stage, at, J)[None], at.colour[None])[0][:, stage.mask]
    Q, _ = np.linalg.qr(nuisance.T)
    away = white - (white @ Q) @ Q.T
    energy = np.sum(away**2, axis=1)
    lengths = np.sqrt(np.maximum(energy, 1e-300))
    cosines = (away / lengths[:, None]) @ (away / lengths[:, None]).T
    whole = np.sqrt(np.maximum(np.sum(white**2, axis=1), 1e-300))
    best: dict[str, Detectable] = {}
    for k, number in enumerate(numbers):
        slot = stage.slots[number]
        main = max(range(len(slot.index)), key=lambda j: thetas[k][slot.index[j]] != 0)
        if slot.cause == "resonance":
            main = slot.names.index("share")
        if slot.cause == "regime_change":
            main = slot.names.index("gain")
        if slot.cause == swing.CAUSE:
            main = slot.names.index("sine")
        seen = energy[k] / max(at.variance, 1e-300)
        visible = lengths[k] > 1e-6 * whole[k] and seen > 1e-9
        size = abs(thetas[k][slot.index[main]])
        inverse = slot.known[main].shown == "inverse"
        smallest = size * np.sqrt(SURE / seen) if visible else np.inf
        if inverse:
            smallest = 1.0 / smallest if np.isfinite(smallest) and smallest > 0 else np.inf
        alike = [
            stage.slots[numbers[j]].cause
            for j in range(len(numbers))
            if visible
            and abs(cosines[k, j]) > _ALIKE
            and stage.slots[numbers[j]].cause != slot.cause
        ]
        names = tuple(dict.fromkeys(alike))
        hint = better(slot.cause, names) if names or not visible else ""
        unit = told_unit(slot, main, units)
        name = "amplitude" if slot.cause == swing.CAUSE else slot.names[main]
        new = Detectable(slot.cause, slot.where, name, float(smallest), unit, names, hint)
        old = best.get(slot.cause)
        easier = old is None or (
            new.smallest > old.smallest if inverse else new.smallest < old.smallest
        )
        if easier:
            best[slot.cause] = new
    return list(best.values())
