"""From records to stages: runs side by side, what is held out, and the sizes of the signals."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from ..config import PlantSpec
from ..data.noise import white_noise_std
from ..data.record import Record
from ..data.segment import Segment
from ..effects import ACTUATOR, AbstractEffect, Scales, Signals
from ..models.bicycle import Bicycle
from .body import CHANNELS, WINDOW, Body, increments
from .found import Search
from .held_out import driving, judges
from .noise import KnownNoise, Pair, pairs, repeated
from .stage import Stage
from .windows import moving_mean

_SLOWEST_STEERED = 0.3  # m/s, below which a yaw rate tells no steering angle
_SLOWER_STEERED = 0.5  # of the usual speed, likewise: a lag of either tells when a vehicle sets off
_LONGEST = 6000  # samples of a run that are simulated at once; longer ones are cut
_MOST = 15_000  # samples that are looked at; of more, stretches spread over all of them are
_STRETCH = 2000  # samples of such a stretch
_MOST_RUNS = 24  # that are looked at
_HEADED, _HEADINGS = 4.0, 6  # s, over which headings are compared, and how often at least
_SURELY = 5.0  # standard errors, from which the yaw rate has a bias
_SMOOTH = 0.1  # s, over which a signal is averaged whose plant is not known
_ROW = 0.02  # s, between rows of a vehicle's record
_BLOCKS, _JUDGING = 10, (2, 5, 8)  # parts of a single run, and which of them are held out; others
# are those before

_FOREIGN = {
    "powertrain": {"speed_dependent_gain", "cross_coupling by speed"}
    | {"cross_coupling by acceleration", "offset by travel"},
    "steering": {"drag", "road_grade", "coulomb_friction against response"}
    | {f"cross_coupling by {by}" for by in ("signed", "size", "square", "slowed")},
}
_SESSION = {"gain_drift over session", "regime_change over session"}
_VEHICLES_ONLY = {"cross_coupling", "speed_dependent_gain", "drag", "road_grade"}
_BOTH_WAYS = {"offset by travel"}
_PLANTS_ONLY = {"gain_nonlinearity by stiffness"}  # of a speed that is drag
_REVERSED = 0.05  # of the time, that a vehicle moves the other way if it moves both ways


@dataclass(frozen=True, eq=False)
class Runs:
    """Stretches of records side by side.

    Attributes:
        names: of the runs that they belong to.
        records, starts, stops: where each comes from.
        since: time of each one's first sample since its run began, s.
        judged: of each, the stretches (first, stop) that are held out.
        length: of the longest.
        dt: sample period, s.
    """

    names: tuple[str, ...]
    records: tuple[Record, ...]
    starts: tuple[int, ...]
    stops: tuple[int, ...]
    since: tuple[float, ...]
    judged: tuple[tuple[tuple[int, int], ...], ...]
    dt: float

    @property
    def length(self) -> int:
        """Samples of the longest."""
        return max(b - a for a, b in zip(self.starts, self.stops, strict=True))

    def channel(self, name: str) -> Float[np.ndarray, "R N"]:
        """A channel, padded by its last value; zeros where a record lacks it."""
        return np.stack(
            [self._padded(r[name] if name in r else np.zeros(r.n), i) for i, r in self._each()]
        )

    def seen(self, name: str) -> np.ndarray:
        """(R, N) whether the channel was measured there."""
        rows = []
        for i, record in self._each():
            row = np.zeros(self.length, bool)
            n = self.stops[i] - self.starts[i]
            if name in record:
                row[:n] = record.measured(name)[self.starts[i] : self.stops[i]]
            rows.append(row)
        return np.stack(rows)

    def held(self) -> np.ndarray:
        """(R, N) whether a sample is held out."""
        held = np.zeros((len(self.records), self.length), bool)
        for row, spans in zip(held, self.judged, strict=True):
            for first, stop in spans:
                row[first:stop] = True
        return held

    def whole(self) -> bool:
        """Whether whole records are held out."""
        return any(not spans for spans in self.judged) and any(self.judged)

    def judging(self) -> list[str]:
        """Names of the runs of which some is held out."""
        names = [r for r, spans in zip(self.names, self.judged, strict=True) if spans]
        return list(dict.fromkeys(names))

    def time(self) -> Float[np.ndarray, "R N"]:
        """(R, N) time since the start of the run, s."""
        return np.asarray(self.since)[:, None] + self.dt * np.arange(self.length)

    def travelled(self) -> Float[np.ndarray, "R N"]:
        """(R, N) way since the start of the run, m."""
        ways = {record: record.travelled() for record in set(self.records)}
        return np.stack([self._padded(ways[record], i) for i, record in self._each()])

    def _each(self):
        return enumerate(self.records)

    def _padded(self, values: np.ndarray, i: int) -> np.ndarray:
        own = values[self.starts[i] : self.stops[i]]
        return np.pad(own, (0, self.length - len(own)), mode="edge")


def slower(record: Record) -> Record:
    """A vehicle's record at about 50 Hz, where it was sampled faster: commands are averaged over
    the longer rows, measurements are those at their beginning. A plant that is no vehicle's is left
    as it is, since its time scale is unknown."""
    every = round(_ROW / record.dt)
    if record.vehicle is None or every < 2:
        return record
    parts, index, start = [], [], 0
    for own in record.segments:
        rows = len(own) // every
        if rows:
            index.append(own.start + every * np.arange(rows))
            parts.append(Segment(start, start + rows, own.run))
            start += rows
    at = np.concatenate(index)

    def mean(values: np.ndarray) -> np.ndarray:
        return values[at[:, None] + np.arange(every)].mean(axis=1)

    return replace(
        record,
        dt=record.dt * every,
        t=record.t[at],
        channels={
            name: mean(values) if name.endswith("_cmd") else values[at]
            for name, values in record.channels.items()
        },
        filled={name: mask[at] for name, mask in record.filled.items()},
        segments=tuple(parts),
    )


def lay_out(records: Sequence[Record], whole: bool = True, others: bool = False) -> Runs:
    """Put the segments of records side by side and choose what is held out: a third of the records,
    or, where none can judge the others or whole ones shall not, three tenths of each segment that
    lie apart, since its end may show another regime; `others`, where the usual ones shall not."""
    pieces = []
    judging = judges(records) if whole else None
    many = sum(len(s) for r in records for s in r.segments) > _MOST
    at_once = _STRETCH if many else _LONGEST
    for k, record in enumerate(records):
        for segment in record.segments:
            parts = -(-len(segment) // at_once)
            edges = np.linspace(segment.start, segment.stop, parts + 1).astype(int)
            first = next(s.start for s in record.segments if s.run == segment.run)
            for a, b in zip(edges[:-1], edges[1:], strict=True):
                n = int(b - a)
                if judging is None:
                    spans = _apart(n, others)
                else:
                    spans = ((0, n),) if k in judging else ()
                pieces.append(
                    (
                        segment.run,
                        record,
                        int(a),
                        int(b),
                        float(record.t[a] - record.t[first]),
                        spans,
                    )
                )
    longest = max(p[3] - p[2] for p in pieces)
    long = [p for p in pieces if p[3] - p[2] >= max(40, longest // 20)]
    most = min(_MOST_RUNS, _MOST // (longest if many else 1))
    if len(long) > most:
        picked = np.unique(np.linspace(0, len(long) - 1, most).astype(int))
        long = [long[i] for i in picked]
    columns = zip(*long, strict=True)
    return Runs(*map(tuple, columns), dt=records[0].dt)


def _apart(n: int, others: bool) -> tuple[tuple[int, int], ...]:
    """Stretches of `n` samples that are held out."""
    edges = np.linspace(0, n, _BLOCKS + 1).astype(int)
    return tuple((int(edges[k - others]), int(edges[k - others + 1])) for k in _JUDGING)


def steering_angle(runs: Runs) -> tuple[np.ndarray, np.ndarray] | None:
    """Measured road-wheel angle and where it is known; where it was not logged, from speed and yaw
    rate, less its bias; None where neither was."""
    if all("delta" in r for r in runs.records):
        return runs.channel("delta"), runs.seen("delta")
    vehicle = runs.records[0].vehicle
    if vehicle is None or not all("r" in r and "v" in r for r in runs.records):
        return None
    v, r = runs.channel("v"), runs.channel("r") - yaw_rate_bias(runs)
    seen = runs.seen("r") & runs.seen("v")
    usual = float(np.median(np.abs(v[seen]))) if seen.any() else 0.0
    known = (np.abs(v) > max(_SLOWEST_STEERED, _SLOWER_STEERED * usual)) & seen
    behind = vehicle.rear_to_reference
    bicycle = Bicycle(vehicle.wheelbase - behind, behind)
    curvature = np.where(known, r / np.where(known, v, 1.0), 0.0)
    limit = 0.99 / max(abs(behind), 1e-6)
    angle = np.asarray(bicycle.steering_angle(jnp.asarray(np.clip(curvature, -limit, limit))))
    return angle, known & (np.abs(curvature) < limit)


def yaw_rate_bias(runs: Runs) -> float:
    """What the yaw rate says more than the heading turns, rad/s, of what is fitted; zero where that
    is not sure, or one of them was not logged."""
    if not all("r" in record and "psi" in record for record in runs.records):
        return 0.0
    r, psi = runs.channel("r"), np.unwrap(runs.channel("psi"), axis=1)
    seen = runs.seen("r") & runs.seen("psi") & ~runs.held()
    rows = max(round(_HEADED / runs.dt), 2)
    turned = runs.dt * np.cumsum(0.5 * (r[:, 1:] + r[:, :-1]), axis=1)
    excess = []
    for own, angle, use in zip(turned, psi, seen, strict=True):
        for a in range(0, len(own) - rows, rows):
            b = a + rows
            if use[a : b + 2].all():
                excess.append((own[b] - own[a] - angle[b + 1] + angle[a + 1]) / (rows * runs.dt))
    if len(excess) < _HEADINGS:
        return 0.0
    middle = float(np.median(excess))
    spread = 1.4826 * float(np.median(np.abs(np.array(excess) - middle)))
    sure = abs(middle) > _SURELY * 1.2533 * spread / np.sqrt(len(excess))
    return middle if sure else 0.0


def kind(effect: AbstractEffect) -> str:
    """The cause and which of its forms: `saturation at command`."""
    forms = [
        n for n in ("at", "by", "over", "against") if isinstance(getattr(effect, n, None), str)
    ]
    return " ".join([effect.cause, *(f"{n} {getattr(effect, n)}" for n in forms)])


def stage_of(runs: Runs, spec: PlantSpec, reference: KnownNoise | None = None) -> Stage:
    """The stage of one plant; the noise of its response by a reference, else by runs with the same
    commands where there are any."""
    u = runs.channel(spec.input)
    y, seen = runs.channel(spec.output), runs.seen(spec.output)
    if spec.output == "delta":
        found = steering_angle(runs)
        assert found is not None
        y, seen = found
    v = runs.channel("v")
    other = runs.channel("delta_cmd" if spec.output == "v" else "v_cmd")
    held = runs.held()
    name = spec.name if spec.name in _FOREIGN else "plant"
    is_vehicle = runs.records[0].vehicle is not None and name != "plant"
    foreign = _FOREIGN.get(name, set())
    foreign = foreign | (_PLANTS_ONLY if is_vehicle else _VEHICLES_ONLY | _BOTH_WAYS)
    if u.min() >= 0.0 or u.max() <= 0.0:  # there both forms are one
        foreign = foreign | {"gain_nonlinearity by skew", "quantization by truncation"}
    if min(np.mean(v[seen] > 0.0), np.mean(v[seen] < 0.0)) < _REVERSED:
        foreign = foreign | _BOTH_WAYS
    begun = np.array([[r.session] for r in runs.records])
    if np.ptp(begun) == 0.0:  # there is none, or it is the run
        foreign = foreign | _SESSION
    wheres = tuple("vehicle" if e.cause == "road_grade" else name for e in ACTUATOR)
    allowed = tuple(i for i, e in enumerate(ACTUATOR) if not {e.cause, kind(e)} & foreign)
    shared = (runs.time(), v, other, runs.travelled())
    masks = seen & ~held, seen & held
    stage = make_stage(spec.name, u, y, *masks, shared, allowed, wheres, runs.dt, begun)
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


def make_stage(name, u, y, mask, held_out, shared, allowed, wheres, dt, begun=None) -> Stage:
    """A stage with the sizes of its signals, from arrays."""
    begun = np.zeros((len(u), 1)) if begun is None else begun
    ends = [x[use].max() for x, use in zip(begun + shared[0], mask, strict=True) if use.any()]
    known = mask | held_out
    pieces = [row[use] for row, use in zip(y, known, strict=True) if use.any()]
    lengths = [int(use.sum()) for use in known]
    low, high = np.quantile(u[known], [0.02, 0.98])
    y_low, y_high = np.quantile(y[known], [0.02, 0.98])
    noise = white_noise_std(pieces)
    scales = Scales(
        float(low), float(high), float(y_low), float(y_high),
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
    scales = replace_scales(scales, rate=_typical(rates), time_constant=slow)
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


def replace_scales(scales: Scales, **new: float) -> Scales:
    """The same sizes but some."""
    names = scales.__dataclass_fields__
    values = {name: getattr(scales, name) for name in names} | new
    return Scales(**values)


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
    angle."""
    vehicle = runs.records[0].vehicle
    angle = steering_angle(runs)
    channels = set.intersection(*(set(r.channels) for r in runs.records))
    if vehicle is None or angle is None or "v" not in channels:
        return None
    by_yaw_rate = "delta" not in channels or derived(runs, angle)
    told = "r" in channels and not by_yaw_rate
    posed = {"x", "y", "psi"} <= channels
    if not told and not posed:
        return None
    measured, mask, held_out = {}, {}, {}
    held = runs.held()
    moving = runs.seen("v") & angle[1] & _inside(runs)
    if told:
        measured["r"] = runs.channel("r")
        mask["r"], held_out["r"] = (moving & runs.seen("r") & part for part in (~held, held))
    if posed:
        window = max(1, round(WINDOW / runs.dt))
        x, y, psi = (runs.channel(c) for c in ("x", "y", "psi"))
        seen = runs.seen("x") & runs.seen("y") & runs.seen("psi") & moving
        whole = seen & np.roll(seen, -window, axis=1)
        whole[:, -window:] = False
        for c, values in zip(
            CHANNELS[1:], increments(x, y, np.unwrap(psi, axis=1), window), strict=True
        ):
            measured[c] = values
            mask[c] = whole & ~held & ~np.roll(held, -window, axis=1)
            held_out[c] = whole & held
    v, delta = runs.channel("v"), angle[0]
    smooth = {}
    for name, values, known in (("v", v, runs.seen("v")), ("delta", delta, angle[1])):
        search = searches.get(name)
        model = moving_mean(values, _SMOOTH, runs.dt) if search is None else search.final.y
        smooth[name] = np.where(known, model, values)
    behind = vehicle.rear_to_reference
    bicycle = Bicycle(vehicle.wheelbase - behind, behind)
    return Body(
        smooth["v"], smooth["delta"], v - smooth["v"], delta - smooth["delta"],
        measured, mask, held_out, bicycle, runs.dt, by_yaw_rate, repeats=repeats(runs),
        yaw_bias=0.0 if "delta" in channels else yaw_rate_bias(runs),
    )  # fmt: skip


def _inside(runs: Runs) -> np.ndarray:
    """(R, N) all but half a second at both ends of each run, beyond which a delay reaches."""
    edge = max(1, round(WINDOW / runs.dt))
    at = np.arange(runs.length)
    sizes = [b - a for a, b in zip(runs.starts, runs.stops, strict=True)]
    return np.stack([(at >= edge) & (at < size - edge) for size in sizes])


def derived(runs: Runs, angle: tuple[np.ndarray, np.ndarray]) -> bool:
    """Whether the steering angle was made of the yaw rate, which then tells nothing of its own."""
    vehicle = runs.records[0].vehicle
    if vehicle is None:
        return False
    v, r, known = runs.channel("v"), runs.channel("r"), angle[1] & runs.seen("r")
    behind = vehicle.rear_to_reference
    bicycle = Bicycle(vehicle.wheelbase - behind, behind)
    error = np.abs(np.asarray(bicycle.yaw_rate(v, angle[0])) - r)[known]
    return bool(error.size and np.median(error) < 1e-6 * max(float(np.std(r[known])), 1e-12))
