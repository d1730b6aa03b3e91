"""The body and the road: yaw rate and pose, given how the actuators moved.

Speed and angle are those of the fitted actuators; what the actuators' models leave of them is
passed on by regression (the chain rule of likelihoods), so that one disturbance does not count
twice. Poses count as increments over half a second in the body's frame, which need no start and do
not pile errors up.
"""

from dataclasses import dataclass, replace
from functools import cached_property

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from ...config import CANONICAL
from ...effects import VEHICLE, AbstractEffect, SensorBias, SensorDelay, SensorLag
from ...effects.bank import Bank
from ...effects.base import first_order
from ...effects.misalignment import Misalignment
from ...effects.yaw_offset import YawOffset
from ...models.bicycle import Bicycle
from ...parameters import parameters, with_values
from ...programs import Kept, Static
from ...units import si_symbol
from ..signals.chain import Chain
from ..signals.colour import filter_length, forgetting, least_squares, settled
from ..signals.noise import PER_LAG, Pair, differences, shared

WINDOW = 0.5
"""Length of a pose increment, s."""

LAGS = ("lag", "turning")
NUISANCE = dict.fromkeys(LAGS, (0.0, 0.02)) | {"ahead": (-0.3, 0.3), "slip": (-0.03, 0.03)}
"""What every vehicle has a little of, and that is no finding, with its bounds: lags of the yaw rate
and of the curvature, s (of tyres and body, 6 to 18 ms in real ones: only the latter leaves what the
speed does to the yaw rate); how far the point whose pose is told is ahead of where it is said to
be, in wheelbases; and side slip of the rear by lateral acceleration, rad s^2/m."""

CHANNELS = ("r", "psi", "forward", "aside")
LANES = 8
"""Vectors that a compiled program takes."""
STANDS = 0.05  # of the largest speed, below which a vehicle tells nothing of its angle
_SETTLED = 0.7  # of a channel's samples, that have all of the past that its colour sees


@dataclass(frozen=True, eq=False)
class BodyCause:
    """A cause of the body, the road or a sensor.

    Attributes:
        effect: what it is, off.
        where: as in the contract; `channel` of a sensor.
        names: of its parameters; `units`: theirs.
        lower: their bounds.
        weight: how many parameters it counts as.
    """

    effect: AbstractEffect
    where: str
    channel: str | None = None

    @property
    def cause(self) -> str:
        return self.effect.cause

    @property
    def told(self) -> tuple[str, str, str | None]:
        """What a diagnosis says of it, whichever form it has."""
        return self.cause, self.where, self.channel

    @cached_property
    def names(self) -> tuple[str, ...]:
        return tuple(parameters(self.effect))

    @cached_property
    def units(self) -> tuple[str, ...]:
        own = {"response": si_symbol(CANONICAL[self.channel])} if self.channel in CANONICAL else {}
        return tuple(own.get(p.unit, p.unit) for p in parameters(self.effect).values())

    @cached_property
    def lower(self) -> tuple[float, ...]:
        """A time, of which an effect may know a signed continuation, ends at zero here."""
        known = parameters(self.effect).values()
        return tuple(max(p.lower, 0.0) if p.unit == "s" else p.lower for p in known)

    @cached_property
    def weight(self) -> float:
        return self.effect.weight or float(len(self.names))


SENSORS = (
    ("r", SensorLag()),
    ("r", SensorDelay()),
    ("r", SensorBias()),
    ("delta", SensorLag()),
    ("delta", SensorDelay()),
    ("v", SensorLag()),
    ("v", SensorDelay()),
    ("v", SensorBias()),
    ("psi", SensorBias()),
    ("psi", SensorLag()),
    ("psi", SensorDelay()),
    ("pose", SensorDelay()),
)
"""Which sensor may have which fault. A bias of the angle is the offset of the wheels."""

CAUSES = (
    *(BodyCause(effect, "vehicle") for effect in VEHICLE),
    *(BodyCause(effect, "sensor", channel) for channel, effect in SENSORS),
)
"""The causes of this stage, in the order of their parameters."""

INDEX = tuple(
    tuple(range(a, a + len(c.names)))
    for a, c in zip(
        np.cumsum([len(NUISANCE), *(len(c.names) for c in CAUSES)])[:-1], CAUSES, strict=True
    )
)
"""Where each cause has its parameters; the nuisance ones come first."""

BANK = next(i for i, cause in enumerate(CAUSES) if isinstance(cause.effect, Bank))
"""The number of a road that leans."""

ASKEW = next(i for i, cause in enumerate(CAUSES) if isinstance(cause.effect, Misalignment))
"""The number of wheels that stand askew, which a bias of the angle's sensor is as well."""


@dataclass(frozen=True, eq=False)
class Body:
    """The data of the stage, (runs, N) each.

    Attributes:
        v, delta: responses of the actuators' models as measured, sensors included.
        dv, ddelta: what these leave of the measurement.
        measured: by channel of `CHANNELS`; missing channels are absent.
        mask, held_out: by channel, samples that are fitted and that judge.
        bicycle: geometry; `dt`: sample period, s.
        by_yaw_rate: whether the angle was made of yaw rate and speed: a hypothesis that changes
            the speed changes the angle then, and leaves the yaw rate.
        memory: of the noise of the yaw rate at the most, s; none is set by default.
        yaw_bias: of the yaw rate, rad/s, that was taken out of the angle; it is for a hypothesis to
            say it.
        refuted: numbers of the causes that failed on data held out.
        by_course: whether neither heading nor yaw rate is known: the way is told along the course
            then, by `along_course`.
        repeats: runs with the same commands, whose noise is that of all where both are fitted.
    """

    v: Float[np.ndarray, "R N"]
    delta: Float[np.ndarray, "R N"]
    dv: Float[np.ndarray, "R N"]
    ddelta: Float[np.ndarray, "R N"]
    measured: dict[str, np.ndarray]
    mask: dict[str, Bool[np.ndarray, "R N"]]
    held_out: dict[str, Bool[np.ndarray, "R N"]]
    bicycle: Bicycle
    dt: float
    by_yaw_rate: bool = False
    refuted: tuple[int, ...] = ()
    repeats: tuple[Pair, ...] = ()
    yaw_bias: float = 0.0
    memory: float | None = None
    by_course: bool = False

    def without(self, cause: int) -> "Body":
        """The same without one more cause."""
        return replace(self, refuted=(*self.refuted, cause))

    @cached_property
    def window(self) -> int:
        """Rows of a pose increment."""
        return max(1, round(WINDOW / self.dt))

    @cached_property
    def order(self) -> dict[str, int]:
        """Of each channel's colour: lower where its samples come in short stretches."""
        found = {}
        for c, mask in self.mask.items():
            order = filter_length(self.dt, int(mask.sum()))
            while order > 1 and settled(mask, order).sum() < _SETTLED * mask.sum():
                order //= 2
            found[c] = order
        return found

    @cached_property
    def counted(self) -> dict[str, Bool[np.ndarray, "R N"]]:
        """Samples of each channel whose innovations count."""
        return {c: settled(mask, self.order[c]) for c, mask in self.mask.items()}

    @cached_property
    def _repeated(self) -> dict[str, Bool[np.ndarray, "P N"]]:
        """Rows of the differences of repeats whose past is known; of channels with enough."""
        found = {}
        for c, mask in self.mask.items():
            counted = settled(shared(self.repeats, mask), self.order[c])
            if counted.sum() >= PER_LAG * self.order[c]:
                found[c] = counted
        return found

    def noise(
        self, channel: str, left: Float[np.ndarray, "R N"]
    ) -> tuple[Float[np.ndarray, "_ N"], Bool[np.ndarray, "_ N"]]:
        """What tells the colour of a channel's noise, and where it counts: what repeats differ by,
        else the residual itself."""
        if channel not in self._repeated:
            return left, self.counted[channel]
        return differences(self.repeats, left), self._repeated[channel]

    def colour(
        self, channel: str, left: Float[np.ndarray, "R N"], repeated: bool = True
    ) -> Float[np.ndarray, " order"]:
        """Colour of the noise that a residual of a channel is; if `repeated`, of what repeats
        differ by where there are some."""
        order = self.order[channel]
        told = self.noise(channel, left) if repeated else (left, self.counted[channel])
        colour = least_squares(*told, order)
        if self.memory is None or channel != "r":
            return colour
        return colour * forgetting(order, self.memory, self.dt)

    @property
    def nuisance(self) -> tuple[int, ...]:
        """The nuisance parameters that the channels at hand could show."""
        return tuple(range(len(NUISANCE if "aside" in self.measured else LAGS)))

    @cached_property
    def chain(self) -> Chain:
        """What the residuals upstream of each channel pass on to it."""
        wheelbase = float(self.bicycle.wheelbase)
        parts = (self.v, self.delta, self.dv, self.ddelta, self.mask)
        return Chain(*parts, wheelbase, self.window, self.dt)

    @cached_property
    def everywhere(self) -> Chain:
        """The same over all samples, counted or not."""
        return replace(self.chain, mask={c: np.ones_like(m) for c, m in self.mask.items()})

    @property
    def allowed(self) -> tuple[int, ...]:
        """Causes that the channels at hand could show."""
        hidden: set[tuple[str, str | None]] = set()
        if "forward" not in self.measured:
            hidden |= {("speed_scale", None), ("sensor_bias", "v"), ("sensor_delay", "pose")}
            if self.by_yaw_rate:
                hidden |= {("sensor_lag", "v"), ("sensor_delay", "v")}
        if "aside" not in self.measured or self.by_course:  # a course has no side
            hidden |= {("bank", None), ("sensor_bias", "psi")}
            hidden |= {("sensor_lag", "psi"), ("sensor_delay", "psi")}
        yaw = {("sensor_lag", "r"), ("sensor_delay", "r")}
        if self.yaw_bias == 0.0:
            yaw |= {("sensor_bias", "r")}
        else:  # then the wheels of the path stand as those of the yaw rate without it
            hidden |= {("offset", None)}
        return tuple(
            i
            for i, c in enumerate(CAUSES)
            if i not in self.refuted
            and not (self.by_yaw_rate and isinstance(c.effect, YawOffset))
            and (c.cause, c.channel) not in hidden
            and ("r" in self.measured or (c.cause, c.channel) not in yaw)
        )

    def simulate(self, theta: Float[np.ndarray, "L P"]) -> dict[str, Float[np.ndarray, "L R N"]]:
        """Every channel at each vector."""
        parts = []
        for start in range(0, len(theta), LANES):
            turned, moved, _ = self._moved(theta[start : start + LANES], self.v, self.delta)
            parts.append((turned, *moved))
        joined = [np.concatenate(x) for x in zip(*parts, strict=True)]
        return {c: y for c, y in zip(CHANNELS, joined, strict=True) if c in self.measured}

    def travel(
        self, theta: Float[np.ndarray, " P"], v: np.ndarray, delta: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """Yaw rate and pose, (runs, N) each, from speeds and angles; poses begin at zero."""
        r, _, pose = self._moved(theta[None], v, delta)
        return r[0], *(x[0] for x in pose)

    def _moved(self, theta: Float[np.ndarray, "L P"], v: np.ndarray, delta: np.ndarray):
        """Yaw rates, increments and poses of no more vectors than a program takes."""
        padded = np.concatenate([theta, np.repeat(theta[:1], LANES - len(theta), axis=0)])
        how = Static((self.by_yaw_rate, self.by_course, self.window))
        told = np.asarray(self.dt), np.asarray(self.yaw_bias)
        moved = _simulate(padded, v, delta, self.bicycle, *told, how)
        return jax.tree.map(lambda x: np.asarray(x)[: len(theta)], moved)


def increments(x, y, psi, window: int, xp=np):
    """Change of heading, and way forward and aside in the body's frame, over `window` rows from
    each; the last rows repeat."""

    def ahead(values):
        tail = xp.repeat(values[..., -1:], window, axis=-1)
        return xp.concatenate([values[..., window:], tail], axis=-1) - values

    dx, dy, turned = ahead(x), ahead(y), ahead(psi)
    c, s = xp.cos(psi), xp.sin(psi)
    return turned, c * dx + s * dy, c * dy - s * dx


def along_course(x, y, v, window: int, xp=np):
    """Way forward over `window` rows, and how much further aside the next such way leads, m, of a
    vehicle whose heading nobody knows: in the frame of both ways together, whose direction noise
    turns least. Backwards where the speed is negative."""

    def ahead(values):
        tail = xp.repeat(values[..., -1:], window, axis=-1)
        return xp.concatenate([values[..., window:], tail], axis=-1)

    first = ahead(x) - x, ahead(y) - y
    then = tuple(ahead(part) for part in first)
    whole = first[0] + then[0], first[1] + then[1]
    stays = (whole[0] == 0.0) & (whole[1] == 0.0)
    length = xp.hypot(xp.where(stays, 1.0, whole[0]), whole[1])
    sign = xp.where(v < 0.0, -1.0, 1.0) / length
    forward = first[0] * whole[0] + first[1] * whole[1]
    aside = 2.0 * (first[0] * then[1] - first[1] * then[0])
    return {"forward": sign * forward, "aside": sign * aside}


@Kept
def _simulate(theta, v, delta, bicycle: Bicycle, dt, yaw_bias, how: Static):
    by_yaw_rate, by_course, window = how.value

    def one(vector, v, delta):
        r, x, y, psi = _motion(vector, v, delta, bicycle, dt, by_yaw_rate, yaw_bias)
        if by_course:
            course = along_course(x, y, v, window, jnp)
            way = psi, course["forward"], course["aside"]  # and no heading is measured
        else:
            way = increments(x, y, psi, window, jnp)
        return r, way, (x, y, psi)

    over_runs = jax.vmap(one, in_axes=(None, 0, 0))
    return jax.vmap(over_runs, in_axes=(0, None, None))(theta, v, delta)


def _motion(vector, v, delta, bicycle, dt, by_yaw_rate, yaw_bias):
    yaw_lag, turning, ahead, slip = vector[: len(NUISANCE)]
    sensed: dict[str, Array] = {}
    at, effects = len(NUISANCE), []
    for cause in CAUSES:
        own = vector[at : at + len(cause.names)]
        at += len(cause.names)
        if cause.channel is not None:
            sensed[f"{cause.channel} {cause.cause}"] = own[0]
            continue
        effects.append(with_values(cause.effect, own))
    told = v
    v = _unsensed(v - sensed["v sensor_bias"], sensed["v sensor_lag"], sensed["v sensor_delay"], dt)
    delta = _unsensed(delta, sensed["delta sensor_lag"], sensed["delta sensor_delay"], dt)
    for effect in effects:
        v, delta = effect.speed(v), effect.angle(delta)
    if by_yaw_rate:
        slow = jnp.abs(v) < STANDS * jnp.max(jnp.abs(v))
        per_speed = jnp.where(slow, 0.0, 1.0 / jnp.where(slow, 1.0, v))
        left = jnp.where(yaw_bias == 0.0, 0.0, yaw_bias - sensed["r sensor_bias"])
        unexplained = left * bicycle.wheelbase
        tangent = jnp.tan(delta) * jnp.where(slow, 1.0, told * per_speed)
        delta = jnp.arctan(tangent + unexplained * per_speed)
    beta = bicycle.slip_angle(delta)
    kappa = bicycle.course(delta)[2]
    for effect in effects:
        beta, kappa = effect.course(beta), effect.curvature(kappa, v)
    for effect in effects:
        kappa = effect.relaxed(kappa, v, dt)
    kappa = _lagged(kappa, turning, dt)
    r = _lagged(v * kappa, yaw_lag, dt)

    def run(values):
        return jnp.concatenate([jnp.zeros(1), jnp.cumsum(0.5 * (values[1:] + values[:-1]) * dt)])

    psi = run(r)
    beta = beta + kappa * (ahead * bicycle.wheelbase - slip * v**2)
    # a heading that is told too large turns the path to the right of it
    beta = beta - sensed["psi sensor_bias"]
    x, y = run(v * jnp.cos(psi + beta)), run(v * jnp.sin(psi + beta))
    psi = _shifted(_lagged(psi, sensed["psi sensor_lag"], dt), sensed["psi sensor_delay"] / dt)
    x, y, psi = (_shifted(p, sensed["pose sensor_delay"] / dt) for p in (x, y, psi))
    r = _shifted(_lagged(r, sensed["r sensor_lag"], dt), sensed["r sensor_delay"] / dt)
    return r + sensed["r sensor_bias"], x, y, psi


def _unsensed(y, lag, late, dt):
    """The signal whose measurement, by a sensor with a lag and a delay, is the smooth `y`."""
    slope = jnp.gradient(y, dt)
    return _shifted(y + lag * slope, -late / dt)


def _shifted(y, steps):
    """`y` later by so many rows, by cubic interpolation."""
    whole = jnp.floor(steps)
    f = 1.0 - (steps - whole)
    at = jnp.arange(y.shape[0]) - whole.astype(int) - 1
    a, b, c, d = (y[jnp.clip(at + k, 0, y.shape[0] - 1)] for k in (-1, 0, 1, 2))
    return b + 0.5 * f * (c - a + f * (2 * a - 5 * b + 4 * c - d + f * (3 * (b - c) + d - a)))


def _lagged(y, tau, dt):
    """A first-order lag, exact for an input that is linear between rows: exactly `y` at zero."""
    return first_order(y, jnp.full_like(y, dt) / jnp.maximum(tau, 1e-9))
