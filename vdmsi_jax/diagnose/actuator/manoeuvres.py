"""What to drive next: manoeuvres that separate causes, each simulated before it is recommended."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float

from ...effects import AbstractEffect
from ..signals.colour import whiten
from .hypothesis import Refit, responses, sensitivities
from .stage import Stage

NEEDED = 20.0
"""Non-centrality between two causes at which they are told apart in 95 % of drives."""


@dataclass(frozen=True)
class Manoeuvre:
    """A drive of the catalogue.

    Attributes:
        words: what to do.
        command: from time in s and the low and high end of the command to the command.
    """

    words: str
    command: Callable[[np.ndarray, float, float], np.ndarray]


def _chirp(t, low, high):
    rate = 5.5 / max(t[-1], 1e-9)
    return 0.5 * (low + high) + 0.35 * (high - low) * np.sin(2 * np.pi * (0.1 + 0.5 * rate * t) * t)


def _sweep(t, low, high):
    size = 0.5 * (high - low) * (0.05 + 0.95 * t / max(t[-1], 1e-9))
    return 0.5 * (low + high) + size * np.sin(2 * np.pi * 0.5 * t)


def _ladder(t, low, high):
    step = np.floor(t / max(t[-1] / 8, 1e-9))
    return low + (high - low) * np.minimum(step, 8 - step).clip(0, 4) / 4


def _steps(t, low, high):
    return np.where(np.floor(t / 3.0) % 2 == 0, low, high)


def _levels(t, low, high):
    rng = np.random.default_rng(5)
    levels = rng.uniform(low, high, int(t[-1] / 1.5) + 2)
    return levels[np.floor(t / 1.5).astype(int)]


def _coast(t, low, high):
    third = t[-1] / 3
    return np.where(t < third, high, np.where(t < 2 * third, 0.0, low))


CATALOGUE = (
    Manoeuvre("a chirp of 0.1 to 6 Hz for 60 s", _chirp),
    Manoeuvre(
        "a sine of 0.5 Hz whose amplitude grows from nothing to full range over 60 s", _sweep
    ),
    Manoeuvre("a ladder of five levels up and down", _ladder),
    Manoeuvre("repeated steps between two levels, every 3 s", _steps),
    Manoeuvre("random levels over the whole range, every 1.5 s", _levels),
    Manoeuvre("full command, then release and coast down, then the low end", _coast),
)
AGAIN = "the same drives once more"
"""A repeat of the logs at hand."""

_TURNING, _CHIRP = "constant steering with a ramp of speed", "a chirp of 0.1 to 6 Hz"
APART = {
    frozenset({"sensor_lag", "sensor_delay"}): _CHIRP,
    frozenset({"coulomb_friction", "backlash"}): _CHIRP,
    frozenset({"geometry_scale", "understeer"}): _TURNING,
    frozenset({"geometry_scale", "speed_scale"}): _TURNING,
    frozenset({"drag", "offset"}): "a ladder of speeds, or coasting down",
    frozenset({"gain_drift", "regime_change"}): "the same manoeuvre throughout",
    frozenset({"bank", "offset"}): "the same road in both directions",
}
"""What separates two causes whatever the vehicle, where neither is simulated."""


def separate(stage: Stage, final: Refit, rival: Refit) -> str:
    """The manoeuvre that separates two explanations best, with what it is predicted to reach.

    Both are simulated over the catalogue; their difference, less what the plant's own parameters
    could absorb, in units of the noise's innovations is the non-centrality. A repeat of the logs at
    hand doubles theirs, and tells the noise, where none of them is a repeat already.
    """
    runs, n = stage.u.shape
    t = stage.dt * np.arange(n)
    low, high = stage.scales.low, stage.scales.high
    found = []
    if stage.noise.std is None:
        found.append((AGAIN, 2.0 * float(np.sum(_apart(stage, final, rival)))))
    for start in range(0, len(CATALOGUE), runs):
        batch = CATALOGUE[start : start + runs]
        u = np.stack([m.command(t, low, high) for m in batch])
        u = np.concatenate([u, np.repeat(u[:1], runs - len(batch), axis=0)])
        drive = replace(
            stage, u=u, mask=np.ones_like(stage.mask), held_out=np.zeros_like(stage.mask)
        )
        each = _apart(drive, final, rival, together=False)
        found += [(m.words, float(apart)) for m, apart in zip(batch, each, strict=False)]
    words, apart = max(found, key=lambda pair: pair[1])
    if apart < NEEDED:
        reached = f"with λ = {apart:.1f} of the {NEEDED:.0f} that suffice"
        return f"{words}, which comes closest of the catalogue, {reached}, and may not do"
    return f"{words} (predicted separation λ = {min(apart, 1e6):.0f}; {NEEDED:.0f} suffice)"


def _apart(
    drive: Stage, final: Refit, rival: Refit, together: bool = True
) -> Float[np.ndarray, " runs"]:
    """Non-centrality between two explanations in each run of a drive, less what parameters could
    absorb that serve all runs, or that each run has to itself."""
    y = responses(drive, [final.hypothesis, rival.hypothesis])
    J = sensitivities(drive, [rival.hypothesis], [y[1]])[0]
    both = np.where(drive.mask, np.concatenate([(y[0] - y[1])[None], J]), 0.0)
    white = whiten(both[None], final.colour[None])[0] * drive.mask
    parts = [slice(None)] if together else [slice(k, k + 1) for k in range(len(drive.u))]
    left = np.zeros(white.shape[1:])
    for part in parts:
        rows = white[:, part].reshape(len(white), -1)
        sizes = np.maximum(np.sqrt(np.mean(rows[1:] ** 2, axis=1, keepdims=True)), 1e-300)
        columns = (rows[1:] / sizes).T
        shares, *_ = np.linalg.lstsq(columns, rows[0], rcond=1e-8)
        left[part] = (rows[0] - columns @ shares).reshape(left[part].shape)
    return np.sum(left**2, axis=1) / max(final.variance, 1e-300)


def better(effect: AbstractEffect, alike: Sequence[str]) -> str:
    """What to drive to see an effect that a log does not excite, or to tell it from the causes that
    look alike: from the first of them that something separates."""
    pairs = (frozenset({effect.cause, other}) for other in alike)
    return next((APART[pair] for pair in pairs if pair in APART), effect.shown_by)
