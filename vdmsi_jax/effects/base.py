"""What an effect is: a cause that transforms a signal at one port of a model, and is exactly the
identity when it is off.

The signal's way through an actuator, with the ports by name::

    command -> [command] -> [held] -> dynamics with [load] and [effort] -> [output] -> response
    response -> [measured] -> measurement, where a row is told; [sensor] of a channel's sensor

`command` and `measured` see the rows of the record, where commands are held; the other ports see
sub-steps, finer than the rows, so that effects with memory (play, friction, a limited rate) are
discrete operators that are exact there. A vehicle has the ports `speed`, `angle`, `course`,
`curvature` and `relaxed`, which see the bicycle at the rows or at the instants of a quadrature.
"""

import abc
import dataclasses
from collections.abc import Iterable
from typing import Any, ClassVar, TypeVar

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jax import lax
from jax.core import Tracer
from jaxtyping import Array, ArrayLike, Float

from vdmsi_jax.errors import refuse_unknown_words
from vdmsi_jax.parameters import described, parameters
from vdmsi_jax.shown import shown

FORCES = frozenset({"load", "effort"})
_BETWEEN_ROWS = FORCES | {"held", "output", "sensor"}
_ROUNDING = 1e-9  # below which a signal in its unit is none
BODY = frozenset({"speed", "angle", "course", "curvature", "relaxed"})
PORTS = _BETWEEN_ROWS | BODY | {"command", "measured"}


class Signals(eqx.Module):
    """What an effect may look at beside the signal of its port; a row each. A stage holds those of
    several runs, and maps over them.

    Attributes:
        t: time since the start of the run, s.
        v: speed of the vehicle, m/s; zero where there is none.
        other: the command of the other actuator, in its unit; zero where there is none.
        distance: travelled since the start of the run, m.
        slowness: as in `Effort`.
        leads: what a force does earlier than a command, as polynomial `1 + leads[0] q + leads[1]
            q^2` of the plant's own unit of time: zero where it acts beside the command (a position
            servo), the time constant of what lies between where it acts behind that (a lag before
            the body), large where an integrator in the controller makes up for it.
        h: length of a sub-step, s.
        substeps: sub-steps a row.
        before: the command that acted before the first row; None for the first command itself.
        begun: time of the session at which the run began, s.
    """

    t: Float[Array, "*runs N"]
    v: Float[Array, "*runs N"]
    other: Float[Array, "*runs N"]
    distance: Float[Array, "*runs N"]
    slowness: Float[Array, ""]
    leads: Float[Array, "2"]
    h: Float[Array, ""]
    substeps: int = eqx.field(static=True)
    before: Float[Array, ""] | None = None
    begun: Float[Array, "*runs 1"] = eqx.field(default_factory=lambda: jnp.zeros(1))

    def earlier(self, u: Float[Array, " M"]) -> Float[Array, ""]:
        """The command that acted before the first of `u`."""
        return u[0] if self.before is None else self.before

    def clock(self, over: str) -> Float[Array, "*runs N"]:
        """Time by which a change is told, s: of the `session`, or of a run."""
        return self.t + self.begun if over == "session" else self.t

    @staticmethod
    def plain(n: int, dt: float, substeps: int = 1) -> "Signals":
        """The signals of a plant that is no vehicle's, for `n` rows every `dt` seconds."""
        nothing = jnp.zeros(n)
        one, none, h = jnp.ones(()), jnp.zeros(2), jnp.asarray(dt / substeps, float)
        return Signals(dt * jnp.arange(n), nothing, nothing, nothing, one, none, h, substeps)


class Effort(eqx.Module):
    """A plant in one sub-step, as the forces inside it see it.

    Attributes:
        u: the command that acts, its unit.
        y: the response now, its unit.
        rate: of the response at the end of the sub-step if no more force acts, unit/s.
        gain: by how much a unit of force, told as a command, lowers that rate.
        stuck: 1 where the response stood still in the sub-step before, else 0.
        rest: the response to a unit of command that lasts, its unit.
        slowness: seconds of command that a unit of acceleration is worth: the sum of the plant's
            time constants over its gain; where an integrator makes up for it, by the response to it
            before it does.
        lag: command that the response lags behind one that rises, per rate of the response, s.
        h: length of the sub-step, s.
    """

    u: Float[Array, ""]
    y: Float[Array, ""]
    rate: Float[Array, ""]
    gain: Float[Array, ""]
    stuck: Float[Array, ""]
    rest: Float[Array, ""]
    slowness: Float[Array, ""]
    lag: Float[Array, ""]
    h: Float[Array, ""]

    @property
    def level(self) -> Float[Array, ""]:
        """`rest`, kept off zero to divide by."""
        return jnp.where(jnp.abs(self.rest) > 1e-12, self.rest, 1e-12)

    @property
    def still(self) -> Float[Array, ""]:
        """The command that would hold the response where it is, its unit."""
        return self.y / self.level

    def more_pull(self, stiffness: Float[Array, ""]) -> Float[Array, ""]:
        """The force by which something pulls the response back beyond what a linear one pulls,
        which has a stiffness of one; between a tenth and ten times that, or a soft one would push
        away."""
        return (jnp.clip(stiffness, 0.1, 10.0) - 1.0) * self.still


class Scales(eqx.Module):
    """Sizes of a record's signals, to make probes of: a probe is a value that is strictly on.

    Attributes:
        command: range of the command, its unit; `low` and `high` are its 2 and 98 % quantiles.
        response: range of the response; `y_low` and `y_high` likewise.
        rate: typical rate of the modelled response where it moves, unit/s.
        speed: mean speed, m/s; 0 where there is none.
        distance: length of the longest run, m.
        duration: length of a run, s.
        dt: sample period, s.
        time_constant: slowest time constant of the plant, s.
        noise: standard deviation of the response's noise.
        log: length of the longest log, s, of which runs may be parts; zero where they are none.
        session: length of the session, s, of which the runs are parts; zero where they are none.
    """

    low: float
    high: float
    y_low: float
    y_high: float
    rate: float
    speed: float
    distance: float
    duration: float
    dt: float
    time_constant: float
    noise: float
    log: float = 0.0
    session: float = 0.0

    def clock(self, over: str) -> float:
        """How long a clock goes on that changes are told by, s: of the `session`, or of a log."""
        return self.session if over == "session" else max(self.log, self.duration)

    @property
    def command(self) -> float:
        """Range of the command."""
        return self.high - self.low

    @property
    def response(self) -> float:
        """Range of the response."""
        return self.y_high - self.y_low


_Effect = TypeVar("_Effect", bound="AbstractEffect")


class AbstractEffect(eqx.Module):
    """A cause. A subclass overrides the ports that it acts at, and declares its parameters by
    `vdmsi_jax.parameters.parameter`, which puts them into its docstring, too: with their units, in
    which `command` and `response` stand for those of the plant's channels.

    Raises:
        ValueError: an inverse limit is negative: a limit was given in its place.

    Attributes:
        cause: the word of the contract.
        shown_by: what to drive to see it best, as part of a sentence.
        weight: how many parameters it counts as in a comparison, where that is not as many as it
            has: more of a cause whose place in time or frequency is searched over, which fits noise
            more easily, less where some of them hardly ever matter.
        refines: causes in whose place it is tried once they are found, being a finer form of one of
            them; where there are none it is looked for by itself.
    """

    cause: ClassVar[str]
    shown_by: ClassVar[str]
    weight: ClassVar[float] = 0.0
    refines: ClassVar[tuple[str, ...]] = ()

    def __init_subclass__(cls, **options: Any):
        super().__init_subclass__(**options)
        inherited = getattr(cls, "__dataclass_fields__", {})
        own = {k: field for k, field in vars(cls).items() if isinstance(field, dataclasses.Field)}
        if cls.__dict__.get("__doc__"):
            cls.__doc__ = described(cls.__dict__["__doc__"], {**inherited, **own})

    def __repr__(self) -> str:
        return shown(self)

    def __check_init__(self):
        refuse_unknown_words(self)
        for name, known in parameters(self).items():
            size = getattr(self, name)
            if (
                known.shown == "inverse"
                and not isinstance(size, Tracer)
                and np.any(np.asarray(size) < 0)
            ):
                effect, least = type(self).__name__, float(np.min(np.asarray(size)))
                problem = f"{effect}: {name} is {least:g}, and an inverse limit is not negative"
                raise ValueError(f"{problem}; {effect}.of({name}={least:g}) takes the limit itself")

    @classmethod
    def of(cls: type[_Effect], **values: Any) -> _Effect:
        """The effect by limits instead of their inverses: `Saturation.of(lower=-2.0, upper=2.0)`
        cuts at 2, `RateLimit.of(rising=0.5, falling=0.5)` at 0.5 per second.

        Args:
            **values: the attributes. Of a limit its size counts, so that a lower one may be given
                with its sign or without; infinity is none. All others are as in the constructor.

        Raises:
            ValueError: a limit is zero.
        """
        limits = {name for name, known in parameters(cls).items() if known.shown == "inverse"}
        for name in limits & set(values):
            if not isinstance(values[name], Tracer) and np.any(np.asarray(values[name]) == 0.0):
                raise ValueError(f"{cls.__name__}.of: {name} is 0, which lets nothing through")
            values[name] = 1.0 / jnp.abs(jnp.asarray(values[name], float))
        return cls(**values)

    @property
    def ports(self) -> frozenset[str]:
        """Where it acts: the ports that its class overrides. Of a class whose forms act at one port
        each, a form tells its own, and is not asked at the others."""
        return frozenset(
            port for port in PORTS if getattr(type(self), port) is not getattr(AbstractEffect, port)
        )

    @property
    def remembers(self) -> bool:
        """Whether it acts between the rows: at a port other than `command` and `measured`."""
        return not self.ports.isdisjoint(_BETWEEN_ROWS)

    @property
    def hides_small(self) -> bool:
        """Whether small movements of the command do not get through it: where a controller answers
        what disturbs the plant, those are its answers, and an error that knows them looks alike."""
        return False

    def scaled(self, scales: Scales) -> "AbstractEffect":
        """The same effect with its constants set for a record."""
        return self

    @abc.abstractmethod
    def probes(self, scales: Scales) -> list[tuple[float, ...]]:
        """Values of the parameters to screen: finite, strictly on, from barely seen to plain."""

    def command(self, u: Float[Array, " N"], signals: Signals) -> Float[Array, " N"]:
        """The command at the rows."""
        return u

    def held(self, u: Float[Array, " M"], signals: Signals) -> Float[Array, " M"]:
        """The command at the sub-steps, on its way to the dynamics."""
        return u

    def load(self, signals: Signals) -> Float[Array, " M"]:
        """The force at the sub-steps that no motion changes, in the unit of the command."""
        return jnp.zeros(signals.t.shape[0] * signals.substeps)

    def effort(self, at: Effort) -> Float[Array, ""]:
        """The force against the command in one sub-step, in the unit of the command."""
        return jnp.zeros_like(at.u)

    def output(self, y: Float[Array, " M"], signals: Signals) -> Float[Array, " M"]:
        """The response at the sub-steps."""
        return y

    def measured(self, y: Float[Array, " N"], signals: Signals) -> Float[Array, " N"]:
        """The response at the rows: for effects that are slow to compute."""
        return y

    def rested(self, y: Float[Array, ""]) -> Float[Array, ""]:
        """The response at rest behind one that is measured, where what is measured may be far from
        it: that a plant rests at 40 degrees in a room of 40 says that its command does nothing."""
        return y

    def sensor(self, y: Float[Array, " M"], signals: Signals) -> Float[Array, " M"]:
        """What is measured of the response at the sub-steps."""
        return y

    def speed(self, v: Float[Array, " M"]) -> Float[Array, " M"]:
        """Speed over the ground, m/s."""
        return v

    def angle(self, delta: Float[Array, " M"]) -> Float[Array, " M"]:
        """Road-wheel angle, rad."""
        return delta

    def course(self, beta: Float[Array, " M"]) -> Float[Array, " M"]:
        """Angle from the heading to the course, rad."""
        return beta

    def curvature(self, kappa: Float[Array, " M"], v: Float[Array, " M"]) -> Float[Array, " M"]:
        """Curvature of the path, 1/m, at speed `v`, m/s."""
        return kappa

    def relaxed(
        self, kappa: Float[Array, " M"], v: Float[Array, " M"], h: Float[ArrayLike, "..."]
    ) -> Float[Array, " M"]:
        """Curvature at instants that follow each other by `h` seconds (one number, or one for each
        instant: the time since the one before), with a memory of the way."""
        return kappa


def several(effects: AbstractEffect | Iterable[AbstractEffect]) -> tuple[AbstractEffect, ...]:
    """Effects as a tuple; one may stand alone."""
    return (effects,) if isinstance(effects, AbstractEffect) else tuple(effects)


def late(
    y: Float[Array, " M"], steps: Float[Array, ""], before: Float[Array, ""] | None = None
) -> Float[Array, " M"]:
    """`y` later by so many samples, not necessarily whole; `before`, or else the first value,
    stands before them.

    Linear between samples, which is the exact mean over a sub-step of a signal that is held
    between them. Exactly `y` at zero; negative values look ahead.
    """
    whole = jnp.floor(steps)
    rest = steps - whole
    at = jnp.arange(y.shape[0]) - whole.astype(int)
    first = y[0] if before is None else before

    def read(at: Array) -> Array:
        return jnp.where(at < 0, first, y[jnp.clip(at, 0, y.shape[0] - 1)])

    now = read(at)
    return now + rest * (read(at - 1) - now)


def lag(y: Float[Array, " M"], spans: Float[Array, " M"]) -> Float[Array, " M"]:
    """A first-order lag of `y`, exact where `y` is linear between samples.

    Args:
        y: the input; the first value stands before it.
        spans: time constant over the time from each sample's predecessor to it. Exactly `y` where
            it is zero, with the derivative that a small lag has.
    """
    smears = spans > 1e-3  # below that nothing is left of exp(-1 / span)
    steps = 1.0 / jnp.where(smears, spans, 1.0)
    keep = jnp.where(smears, jnp.exp(-steps), 0.0)
    mean = jnp.where(smears, -jnp.expm1(-steps), 1.0) * spans  # of the exponential over the step

    def follow(before: tuple[Array, Array], now: tuple[Array, ...]) -> tuple[tuple, Array]:
        old, last = before
        y, keep, mean = now
        new = y + keep * (old - last) - mean * (y - last)
        return (new, y), new

    return lax.scan(follow, (y[0], y[0]), (y, keep, mean))[1]


def before_lag(y: Float[Array, " M"], span: Float[ArrayLike, ""]) -> Float[Array, " M"]:
    """What a first-order lag made `y` of, at rest before the first value.

    Args:
        y: what comes out.
        span: time constant over the time between values. Exactly `y` where it is zero.
    """
    return y + span * jnp.diff(y, prepend=y[:1])


def moved(
    u: Float[Array, " M"], span: Float[Array, ""], first: Float[Array, ""]
) -> Float[Array, " M"]:
    """What a first-order lag has made of a held signal by the end of each sub-step, exactly.

    Args:
        u: the signal.
        span: time constant over the length of a sub-step. Exactly `u` where it is zero.
        first: what it had made of it before.
    """
    keep = _kept(span)

    def follow(last: Array, now: Array) -> tuple[Array, Array]:
        new = now + keep * (last - now)
        return new, new

    return lax.scan(follow, first, u)[1]


def mover(
    x: Float[Array, " M"], span: Float[Array, ""], first: Float[Array, ""]
) -> Float[Array, " M"]:
    """The held signal of which a first-order lag makes `x` by the end of each sub-step: the inverse
    of `moved`, and as exact."""
    keep = _kept(span)
    return x + keep / (1.0 - keep) * jnp.diff(x, prepend=first[None])


def _kept(span: Float[Array, ""]) -> Float[Array, ""]:
    """Share that a lag keeps of what it was a sub-step before."""
    smears = span > 1e-3
    return jnp.where(smears, jnp.exp(-1.0 / jnp.where(smears, span, 1.0)), 0.0)


def first_order(y: Float[Array, " M"], steps: Float[Array, " M"]) -> Float[Array, " M"]:
    """`lag` by the inverse of its `spans`; where it is beyond 1e5 the output is the input."""
    return lag(y, jnp.where(steps > 1e5, 0.0, 1.0 / steps))


def within(x: Float[Array, "*n"], size: Float[Array, "*#n"]) -> Float[Array, "*n"]:
    """`x`, cut to plus or minus `size`. Unlike `clip`, whose bounds coincide at size zero, it has
    the right derivatives there: the sign of `x` to the size, and none to `x`; of what is nothing
    but rounding (a plant at rest), none to either."""
    sign = jnp.where(jnp.abs(x) < _ROUNDING, 0.0, jnp.sign(x))
    return jnp.where(jnp.abs(x) < size, x, sign * size)
