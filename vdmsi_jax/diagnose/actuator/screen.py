"""The screen: which causes could explain what a hypothesis leaves, all of them in one batch.

Every cause is tried at finite values (saturation and limits of rates have no derivative at "off"),
what the hypothesis itself could absorb is projected out, and the colour of the noise is estimated
anew for each. The answer ranks candidates; only refits decide.
"""

from collections.abc import Iterable
from dataclasses import dataclass, replace
from itertools import product

import numpy as np
from jaxtyping import Float

from ..signals.colour import spectrum, whiten
from . import swing
from .hypothesis import Hypothesis, Refit, responses, sensitivities
from .lanes import LEADS
from .stage import MOST_LEAD, Stage
from .steps import likely_steps

_LARGEST = 3.0  # a probe may be scaled by so much when its size is estimated
_TOGETHER = 32  # directions that are judged at once
_IN_STEPS = 60.0  # gain by steps of a command, from which on the log's own rows are looked at
RAGGED = ("quantization", "regime_change")
"""Causes whose likelihood has many maxima."""


@dataclass(frozen=True, eq=False)
class Candidate:
    """A cause at the probe that explains most.

    Attributes:
        number: of the effect in its stage.
        gain: twice the log-likelihood that it is predicted to gain.
        theta: vector to start a refit from.
        swing: as in `Hypothesis`.
    """

    number: int
    gain: float
    theta: Float[np.ndarray, " P"]
    swing: Float[np.ndarray, "R 2"] | None = None

    def beside(self, h: Hypothesis) -> Hypothesis:
        """A hypothesis with this cause at its probe, in the plant of another and beside its
        causes."""
        theta = self.theta.copy()
        theta[: LEADS[0]] = h.theta[: LEADS[0]]
        active = tuple(sorted({*h.active, self.number}))
        return replace(h, active=active, theta=theta, swing=self.swing)


def screen(stage: Stage, at: Refit, fine: bool = True) -> list[Candidate]:
    """All causes that are not on yet, by what they are predicted to explain, best first. Another
    form of a cause that is on is none: each would be worth little beside the other; nor is one that
    `refines` others.

    Args:
        stage: the data.
        at: the hypothesis that is to be extended.
        fine: try those whose likelihood is ragged on a finer grid, too.
    """
    ground, steps = _Ground(stage, at), {}
    if fine and not at.hypothesis.active and stage.within is None and _may_round(stage):
        steps = {by: found for by, (found, _) in likely_steps(stage, at, ground.pull).items()}
    numbers, tried = [], []
    on = {(stage.slots[k].cause, stage.slots[k].where) for k in at.hypothesis.active}
    for number in stage.allowed:
        slot = stage.slots[number]
        if (slot.cause, slot.where) in on or slot.effect.refines:
            continue
        options = [(probe, at.hypothesis.swing) for probe in slot.effect.probes(stage.scales)]
        if slot.cause == "quantization":
            options += [
                ((s,), at.hypothesis.swing) for s in steps.get(getattr(slot.effect, "by", ""), ())
            ]
        if slot.cause == swing.CAUSE:
            e = np.where(stage.mask, stage.y - at.y, 0.0)
            white = whiten(e[None], at.colour[None])[0] * stage.mask
            lines = swing.peaks(stage, at.hypothesis.theta, at.hypothesis.active, e, white)
            options = [((f, 0.0, 0.0), own) for f, own in lines]
        known = (tuple(at.hypothesis.theta[list(LEADS)]),)
        pairs = _leads(at.hypothesis) if slot.forces else known
        for (probe, own), leads in product(options, pairs):
            theta = at.hypothesis.theta.copy()
            theta[list(slot.index)], theta[list(LEADS)] = probe, leads
            active = (*at.hypothesis.active, number)
            numbers.append(number)
            tried.append(replace(at.hypothesis, active=active, theta=theta, swing=own))
    if not tried:
        return []
    y = responses(stage, tried)
    gains = ground.explained(y - at.simulated)
    best: dict[int, Candidate] = {}
    loudest, loud = None, 0.0  # a colour takes most of a line, and less of its overtones
    for number, h, gain in zip(numbers, tried, gains, strict=True):
        here = Candidate(number, float(gain), h.theta, h.swing)
        if number not in best or gain > best[number].gain:
            best[number] = here
        if h.swing is not None and stage.slots[number].cause == swing.CAUSE:
            size = float(np.sum(h.swing**2))
            loudest, loud = (here, size) if size > loud else (loudest, loud)
    steps = [n for n in best if stage.slots[n].cause == "quantization"]
    less = sorted(steps, key=lambda n: -best[n].gain)[1:]  # forms that promise less stay coarse
    for n in [n for n in best if fine and stage.slots[n].cause in RAGGED and n not in less]:
        best[n] = _finer(stage, ground, best[n])
    found = list(best.values())
    if loudest is not None and loudest is not best[loudest.number]:
        found.append(loudest)
    return sorted(found, key=lambda c: -c.gain)


def leading(stage: Stage, candidates: Iterable[Candidate], causes: int) -> list[Candidate]:
    """The first candidates, until so many causes are among them: a cause of many forms must not
    crowd out others, nor take more than half as many places again."""
    picked, names = [], set()
    for candidate in candidates:
        name = stage.slots[candidate.number].cause
        if name in names and len(picked) - len(names) >= causes // 2:
            continue
        if name not in names and len(names) == causes:
            break
        picked.append(candidate)
        names.add(name)
    return picked


def _leads(h: Hypothesis) -> tuple[tuple[float, float], ...]:
    """Leads of a force to try: none, what makes up for all poles but the two slowest, which are
    those of the mass that it acts on, and both behind a controller that makes up for lasting
    forces."""
    known = tuple(h.theta[list(LEADS)])
    if h.poles < 2 or any(known):
        return (known,)
    poles = np.roots(h.den)
    fast = float(np.sum(np.real(-1.0 / poles[np.argsort(np.abs(poles))][2:])))
    fast = min(max(fast, 0.0), MOST_LEAD)
    washed = min(max(4.0 * h.den[-2] / h.den[-1], 0.0), MOST_LEAD)
    tried = ((0.0, 0.0), (washed, min(washed * fast, MOST_LEAD)))
    return tried if h.poles < 3 else (*tried, (fast, 0.0))


def acts_in_steps(stage: Stage, at: Refit) -> bool:
    """Whether the command is rounded before it acts on the plain plant, and the rows of the stage
    are means of the log's own, which cannot tell how."""
    if stage.within is None or not _may_round(stage):
        return False
    ground = _Ground(stage, at)
    found = likely_steps(stage, at, ground.pull).values()
    return any(bool(ground.explained(moved, fixed=True).max() > _IN_STEPS) for _, moved in found)


def _may_round(stage: Stage) -> bool:
    return any(stage.slots[number].cause == "quantization" for number in stage.allowed)


def _finer(stage: Stage, ground: "_Ground", found: Candidate) -> Candidate:
    """The same cause on a grid about its best step, or its best moment: the likelihood of these is
    ragged, and no refit finds its way far."""
    slot = stage.slots[found.number]
    i, moment = slot.index[0], slot.cause == "regime_change"
    clock = stage.scales.clock(getattr(slot.effect, "over", "run"))
    for width in (0.06, 0.006):
        thetas = np.repeat(found.theta[None], 32, axis=0)
        around = clock if moment else found.theta[i]
        thetas[:, i] += np.linspace(-width, width, 32) * around
        tried = [replace(ground.at.hypothesis, theta=theta) for theta in thetas]
        y = responses(stage, tried)
        gains = ground.explained(y - ground.at.simulated, fixed=not moment)
        k = int(np.argmax(gains))
        if gains[k] > found.gain:
            found = replace(found, gain=float(gains[k]), theta=thetas[k])
    return found


class _Ground:
    """What a hypothesis leaves and what it could absorb, to judge directions against."""

    def __init__(self, stage: Stage, at: Refit):
        self.stage, self.at = stage, at
        J = sensitivities(stage, [at.hypothesis], [at.simulated])[0]
        nuisance = absorbable(stage, at, J)
        e = np.where(stage.mask, stage.y - at.y, 0.0)
        self.Q, self.R = np.linalg.qr(self._white(nuisance).T)
        self.error = self._white(e[None])[0]
        self.absorbed = self.error @ self.Q
        self.spectra = np.concatenate([spectrum(e[None]), spectrum(nuisance)])
        self.flat = self.spectra.reshape(len(self.spectra), -1).view(float)
        self.variance = self._innovations(self.spectra[:1])[0]

    def explained(self, directions: Float[np.ndarray, "L R N"], fixed: bool = False) -> np.ndarray:
        """Gain of twice the log-likelihood by each direction, at its best size unless fixed."""
        parts = range(0, len(directions), _TOGETHER)
        return np.concatenate([self._part(directions[i : i + _TOGETHER], fixed) for i in parts])

    def pull(self, directions: Float[np.ndarray, "L R N"]) -> np.ndarray:
        """Square that each direction explains under the colour at hand, in units of the
        innovations, with the sign of its size."""
        white = self._white(np.where(self.stage.mask, directions, 0.0))
        shared = white @ self.Q
        energy = np.sum(white**2, axis=1) - np.sum(shared**2, axis=1)
        pull = white @ self.error - shared @ self.absorbed
        return np.sign(pull) * pull**2 / np.maximum(energy, 1e-300)

    def _part(self, directions: np.ndarray, fixed: bool) -> np.ndarray:
        directions = np.where(np.isfinite(directions) & self.stage.mask, directions, 0.0)
        white = self._white(directions)
        shared = white @ self.Q
        energy = np.sum(white**2, axis=1) - np.sum(shared**2, axis=1)
        pull = white @ self.error - shared @ self.absorbed
        size = np.clip(pull / np.maximum(energy, 1e-300), 0.0, _LARGEST)
        size = np.ones_like(size) if fixed else size
        wanted = self.absorbed[:, None] - shared.T * size
        shares = np.linalg.lstsq(self.R, wanted, rcond=1e-10)[0].T
        taken = np.concatenate([np.ones((len(size), 1)), -shares], axis=1)
        left = (taken @ self.flat).view(complex).reshape(len(size), *self.spectra.shape[1:])
        left -= size[:, None, None] * spectrum(directions)
        gain = self.stage.mask.sum() * np.log(self.variance / self._innovations(left))
        return np.where(energy > 1e-12 * float(self.error @ self.error), gain, 0.0)

    def _white(self, x: Float[np.ndarray, "L R N"]) -> Float[np.ndarray, "L S"]:
        return (whiten(x[None], self.at.colour[None])[0] * self.stage.mask).reshape(len(x), -1)

    def _innovations(self, spectra: np.ndarray) -> np.ndarray:
        """Sums of squares after each one's own whitening."""
        return np.maximum(self.stage.noise.innovations(spectra, self.at.colour.size), 1e-300)


def absorbable(stage: Stage, at: Refit, J: np.ndarray) -> Float[np.ndarray, "q R N"]:
    """What the hypothesis can absorb: its parameters and the states at its starts, scaled."""
    runs, n = stage.u.shape[0], at.states.shape[1]
    starts = np.zeros((runs, n, *stage.u.shape))
    for r in range(runs):
        starts[r, :, r] = at.states.T
    columns = np.concatenate([J, starts.reshape(-1, *stage.u.shape)])
    columns = np.where(stage.mask, columns, 0.0)
    size = np.sqrt(np.mean(columns**2, axis=(1, 2)))
    return columns[size > 0] / size[size > 0, None, None]
