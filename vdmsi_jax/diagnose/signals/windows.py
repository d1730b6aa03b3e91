"""Means and sums over stretches of time, and what they tell of how sure parameters are."""

import numpy as np
from jaxtyping import Float

BLOCK = 5.0
"""Length of a stretch over which errors of a vehicle count as independent, s."""

_SAMPLES = 10  # of a stretch, at the least, where samples are seconds apart

SLOW = 1.0
"""Length of the mean that is the slow part of an error, s."""


def moving_mean(
    x: Float[np.ndarray, "... N"], seconds: float, dt: float
) -> Float[np.ndarray, "... N"]:
    """Centred mean over some seconds, the ends repeated."""
    half = max(1, round(0.5 * seconds / dt))
    before, after = (np.repeat(x[..., at, None], half, axis=-1) for at in (0, -1))
    total = np.cumsum(np.concatenate([np.zeros_like(x[..., :1]), before, x, after], -1), axis=-1)
    return (total[..., 2 * half + 1 :] - total[..., : -2 * half - 1]) / (2 * half + 1)


def slow_part(x: Float[np.ndarray, "... N"], dt: float) -> Float[np.ndarray, "... N"]:
    """Centred mean over `SLOW` seconds, or more where samples are so far apart that a single one
    would be much of it."""
    return moving_mean(x, max(SLOW, _SAMPLES * dt), dt)


def history(x: Float[np.ndarray, "R N"], seconds: float, dt: float) -> Float[np.ndarray, "R N"]:
    """Exponential mean of the past, over a time constant in s."""
    n = x.shape[1]
    size = 1 << (2 * n).bit_length()
    weights = np.exp(-dt / seconds * np.arange(n))
    summed = np.fft.irfft(np.fft.rfft(x, size) * np.fft.rfft(weights, size), size)[:, :n]
    return summed / np.cumsum(weights)


def blocks_in(samples: int, dt: float, most: int | None = None, memory: float = BLOCK) -> int:
    """How many stretches over which errors count as independent so many samples are, two at the
    least, and `most`; none is shorter than what makes the errors remembers, s."""
    blocks = min(int(samples * dt / max(memory, BLOCK)), samples // _SAMPLES)
    return max(2, blocks if most is None else min(blocks, most))


def block_sums(rows: Float[np.ndarray, "... n"], blocks: int) -> Float[np.ndarray, "... blocks"]:
    """Sums over equal blocks of the last axis."""
    n = rows.shape[-1]
    starts = -(-np.arange(blocks) * n // blocks)  # where `k * blocks // n` first reaches each
    return np.add.reduceat(rows, starts, axis=-1)


def thinned(x: np.ndarray, every: int) -> np.ndarray:
    """Means over so many rows of the last axis, of a mask whether all are true; what is left over
    at the end is left out."""
    whole = x.shape[-1] // every * every
    blocks = x[..., :whole].reshape(*x.shape[:-1], -1, every)
    return np.all(blocks, axis=-1) if x.dtype == bool else np.mean(blocks, axis=-1)


def widening(
    covariance: Float[np.ndarray, "p p"], scores: Float[np.ndarray, "p blocks"]
) -> Float[np.ndarray, " p"]:
    """Factors, one or more, by which standard deviations are too small where the scores of blocks
    disagree by more than noise allows, as they do where a form is not quite right; ones where there
    are too few blocks to tell.

    Source: White, Maximum likelihood estimation of misspecified models (1982), by blocks.
    """
    if scores.shape[1] < 3 * len(scores):
        return np.ones(len(scores))
    spread = np.diag(covariance @ (scores @ scores.T) @ covariance)
    return np.sqrt(np.maximum(spread / np.maximum(np.diag(covariance), 1e-300), 1.0))


def inverse(normal: np.ndarray) -> np.ndarray:
    """Inverse of the normal equations; a parameter without effect gets a huge variance."""
    own = np.diag(normal)
    scale = np.sqrt(np.maximum(own, 1e-30 * max(float(own.max(initial=0.0)), 1e-100)))
    unit = normal / np.outer(scale, scale) + 1e-12 * np.eye(len(scale))
    return np.linalg.inv(unit) / np.outer(scale, scale)
