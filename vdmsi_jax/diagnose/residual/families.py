"""Kinds of error that no cause of the library has a name for: what a kind adds is linear in weights
on features of the commands and states, so that one regression judges the whole of it.

No shape needs to be known. What every linear plant would do with more freedom stands beside them.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Float

from ..signals.windows import history

RIDGE = 1e-4
"""Of the samples, of each weight: a hundredth of a standard deviation."""

_SHRUNK = 0.1  # the same for weights of many shapes, of which only all together mean anything

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

_WIDTHS = (0.02, 0.05, 0.1, 0.2, 0.35)  # of plays, of the range
_PASTS = (3.0, 10.0, 30.0)  # s
_LAGS = (0.1, 0.3, 1.0, 3.0)  # s
_SWAYS = (0.05, 0.15, 0.5)  # s
_WAVES, _FEWEST = 128, 16  # shapes, fewer in short logs
_BANDWIDTH = 1.6  # rad by which a shape turns over a standard deviation of all states, typically
_SPANS, _EFFORTS = (0.3, 1.0, 3.0, 10.0), (1.0, 5.0)  # time constants of the plant, of its past
_LOOPS = (0.08, 0.25)  # widths of plays that it remembers by, of the range

EACH = 15
"""Samples, at the least, for each weight."""

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
    ridge: float = RIDGE

    def times(self, weights: Float[np.ndarray, "R N"] | float) -> "Family":
        """The same of an error that is weighted."""
        return replace(self, features=self.features * weights)


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
    span = float(np.clip(span, 3.0 * dt, 0.1 * max(float(np.ptp(t)), 30.0 * dt)))
    bent = [history(x, span, dt) for x in _curves(u, mask)]  # as a plant of one pole, or two, moves
    slower = [history(x, span, dt) for x in bent]
    now = t / max(float(t.max()), dt)
    aging = [now, now**2, now * y, now**2 * y, now * rate]
    found = [
        _hysteresis(y, response, mask, STICKING),
        _family(MEMORY, [command], [y * x for x in effort]),
        _family(PACE, [response], paced, _PACED),
        _family("a gain that changes with the state", [response], _curves(y, mask), _CURVED),
        _family("a gain that changes with the command", [command], [*bent, *slower], _CURVED),
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
    """What a gain that bends at any level adds."""
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
    count = min(_WAVES, int(mask.sum()) // EACH - beside)
    if not scaled or count < _FEWEST:
        return []
    rng = np.random.default_rng(0)
    weights = rng.normal(size=(count, len(scaled))) * _BANDWIDTH / np.sqrt(len(scaled))
    phases = rng.uniform(0.0, 2.0 * np.pi, count)
    waves = np.tensordot(weights, np.stack(list(scaled.values())), 1) + phases[:, None, None]
    named = tuple(name for name in scaled if isinstance(name, str))
    return [Family(words, named, np.cos(waves), None, _SHRUNK)]
