"""Plants with one cause, in loops of one millisecond that know nothing of the package.

A lag of `tau` seconds, alone or behind a first one of `before` seconds; forces act between the two.
Within a millisecond forces are held and the lags move by their exponentials.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

MS = 1e-3
GRAVITY = 9.80665


@dataclass(frozen=True)
class Drive:
    """Commands and what goes on around them, one row each; `fine` repeats rows to milliseconds. The
    run begins `begun` seconds into its session."""

    t: np.ndarray
    u: np.ndarray
    v: np.ndarray
    other: np.ndarray
    distance: np.ndarray
    dt: float
    begun: float = 0.0

    def fine(self, rows: np.ndarray) -> np.ndarray:
        return np.repeat(rows, round(self.dt / MS))


def drive(n: int, dt: float, seed: int, begun: float = 0.0) -> Drive:
    """Commands in steps of both signs with slow reversals and a chirp, by a moving vehicle."""
    rng = np.random.default_rng(seed)
    t = dt * np.arange(n)
    per = round(0.8 / dt)
    steps = np.repeat(rng.uniform(-2.2, 2.2, n // per + 1), per)[:n]
    u = steps + 1.4 * np.sin(2.0 * np.pi * 0.11 * t + seed) + 0.7 * np.sin(2 * np.pi * 0.06 * t * t)
    v = 10.0 + 4.0 * np.sin(2.0 * np.pi * 0.13 * t + seed)
    other = 0.3 * np.repeat(rng.uniform(-1.0, 1.0, n // 30 + 1), 30)[:n]
    return Drive(t, u, v, other, np.cumsum(v) * dt - v[0] * dt, dt, begun)


def same(values: np.ndarray, drive: Drive) -> np.ndarray:
    return values


def no_force(u: float, y: float, speed: float, still: bool) -> float:
    return 0.0


@dataclass(frozen=True)
class Cause:
    """Where it acts: on the commands at the rows, on those at the milliseconds, between the lags
    (made anew for each run, since it remembers), as a force in the last lag (a lost command), on
    the response at the milliseconds, or on the measurement."""

    rows: Callable = same
    held: Callable = same
    between: Callable = field(default=lambda: lambda z: z)
    force: Callable = field(default=no_force)
    response: Callable = same
    measured: Callable = same


def respond(drive: Drive, cause: Cause, tau: float, before: float = 0.0) -> np.ndarray:
    """The measured response at the rows, from rest."""
    u = cause.held(drive.fine(cause.rows(drive.u, drive)), drive)
    moves, first = -math.expm1(-MS / tau), -math.expm1(-MS / before) if before else 1.0
    y = z = float(u[0])
    out, still, driven = np.empty(len(u)), True, cause.between()
    for k, now in enumerate(u.tolist()):
        out[k] = y
        if before:
            pushed = now + (z - now) * -math.expm1(-MS / before) / (MS / before)  # mean over the ms
            z += first * (now - z)
        else:
            pushed = now
        pushed = driven(pushed)
        lost = cause.force(pushed, y, (pushed - y) / tau, still)
        still = abs(pushed - y - lost) < 1e-12
        y += moves * (pushed - y - lost)
    y = cause.response(out, drive)[:: round(drive.dt / MS)]
    return cause.measured(y, drive)


def delay(seconds: float) -> Cause:
    steps = round(seconds / MS)
    return Cause(held=lambda u, d: np.concatenate([np.full(steps, u[0]), u])[: len(u)])


def dead_zone(width: float) -> Cause:
    return Cause(rows=lambda u, d: np.sign(u) * np.maximum(np.abs(u) - width, 0.0))


def backlash(gap: float) -> Cause:
    def play(y, d):
        out, at = np.empty_like(y), y[0]
        for k, now in enumerate(y.tolist()):
            at = (
                now - gap / 2 if now - at > gap / 2 else now + gap / 2 if at - now > gap / 2 else at
            )
            out[k] = at
        return out

    return Cause(response=play)


def dead_spool(width: float) -> Cause:
    """A dead zone of what follows the command late."""
    return Cause(between=lambda: lambda z: math.copysign(max(abs(z) - width, 0.0), z))


def driven_backlash(gap: float) -> Cause:
    """Play of what follows the command late, and moves the rest."""

    def fresh():
        at = None

        def play(z):
            nonlocal at
            at = z if at is None else min(max(at, z - gap / 2), z + gap / 2)
            return at

        return play

    return Cause(between=fresh)


def pulled_back(gap: float, pace: float) -> Cause:
    """Play whose output a spring pulls to zero through a damper: Euler in the gap."""

    def play(y, d):
        out, at = np.empty_like(y), y[0]
        for k, now in enumerate(y.tolist()):
            at -= pace * MS * at
            at = min(max(at, now - gap / 2), now + gap / 2)
            out[k] = at
        return out

    return Cause(response=play)


def coasting(gap: float, rest: float) -> Cause:
    """Play whose output keeps its speed in the gap, but for a damper: Euler."""

    def play(y, d):
        out, at, speed, before = np.empty_like(y), y[0], 0.0, y[0]
        for k, now in enumerate(y.tolist()):
            speed -= MS / rest * speed
            at += MS * speed
            if abs(at - now) > gap / 2:
                at, speed = now + math.copysign(gap / 2, at - now), (now - before) / MS
            out[k], before = at, now
        return out

    return Cause(response=play)


def slack(gap: float) -> Cause:
    """Play in what the command moves first."""
    return Cause(rows=backlash(gap).response)


def command_limits(upper: float, lower: float) -> Cause:
    return Cause(rows=lambda u, d: np.clip(u, lower, upper))


def soft_limits(upper: float, lower: float, corner: float) -> Cause:
    def bent(u, d):
        size = np.where(u > 0.0, u / upper, u / lower)
        return u / (1.0 + size ** (1.0 / corner)) ** corner

    return Cause(rows=bent)


def late_limits(upper: float, lower: float, corner: float) -> Cause:
    """Limits of what follows the command late."""

    def bent(z):
        size = z / (upper if z > 0.0 else lower)
        return z / (1.0 + size ** (1.0 / corner)) ** corner

    return Cause(between=lambda: bent)


def stops(upper: float, lower: float) -> Cause:
    return Cause(measured=lambda y, d: np.clip(y, lower, upper))


def rim(upper: float, lower: float, tau: float) -> Cause:
    """Stops that the response itself runs against."""

    def force(u, y, speed, still):
        step = -math.expm1(-MS / tau)
        then = y + step * (u - y)
        return (then - min(max(then, lower), upper)) / step

    return Cause(force=force)


def motor_limit(rising: float, falling: float, tau: float) -> Cause:
    def force(u, y, speed, still):
        return (speed - min(max(speed, -falling), rising)) * tau

    return Cause(force=force)


def ramp(rising: float, falling: float) -> Cause:
    def follow(u, d):
        out, at = np.empty_like(u), float(u[0])
        for k, now in enumerate(u.tolist()):
            at += min(max(now - at, -falling * MS), rising * MS)
            out[k] = at
        return out

    return Cause(held=follow)


def dry_friction(level: float, static: float) -> Cause:
    def force(u, y, speed, still):
        push = u - y
        if abs(push) <= (static if still else level):
            return push
        return math.copysign(level, push)

    return Cause(force=force)


def brake(level: float, tau: float) -> Cause:
    """Friction of a constant size against the response, which is a speed."""

    def force(u, y, speed, still):
        if abs(y) < 1e-9 and abs(u) <= level:
            return u - y
        step = -math.expm1(-MS / tau)
        against = math.copysign(level, y if abs(y) > 1e-9 else u)
        then = y + step * (u - y - against)
        return u - y + y / step if then * y < 0.0 and abs(u) <= level else against

    return Cause(force=force)


def two_gains(ratio: float) -> Cause:
    return Cause(rows=lambda u, d: np.where(u > 0.0, (1.0 + ratio) * u, u))


def weak_push(ratio: float) -> Cause:
    return Cause(force=lambda u, y, speed, still: -ratio * max(u - y, 0.0))


def bent(quadratic: float, cubic: float) -> Cause:
    return Cause(rows=lambda u, d: u + quadratic * u * np.abs(u) + cubic * u**3)


def bent_response(quadratic: float, cubic: float) -> Cause:
    return Cause(measured=lambda y, d: y + quadratic * y * np.abs(y) + cubic * y**3)


def stiffened(quadratic: float, cubic: float) -> Cause:
    return Cause(force=lambda u, y, speed, still: quadratic * y * abs(y) + cubic * y**3)


def one_sided(ratio: float) -> Cause:
    """A spring that gives way `1 + ratio` times as far to the positive side."""
    return Cause(force=lambda u, y, speed, still: (1.0 / (1.0 + ratio) - 1.0) * max(y, 0.0))


def drained(bend: float, level: float) -> Cause:
    """Pulled back by a power of the response, as a tank by the root of its level."""

    def force(u, y, speed, still):
        pull = min(max(max(abs(y) / level, 1e-9) ** bend, 0.1), 10.0)
        return (pull - 1.0) * y

    return Cause(force=force)


def skewed(quadratic: float, cubic: float) -> Cause:
    return Cause(rows=lambda u, d: u + quadratic * u**2 + cubic * u**3)


def stepped(step: float) -> Cause:
    return Cause(rows=lambda u, d: step * np.floor(u / step + 0.5))


def counted(step: float) -> Cause:
    """By a counter that drops what is left over."""
    return Cause(rows=lambda u, d: u - np.mod(u, step))


def cast(step: float) -> Cause:
    """By an integer that drops the fraction."""
    return Cause(rows=lambda u, d: np.sign(u) * (np.abs(u) - np.mod(np.abs(u), step)))


def added(bias: float) -> Cause:
    return Cause(measured=lambda y, d: y + bias)


def added_by_travel(bias: float) -> Cause:
    return Cause(measured=lambda y, d: y + np.where(d.v > 0.0, bias, -bias))


def drift(rate: float, session: bool = False) -> Cause:
    return Cause(rows=lambda u, d: (1.0 + rate * (d.t + (d.begun if session else 0.0))) * u)


def warming(rate: float, seconds: float) -> Cause:
    return Cause(rows=lambda u, d: (1.0 - rate * seconds * np.expm1(-d.t / seconds)) * u)


def new_gain(time: float, gain: float, slowing: float = 0.0, session: bool = False) -> Cause:
    def jump(u, d):
        after = d.t[0] + (d.begun if session else 0.0) + MS * np.arange(len(u)) >= time
        out = np.where(after, (1.0 + gain) * u, u)
        if slowing:
            at = float(out[np.argmax(after)])
            for k in np.flatnonzero(after):
                out[k] = at = at + MS / slowing * (out[k] - at)
        return out

    return Cause(held=jump)


def sinking_gain(time: float, gain: float, seconds: float) -> Cause:
    """From `seconds` about a moment on, the gain goes straight to another one."""

    def sink(u, d):
        t = d.t[0] + MS * (np.arange(len(u)) + 0.5)
        return (1.0 + gain * np.interp(t, time + 0.5 * seconds * np.array([-1, 1]), [0, 1])) * u

    return Cause(held=sink)


def mode(frequency: float, damping: float, share: float) -> Cause:
    def swing(u, d):
        w = 2.0 * math.pi * frequency
        q, dq, out = float(u[0]), 0.0, np.empty_like(u)
        fine = 4
        h = MS / fine
        for k, now in enumerate(u.tolist()):
            out[k] = now + share * (q - now)
            for _ in range(fine):  # leapfrog
                half = dq + 0.5 * h * (w * w * (now - q) - 2.0 * damping * w * dq)
                q += h * half
                dq = (half + 0.5 * h * w * w * (now - q)) / (1.0 + h * damping * w)
        return out

    return Cause(held=swing)


def hum(frequency: float, sine: float, cosine: float) -> Cause:
    def turn(y, d):
        angle = 2.0 * np.pi * frequency * d.t
        return y + sine * np.sin(angle) + cosine * np.cos(angle)

    return Cause(measured=turn)


def slower_at_speed(slope: float) -> Cause:
    return Cause(rows=lambda u, d: (1.0 + slope * d.v) * u)


def less_at_speed(slope: float) -> Cause:
    return Cause(measured=lambda y, d: (1.0 + slope * d.v) * y)


def coupled(strength: float, of: Callable) -> Cause:
    return Cause(rows=lambda u, d: u + strength * of(u, d))


def resistance(quadratic: float, rolling: float, tau: float) -> Cause:
    def force(u, y, speed, still):
        sign = math.copysign(1.0, y) if y else 0.0
        return tau * (quadratic * y * abs(y) + rolling * sign)

    return Cause(force=force)


def hills(slopes: tuple[float, ...], length: float, tau: float) -> Cause:
    def climb(u, d):
        at = d.fine(d.distance) / length * (len(slopes) - 1)
        return u - GRAVITY * tau * np.interp(at, np.arange(len(slopes)), slopes)

    return Cause(held=climb)
