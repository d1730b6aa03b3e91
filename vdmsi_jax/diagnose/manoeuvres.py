"""What to drive next: manoeuvres that separate causes, each simulated before it is recommended."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from .colour import whiten
from .refit import Refit, responses, sensitivities
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


def separate(stage: Stage, final: Refit, number: int, rival: Refit) -> str:
    """The manoeuvre that separates two explanations best, with what it is predicted to reach.

    Both are simulated over the catalogue; their difference, less what the plant's own parameters
    could absorb, in units of the noise's innovations is the non-centrality.
    """
    runs, n = stage.u.shape
    t = stage.dt * np.arange(n)
    low, high = stage.scales.low, stage.scales.high
    best = (0.0, "")
    for start in range(0, len(CATALOGUE), runs):
        batch = CATALOGUE[start : start + runs]
        u = np.stack([m.command(t, low, high) for m in batch])
        u = np.concatenate([u, np.repeat(u[:1], runs - len(batch), axis=0)])
        drive = replace(
            stage, u=u, mask=np.ones_like(stage.mask), held_out=np.zeros_like(stage.mask)
        )
        y = responses(drive, [final.hypothesis, rival.hypothesis])
        J = sensitivities(drive, [rival.hypothesis], [y[1]])[0]
        both = np.concatenate([(y[0] - y[1])[None], J])
        white = whiten(both[None], final.colour[None])[0]
        for k, manoeuvre in enumerate(batch):
            rows = white[:, k]
            rows = rows / np.maximum(np.sqrt(np.mean(rows**2, axis=1, keepdims=True)), 1e-300)
            shares, *_ = np.linalg.lstsq(rows[1:].T, white[0, k], rcond=1e-8)
            left = white[0, k] - rows[1:].T @ shares
            apart = float(np.sum(left**2)) / max(final.variance, 1e-300)
            if apart > best[0]:
                best = (apart, manoeuvre.words)
    if best[0] < NEEDED:
        reached = f"reaches λ = {best[0]:.1f} of {NEEDED:.0f}"
        return f"none of the catalogue does: the best, {best[1]}, {reached}"
    return f"{best[1]} (predicted separation λ = {min(best[0], 1e6):.0f}; {NEEDED:.0f} suffice)"


def better(cause: str, alike: Sequence[str]) -> str:
    """What to drive to see a cause that a log does not excite or separate."""
    pairs = {
        frozenset({"sensor_lag", "sensor_delay"}): "a chirp of 0.1 to 6 Hz",
        frozenset({"geometry_scale", "understeer"}): "constant steering with a speed ramp",
        frozenset({"drag", "offset"}): "a ladder of speeds, or coasting down",
        frozenset({"gain_drift", "regime_change"}): "repeated steps over the whole run",
        frozenset({"coulomb_friction", "backlash"}): "a chirp of 0.1 to 6 Hz",
    }
    for other in alike:
        if frozenset({cause, other}) in pairs:
            return pairs[frozenset({cause, other})]
    if cause in ("transport_delay", "resonance", "rate_limit", "coulomb_friction", "backlash"):
        return "a chirp of 0.1 to 6 Hz"
    if cause in ("dead_zone", "gain_nonlinearity", "saturation", "gain_asymmetry", "quantization"):
        return "a sine whose amplitude grows over the whole range of both signs"
    return "random levels over the whole range"
