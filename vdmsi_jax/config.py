"""The configuration: what a TOML file may say about a vehicle, its logs, and what to do with them.

Every table is a frozen dataclass here, and `vdmsi_jax.decode` fills it strictly. The tables, in the
order of the way that a log takes: `[columns]`, `[units]`, `[sign]` (names and units to SI),
`[select]` (which rows), `[prepare]` (sampling, gaps, repairs), `[derive]` (channels that follow
from others), `[vehicle]` (geometry), `[[plants]]` (which channel answers to which; `[plant]`, where
there is one), `[identify]` and `[sweep]`.
"""

import dataclasses
import math
import operator
from collections.abc import Collection, Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import ClassVar, Literal

from .decode import decode, load_toml
from .errors import InputError, nearest, refuse_unknown_words, require
from .geometry import VehicleGeometry as VehicleGeometry
from .geometry import refuse_no_geometry
from .units import unit

CANONICAL = {
    "t": "time",
    "v_cmd": "speed",
    "delta_cmd": "angle",
    "v": "speed",
    "delta": "angle",
    "r": "angular rate",
    "x": "length",
    "y": "length",
    "psi": "angle",
    "a": "acceleration",
}
"""The canonical columns of a log and the quantity that each measures (the log format in the
README)."""

POSE = ("x", "y", "psi")

STEERING_CHANNELS = ("delta_cmd", "delta")
"""Road-wheel angles. They may be logged as the curvature of the path, which the wheelbase turns
into an angle."""


@dataclass(frozen=True)
class PlantSpec:
    """A single-input single-output plant to identify.

    Attributes:
        name: what it is called in results (`powertrain`, `steering`, ...).
        input: the channel that drives it; a table may call it `command`.
        output: the channel that answers; likewise `response`.
    """

    name: str
    input: str
    output: str

    def __post_init__(self):
        problem = f"is its input {self.input!r}, too"
        require(self.input != self.output, self, "output", problem, "name what answers to it")

    @property
    def channels(self) -> tuple[str, str]:
        """Both channels."""
        return self.input, self.output

    @property
    def role(self) -> str:
        """What it is in a vehicle, whatever it is called: `powertrain` and `steering` answer by the
        speed and the wheels' angle to the commands of these (or have that name); else `plant`."""
        for own in DEFAULT_PLANTS:
            if self.output == own.output and (self.input == own.input or self.name == own.name):
                return own.name
        return "plant"


DEFAULT_PLANTS = (
    PlantSpec("powertrain", "v_cmd", "v"),
    PlantSpec("steering", "delta_cmd", "delta"),
)
"""The paper's two actuators: what is identified when a configuration names no plants."""

_SINGLE = (
    PlantSpec("plant", "command", "response"),
    PlantSpec("plant", "input", "output"),
    PlantSpec("plant", "u", "y"),
)
"""Usual names of a plant that is no vehicle's: of a log without the channels of a vehicle's."""
_OTHERWISE = {"command": "input", "response": "output"}  # how a table may call a plant's channels


def plants_among(channels: Collection[str]) -> tuple[PlantSpec, ...]:
    """The plants of logs with these channels that name none: the paper's two, else a single one
    (`command` and `response`, `input` and `output`, or `u` and `y` where `y` is none of a pose)."""
    both = [plant for plant in DEFAULT_PLANTS if {*plant.channels} <= {*channels}]
    if both or "x" in channels:
        return tuple(both)
    return tuple(plant for plant in _SINGLE if {*plant.channels} <= {*channels})[:1]


@dataclass(frozen=True)
class Select:
    """Which rows of the log count.

    Attributes:
        where: an expression over the columns of the file as they are written there (their names,
            their units), such as `phase == "calib" and cmd > 0.5`. Rows for which it is false
            become gaps.
    """

    where: str | None = None


@dataclass(frozen=True)
class Prepare:
    """How a log becomes evenly sampled segments without holes. Every repair is told in
    `Record.repairs`.

    Attributes:
        dt: sample period, s; the log's own if not given. A longer one thins out: of measurements
            those at its samples are taken, of commands the means over a sample.
        jitter: how far a time stamp may lie off the even grid, as a share of dt, before the log
            counts as irregular and is resampled. Rounding of printed time stamps is told apart from
            jitter and is never resampled.
        gap: a hole between rows longer than this, s, ends a segment; 5 sample periods if not given
            (and of a channel that is logged less often, for `missing`, 5 of its own).
        duplicates: rows with the time stamp of the row before: `refuse` the log, or `drop` them.
        missing: empty, NaN or infinite cells in a used column: `refuse` the log, cut the rows out
            (`gap`), or fill holes not longer than `gap` by the last value (`hold`) or by the rule
            of the channel (`interpolate`: commands hold, measurements are interpolated); longer
            holes become gaps.
        hold: channels held between rows like commands, beside those whose name ends in `_cmd`.
        unwrap: angles that are logged wrapped.
        warm_up: s cut from the start of every run.
        min_segment: pieces between gaps with fewer samples are left out.
    """

    dt: float | None = None
    jitter: float = 0.05
    gap: float | None = None
    duplicates: Literal["refuse", "drop"] = "refuse"
    missing: Literal["refuse", "gap", "hold", "interpolate"] = "refuse"
    hold: tuple[str, ...] = ()
    unwrap: tuple[str, ...] = ("psi",)
    warm_up: float = 0.0
    min_segment: int = 10

    def __post_init__(self):
        refuse_unknown_words(self)
        for name in ("dt", "gap"):
            value = getattr(self, name)
            fine = value is None or (math.isfinite(value) and value > 0.0)
            require(fine, self, name, f"{value} is no duration", "give seconds, more than zero")
        problem = f"{self.jitter} is out of range"
        require(0 < self.jitter < 0.5, self, "jitter", problem, "give a share, 0 to 0.5")
        fine = math.isfinite(self.warm_up) and self.warm_up >= 0.0
        problem = f"{self.warm_up} is no duration"
        require(fine, self, "warm_up", problem, "give seconds, zero or more")
        problem = f"{self.min_segment} is too few"
        require(self.min_segment >= 2, self, "min_segment", problem, "give 2 or more")


RULES = (
    "steering_from_yaw_rate",
    "yaw_rate_from_steering",
    "yaw_rate_from_heading",
    "speed_from_pose",
    "heading_from_path",
    "heading_from_path_and_steering",
    "acceleration_from_speed",
)
"""The named rules of `[derive]`; `vdmsi_jax.data.derive` holds their formulas."""


@dataclass(frozen=True)
class Derivation:
    """One channel that follows from others: by a named rule, or by an expression with its unit.

    Attributes:
        rule: one of `RULES`. A bare text in the file means this.
        expression: arithmetic over channels in SI, such as `kappa_cmd * v`; needs `unit`.
        unit: the unit of the expression's value.
        speed, steering, yaw_rate: the channels that a rule takes as such. Where no steering is
            given, a yaw rate follows from `delta_cmd`, a heading from `delta`.
        min_speed: m/s, below which a steering angle cannot be told from the yaw rate and is filled
            in.
        window: s, length of the local parabola that differentiates a measurement; 5 samples if not
            given.
    """

    shorthand: ClassVar[str] = "rule"

    rule: str | None = None
    expression: str | None = None
    unit: str | None = None
    speed: str = "v"
    steering: str = ""
    yaw_rate: str = "r"
    min_speed: float = 0.3
    window: float | None = None

    def __post_init__(self):
        fine = (self.rule is None) != (self.expression is None)
        mend = f"rules are {', '.join(RULES)}"
        require(fine, self, "", "needs either a rule or an expression", mend)
        fine = self.rule is None or self.rule in RULES
        problem = f"unknown rule {self.rule!r}"
        require(fine, self, "rule", problem, nearest(self.rule or "", RULES))
        fine = self.expression is None or self.unit is not None
        require(fine, self, "unit", "missing", 'give that of the expression, as unit = "rad/s"')
        fine = self.window is None or 0.0 < self.window < math.inf
        require(fine, self, "window", f"{self.window} is no duration", "give seconds")
        usual = "delta" if self.rule == "heading_from_path_and_steering" else "delta_cmd"
        object.__setattr__(self, "steering", self.steering or usual)
        problem = f"{self.min_speed} is no limit"
        require(self.min_speed > 0.0, self, "min_speed", problem, "give m/s, more than zero")


@dataclass(frozen=True)
class IdentifyOptions:
    """How plants are identified.

    Attributes:
        poles: numbers of poles of the order grid.
        zeros: numbers of zeros of the order grid.
        delay: whether a transport delay is a parameter; a number is its upper bound in s.
        offset: whether a constant offset of the output is a parameter.
        held_out: share of the record that no fit sees. If not given, a quarter, or nothing where a
            log is too short for that.
        split: what is held out: `blocks` of each segment, or whole runs (`run`). If not given,
            whole runs where there are three or more.
        fit_loss: points of FIT that the paper's rule gives up for a smaller order.
    """

    poles: tuple[int, ...] = (1, 2, 3, 4, 5)
    zeros: tuple[int, ...] = (0, 1, 2, 3, 4, 5)
    delay: bool | float = True
    offset: bool = True
    held_out: float | None = None
    split: Literal["blocks", "run"] | None = None
    fit_loss: float = 0.5

    def __post_init__(self):
        refuse_unknown_words(self)
        for name, allowed in (("poles", range(1, 6)), ("zeros", range(6))):
            given = tuple(map(operator.index, getattr(self, name)))
            object.__setattr__(self, name, given)  # NumPy's numbers as Python's
            problem = f"{list(given)} is out of range"
            fine = len(given) > 0 and set(given) <= set(allowed)
            require(fine, self, name, problem, f"choose from {list(allowed)}")
        problem = f"{self.held_out} is no share"
        mend = "give a number from 0 up to, and less than, 1"
        fine = self.held_out is None or 0 <= self.held_out < 1
        require(fine, self, "held_out", problem, mend)
        problem = f"{self.delay} is no bound"
        require(self.delay is False or self.delay > 0, self, "delay", problem, "give seconds")
        problem = f"{self.fit_loss} is negative"
        require(self.fit_loss >= 0.0, self, "fit_loss", problem, "give points of FIT")


@dataclass(frozen=True)
class SweepRun:
    """One log of a sweep, with its own configuration and, if wanted, only some of its plants.

    Attributes:
        log: path of the log, from the sweep file's folder or from the folder of the data sets.
        config: path of its configuration, from the sweep file's folder.
        plants: names of the plants to identify; all, if empty.
    """

    log: str
    config: str | None = None
    plants: tuple[str, ...] = ()


@dataclass(frozen=True)
class SweepOptions:
    """A grid of orders × logs; `[identify]` of the sweep file says which orders.

    Attributes:
        runs: the logs.
    """

    runs: tuple[SweepRun, ...]

    def __post_init__(self):
        mend = 'give runs = [{ log = "run.csv", config = "vehicle.toml" }, ...]'
        require(len(self.runs) > 0, self, "runs", "there are none", mend)


@dataclass(frozen=True)
class Config:
    """A whole configuration file, decoded. `Config()` is what an absent one means.

    Attributes:
        vehicle: geometry, or None for a plant that is no vehicle.
        columns: name of the file's column for each channel (`run` names the column that tells runs
            apart). A canonical channel that is not named here is the column of its own name.
        units: unit of each channel as it is written in the file; SI if not given.
        sign: 1 or -1 for each channel.
        derive: channels that follow from others, in order.
        select: which rows count.
        prepare: sampling, gaps and repairs.
        plants: what to identify; the paper's two actuators if empty.
        identify: options of the identification; None where the file says nothing of it.
        sweep: logs of a sweep.
        path: the file that this was read from.
    """

    vehicle: VehicleGeometry | None = None
    columns: Mapping[str, str] = field(default_factory=dict)
    units: Mapping[str, str] = field(default_factory=dict)
    sign: Mapping[str, float] = field(default_factory=dict)
    derive: Mapping[str, Derivation] = field(default_factory=dict)
    select: Select = field(default_factory=Select)
    prepare: Prepare = field(default_factory=Prepare)
    plants: tuple[PlantSpec, ...] = ()
    identify: IdentifyOptions | None = None
    sweep: SweepOptions | None = None
    path: Path | None = field(default=None, metadata={"toml": False})

    def __post_init__(self):
        refuse_no_geometry(self.vehicle, "Config")
        plants = self.plants or _SINGLE
        known = {*CANONICAL, *self.columns, *(c for p in plants for c in p.channels)}
        for table in ("units", "sign"):
            for channel in getattr(self, table):
                place = f"[{table}] {channel}"
                mend = nearest(channel, known)
                require(channel in known, self, place, "no such channel", mend)
        for channel, name in self.units.items():
            quantities = allowed_quantities(channel, self.canonical)
            unit(name, source="Config", place=f"[units] {channel}", quantities=quantities)
        for channel, factor in self.sign.items():
            problem = f"{factor} is no sign"
            require(factor in (1, -1), self, f"[sign] {channel}", problem, "give 1 or -1")
        for channel, how in self.derive.items():
            if how.unit is not None and channel not in POSE:
                quantities = allowed_quantities(channel, self.canonical)
                place = f"[derive] {channel} unit"
                unit(how.unit, source="Config", place=place, quantities=quantities)
        for name in ("t", "run"):
            mend = "name the derived channel differently"
            require(name not in self.derive, self, f"[derive] {name}", "is no channel", mend)
        fine = len({plant.name for plant in self.plants}) == len(self.plants)
        require(fine, self, "[[plants]] name", "two plants have one name", "rename one of them")

    @property
    def canonical(self) -> dict[str, str]:
        """What canonical names measure in these logs."""
        return canonical_of(self.plants, self.vehicle)

    @property
    def source(self) -> str:
        """The file's path for messages, or `configuration` where there is none."""
        return str(self.path) if self.path else "configuration"


def canonical_of(plants: Iterable[PlantSpec], vehicle: VehicleGeometry | None) -> dict[str, str]:
    """`CANONICAL`, less the names of a pose that plants have taken which are no part of a vehicle:
    `u` and `y` of a plant are its own."""
    foreign = [p for p in plants if vehicle is None or p.input not in CANONICAL]
    own = {c for p in foreign for c in p.channels}
    return {c: q for c, q in CANONICAL.items() if c not in POSE or c not in own}


def allowed_quantities(channel: str, canonical: Mapping[str, str]) -> tuple[str, ...]:
    """What a channel may measure: fixed for canonical ones (a steering angle may be a curvature),
    open for others."""
    if channel not in canonical:
        return ()
    own = canonical[channel]
    return (own, "curvature") if channel in STEERING_CHANNELS else (own,)


def load_config(path: str | Path | None) -> Config:
    """Read a configuration file.

    Args:
        path: a TOML file, or None for the defaults (a log with the canonical header, no vehicle).

    Raises:
        InputError: the file cannot be read, or a table or key in it is unknown, missing, or has a
            wrong value.
    """
    if path is None:
        return Config()
    path = Path(path)
    table = load_toml(path)
    if "plant" in table and "plants" in table:
        mend = "make it one of [[plants]], with a name"
        raise InputError(str(path), "[plant]", "stands beside [[plants]]", mend)
    if isinstance(table.get("plant"), dict):  # the only one
        table["plants"] = [{"name": "plant"} | table.pop("plant")]
    plants = table.get("plants")
    for plant in plants if isinstance(plants, list) else []:
        for name, own in _OTHERWISE.items():
            if isinstance(plant, dict) and name in plant and own not in plant:
                plant[own] = plant.pop(name)
    return dataclasses.replace(decode(Config, table, source=str(path)), path=path)
