"""From runs to stages: what causes may act in a plant and in a body, and the sizes of signals."""

from collections.abc import Sequence
from dataclasses import replace

import jax.numpy as jnp
import numpy as np
from numpy.typing import NDArray

from ..config import PlantSpec
from ..data.noise import white_noise_std
from ..data.record import Record
from ..effects import ACTUATOR, AbstractEffect, Scales, Signals
from ..errors import InputError
from ..models.bicycle import Bicycle
from .actuator.stage import Stage
from .body.body import CHANNELS, STANDS, WINDOW, Body, along_course, increments
from .search.found import Search
from .signals.angle import derived, steering_angle, yaw_rate_bias
from .signals.held_out import driving
from .signals.noise import KnownNoise, Pair, pairs, repeated
from .signals.runs import Runs
from .signals.windows import moving_mean

_SMOOTH = 0.1  # s, over which a signal is averaged whose plant is not known
# causes, or `kind`s of them, that some plants cannot have:
_FOREIGN = {  # an actuator of a vehicle, by its role
    "powertrain": {"speed_dependent_gain", "cross_coupling by speed"}
    | {"cross_coupling by acceleration", "offset by travel"},
    "steering": {"drag", "road_grade", "coulomb_friction against response"}
    | {f"cross_coupling by {by}" for by in ("signed", "size", "square", "slowed", "cornering")},
}
_SESSION = {"gain_drift over session", "regime_change over session"}  # runs of no session
_VEHICLES_ONLY = {"cross_coupling", "speed_dependent_gain", "drag", "road_grade"}
_BOTH_WAYS = {"offset by travel"}  # one whose response goes one way alone
_PLANTS_ONLY = {  # a vehicle's speed, of which these are drag
    "gain_nonlinearity by stiffness",
    "gain_nonlinearity by power",
    "gain_asymmetry by stiffness",
}
FEWEST = 80  # samples that a fit needs
_FAR = 0.5  # of a command's largest, above which it always is where no dead zone is in its way
_CLEAR_WAY = 4.0  # times the noise of a position, that half a second's way has to be
_REVERSED = 0.05  # of the time, that something moves the other way if it moves both ways


def kind(effect: AbstractEffect) -> str:
    """The cause and which of its forms: `saturation at command`."""
    forms = [
        n for n in ("at", "by", "over", "against") if isinstance(getattr(effect, n, None), str)
    ]
    return " ".join([effect.cause, *(f"{n} {getattr(effect, n)}" for n in forms)])


_KINDS = {word for effect in ACTUATOR for word in (effect.cause, kind(effect))}


def _goes_both_ways(signal: NDArray[np.float64]) -> bool:
    return bool(min(np.mean(signal > 0.0), np.mean(signal < 0.0)) >= _REVERSED)


def stage_of(runs: Runs, spec: PlantSpec, reference: KnownNoise | None = None) -> Stage:
    """The stage of one plant; the noise of its response by a reference, else by runs with the same
    commands where there are any.

    Raises:
        InputError: too few samples to fit.
    """
    u = runs.channel(spec.input)
    y, seen = runs.channel(spec.output), runs.seen(spec.output)
    if spec.output == "delta":
        found = steering_angle(runs)
        assert found is not None
        y, seen = found
    v = runs.channel("v")
    other = runs.channel("delta_cmd" if spec.output == "v" else "v_cmd")
    held = runs.held()
    is_vehicle = runs.records[0].vehicle is not None and spec.role != "plant"
    foreign = _FOREIGN.get(spec.role, set())
    foreign = foreign | (_PLANTS_ONLY if is_vehicle else _VEHICLES_ONLY | _BOTH_WAYS)
    if u.min() >= 0.0 or u.max() <= 0.0:  # there both forms are one, and spools are rare
        foreign = foreign | {"gain_nonlinearity by skew", "quantization by truncation"}
        foreign = foreign | {"dead_zone at spool"}
        if not is_vehicle:  # as are gears: of tanks they imitate a rim
            foreign = foreign | {"backlash at between"}
        if np.abs(u).min() > _FAR * np.abs(u).max():
            foreign = foreign | {"dead_zone"}  # which it never enters: it is an offset
    if not _goes_both_ways(y[seen]):  # there it is a spring of another stiffness
        foreign = foreign | {"gain_asymmetry by stiffness"}
    if not _goes_both_ways(v[seen]):
        foreign = foreign | _BOTH_WAYS
    begun = np.array([[r.session] for r in runs.records])
    if np.ptp(begun) == 0.0:  # there is none, or it is the run
        foreign = foreign | _SESSION
    wheres = tuple("vehicle" if e.cause == "road_grade" else spec.role for e in ACTUATOR)
    assert foreign <= _KINDS, "a word that no effect has would bar none"
    allowed = tuple(i for i, e in enumerate(ACTUATOR) if not {e.cause, kind(e)} & foreign)
    shared = (runs.time(), v, other, runs.travelled())
    masks = seen & ~held, seen & held
    if masks[0].sum() < FEWEST:
        problem = f"only {int(masks[0].sum())} samples of {spec.output} to fit"
        raise InputError(runs.records[0].source, spec.output, problem, "give a longer log")
    stage = make_stage(spec.name, u, y, *masks, shared, allowed, wheres, runs.dt, begun)
    stage = replace(stage, within=runs.within(spec.input))
    if reference is not None:
        return replace(stage, noise=reference.at(runs.dt))
    known = repeated(repeats(runs), y, seen, stage.scales.time_constant, runs.dt)
    return stage if known is None else replace(stage, noise=known)


def repeats(runs: Runs) -> tuple[Pair, ...]:
    """Runs that were driven alike, by all that tells it: where a vehicle's command was not logged,
    what was measured, whose noise is never the same."""
    every = [c for c in sorted(driving(runs.records)) if all(c in r for r in runs.records)]
    told = [runs.channel(c) for c in every]
    if not told:
        return ()
    inside = np.arange(runs.length) < np.subtract(runs.stops, runs.starts)[:, None]
    logs = [(id(record), name) for record, name in zip(runs.records, runs.names, strict=True)]
    return pairs(np.stack(told), inside, logs, runs.dt)


def _range(values: np.ndarray) -> tuple[float, float]:
    """Between what values nearly all are; of what hardly ever moves, all."""
    low, high = np.quantile(values, [0.02, 0.98])
    return (float(low), float(high)) if high > low else (float(values.min()), float(values.max()))


def make_stage(name, u, y, mask, held_out, shared, allowed, wheres, dt, begun=None) -> Stage:
    """A stage with the sizes of its signals, from arrays."""
    begun = np.zeros((len(u), 1)) if begun is None else begun
    ends = [x[use].max() for x, use in zip(begun + shared[0], mask, strict=True) if use.any()]
    known = mask | held_out
    pieces = [row[use] for row, use in zip(y, known, strict=True) if use.any()]
    lengths = [int(use.sum()) for use in known]
    low, high = _range(u[known])
    y_low, y_high = _range(y[known])
    noise = white_noise_std(pieces)
    scales = Scales(
        low, high, y_low, y_high,
        rate=1.0, speed=float(np.mean(np.abs(shared[1][known]))),
        distance=float(shared[3][mask].max()),
        duration=max(lengths) * dt, dt=dt, time_constant=1.0,
        noise=float(noise) if np.isfinite(noise) else 0.0, log=float(shared[0][mask].max()),
        session=float(max(ends, default=0.0)),
    )  # fmt: skip
    effects = tuple(e.scaled(scales) for e in ACTUATOR)
    t, v, other, distance = (jnp.asarray(x) for x in shared)
    one, none = jnp.ones(()), jnp.zeros(2)
    began = jnp.asarray(begun)
    signals = Signals(t, v, other, distance, one, none, jnp.asarray(dt), 1, begun=began)
    stage = Stage(name, u, y, mask, held_out, signals, effects, allowed, wheres, scales, 1.0, dt)
    slow, response = _look(stage)
    rates = np.abs(np.diff(response, axis=1))[known[:, 1:]] / dt
    scales = replace(scales, rate=_typical(rates), time_constant=slow)
    substeps = int(np.clip(2 ** np.ceil(np.log2(max(15.0 * dt / slow, 1.0))), 1, 4))
    signals = replace(signals, h=jnp.asarray(dt / substeps), substeps=substeps)
    return replace(stage, scales=scales, pace=1.0 / slow, signals=signals)


def _typical(rates: np.ndarray) -> float:
    """The rate that moves have: their 95 % quantile, or where most of the time nothing moves, the
    one below which half of their energy lies."""
    sizes = np.sort(rates)
    energy = np.cumsum(sizes**2)
    half = sizes[np.searchsorted(energy, 0.5 * energy[-1])]
    return float(max(np.quantile(rates, 0.95), half))


def _look(stage: Stage) -> tuple[float, np.ndarray]:
    """Time constant of the lag, and its response, that come closest to the measured one."""
    ladder = np.geomspace(1.5 * stage.dt, 0.3 * stage.u.shape[1] * stage.dt, 14)
    seen = stage.y[stage.mask]
    best = (np.inf, 1.0, stage.y)
    n = stage.u.shape[1]
    for tau in ladder:
        keep = np.exp(-stage.dt / tau)
        forced, free = _lag(stage.u, keep), stage.y[:, :1] * keep ** np.arange(n)
        columns = np.stack([forced, free, np.ones_like(forced)], axis=-1)
        found, *_ = np.linalg.lstsq(columns[stage.mask], seen, rcond=None)
        error = float(np.sum((seen - columns[stage.mask] @ found) ** 2))
        if error < best[0]:
            best = (error, float(tau), columns @ found)
    return best[1], best[2]


def _lag(u: np.ndarray, keep: float) -> np.ndarray:
    """`y[k+1] = keep y[k] + (1 - keep) u[k]` from zero, along the last axis."""
    n = u.shape[1]
    size = 1 << (2 * n).bit_length()
    taps = np.concatenate([[0.0], (1.0 - keep) * keep ** np.arange(n - 1)])
    return np.fft.irfft(np.fft.rfft(u, size) * np.fft.rfft(taps, size), size)[:, :n]


def body_of(runs: Runs, searches: dict[str, Search]) -> Body | None:
    """The stage of the body; None where neither yaw rate nor pose can be set against speed and
    angle, or the vehicle stands."""
    vehicle = runs.records[0].vehicle
    angle = steering_angle(runs)
    channels = set.intersection(*(set(r.channels) for r in runs.records))
    if vehicle is None or angle is None or "v" not in channels:
        return None
    by_yaw_rate = derived(runs)
    told = "r" in channels and not by_yaw_rate
    posed = {"x", "y", "psi"} <= channels
    if not told and not posed:
        return None
    by_course = posed and not told and not runs.seen("psi").any()
    measured, mask, held_out = {}, {}, {}
    held = runs.held()
    moving = runs.seen("v") & angle[1] & _inside(runs)
    if stands(runs.records):
        return None
    if told:
        measured["r"] = runs.channel("r")
        mask["r"], held_out["r"] = (moving & runs.seen("r") & part for part in (~held, held))
    if posed:
        window = max(1, round(WINDOW / runs.dt))
        x, y, psi = (runs.channel(c) for c in ("x", "y", "psi"))
        way = dict(zip(CHANNELS[1:], increments(x, y, np.unwrap(psi, axis=1), window), strict=True))
        seen, headed = runs.seen("x") & runs.seen("y") & moving, runs.seen("psi")
        rows = [window]
        if by_course:  # the heading is reckoned from the angle, and the course turns without it
            way, clear = _course(runs, x, y, window)
            rows = [window, 2 * window]
            seen &= clear
        elif headed.any():
            seen &= headed
        else:  # it is reckoned from the yaw rate
            way = {"forward": way["forward"]}
        whole, fitted = seen, seen & ~held
        for shift in rows:
            whole = whole & np.roll(seen, -shift, axis=1)
            fitted = fitted & np.roll(~held, -shift, axis=1)
        whole[:, -rows[-1] :] = False
        for c, values in way.items():
            measured[c] = values
            mask[c], held_out[c] = whole & fitted, whole & held
    measured = {c: y for c, y in measured.items() if int(mask[c].sum()) >= FEWEST}
    mask, held_out = ({c: own[c] for c in measured} for own in (mask, held_out))
    if not measured:
        return None
    v, delta = runs.channel("v"), angle[0]
    smooth = {}
    for name, values, known in (("v", v, runs.seen("v")), ("delta", delta, angle[1])):
        search = searches.get(name)
        model = moving_mean(values, _SMOOTH, runs.dt) if search is None else search.final.y
        smooth[name] = np.where(known, model, values)
    bicycle = Bicycle.at_reference(vehicle)
    return Body(
        smooth["v"], smooth["delta"], v - smooth["v"], delta - smooth["delta"],
        measured, mask, held_out, bicycle, runs.dt, by_yaw_rate, repeats=repeats(runs),
        yaw_bias=yaw_rate_bias(runs) if by_yaw_rate else 0.0,
        by_course=by_course,
    )  # fmt: skip


def _course(
    runs: Runs, x: np.ndarray, y: np.ndarray, window: int
) -> tuple[dict[str, np.ndarray], np.ndarray]:
    """`along_course` of a measured position, and where that is clear: where a vehicle goes one way,
    and further than the noise of the position. This makes ways too long, and turns too small, by a
    quarter of its variance over the way's square, to second order in both: that is taken out."""
    speed = runs.channel("v")
    noise = np.sqrt(np.mean([white_noise_std(list(c)) ** 2 for c in (x, y)]))
    way, gone = along_course(x, y, speed, window), np.abs(speed) * window * runs.dt
    fast = (np.abs(speed) > STANDS * np.abs(speed).max()) & (gone > _CLEAR_WAY * noise)
    ahead = np.sign(speed)
    turned = [np.roll(ahead, -shift, axis=1) != ahead for shift in (window, 2 * window)]
    excess = (noise / np.where(fast, 2.0 * gone, np.inf)) ** 2
    taken = {"forward": way["forward"] * (1.0 - excess), "aside": way["aside"] * (1.0 + excess)}
    return taken, fast & ~turned[0] & ~turned[1]


def stands(records: Sequence[Record]) -> bool:
    """Whether a vehicle never moves: its speed is zero, or nothing but noise around it."""
    pieces = [r["v"][s.start : s.stop] for r in records for s in r.segments]
    size = np.sqrt(np.mean(np.concatenate(pieces) ** 2))
    noise = white_noise_std(pieces)
    return bool(size <= 1.2 * noise) or not size


def _inside(runs: Runs) -> np.ndarray:
    """(R, N) all but half a second at both ends of each run, beyond which a delay reaches."""
    edge = max(1, round(WINDOW / runs.dt))
    at = np.arange(runs.length)
    sizes = [b - a for a, b in zip(runs.starts, runs.stops, strict=True)]
    return np.stack([(at >= edge) & (at < size - edge) for size in sizes])
