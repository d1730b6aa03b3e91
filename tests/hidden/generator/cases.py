"""Cases in, drives out: everything about a lane follows from its `Case`, whatever the batch."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from . import driving, in_actuators, in_vehicle, noise
from .causes import CATALOGUE, OUTSIDE, SIZES, CauseTruth, Drawn, Setting
from .vehicle import Actuator, Lane, Vehicle, random_plant, random_vehicle, simulate

AT_ONCE = 64
"""Cases that are simulated in one loop: more would not be faster, only larger."""

_AT_STANDSTILL = ("dead_zone", "coulomb_friction")
"""Causes in the powertrain that are an offset unless the vehicle stops or reverses."""


@dataclass(frozen=True)
class Case:
    """One vehicle (or plant) with its hidden causes, and how it is driven and logged.

    Attributes:
        cause: (word, where) of each cause; empty: none. A sensor's `where` is "sensor:v".
        size: "small", "middle" or "large", of all its causes.
        seed: of the vehicle, the driving, the noise and the causes' parameters; cases that differ
            only in cause and size are the same drive.
        driving: "rich", "plain" or "two_level".
        runs, duration, dt: number of runs, and their length and row distance in s.
        repeat: the second run has the commands of the first.
        parking: each run stops and reverses for a while; None: as the seed has it, and always
            for a cause that acts only there.
        imu: log the column a, too.
    """

    cause: tuple[tuple[str, str], ...] = ()
    size: str = "middle"
    seed: int = 0
    driving: str = "rich"
    runs: int = 3
    duration: float = 60.0
    dt: float = 0.02
    repeat: bool = False
    parking: bool | None = None
    imu: bool = False

    def __post_init__(self):
        if self.driving not in driving.STYLES:
            raise ValueError(f"driving {self.driving!r}; one of {', '.join(driving.STYLES)}")
        if self.size not in SIZES:
            raise ValueError(f"size {self.size!r}; one of {', '.join(SIZES)}")


Run = dict[str, np.ndarray]


@dataclass(frozen=True)
class Truth:
    """What the diagnosis is judged by.

    Attributes:
        causes: word, place and parameters of each.
        response: of each run the channels without measurement noise and without the unpredictable
            disturbances, from the true start, and not yet rounded where a sensor rounds: what the
            best of all simulations would say.
        noise_std: standard deviation of the measurement noise by channel, SI.
        machine: the vehicle, or the single plant.
    """

    causes: tuple[CauseTruth, ...]
    response: list[Run]
    noise_std: dict[str, float]
    machine: Vehicle | Actuator


@dataclass(frozen=True)
class Drive:
    """The runs of one case, column name -> array in SI; `clean_runs` lack only the causes.

    `geometry`: (l_f, l_r) in m as told to the user, None for a single plant.
    """

    case: Case
    runs: list[Run]
    clean_runs: list[Run]
    truth: Truth
    geometry: tuple[float, float] | None
    dt: float


@dataclass
class _Prepared:
    case: Case
    t: np.ndarray
    commands: list[np.ndarray]
    machine: Vehicle | Actuator
    noise: np.ndarray
    std: np.ndarray
    disturbance: np.ndarray
    starts: list[list[float]]
    headings: np.ndarray
    causes: list[Drawn] = field(default_factory=list)

    @property
    def vehicle(self) -> Vehicle | None:
        return self.machine if isinstance(self.machine, Vehicle) else None

    @property
    def actuators(self) -> list[Actuator]:
        if isinstance(self.machine, Vehicle):
            return [self.machine.powertrain, self.machine.steering]
        return [self.machine]


def generate(cases: Sequence[Case]) -> list[Drive]:
    """Drives of vehicles in the order of the cases; columns as in the contract."""
    return _made(cases, _vehicle_case)


def siso(cases: Sequence[Case]) -> list[Drive]:
    """Drives of single plants with columns t, u, y; causes sit at "plant"."""
    return _made(cases, _plant_case)


def draw(cause: tuple[str, str], size: str, seed: int, which: int, **setting) -> Drawn:
    """The parameters of one cause, which is number `which` of its case."""
    word, where = cause
    allowed = {**CATALOGUE, **OUTSIDE}
    if word not in allowed:
        raise ValueError(f"unknown cause {word!r}; one of {', '.join(allowed)}")
    if where not in allowed[word]:
        raise ValueError(f"{word} cannot sit at {where!r}; one of {', '.join(allowed[word])}")
    rng = np.random.default_rng([seed, 40, which, list(allowed).index(word)])
    factor = SIZES[size] * float(np.exp(rng.uniform(-0.18, 0.18)))
    place, _, channel = where.partition(":")
    of_vehicle = place in ("vehicle", "sensor") or word == "drag"
    table = in_vehicle.DRAWS if of_vehicle else in_actuators.DRAWS
    return table[word](
        Setting(rng=rng, word=word, where=place, channel=channel or None, size=factor, **setting)
    )


def _times(case: Case) -> np.ndarray:
    return np.arange(round(case.duration / case.dt) + 1) * case.dt


def _runs(case: Case) -> list[int]:
    """Which commands each run has."""
    return [0 if run == 1 and case.repeat else run for run in range(case.runs)]


def _vehicle_case(case: Case) -> _Prepared:
    vehicle, t = random_vehicle(case.seed), _times(case)
    parking = case.parking
    if parking is None:
        parking = case.driving == "rich" and (
            bool(np.random.default_rng([case.seed, 31]).random() < 0.5)
            or any(word in _AT_STANDSTILL and at == "powertrain" for word, at in case.cause)
        )
    commands = []
    for run in _runs(case):
        rng = np.random.default_rng([case.seed, 30, run])
        fixed = np.random.default_rng([case.seed, 32])
        v = driving.speed(rng, fixed, t, case.driving, parking)
        wheelbase = vehicle.l_f + vehicle.l_r
        delta = driving.steering(rng, fixed, t, case.driving, v, wheelbase)
        commands.append(np.column_stack([v, delta]))
    drawn, std = noise.measurement(case.seed, case.runs, len(t), case.dt)
    pieces = round(case.duration / noise.COARSE) + 1
    rolling = float(vehicle.rolling_start)
    start = np.random.default_rng([case.seed, 33])
    return _with_causes(
        _Prepared(
            case=case,
            t=t,
            commands=commands,
            machine=vehicle,
            noise=drawn,
            std=std,
            disturbance=noise.disturbance(case.seed, case.runs, pieces, None),
            starts=[[rolling * c[0, 0], 0.0] for c in commands],
            headings=start.uniform(-np.pi, np.pi, case.runs),
        )
    )


def _plant_case(case: Case) -> _Prepared:
    (plant, amplitude), t = random_plant(case.seed), _times(case)
    commands = []
    for run in _runs(case):
        rng = np.random.default_rng([case.seed, 30, run])
        fixed = np.random.default_rng([case.seed, 32])
        u = driving.generic(rng, fixed, t, case.driving, amplitude, plant.time)
        commands.append(u[:, None])
    size = plant.gain * amplitude
    drawn, std = noise.generic_measurement(case.seed, case.runs, len(t), case.dt, size)
    pieces = round(case.duration / noise.COARSE) + 1
    disturbed = float(np.random.default_rng([case.seed, 34]).uniform(0.003, 0.01)) * amplitude
    return _with_causes(
        _Prepared(
            case=case,
            t=t,
            commands=commands,
            machine=plant,
            noise=drawn,
            std=std,
            disturbance=noise.disturbance(case.seed, case.runs, pieces, (disturbed,)),
            starts=[[float(c[0, 0])] for c in commands],
            headings=np.zeros(case.runs),
        )
    )


def _with_causes(one: _Prepared) -> _Prepared:
    for which, cause in enumerate(one.case.cause):
        setting = {
            "commands": one.commands,
            "t": one.t,
            "actuators": one.actuators,
            "vehicle": one.vehicle,
        }
        one.causes.append(draw(cause, one.case.size, one.case.seed, which, **setting))
    return one


def _lane(one: _Prepared, run: int, *, causes: bool, disturbed: bool) -> Lane:
    lane = Lane(
        actuators=one.actuators,
        commands=one.commands[run],
        disturbance=one.disturbance[:, run] * float(disturbed),
        start=one.starts[run],
        effects=[],
        vehicle=one.vehicle,
        heading=float(one.headings[run]),
    )
    for cause in one.causes if causes else []:
        effects = cause.effects + (cause.per_run[run] if cause.per_run else [])
        lane = replace(lane, **cause.lane, effects=lane.effects + effects)
        if cause.static:
            place, change = cause.static
            lane.commands = lane.commands.copy()
            lane.commands[:, place] = change(lane.commands[:, place])
    return lane


def _made(cases: Sequence[Case], prepare) -> list[Drive]:
    drives: dict[int, Drive] = {}
    alike: dict[tuple[float, float], list[int]] = {}
    for i, case in enumerate(cases):
        alike.setdefault((case.duration, case.dt), []).append(i)
    for (_, dt), members in alike.items():
        for first in range(0, len(members), AT_ONCE):
            batch = members[first : first + AT_ONCE]
            prepared = [prepare(cases[i]) for i in batch]
            drives |= zip(batch, _driven(prepared, dt), strict=True)
    return [drives[i] for i in range(len(cases))]


def _driven(prepared: list[_Prepared], dt: float) -> list[Drive]:
    """Three lanes for each run: with disturbances, without causes, and without disturbances."""
    lanes, where = [], {}
    for i, one in enumerate(prepared):
        for run in range(one.case.runs):
            for kind, causes, disturbed in (
                ("run", True, True),
                ("ideal", True, False),
                ("clean", False, True),
            ):
                if kind == "clean" and not one.causes:
                    where[i, run, kind] = where[i, run, "run"]
                    continue
                where[i, run, kind] = len(lanes)
                lanes.append(_lane(one, run, causes=causes, disturbed=disturbed))
    out = simulate(lanes, dt)
    drives = []
    for i, one in enumerate(prepared):

        def table(run, kind, one=one, i=i):
            return _table(one, run, out[:, :, where[i, run, kind]], kind)

        runs, clean, ideal = (
            [table(run, kind) for run in range(one.case.runs)] for kind in ("run", "clean", "ideal")
        )
        names = noise.CHANNELS if one.vehicle else ("y",)
        truth = Truth(
            tuple(cause.truth for cause in one.causes),
            ideal,
            {name: float(std) for name, std in zip(names, one.std, strict=True)},
            one.machine,
        )
        told = (one.vehicle.l_f, one.vehicle.l_r) if one.vehicle else None
        drives.append(Drive(one.case, runs, clean, truth, told, dt))
    return drives


def _table(one: _Prepared, run: int, channels: np.ndarray, kind: str) -> Run:
    """Columns of a run from its channels (rows, channel), with what the sensors do to them."""
    measured = channels.copy() if kind == "ideal" else channels + one.noise[:, run]
    if kind != "clean":
        for cause in one.causes:
            for c, bias in cause.bias.items():
                measured[:, c] += bias
    if kind == "run":
        for cause in one.causes:
            for c, step in cause.step.items():
                measured[:, c] = np.round(measured[:, c] / step) * step
    if not one.vehicle:
        return {"t": one.t.copy(), "u": one.commands[run][:, 0].copy(), "y": measured[:, 0]}
    table = {"t": one.t.copy()}
    table |= {"v_cmd": one.commands[run][:, 0].copy(), "delta_cmd": one.commands[run][:, 1].copy()}
    table |= {name: measured[:, c].copy() for c, name in enumerate(noise.CHANNELS)}
    if not one.case.imu:
        del table["a"]
    return table
