"""Where refits start: plants with more poles or fewer, and causes that no small step leads to."""

from collections.abc import Iterable, Sequence
from dataclasses import replace

import numpy as np

from ...effects import AbstractEffect, Scales
from .hypothesis import Hypothesis, Refit, without
from .lanes import FEED, NUMERATOR, POLES
from .stage import Stage

_STATIC = ("saturation", "dead_zone", "gain_nonlinearity", "gain_asymmetry")
_TWO_SIDED = ("saturation", "rate_limit")
_TIMES = 48  # moments that are tried
_LEVEL = 10.0  # of its range, that a level of the command counts for at the most
_SMALLEST, _WIDEST = 0.02, 0.25  # steps that are tried, of the command's range
_PACES = (1.0, 2.0, 5.0)  # of a plant beside a delay, which had told it by a slower pole
_DELAYS, _LONGEST, _NEARLY = 16, 0.1, 2.0  # how many are tried, up to which share of the longest
# run, and how much more than the least error others may leave
_BEYOND, _OUTLASTS = 5, 3.0  # places of a faster pole, up to the rate of the samples, where all
# that are known take longer than a third of a run
_SLOW = 2.5  # squared error over innovations, from which on a part of it is slow
_CHANGE = 0.1  # of gain, to try moments with
_RAMPS = (1.0, 3.0, 10.0)  # time constants, that a change of gain may take


def first_order(stage: Stage) -> list[Hypothesis]:
    """Plants of one pole over a ladder of time constants, the gain by least squares."""
    duration = stage.u.shape[1] * stage.dt
    ladder = np.geomspace(2.0 * stage.dt, 0.5 * duration, 16)
    thetas = np.repeat(stage.off[None], len(ladder), axis=0)
    thetas[:, 0] = thetas[:, POLES] = 1.0 / (ladder * stage.pace)
    errors, scaled = with_gains(stage, thetas)
    return [Hypothesis(1, 0, (), scaled[k]) for k in np.argsort(errors)[:2]]


def nested(stage: Stage, h: Hypothesis) -> Iterable[Hypothesis]:
    """The same plant with a pole, a zero, or both more, from several places."""
    den, num = h.den, h.num
    slow = float(np.abs(np.roots(den)).min())
    fast = float(np.abs(np.roots(den)).max())
    limit = 1.0 / (stage.dt * stage.pace)
    outlasts = fast * stage.u.shape[1] < _OUTLASTS * limit
    beyond = np.geomspace(fast, max(fast, limit), _BEYOND if outlasts else 0)
    for p in {min(3.0 * fast, limit), min(fast, limit), slow / 3.0, *map(float, beyond)}:
        if h.poles < POLES:
            yield plant(h, stage, np.polymul(den, [1.0, p]), num * p)
            for near in (0.8, 1.3):
                yield plant(h, stage, np.polymul(den, [1.0, p]), np.polymul(num, [1.0, p * near]))
    if h.zeros < h.poles - 1:
        for tau in (0.1 / fast, -0.1 / fast):
            yield plant(h, stage, den, np.polymul(num, [tau, 1.0]))


def feeding(stage: Stage, h: Hypothesis) -> Hypothesis:
    """The same with as many zeros as poles: what passes at once is nothing yet."""
    return plant(h, stage, h.den, np.concatenate([np.zeros(len(h.den) - len(h.num)), h.num]))


def _reduced(stage: Stage, h: Hypothesis, order: tuple[int, int]) -> tuple[Hypothesis, float]:
    """The slowest poles and stable zeros of a plant, and the delay that what is left out amounts
    to, s."""
    poles, zeros, level = np.roots(h.den), np.roots(h.num), h.num[-1] / h.den[-1]
    poles = poles[np.argsort(np.abs(poles) + 1e-6 * poles.imag)]
    zeros = zeros[np.argsort(np.where(zeros.real < 0, np.abs(zeros), np.inf))]
    n, m = order
    kept, led = poles[:n], zeros[: min(m, int(np.sum(zeros.real < 0)))]
    den, num = (np.atleast_1d(np.real(np.poly(roots))) for roots in (kept, led))
    num = np.concatenate([np.zeros(m + 1 - len(num)), num * level * den[-1] / num[-1]])
    gone = np.sum(-1.0 / poles[n:]) - np.sum(-1.0 / zeros[len(led) :])
    return plant(h, stage, den, num), float(np.real(gone)) / stage.pace


def reduced(stage: Stage, h: Hypothesis, order: tuple[int, int]) -> Hypothesis:
    """The same with the slowest poles and stable zeros of its plant only."""
    return _reduced(stage, h, order)[0]


def number_of(stage: Stage, cause: str) -> int:
    """Of the first effect that is this cause."""
    return next(i for i, slot in enumerate(stage.slots) if slot.cause == cause)


def added(stage: Stage, h: Hypothesis, number: int, value: float | tuple[float, ...]) -> Hypothesis:
    """The same with one cause more, its parameters at a value, or each at its own."""
    theta = h.theta.copy()
    theta[list(stage.slots[number].index)] = value
    return replace(h, active=tuple(sorted({*h.active, number})), theta=theta)


def shifted_by(stage: Stage, h: Hypothesis, number: int) -> Hypothesis:
    """With an offset, of that number, and a gain that bring the response closest to what was
    measured: it is a straight function of both."""
    at = stage.slots[number].index[0]
    thetas = np.repeat(h.theta[None], 3, axis=0)
    thetas[1, NUMERATOR] *= 2.0
    thetas[2, at] += stage.scales.response
    y = stage.simulate(thetas)[:, stage.mask]
    gain, bias = np.linalg.lstsq((y[1:] - y[0]).T, stage.y[stage.mask] - y[0], rcond=None)[0]
    theta = h.theta.copy()
    theta[NUMERATOR] *= 1.0 + gain
    return added(stage, replace(h, theta=theta), number, bias * stage.scales.response)


def late(stage: Stage, plain: Refit, order: tuple[int, int]) -> Iterable[Hypothesis]:
    """A plant reduced to an order, with the causes that it has, and with and without the delay that
    is lost."""
    if order[0] > plain.hypothesis.poles or order[1] > plain.hypothesis.zeros:
        return
    h, delay = _reduced(stage, plain.hypothesis, order)
    number = number_of(stage, "transport_delay")
    yield h
    if number not in h.active:
        yield added(stage, h, number, max(delay, 0.5 * stage.dt))


def delayed(stage: Stage, first: Refit) -> list[Hypothesis]:
    """Plants of one pole, slow to fast, each with the delay that explains the response itself best,
    the gain by least squares: a long delay has many optima beside it."""
    number = number_of(stage, "transport_delay")
    if number not in stage.allowed:
        return []
    longest = _LONGEST * stage.u.shape[1] * stage.dt
    delays = np.geomspace(2.0 * stage.dt, max(longest, 4.0 * stage.dt), _DELAYS)
    thetas = np.repeat(stage.off[None], len(_PACES) * _DELAYS, axis=0)
    paces = np.repeat(_PACES, _DELAYS) * abs(first.hypothesis.theta[0])
    thetas[:, 0] = thetas[:, POLES] = paces
    thetas[:, stage.slots[number].index[0]] = np.tile(delays, len(_PACES))
    errors, scaled = with_gains(stage, thetas)
    best = errors.reshape(len(_PACES), _DELAYS).argmin(axis=1) + _DELAYS * np.arange(len(_PACES))
    near = [k for k in best if errors[k] < _NEARLY * errors.min()]
    return [Hypothesis(1, 0, (number,), scaled[k]) for k in near]


def ringing(stage: Stage, plain: Refit) -> list[Hypothesis]:
    """The plain plant with its lightly damped poles, and the zeros that came with them, told as a
    resonance."""
    h = plain.hypothesis
    poles, zeros, level = np.roots(h.den), np.roots(h.num), h.num[-1] / h.den[-1]
    number = number_of(stage, "resonance")
    made = []
    for p in poles[(poles.imag > 0) & (-poles.real < 0.4 * np.abs(poles)) & (poles.real < 0)]:
        kept = poles[(np.abs(poles - p) > 1e-9) & (np.abs(poles - np.conj(p)) > 1e-9)]
        if not kept.size:
            continue
        den, own = np.real(np.poly(kept)), zeros[np.abs(zeros.imag) < 1e-9].real
        shares = [(0.3, 0.0), (0.8, 0.0), (-0.2, 0.0)]
        for z in zeros[(zeros.imag > 0) & (np.abs(zeros.real) < 0.4 * np.abs(zeros))]:
            rest = (abs(p) / abs(z)) ** 2  # what does not go through the mode sets its zeros
            shares.append((1.0 - rest, 2.0 * float(p.real - z.real) * rest / abs(p)))
        mode = abs(p) * stage.pace / (2.0 * np.pi), max(-p.real / abs(p), 0.01)
        for led in {0, min(own.size, kept.size - 1)}:
            num = np.atleast_1d(np.poly(own[:led]))
            if num[-1] == 0.0:
                continue
            start = plant(h, stage, den, num * level * den[-1] / num[-1])
            made += [added(stage, start, number, (*mode, *share)) for share in shares]
    return made


def bent(stage: Stage, first: Refit) -> list[Hypothesis]:
    """Plants of one pole with a cause that acts on the command, the gain by least squares: what a
    characteristic bends, a linear fit took for another gain, from which no refit finds back."""
    thetas, numbers = [], []
    for number in stage.allowed:
        slot = stage.slots[number]
        if type(slot.effect).command is AbstractEffect.command or slot.cause not in _STATIC:
            continue
        for probe in slot.effect.probes(stage.scales):
            for pace in (1.0, 4.0):
                theta = stage.off.copy()
                theta[0] = theta[POLES] = pace * abs(first.hypothesis.theta[0])
                theta[list(slot.index)] = probe
                thetas.append(theta)
                numbers.append(number)
    best: dict[int, tuple[float, np.ndarray]] = {}
    for number, error, theta in zip(numbers, *with_gains(stage, np.stack(thetas)), strict=True):
        if error < best.get(number, (np.inf,))[0]:
            best[number] = (error, theta)
    return [Hypothesis(1, 0, (number,), theta) for number, (_, theta) in best.items()]


def refined(stage: Stage, now: Refit) -> list[Hypothesis]:
    """Finer forms in the place of causes that they refine."""
    h, made = now.hypothesis, []
    for number in stage.allowed:
        slot = stage.slots[number]
        for other in h.active:
            if number in h.active or stage.slots[other].cause not in slot.effect.refines:
                continue
            bare = without(stage, h, other)
            made += [added(stage, bare, number, p) for p in slot.effect.probes(stage.scales)]
    return made


def errs_slowly(stage: Stage, fit: Refit) -> bool:
    """Whether a part of the error lasts much longer than the noise's colour tells."""
    return fit.error(stage) >= _SLOW * fit.variance


def hilly(stage: Stage, h: Hypothesis) -> list[Hypothesis]:
    """The same with hills, next to level ones, where there may be any."""
    number = number_of(stage, "road_grade")
    if number in h.active or number not in stage.allowed:
        return []
    return [added(stage, h, number, 1e-4)]


def plant(h: Hypothesis, stage: Stage, den: np.ndarray, num: np.ndarray) -> Hypothesis:
    theta = h.theta.copy()
    theta[: FEED + 1] = 0.0
    poles, zeros = len(den) - 1, len(num) - 1
    theta[:poles] = den[1:]
    if zeros == poles:
        theta[FEED], num = num[0], num[1:]
    theta[POLES + poles - len(num) : POLES + poles] = num
    return replace(h, poles=poles, zeros=zeros, theta=theta)


def mirrored(stage: Stage, fits: Sequence[Refit]) -> list[Hypothesis]:
    """Limits that were found on one side, on both: from a side that is off nothing leads to it."""
    made = []
    for f in fits:
        for number in f.hypothesis.active:
            slot = stage.slots[number]
            sides = list(slot.index[:2])
            values = f.hypothesis.theta[sides]
            if slot.cause in _TWO_SIDED and np.any(values == 0.0) and np.any(values != 0.0):
                theta = f.hypothesis.theta.copy()
                theta[sides] = values.max()
                made.append(replace(f.hypothesis, theta=theta))
    return made


def scanned(stage: Stage, at: Refit) -> list[Hypothesis]:
    """A plant with a change of gain, or with steps in its command, at the moments and of the sizes
    that explain the response itself best: their likelihood has many maxima, and in innovations a
    change of gain shows only when the command moves."""
    h, made = at.hypothesis, []
    for number in stage.allowed:
        slot = stage.slots[number]
        if slot.cause == "regime_change":
            made += _changed(stage, h, number)
        nearest = getattr(slot.effect, "by", None) == "nearest"  # other forms shift the mean, too
        if slot.cause == "quantization" and nearest:
            thetas = np.repeat(h.theta[None], len(sizes := _steps(stage.scales)), axis=0)
            thetas[:, slot.index[0]] = sizes
            errors, scaled = with_gains(stage, thetas)
            made += [
                Hypothesis(h.poles, h.zeros, (number,), scaled[k]) for k in np.argsort(errors)[:2]
            ]
    return made


def _changed(stage: Stage, h: Hypothesis, number: int) -> list[Hypothesis]:
    """A plant with a change of gain, alone, with a lag and as a ramp, at the moments that explain
    most."""
    slot = stage.slots[number]
    time, gain, slowing, ramp = slot.index
    told = np.asarray(stage.signals.clock(getattr(slot.effect, "over", "run")))[stage.mask]
    times = np.quantile(told, np.linspace(0.03, 0.97, _TIMES))
    lag = _CHANGE * stage.scales.time_constant
    thetas = np.repeat(h.theta[None], 2 * _TIMES, axis=0)
    thetas[:, time], thetas[:, gain] = np.tile(times, 2), _CHANGE
    thetas[_TIMES:, slowing] = lag
    forced, free = (x[0] for x in _forced(stage, h.theta[None]))
    y, base = stage.simulate(thetas)[:, stage.mask], forced + free
    changed, slowed = y[:_TIMES], y[_TIMES:]
    made = []
    for lags in (False, True):
        rows = [[forced, a - base, b - a] for a, b in zip(changed, slowed, strict=True)]
        errors, shares = _fitted(stage, rows if lags else [row[:2] for row in rows], free)
        for k in np.argsort(errors)[:2]:
            theta, whole = thetas[k].copy(), shares[k][0]
            theta[NUMERATOR] *= whole
            theta[gain] = max(_CHANGE * shares[k][1] / whole, -0.9)
            theta[slowing] = max(lag * shares[k][2] / whole, 0.0) if lags else 0.0
            made.append(Hypothesis(h.poles, h.zeros, (number,), theta))
    long = np.minimum(np.array(_RAMPS) * stage.scales.time_constant, stage.bounds[1][ramp])
    thetas = np.repeat(made[0].theta[None], len(long), axis=0)
    thetas[:, ramp] = long
    errors, scaled = with_gains(stage, thetas)
    return [*made, Hypothesis(h.poles, h.zeros, (number,), scaled[np.argmin(errors)])]


def _steps(scales: Scales) -> np.ndarray:
    """Sizes of steps to try, each as far from the one before as rounding the largest command the
    same way allows. Of a command that hardly moves beside its level they would be endless."""
    whole = scales.high - scales.low
    largest = min(max(abs(scales.low), abs(scales.high)), _LEVEL * whole)
    sizes = [_SMALLEST * whole]
    while sizes[-1] < _WIDEST * whole:
        sizes.append(sizes[-1] * (1.0 + sizes[-1] / (6.0 * largest)))
    return np.array(sizes)


def with_gains(stage: Stage, thetas: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Squared errors of plants whose gain, and a level, are by least squares, infinite where they
    blow up; and the plants with that gain."""
    forced, free = _forced(stage, thetas)
    errors, shares = _fitted(stage, [[row] for row in forced], free)
    scaled = thetas.copy()
    scaled[:, NUMERATOR] *= np.array(shares)
    return np.where(np.isfinite(errors), errors, np.inf), scaled


def _forced(stage: Stage, thetas: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """What grows with the gain of each plant, and what it does by itself: from the level that was
    measured at first it comes to rest, which says nothing of its gain."""
    doubled = thetas.copy()
    doubled[:, NUMERATOR] *= 2.0
    y = stage.simulate(np.concatenate([thetas, doubled]))[:, stage.mask]
    forced = y[len(thetas) :] - y[: len(thetas)]
    return forced, y[: len(thetas)] - forced


def _fitted(
    stage: Stage, candidates: Sequence[Sequence[np.ndarray]], free: np.ndarray
) -> tuple[np.ndarray, list[np.ndarray]]:
    """Squared errors of the measured response less what is `free`, one for all or of each
    candidate, by least squares on each candidate's rows and a level; and the shares of the rows."""
    seen = stage.y[stage.mask] - np.atleast_2d(free)
    rows = np.array(candidates, float)
    ones = np.ones((len(rows), 1, seen.shape[1]))
    shape = np.concatenate([rows, ones], axis=1)
    size = np.sqrt(np.mean(shape**2, axis=2))
    size = np.where(size > 0.0, size, 1.0)
    shape /= size[..., None]
    normal = shape @ np.swapaxes(shape, 1, 2)
    normal += 1e-12 * seen.shape[1] * np.eye(shape.shape[1])
    found = np.linalg.solve(normal, shape @ seen[..., None])
    errors = np.sum((seen - np.sum(shape * found, axis=1)) ** 2, axis=1)
    return errors, list((found[..., 0] / size)[:, :-1])
