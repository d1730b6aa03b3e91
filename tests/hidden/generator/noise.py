"""Measurement noise and process disturbances: first-order autoregressive, or white."""

import numpy as np

CHANNELS = ("v", "delta", "r", "x", "y", "psi", "a")
"""Measured channels in the order of every array of channels; m/s, rad, rad/s, m, m, rad, m/s^2."""

COARSE = 0.01  # s: disturbances are held this long


def coloured(white: np.ndarray, keep: np.ndarray | float) -> np.ndarray:
    """Autoregressive series of unit variance along axis 0; `keep` is what a step leaves of it."""
    keep = np.broadcast_to(np.asarray(keep, float), white.shape[1:])
    fresh = np.sqrt(1.0 - keep**2)
    out = np.empty_like(white)
    out[0] = white[0]
    for k in range(1, len(white)):
        out[k] = keep * out[k - 1] + fresh * white[k]
    return out


def measurement(seed: int, runs: int, rows: int, dt: float) -> tuple[np.ndarray, np.ndarray]:
    """Noise (rows, runs, channel), and its standard deviation by channel, of a vehicle's log."""
    rng = np.random.default_rng([seed, 20])
    pose = rng.uniform(0.015, 0.025)
    std = np.array(
        [
            rng.uniform(0.02, 0.05),
            rng.uniform(0.001, 0.003),
            rng.uniform(0.002, 0.006),
            pose,
            pose,
            rng.uniform(0.002, 0.004),
            rng.uniform(0.1, 0.3),
        ]
    )
    return _drawn(rng, [seed, 21], std, runs, rows, dt)


def generic_measurement(
    seed: int, runs: int, rows: int, dt: float, size: float
) -> tuple[np.ndarray, np.ndarray]:
    """The same of a single plant whose response has the given `size`."""
    rng = np.random.default_rng([seed, 20])
    return _drawn(rng, [seed, 21], np.array([rng.uniform(0.008, 0.02) * size]), runs, rows, dt)


def _drawn(rng, seed: list[int], std: np.ndarray, runs: int, rows: int, dt: float):
    keep = np.where(rng.random(len(std)) < 0.5, 0.0, rng.uniform(0.4, 0.9, len(std)))
    keep = keep ** (dt / 0.02)  # the same colour in time at every sample period
    draws = [np.random.default_rng([*seed, run]) for run in range(runs)]
    white = np.stack([one.standard_normal((rows, len(std))) for one in draws], axis=1)
    return coloured(white, keep) * std, std


def disturbance(seed: int, runs: int, steps: int, size: tuple[float, ...] | None) -> np.ndarray:
    """Disturbances (steps of 10 ms, runs, kind), correlated over 0.2-2 s.

    Kinds: acceleration (m/s^2), steering command (rad), yaw rate (rad/s); or those of `size`,
    standard deviations of kinds of the caller's.
    """
    rng = np.random.default_rng([seed, 22])
    ranges = [(0.03, 0.10), (0.0004, 0.0015), (0.001, 0.004)]
    std = np.array([rng.uniform(*r) for r in ranges] if size is None else size)
    keep = np.exp(-COARSE / rng.uniform(0.2, 2.0, len(std)))
    draws = [np.random.default_rng([seed, 23, run]) for run in range(runs)]
    white = np.stack([one.standard_normal((steps, len(std))) for one in draws], axis=1)
    return coloured(white, keep) * std
