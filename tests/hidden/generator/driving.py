"""Commands at the rows of a log: how somebody drives."""

from collections.abc import Callable

import numpy as np

STYLES = ("rich", "plain", "two_level")
GRIP = 4.5  # m/s^2: the lateral acceleration that a sensible driver does not exceed


def _levels(
    rng: np.random.Generator,
    t: np.ndarray,
    level: Callable[[float], float],
    hold: tuple[float, float],
    ramps: float = 0.0,
    ramp: tuple[float, float] = (1.0, 4.0),
) -> np.ndarray:
    """Levels held for a random time; a share `ramps` of the changes is a ramp (s), not a step."""
    u = np.empty_like(t)
    now, value = t[0], level(t[0])
    while now <= t[-1]:
        until = now + rng.uniform(*hold)
        u[(t >= now) & (t < until)] = value
        following = level(until)
        if rng.random() < ramps:
            takes = rng.uniform(*ramp)
            inside = (t >= until) & (t < until + takes)
            u[inside] = value + (following - value) * (t[inside] - until) / takes
            until += takes
        now, value = until, following
    return u


def speed(
    rng: np.random.Generator, fixed: np.random.Generator, t: np.ndarray, style: str, parking: bool
) -> np.ndarray:
    """Speed command, m/s. `fixed` draws what all runs share; `parking` adds stops and reversing."""
    if style == "two_level":
        low = fixed.uniform(2.5, 6.0)
        pair = (low, low + fixed.uniform(2.0, 5.0))
        state = [int(rng.integers(2))]

        def switch(_: float) -> float:
            state[0] = 1 - state[0]
            return pair[state[0]]

        u = _levels(rng, t, switch, (3.0, 9.0))
    elif style == "plain":
        u = _levels(rng, t, lambda _: rng.uniform(3.0, 9.0), (14.0, 26.0), 0.6)
    else:
        u = _levels(rng, t, lambda _: rng.uniform(2.0, 12.0), (2.0, 6.0), 0.4)
    if parking:
        length = t[-1] - t[0]
        start = t[0] + rng.uniform(0.2, 0.6) * length
        inside = (t >= start) & (t < start + min(14.0, 0.3 * length))

        def creep(_: float) -> float:
            return float(rng.choice([0.0, 1.0, 1.0, -1.0])) * rng.uniform(0.3, 3.0)

        u[inside] = _levels(rng, t[inside], creep, (1.0, 2.5), 0.3, (0.5, 1.5))
    return u


def steering(
    rng: np.random.Generator,
    fixed: np.random.Generator,
    t: np.ndarray,
    style: str,
    v: np.ndarray,
    wheelbase: float,
) -> np.ndarray:
    """Steering command, rad, for the speed command `v` (m/s): sharp only where it is slow."""

    def sharpest(start: float, end: float) -> float:
        near = np.abs(v[(t >= start - 2.5) & (t <= end)])
        top = near.max() if near.size else np.abs(v).max()
        return min(0.42, GRIP * wheelbase / max(top, 2.0) ** 2)

    if style == "two_level":
        size = fixed.uniform(0.5, 0.9) * sharpest(t[0], t[-1])
        side = [float(rng.choice([-1.0, 1.0]))]

        def switch(_: float) -> float:
            side[0] = -side[0]
            return side[0] * size

        return _levels(rng, t, switch, (1.5, 5.0))
    u = np.zeros_like(t)
    now = t[0] + (rng.uniform(0.5, 2.0) if style == "rich" else rng.uniform(2.0, 5.0))
    while now < t[-1]:
        if style == "plain":
            takes = rng.uniform(4.0, 8.0)
            size = rng.uniform(0.2, 0.5) * sharpest(now, now + takes) * rng.choice([-1.0, 1.0])
            here = (t >= now) & (t < now + takes)
            u[here] = 0.5 * size * (1.0 - np.cos(2.0 * np.pi * (t[here] - now) / takes))
            now += takes + rng.uniform(1.0, 6.0)
            continue
        kind = rng.choice(["steps", "chirp", "ramps"], p=[0.45, 0.3, 0.25])
        takes = rng.uniform(8.0, 12.0) if kind == "chirp" else rng.uniform(4.0, 9.0)
        here = (t >= now) & (t < now + takes)
        size = sharpest(now, now + takes)
        u[here] = _shape(rng, str(kind), t[here], takes, size)
        now += takes
    return u


def _shape(
    rng: np.random.Generator, kind: str, t: np.ndarray, takes: float, size: float
) -> np.ndarray:
    """One piece of rich driving around zero, within `size`."""
    if kind == "chirp":
        since = t - t[0] if t.size else t
        low, high = 0.1, 4.0
        phase = 2.0 * np.pi * low * takes / np.log(high / low)
        swept = phase * ((high / low) ** (since / takes) - 1.0)
        return rng.uniform(0.25, 0.8) * size * np.sin(swept)
    if kind == "ramps":
        knots = np.arange(0.0, takes + 2.0, rng.uniform(0.7, 1.6))
        values = rng.uniform(-1.0, 1.0, len(knots)) * size
        return np.interp(t - t[0] if t.size else t, knots, values)
    return _levels(rng, t, lambda _: rng.uniform(-1.0, 1.0) * size, (0.4, 2.0)) if t.size else t


def generic(
    rng: np.random.Generator,
    fixed: np.random.Generator,
    t: np.ndarray,
    style: str,
    amplitude: float,
    time: float,
) -> np.ndarray:
    """Command of a single plant within `amplitude`, with pieces of some `time` (s) constants."""
    if style == "two_level":
        pair = np.sort(fixed.uniform(-1.0, 1.0, 2)) * amplitude
        pair[1] = max(pair[1], pair[0] + 0.6 * amplitude)
        state = [int(rng.integers(2))]

        def switch(_: float) -> float:
            state[0] = 1 - state[0]
            return float(pair[state[0]])

        return _levels(rng, t, switch, (2.0 * time, 10.0 * time))
    if style == "plain":
        return _levels(rng, t, lambda _: rng.uniform(-1, 1) * amplitude, (12.0, 24.0), 0.6)
    u = np.zeros_like(t)
    now = t[0] + rng.uniform(0.5, 2.0)
    while now < t[-1]:
        kind = str(rng.choice(["steps", "chirp", "ramps"], p=[0.5, 0.25, 0.25]))
        takes = rng.uniform(8.0, 12.0) if kind == "chirp" else rng.uniform(6.0, 12.0)
        here = (t >= now) & (t < now + takes)
        if kind == "steps" and here.any():
            u[here] = _levels(
                rng, t[here], lambda _: rng.uniform(-1, 1) * amplitude, (time, 8 * time)
            )
        else:
            u[here] = _shape(rng, kind, t[here], takes, amplitude)
        now += takes
    return u
