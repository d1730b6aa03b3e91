"""Kinds of error that no cause of the library has a name for: what a kind adds is linear in weights
on features of the commands and states, so that one regression judges the whole of it.

Generalised least squares with the noise's colour estimated anew under each kind: under one that is
true the noise is smaller and plainer than without, and no shape needs to be known. It is judged
beside what every linear plant would do with more freedom, and on data held out.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Float

from ..signals.colour import autoregression, filter_length, whiten
from ..signals.windows import history

_ROUNDS = 4
_SETTLED = 1.0  # gain of twice the log-likelihood by a round, after which another is not worth it
_IDLE = 5.0  # gain by the first round, below which there is no second
_RIDGE = 1e-4  # of the samples: a hundredth of a standard deviation for each weight
_SHRUNK = 0.1  # the same for weights of many shapes, of which only all together mean anything
SURE, HELD = 30.0, 12.0
"""Twice the gain in log-likelihood, beyond two for each weight, and on data held out, from which on
a kind of error is told."""

PLAIN = 100.0
"""The same, from which on an error is plainly some function of inputs and states, whatever data
held out say of that function: 30 clean responses had -65 to 11."""

PACE = "a time constant that changes with the state"
"""The kind of what changes how fast a response moves, and not where it comes to rest."""

PACE_BY_OTHER = "a time constant that changes with the other command"
"""The same of a pump on the engine, by whose speed it steers."""

MEMORY = "a gain that remembers past effort"
"""The kind of what heat does to a gain, and what an effort leaves behind."""

BY_DIRECTION = "a time constant that differs up and down"
"""The same of what heats faster than it cools."""

OF_STATES = "a function of inputs and states"
"""The kind of what depends on these by no rule that has a name."""

HYSTERESIS = "a hysteresis"
"""The kind of what depends on where a signal turned."""

_RUINED = 2.0  # times the innovations' variance on data held out, from which on they refute even
# that: right ones had up to 1.3, that clean one 2.9
_WORTH = 0.05  # share of the squared error, fitted and held out, below which it is not told
_START = 2.0  # s at the start of what is held out, where the states at the start are guessed
_WIDTHS = (0.02, 0.05, 0.1, 0.2, 0.35)  # of plays, of the range
_PASTS = (3.0, 10.0, 30.0)  # s
_LAGS = (0.1, 0.3, 1.0, 3.0)  # s
_SWAYS = (0.05, 0.15, 0.5)  # s
_WAVES, _FEWEST = 128, 16  # shapes, fewer in short logs
_BANDWIDTH = 1.6  # rad by which a shape turns over a standard deviation of all states, typically
_SPANS, _EFFORTS = (0.3, 1.0, 3.0, 10.0), (1.0, 5.0)  # time constants of the plant, of its past
_LOOPS = (0.08, 0.25)  # widths of plays that it remembers by, of the range
_EACH = 15  # samples, at the least, for each weight
_BETTER = (1.2, 20.0)  # times a cause's gain, and beyond, from which a kind tells it better
_ELSE = (2.0, 0.3, 100.0)  # times what its own kind has, of a cause's gain, and at the least; and
_ELSE_SHARE = (0.3, 0.6)  # of the error, likewise, from which on a gain that remembers tells what
# a cause owes to none of its own kind: of 60 right names none had it
_OF_FORM = (0.5, 0.7)  # of the best statistic and its share, from which on a known kind is told

STICKING = ("backlash", "coulomb_friction", "dead_zone")
_CURVED = (
    *("gain_nonlinearity", "saturation", "dead_zone", "gain_asymmetry"),
    *("offset", "quantization", "drag", "coulomb_friction"),
)
_PACED = ("rate_limit", "gain_asymmetry")
_AGING = ("gain_drift", "regime_change", "offset", "periodic_disturbance", "road_grade")
_CROSSED = ("cross_coupling", "speed_dependent_gain")
_SWAYING = ("tyre_relaxation", "yaw_inertia")
_LATE = ("sensor_lag", "sensor_delay", *_SWAYING)


@dataclass(frozen=True, eq=False)
class Family:
    """A kind of error.

    Attributes:
        words: what it is, as part of a sentence.
        depends_on: what it depends on.
        features: (k, R, N) what it adds for unit weights.
        causes: those of the library that are of this kind; None where all may be.
        ridge: of its weights, of the samples.
    """

    words: str
    depends_on: tuple[str, ...]
    features: Float[np.ndarray, "k R N"]
    causes: tuple[str, ...] | None = ()
    ridge: float = _RIDGE

    def times(self, weights: Float[np.ndarray, "R N"] | float) -> "Family":
        """The same of an error that is weighted."""
        return replace(self, features=self.features * weights)


@dataclass(frozen=True, eq=False)
class Explained:
    """How much of an error a family explains.

    Attributes:
        family: the kind.
        statistic: twice the gain in log-likelihood, less two for each weight that is free.
        held_out: twice the gain on data held out; infinite where there is none, or none is asked.
        share: of the squared error, where it was fitted or held out, whichever is less; of the
            innovations', where that is more and it is any function at all.
        by_fit_alone: whether the fit is so plain that no data held out are asked.
    """

    family: Family
    statistic: float
    held_out: float
    share: float
    by_fit_alone: bool = False

    def sure(self, least: float = _WORTH) -> bool:
        """Whether it is sure, borne out on data held out, and more than a share."""
        return self.statistic > SURE and self.held_out > HELD and self.share > least


def of_plant(
    u: Float[np.ndarray, "R N"],
    y: Float[np.ndarray, "R N"],
    other: Float[np.ndarray, "R N"],
    t: Float[np.ndarray, "R N"],
    names: tuple[str, str],
    mask: Bool[np.ndarray, "R N"],
    dt: float,
    span: float = 1.0,
) -> tuple[Float[np.ndarray, "k R N"], list[Family]]:
    """What a freer linear plant could add, and the families of a plant with one input.

    Args:
        u, y: command, that of the row before, and simulated response; `names`: theirs.
        other: command of the other actuator, zero where there is none.
        t: time, s.
        mask: samples that are fitted.
        dt: sample period, s.
        span: slowest time constant of the plant, s.
    """
    command, response = names
    rate = np.diff(y, axis=1, prepend=y[:, :1]) / dt  # of the past: what follows knows the command
    usual = max(float(np.abs(u[mask]).mean()), 1e-300)
    effort = [history(x, s, dt) for s in _PASTS for x in (np.abs(u), u**2 / usual)]
    effort += [history(u**2 / usual, s, dt) * (1.0 - np.exp(-t / s)) for s in _PASTS]  # from cold
    paced = [np.abs(y) * rate, y * rate, y**2 * rate, np.abs(rate), np.abs(rate) * rate]
    paced += [history(x, s, dt) for s in (0.2, 1.0) for x in paced]
    now = t / max(float(t.max()), dt)
    aging = [now, now**2, now * y, now**2 * y, now * rate]
    found = [
        _hysteresis(y, response, mask, STICKING),
        _family(MEMORY, [command], [y * x for x in effort]),
        _family(PACE, [response], paced, _PACED),
        _family("a gain that changes with the state", [response], _curves(y, mask), _CURVED),
        _family("a change with time", ["t"], aging, _AGING),
    ]
    states = {command: u, response: y, f"rate of {response}": rate, "t": t}
    if np.any(other):
        o = history(other, 0.3, dt)
        across = [other, o, np.abs(o), other**2, o**2, o * y, o**2 * y, np.abs(o) * y]
        across += [o * rate, np.abs(o) * rate]
        words = "a coupling with the other command"
        found.append(_family(words, ["the other command"], across, _CROSSED))
        paced = [o * rate, np.abs(o) * rate, o**2 * rate]
        paced += [history(x, s, dt) for s in (0.2, 1.0) for x in paced]
        found.append(_family(PACE_BY_OTHER, ["the other command"], paced))
        states["the other command"] = other
    span = float(np.clip(span, 3.0 * dt, 0.1 * max(float(np.ptp(t)), 30.0 * dt)))
    past = [history(u, k * span, dt) for k in _SPANS]
    efforts = [history(np.abs(u - u[mask].mean()), k * span, dt) for k in _EFFORTS]
    loops = y - plays(y, [0.5 * w * float(np.ptp(y[mask])) for w in _LOOPS])
    remembered = [*past, *efforts, *loops]
    lagged = [history(x, s, dt) for s in _LAGS for x in (u, y)]
    linear = np.stack([np.ones_like(u), u, y, rate, *lagged, *past])
    found += _any(OF_STATES, states, remembered, mask, len(linear))
    return linear, found


def of_swing(
    y: Float[np.ndarray, "R N"], wave: Float[np.ndarray, "2 N"], response: str
) -> list[Family]:
    """What a swing adds, and a gain that swings: each run has its own phase.

    Args:
        y: simulated response; `response`: its name.
        wave: sine and cosine at the frequency.
    """
    runs = np.eye(len(y))[:, None, :, None]  # one of them, and the others zero
    own = (runs * wave[:, None]).reshape(-1, *y.shape)
    return [
        _family("a swing", ["t"], list(own), ("periodic_disturbance",)),
        _family("a gain that swings", ["t", response], list(own * y)),
    ]


def of_body(
    v: Float[np.ndarray, "R N"],
    delta: Float[np.ndarray, "R N"],
    t: Float[np.ndarray, "R N"],
    mask: Bool[np.ndarray, "R N"],
    dt: float,
) -> tuple[Float[np.ndarray, "k R N"], list[Family]]:
    """The same of a vehicle's yaw rate. A yaw lag that changes with speed and turn is no news:
    every vehicle has one.

    Args:
        v: speed, m/s; `delta`: steering angle, rad; `t`: time, s.
        mask: samples that are fitted.
        dt: sample period, s.
    """
    turn = v * delta
    lateral = v * turn
    rate, braked = (np.gradient(x, dt, axis=1) for x in (turn, v))
    tyres = [turn * lateral**2, turn * np.abs(lateral), turn * lateral**4, turn * delta**2]
    tyres += [turn * np.abs(delta), delta * np.abs(lateral)]
    paced = [np.abs(turn) * rate, turn**2 * rate, np.abs(rate), np.abs(rate) * rate, v * rate]
    shifted = [braked, braked * delta, braked * turn, braked * rate, np.abs(braked) * delta]
    states = {"v": v, "delta": delta, "lateral acceleration": lateral, "t": t}
    behind = [history(turn, s, dt) for s in _SWAYS]
    sways = [
        np.gradient(rate, dt, axis=1),
        *behind,
        *(history(x, s, dt) for x, s in zip(behind, _SWAYS, strict=True)),
    ]
    found = [
        _family("tyres whose grip runs out", ["lateral acceleration"], tyres),
        _hysteresis(turn, "delta", mask),
        _family("braking and accelerating while it turns", ["rate of v"], shifted, _LATE),
        _family("a body that sways", ["delta"], sways, _SWAYING),
    ]
    lagged = [v * history(delta, s, dt) for s in _LAGS[:2]]
    linear = np.stack([np.ones_like(v), v, delta, turn, rate, *lagged, *paced])
    found += _any("a function of speed and angle", states, behind, mask, len(linear))
    return linear, found


def weighed(
    e: Float[np.ndarray, "R N"],
    linear: Float[np.ndarray, "k R N"],
    families: Sequence[Family],
    mask: Bool[np.ndarray, "R N"],
    held_out: Bool[np.ndarray, "R N"],
    dt: float,
) -> list[Explained]:
    """What each family explains of an error, but of those that have too many weights to tell.

    Args:
        e: the error.
        linear: what is no news.
        families: the kinds.
        mask: samples that were fitted; `held_out`: those that were not.
        dt: sample period, s.
    """
    settled = held_out.copy()
    settled[:, : round(_START / dt)] = False
    uses = (mask, settled) if settled.sum() > 200 else (mask,)
    plain = _squares(e, linear, uses, dt)
    found = []
    for family in families:
        if mask.sum() < _EACH * (len(family.features) + len(linear)):
            continue
        ridges = np.repeat([_RIDGE, family.ridge], [len(linear), len(family.features)])
        freer = _squares(e, np.concatenate([linear, family.features]), uses, dt, ridges)
        news = [u.sum() * np.log(a / b) for u, a, b in zip(uses, plain[0], freer[0], strict=True)]
        fitted = float(news[0]) - 2.0 * (freer[2] - plain[2])
        # other data may be where no shape has learnt, and a little worse with it
        borne = all(b < _RUINED * a for a, b in zip(plain[0], freer[0], strict=True))
        alone = family.causes is None and fitted > PLAIN and borne
        asked = slice(1) if alone else slice(None)
        share = _share(plain[1][asked], freer[1][asked])
        if family.causes is None:  # of what is fast, where most of the error is slow
            share = max(share, _share(plain[0][asked], freer[0][asked]))
        held = float(min(news[asked][1:], default=np.inf))
        found.append(Explained(family, fitted, held, float(share), alone))
    return found


def explained(found: Sequence[Explained], causes: Sequence[str] = ()) -> Explained | None:
    """The family that explains most, where one does so surely and enough of it to matter: one of
    the kind of `causes` that are known rather than another that explains little more, since what is
    left of a cause is first of all what its form leaves."""
    sure = [f for f in found if f.sure()]
    best = max(sure, key=lambda f: f.statistic, default=None)
    if best is None:
        return None
    nearly, alike = _OF_FORM
    known = [
        f
        for f in sure
        if set(f.family.causes or ()) & set(causes)
        if f.statistic > nearly * best.statistic and f.share > alike * best.share
    ]
    return max(known, key=lambda f: f.statistic, default=best)


def better_than(
    cause: str, gain: float, found: Sequence[Explained], *, doubted: bool = False
) -> Explained | None:
    """The family that explains what a cause explains, and clearly better than it and than all of
    its own kind, where one of another kind does: the cause only stands in for it.

    Args:
        cause: its name.
        gain: twice the log-likelihood that it gains.
        found: what each family explains of the error of the model without it.
        doubted: whether a kind has told another cause beside it better; what it takes of the plain
            error counts no longer then.
    """
    times, beyond = _BETTER
    named = [f for f in found if f.family.causes is not None]
    own = [f for f in named if cause in (f.family.causes or ())]
    most = max([gain, *(f.statistic for f in own)])
    share = -np.inf if doubted else max((f.share for f in own), default=0.0)
    others = [f for f in named if f not in own and f.sure(share)]
    better = [f for f in others if f.statistic > times * most + beyond or _is_memory(f, gain, own)]
    return max(better, key=lambda f: f.statistic, default=None)


def _is_memory(kind: Explained, gain: float, own: Sequence[Explained]) -> bool:
    """Whether a gain that remembers tells an error so much better than the kinds of a cause do that
    the cause can only gain by what else it does. No other kind: what limits a command changes how
    fast a response moves as well."""
    if kind.family.words != MEMORY or not own:
        return False
    times, part, least = _ELSE
    more, much = _ELSE_SHARE
    told, held, share = (
        max(getattr(f, x) for f in own) for x in ("statistic", "held_out", "share")
    )
    clear = kind.statistic > max(times * told, part * gain, least) and kind.held_out > times * held
    return clear and kind.share > max(share + more, much)


def plays(x: Float[np.ndarray, "R N"], halves: Sequence[float]) -> Float[np.ndarray, "k R N"]:
    """Outputs of plays of some half widths: sums of them approach any hysteresis. A step holds the
    output between two bounds, and so do several steps at once: after the first pass of two, then
    of four.

    Source: Brokate and Sprekels, Hysteresis and Phase Transitions (1996), section 2.3; Hillis and
    Steele, Data parallel algorithms (1986), for sums by passes.
    """
    half = np.asarray(halves)[:, None, None]
    low, high = x - half, x + half
    step = 1
    while step < x.shape[1]:
        later = low[..., step:], high[..., step:]
        ends = [np.clip(bound[..., :-step], *later) for bound in (low, high)]
        low, high = low.copy(), high.copy()
        low[..., step:], high[..., step:] = ends
        step *= 2
    return np.clip(x[:, :1], low, high)


def _squares(
    e, X, uses, dt, ridges: float | np.ndarray = _RIDGE
) -> tuple[list[float], list[float], float]:
    """Mean squares of the innovations, and of the error, that the features leave in each part, and
    how many of their weights are free."""
    mask = uses[0]
    n, order = int(mask.sum()), filter_length(dt, int(mask.sum()))
    left, before, free = e, None, 0.0
    for turn in range(_ROUNDS + 1):
        colour = autoregression(np.where(mask, left, 0.0)[None], mask, order)
        white = whiten(left[None], colour)[0]
        now = _power(white[mask])
        gain = np.inf if before is None else n * np.log(before / now)
        before = now
        if turn == _ROUNDS or gain < (_IDLE if turn == 1 else _SETTLED):
            break
        Z = whiten(X[None], colour)[0][:, mask]
        sizes = np.sqrt(np.mean(Z**2, axis=1)) + 1e-300
        Z /= sizes[:, None]
        own = Z @ Z.T
        weights = np.linalg.inv(own + np.diag(n * np.broadcast_to(ridges, len(X))))
        target, free = whiten(e[None], colour)[0][mask], float(np.sum(weights * own))
        left = e - np.tensordot(weights @ (Z @ target) / sizes, X, 1)
    innovations, errors = ([_power(z[u]) for u in uses] for z in (white, left))
    return innovations, errors, free


def _share(before: Sequence[float], after: Sequence[float]) -> float:
    """The least share of a mean square that is taken, of several."""
    return min(1.0 - b / a for a, b in zip(before, after, strict=True))


def _power(z: np.ndarray) -> float:
    """Mean square, and never nothing: a log may be its model's own simulation."""
    return max(float(np.mean(z**2)), 1e-300)


def _family(
    words: str,
    depends_on: Sequence[str],
    rows: Sequence[np.ndarray],
    causes: tuple[str, ...] | None = (),
) -> Family:
    return Family(words, tuple(depends_on), np.stack(rows), causes)


def _hysteresis(x: np.ndarray, name: str, mask: np.ndarray, causes: tuple = ()) -> Family:
    width = float(np.ptp(x[mask]))
    features = x - plays(x, [w * width for w in _WIDTHS])
    return Family(HYSTERESIS, (f"where {name} turned",), features, causes)


def _curves(y: np.ndarray, mask: np.ndarray) -> list[np.ndarray]:
    width = float(np.ptp(y[mask]))
    bent = [np.abs(y - c * width) for c in (-0.3, 0.0, 0.3)]
    return [y**2, y**3, np.abs(y) * y, np.sign(y), *bent]


def _any(
    words: str,
    states: Mapping[str, np.ndarray],
    remembered: Sequence[np.ndarray],
    mask: np.ndarray,
    beside: int,
) -> list[Family]:
    """Random cosines of all states together and of what they were (Rahimi and Recht, Random
    features for large-scale kernel machines, 2007), as many as can be told `beside` so many other
    features; none where these are too few."""
    scaled = {}
    for name, x in (*states.items(), *((None, x) for x in remembered)):
        middle, spread = float(np.mean(x[mask])), float(np.std(x[mask]))
        if spread > 1e-9 * (1.0 + float(np.abs(x[mask]).max())):
            scaled[name or len(scaled)] = np.clip((x - middle) / spread, -4.0, 4.0)
    count = min(_WAVES, int(mask.sum()) // _EACH - beside)
    if not scaled or count < _FEWEST:
        return []
    rng = np.random.default_rng(0)
    weights = rng.normal(size=(count, len(scaled))) * _BANDWIDTH / np.sqrt(len(scaled))
    phases = rng.uniform(0.0, 2.0 * np.pi, count)
    waves = np.tensordot(weights, np.stack(list(scaled.values())), 1) + phases[:, None, None]
    named = tuple(name for name in scaled if isinstance(name, str))
    return [Family(words, named, np.cos(waves), None, _SHRUNK)]
