"""Periodic disturbances: what swings along keeps its frequency and strength, but begins each run at
a phase of its own, which is told by that run as its start is."""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Bool, Float, Inexact

from .stage import Stage

CAUSE = "periodic_disturbance"
FEWEST = 3.0
"""Swings in the longest run, below which any slow error has one."""
_PEAKS = 3  # of a spectrum that are tried
_SWINGS = 5  # of a mode, in a run, from which on it may tell a disturbance
_NEAR = 8  # lines of a spectrum, within which two peaks are one


def number_of(stage: Stage, active: Sequence[int]) -> int | None:
    """The periodic disturbance among causes that are on."""
    return next((k for k in active if stage.slots[k].cause == CAUSE), None)


def goes_on(stage: Stage, poles: Inexact[np.ndarray, " n"]) -> Bool[np.ndarray, " n"]:
    """Which poles of a plant, in its unit of frequency, are of a mode that swings on through the
    runs: what it tells is a periodic disturbance, by the states at the starts."""
    turned = poles * stage.pace * stage.dt * stage.u.shape[1]
    return (np.abs(turned.imag) > 2.0 * np.pi * _SWINGS) & (np.abs(turned.real) < 1.0)


def drifts(stage: Stage, frequency: float) -> bool:
    """Whether a periodic disturbance of a frequency, Hz, hardly swings: it is a level of each run's
    own then, or a trend."""
    return frequency * stage.scales.duration < FEWEST


def columns(stage: Stage, frequency: float) -> Float[np.ndarray, "2 N"]:
    """Its sine and cosine since the first row."""
    angle = 2.0 * np.pi * frequency * stage.dt * np.arange(stage.u.shape[1])
    return np.stack([np.sin(angle), np.cos(angle)])


def peaks(
    stage: Stage,
    theta: Float[np.ndarray, " P"],
    active: Sequence[int],
    e: Float[np.ndarray, "R N"],
    white: Float[np.ndarray, "R N"],
) -> list[tuple[float, Float[np.ndarray, "R 2"]]]:
    """Frequencies, Hz, with each run's sine and cosine, that stand out in a residual or in its
    innovations: a colour that is estimated may take a strong line for noise that it predicts. Not
    those of a mode of the model, which swings by itself in a run that begins in motion."""
    size = 1 << (4 * e.shape[1]).bit_length()
    lines = np.fft.rfftfreq(size, stage.dt)
    found: dict[int, tuple[float, np.ndarray]] = {}
    for x in (white, e):
        power = np.sum(np.abs(np.fft.rfft(x, size)) ** 2, axis=0)
        power[lines < FEWEST / stage.scales.duration] = 0.0
        for frequency, damping in _modes(stage, theta, active):
            width = max(2.0 * damping * frequency, 2.0 / stage.scales.duration)
            power[np.abs(lines - frequency) < width] = 0.0
        for _ in range(_PEAKS):
            k = int(np.argmax(power))
            power[max(0, k - _NEAR) : k + _NEAR + 1] = 0.0
            if all(abs(k - other) > _NEAR for other in found):
                found[k] = (float(lines[k]), shares(stage, e, float(lines[k])))
    return list(found.values())


def _modes(
    stage: Stage, theta: Float[np.ndarray, " P"], active: Sequence[int]
) -> list[tuple[float, float]]:
    """Frequency, Hz, and damping of the resonances that are on."""
    own = [stage.slots[k] for k in active if stage.slots[k].cause == "resonance"]
    return [tuple(theta[list(slot.index[:2])]) for slot in own]


def shares(stage: Stage, e: Float[np.ndarray, "R N"], frequency: float) -> Float[np.ndarray, "R 2"]:
    """Sine and cosine of each run in what is left of it, by least squares."""
    wave, made = columns(stage, frequency), np.zeros((len(e), 2))
    for r, use in enumerate(stage.mask):
        if use.sum() > 2:
            made[r] = np.linalg.lstsq(wave[:, use].T, e[r, use], rcond=None)[0]
    return made


def strength(
    stage: Stage, swing: Float[np.ndarray, "R 2"], frequency: float
) -> tuple[float, float, int]:
    """Amplitude over all runs that have one, phase at the start of the first of them, rad, and
    which that is."""
    sizes = np.hypot(*swing.T)
    known = np.flatnonzero(sizes > 0)
    if not known.size:
        return 0.0, 0.0, 0
    first = int(known[0])
    since = float(np.asarray(stage.signals.t)[first, 0])
    phase = np.arctan2(swing[first, 1], swing[first, 0]) - 2.0 * np.pi * frequency * since
    amplitude = float(np.sqrt(np.mean(sizes[known] ** 2)))
    return amplitude, float((phase + np.pi) % (2.0 * np.pi) - np.pi), first
