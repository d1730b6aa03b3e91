"""The screen: which causes could explain what a hypothesis leaves, all of them in one batch.

Every cause is tried at finite values (saturation and limits of rates have no derivative at "off"), what
the hypothesis itself could absorb is projected out, and the colour of the noise is estimated anew for
each. The answer ranks candidates; only refits decide.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from .colour import autoregression, whiten
from .refit import Refit, sensitivities, usable
from .stage import Stage

_LARGEST = 3.0  # a probe may be scaled by so much when its size is estimated
_PEAKS = 3  # of the residual's spectrum that are tried as periodic disturbances


@dataclass(frozen=True, eq=False)
class Candidate:
    """A cause at the probe that explains most.

    Attributes:
        number: of the effect in its stage.
        gain: twice the log-likelihood that it is predicted to gain.
        theta: vector to start a refit from.
    """

    number: int
    gain: float
    theta: Float[np.ndarray, " P"]


def screen(stage: Stage, at: Refit) -> list[Candidate]:
    """All causes that are not on yet, by what they are predicted to explain, best first."""
    base = at.hypothesis.theta
    numbers, thetas = [], []
    for number in stage.allowed:
        if number in at.hypothesis.active:
            continue
        slot = stage.slots[number]
        probes = slot.effect.probes(stage.scales)
        if slot.cause == "periodic_disturbance":
            probes = _peaks(stage, at)
        for probe in probes:
            theta = base.copy()
            theta[list(slot.index)] = probe
            numbers.append(number)
            thetas.append(theta)
    y = stage.simulate(np.stack(thetas))
    J = sensitivities(stage, [at.hypothesis], [at.simulated])[0]
    gains, sizes = _explained(stage, at, y - at.simulated, J)
    best: dict[int, Candidate] = {}
    for number, theta, gain, size in zip(numbers, thetas, gains, sizes, strict=True):
        if number not in best or gain > best[number].gain:
            best[number] = Candidate(number, float(gain), theta)
    stepped = [n for n in best if stage.slots[n].cause == "quantization"]
    for n in stepped:
        best[n] = _finer(stage, at, best[n], J)
    return sorted(best.values(), key=lambda c: -c.gain)


def _finer(stage: Stage, at: Refit, found: Candidate, J: np.ndarray) -> Candidate:
    """The same cause on a grid about its best step: its likelihood is ragged, and no refit finds its
    way."""
    i = stage.slots[found.number].index[0]
    for width in (0.06, 0.006):
        thetas = np.repeat(found.theta[None], 32, axis=0)
        thetas[:, i] *= np.linspace(1.0 - width, 1.0 + width, 32)
        gains, _ = _explained(stage, at, stage.simulate(thetas) - at.simulated, J, fixed=True)
        k = int(np.argmax(gains))
        if gains[k] > found.gain:
            found = Candidate(found.number, float(gains[k]), thetas[k])
    return found


def _explained(
    stage: Stage, at: Refit, directions: np.ndarray, J: np.ndarray, fixed: bool = False
) -> tuple[np.ndarray, np.ndarray]:
    """Gain of twice the log-likelihood by each direction, and the size at which it is reached."""
    order = at.colour.size
    counted = usable(stage)
    e = np.where(stage.mask, stage.y - at.y, 0.0)
    directions = np.where(np.isfinite(directions) & stage.mask, directions, 0.0)
    nuisance = _nuisance(stage, at, J)
    colour = at.colour[None]
    eW = whiten(e[None], colour)[0][counted]
    dW = whiten(directions[None], colour)[0][:, counted]
    nW = whiten(nuisance[None], colour)[0][:, counted]
    Q, R = np.linalg.qr(nW.T)
    away = dW - (dW @ Q) @ Q.T
    rest = eW - Q @ (Q.T @ eW)
    energy = np.einsum("ls,ls->l", away, away)
    size = np.clip(away @ rest / np.maximum(energy, 1e-300), 0.0, _LARGEST)
    size = np.ones_like(size) if fixed else size
    shares = np.linalg.lstsq(R, Q.T @ (eW[:, None] - dW.T * size), rcond=1e-10)[0]
    left = e - size[:, None, None] * directions - np.tensordot(shares.T, nuisance, axes=1)
    left = np.where(stage.mask, left, 0.0)
    own = autoregression(left, stage.mask, order)
    variance = np.mean(whiten(left, own)[:, counted] ** 2, axis=1)
    n = counted.sum()
    gain = n * np.log(at.variance / np.maximum(variance, 1e-300))
    return np.where(energy > 1e-12 * np.mean(eW**2) * n, gain, 0.0), size


def _nuisance(stage: Stage, at: Refit, J: np.ndarray) -> Float[np.ndarray, "q R N"]:
    """What the hypothesis can absorb: its parameters and the states at its starts, scaled."""
    runs, n = stage.u.shape[0], at.states.shape[1]
    starts = np.zeros((runs, n, *stage.u.shape))
    for r in range(runs):
        starts[r, :, r] = at.states.T
    columns = np.concatenate([J, starts.reshape(-1, *stage.u.shape)])
    columns = np.where(stage.mask, columns, 0.0)
    size = np.sqrt(np.mean(columns**2, axis=(1, 2)))
    return columns[size > 0] / size[size > 0, None, None]


def _peaks(stage: Stage, at: Refit) -> list[tuple[float, float, float]]:
    """The strongest lines in the spectrum of the residual, all runs in phase."""
    e = np.where(stage.mask, stage.y - at.y, 0.0)
    white = whiten(e[None], at.colour[None])[0] * usable(stage)
    size = 1 << (2 * e.shape[1]).bit_length()
    power = np.abs(np.fft.rfft(white.sum(axis=0), size)) ** 2
    lines = np.fft.rfft(e.sum(axis=0), size) * 2.0 / max(stage.mask.sum(), 1)
    frequency = np.fft.rfftfreq(size, stage.dt)
    power[frequency < 1.5 / stage.scales.duration] = 0.0
    found = []
    for _ in range(_PEAKS):
        k = int(np.argmax(power))
        found.append((float(frequency[k]), float(-lines[k].imag), float(lines[k].real)))
        power[max(0, k - 8) : k + 9] = 0.0
    return found
