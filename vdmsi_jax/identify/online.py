"""Recursive identification: a plant that changes during the drive is followed sample by sample.

The recursive prediction-error method in the form of a Kalman filter: the plant's states and its
coefficients are estimated together, the coefficients being constants that may wander (Ljung and
Soderstrom, Theory and Practice of Recursive Identification, 1983, ch. 3; Ljung, Asymptotic behavior
of the extended Kalman filter as a parameter estimator, 1979). Without noise on the states, as here,
its gain is that of a recursive Gauss-Newton search for the least simulation error, so what it
converges to is the offline fit.
"""

from dataclasses import dataclass

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax import lax
from jaxtyping import Array, ArrayLike, Bool, Float

from vdmsi_jax.config import PlantSpec
from vdmsi_jax.data.noise import white_noise_std
from vdmsi_jax.data.record import Record
from vdmsi_jax.errors import InputError
from vdmsi_jax.identify.result import Fit, model_of, place_of, z_of
from vdmsi_jax.models.linear_plant import delayed
from vdmsi_jax.models.state_space import StateSpace
from vdmsi_jax.models.transfer_function import TransferFunction

_OUTLIER = 3.0  # standard deviations of an innovation beyond which noise learns no more
_REDDEST = 0.98  # correlation of neighbours that is believed
_STABLE = -1e-6  # real part of a pole, in units of the pace, to which an unstable one is no match


class Forgetting(eqx.Module):
    """How fast the past loses its say.

    Two ways, since slow wear and sudden change ask for different ones. Exponential forgetting gives
    a sample of age s the weight `exp(-s / memory)`. An alarm gives the coefficients their first
    uncertainty back (covariance resetting: Goodwin and Sin, Adaptive Filtering, 1984, sec. 3.3):
    it is raised when the innovations of the last `window` seconds are larger than noise makes them.

    Attributes:
        memory: s; infinite for a plant that only changes by jumps.
        growth: seconds by which the memory grows in each second from a start or an alarm on, until
            it is `memory`: what was learnt with poor coefficients is poor, and is soon forgotten.
        window: s over which innovations are averaged for an alarm.
        alarm: standard deviations of that average beyond its mean of one.
        spread: standard deviation of the coefficients at a start and after an alarm, relative to
            their values.
    """

    memory: float = 60.0
    growth: float = 3.0
    window: float = 0.5
    alarm: float = 8.0
    spread: float = 0.5

    def __check_init__(self):
        for name in ("memory", "growth", "window", "alarm", "spread"):
            if not getattr(self, name) > 0.0:
                raise ValueError(f"{name} is {getattr(self, name)}; give more than zero")


@dataclass(frozen=True)
class Tracking:
    """What a recursive identification knew at each sample, from the samples up to it.

    Attributes:
        names: of the coefficients (`b1`, `b0`, `a1`, `a0`, `offset`), descending powers of s, the
            leading denominator coefficient being 1.
        parameters: (N, p) estimates, in units of the plant.
        covariance: (N, p, p) of the estimates, for noise as coloured as neighbouring innovations
            tell (first order).
        innovation: (N,) measurement less what was predicted for it, output unit.
        noise_std: (N,) of the measurement, as estimated so far, output unit.
        alarms: (N,) where a change was noticed.
        delay: transport delay, s, which is not estimated; None where there is none.
    """

    names: tuple[str, ...]
    parameters: Float[np.ndarray, "N p"]
    covariance: Float[np.ndarray, "N p p"]
    innovation: Float[np.ndarray, " N"]
    noise_std: Float[np.ndarray, " N"]
    alarms: Bool[np.ndarray, " N"]
    delay: float | None = None

    @property
    def std(self) -> Float[np.ndarray, "N p"]:
        """Standard deviations of the estimates."""
        return np.sqrt(np.maximum(np.diagonal(self.covariance, axis1=1, axis2=2), 0.0))

    def value(self, name: str) -> Float[np.ndarray, " N"]:
        """Estimates of one coefficient over the drive."""
        return self.parameters[:, place_of(name, self.names, "Tracking")]

    def interval(
        self, name: str, level: float = 0.95
    ) -> tuple[Float[np.ndarray, " N"], Float[np.ndarray, " N"]]:
        """Two-sided confidence interval of one coefficient over the drive. Raises InputError if
        there is no such coefficient, or if `level` lies outside 0 to 1."""
        value = self.value(name)
        half = z_of(level) * self.std[:, self.names.index(name)]
        return value - half, value + half

    def dc_gain(self) -> tuple[Float[np.ndarray, " N"], Float[np.ndarray, " N"]]:
        """Static gain `b0 / a0` over the drive and its standard deviation (by its gradient)."""
        b, a = self.names.index("b0"), self.names.index("a0")
        gain = self.parameters[:, b] / self.parameters[:, a]
        gradient = np.zeros_like(self.parameters)
        gradient[:, b] = 1.0 / self.parameters[:, a]
        gradient[:, a] = -gain / self.parameters[:, a]
        variance = np.einsum("ni,nij,nj->n", gradient, self.covariance, gradient)
        return gain, np.sqrt(np.maximum(variance, 0.0))

    def model(self, row: int = -1) -> TransferFunction:
        """The plant as it was known at a row."""
        zeros = sum(name.startswith("b") for name in self.names)
        poles = sum(name.startswith("a") for name in self.names)
        num, den, rest = np.split(self.parameters[row], [zeros, zeros + poles])
        offset = rest[0] if rest.size else None
        return TransferFunction(num, np.append(1.0, den), delay=self.delay, offset=offset)


def identify_online(
    record: Record,
    plant: str | PlantSpec,
    start: TransferFunction | Fit,
    *,
    forgetting: Forgetting | None = None,
    noise_std: float | None = None,
) -> Tracking:
    """Follow one plant through a drive.

    Use it where the plant changes on the way (load, temperature, wear), or where it is to be known
    before the drive is over; for a plant that stays, `identify` tries every order and delay and
    weighs all samples alike.

    Args:
        record: one drive without gaps.
        plant: "powertrain", "steering", the name of a plant of the configuration, or a `PlantSpec`.
        start: a model to begin with, such as the offline fit of an earlier drive, or a guess: its
            order and its delay are kept, its coefficients are taken to within `forgetting.spread`.
            An offset is estimated if it has one. It is at rest under the first command.
        forgetting: how fast the past loses its say.
        noise_std: first guess of the measurement's noise, output unit; from the differences of
            the first samples if not given. It is refined on the way.

    Raises:
        InputError: the record has gaps, or lacks a channel, or the fit to start from has no model.
        ValueError: `start` is not stable.
    """
    start = model_of(start) if isinstance(start, Fit) else start
    spec = plant if isinstance(plant, PlantSpec) else record.plant(plant)
    if len(record.segments) != 1:
        problem = f"has {len(record.segments)} segments, and a recursion cannot cross a gap"
        mend = "give record.select([segment]) for one of record.segments"
        raise InputError(record.source, "segments", problem, mend)
    u, y = record[spec.input], record[spec.output]
    if np.any(np.roots(np.asarray(start.den)).real >= 0.0):
        raise ValueError("start is not stable; give a stable plant of the same order")
    if noise_std is None:
        first = y[: max(round(1.0 / record.dt), 20)]
        noise_std = max(white_noise_std([first]), 1e-6 * float(np.ptp(y)), 1e-12)
    measured = record.measured(spec.output)
    known = track(u, y, record.dt, start, noise_std, forgetting or Forgetting(), measured)
    parameters, covariance, innovation, noise, alarms = map(np.asarray, known)
    names = [f"b{i}" for i in range(start.num.shape[0] - 1, -1, -1)]
    names += [f"a{i}" for i in range(start.den.shape[0] - 2, -1, -1)]
    names += ["offset"] * (start.offset is not None)
    delay = None if start.delay is None else float(start.delay)
    return Tracking(tuple(names), parameters, covariance, innovation, noise, alarms, delay)


class _Memory(eqx.Module):
    """What is carried from sample to sample, coefficients scaled to a size of one."""

    mean: Float[Array, " q"]  # states, then coefficients
    covariance: Float[Array, "q q"]
    noise: Float[Array, ""]  # variance
    colour: Float[Array, ""]  # correlation of an innovation with the one before
    last: Float[Array, ""]  # innovation, in standard deviations
    surprise: Float[Array, ""]  # mean of the last squared innovations, in units of their variance
    age: Float[Array, ""]  # s since the start or an alarm


class _Scaled(eqx.Module):
    """The plant in a time in which its poles are of order one, as a filter's states and outputs.

    The states are those of the observer form, the first of them being the output without its
    feed-through; the coefficients are `b` and `a` in descending powers, then the offset.
    """

    first: Float[Array, " p"]  # coefficients of the first model
    sizes: Float[Array, " p"]  # what a whole change of each would be
    units: Float[Array, " p"]  # a coefficient in its unit over the scaled one
    pace: Float[Array, ""]
    poles: int = eqx.field(static=True)
    zeros: int = eqx.field(static=True)
    has_offset: bool = eqx.field(static=True)

    @staticmethod
    def of(start: TransferFunction) -> "_Scaled":
        n, m = start.den.shape[0] - 1, start.num.shape[0] - 1
        pace = jnp.abs(start.den[-1]) ** (1.0 / n)
        powers = np.concatenate([n - np.arange(m, -1, -1), np.arange(1, n + 1)])
        units = pace ** jnp.asarray(powers, float)
        first = jnp.concatenate([start.num, start.den[1:]]) / units
        gain = jnp.abs(start.num[-1] / start.den[-1])
        least = jnp.concatenate([jnp.full(m + 1, 0.1 * gain), jnp.full(n, 0.1)])
        if start.offset is not None:
            first, units = jnp.append(first, start.offset), jnp.append(units, 1.0)
            least = jnp.append(least, 0.1 * gain)
        sizes = jnp.maximum(jnp.abs(first), least)
        return _Scaled(first, sizes, units, pace, n, m, start.offset is not None)

    def parts(self, theta: Array) -> tuple[Array, Array, Array, Array]:
        """`a`, what the command pushes the states by, feed-through and offset."""
        b, a = theta[: self.zeros + 1], theta[self.zeros + 1 : self.zeros + 1 + self.poles]
        b = jnp.concatenate([jnp.zeros(self.poles - self.zeros), b])
        offset = theta[-1] if self.has_offset else jnp.zeros(())
        return a, b[1:] - b[0] * a, b[0], offset

    def output(self, mean: Array, u: Array) -> Array:
        """What is measured while `u` acts, without noise."""
        _, _, D, offset = self.parts(mean[self.poles :])
        return mean[0] + D * u + offset

    def moved(self, mean: Array, early: Array, late: Array, rest: Array | None, dt: Array) -> Array:
        """States and coefficients one sample later; the delayed command jumps from `early` to
        `late` when `rest` of the sample is left, or at its end."""
        n = self.poles
        x, theta = mean[:n], mean[n:]
        a, push, D, _ = self.parts(theta)
        A = jnp.eye(n, k=1).at[:, 0].add(-a) * self.pace
        system = StateSpace(A, push * self.pace, jnp.eye(n)[0], D)
        for span, u in ((dt, early),) if rest is None else ((dt - rest, early), (rest, late)):
            Ad, Bd = system.discretise(span)
            x = Ad @ x + Bd * u
        return jnp.concatenate([x, theta])

    def at_rest_of(self, theta: Array, u: Array) -> Array:
        """States at rest under a constant command."""
        a, push, _, _ = self.parts(theta)
        level = push[-1] / a[-1]
        return u * jnp.append(level, a[:-1] * level - push[:-1])

    def at_rest(self, u: Array) -> Array:
        """The first model at rest."""
        return jnp.concatenate([self.at_rest_of(self.first, u), self.first])

    def tamed(self, mean: Array, then: Array) -> Array:
        """`then`, or `mean` with its states alone moved where the plant would be unstable."""
        n = self.poles
        a = self.parts(then[n:])[0]
        poles = jnp.linalg.eigvals(jnp.eye(n, k=1).at[:, 0].add(-a))
        stable = jnp.all(poles.real < _STABLE) & jnp.all(jnp.isfinite(then))
        kept = jnp.concatenate([then[:n], mean[n:]])
        return jnp.where(stable, then, jnp.where(jnp.all(jnp.isfinite(kept)), kept, mean))

    def in_units(self, theta: Array) -> Array:
        return theta * self.units

    def covariance_in_units(self, P: Array) -> Array:
        return P * self.units[:, None] * self.units[None, :]


@eqx.filter_jit
def track(
    u: Float[ArrayLike, " N"],
    y: Float[ArrayLike, " N"],
    dt: Float[ArrayLike, ""],
    start: TransferFunction,
    noise_std: Float[ArrayLike, ""],
    forgetting: Forgetting,
    measured: Bool[ArrayLike, " N"] | None = None,
) -> tuple[Array, Array, Array, Array, Array]:
    """`identify_online` on arrays, for `jax.vmap` over drives.

    Args:
        u, y: commands and measured responses.
        dt: sample period, s.
        start: the first model.
        noise_std: first guess of the noise, output unit.
        forgetting: how fast the past loses its say.
        measured: which samples of `y` count; all if None.

    Returns:
        The arrays of `Tracking`: parameters, covariance, innovation, noise_std, alarms.
    """
    u, y, dt = (jnp.asarray(value, float) for value in (u, y, dt))
    counts = jnp.ones(u.shape[0], bool) if measured is None else jnp.asarray(measured)
    scaled = _Scaled.of(start)
    n, window = scaled.poles, dt / jnp.minimum(forgetting.window, 1e6)
    prior = (forgetting.spread * scaled.sizes) ** 2
    early, late, rest = u, u, None
    if start.delay is not None:
        early, late, rest = delayed(u, start.delay, dt)

    def step(carry: _Memory, row: tuple) -> tuple[_Memory, tuple]:
        before, after, y, counts = row
        mean, P = carry.mean, carry.covariance
        predicted, h = jax.value_and_grad(scaled.output)(mean, before)
        Ph = P @ h
        size = h @ Ph + carry.noise
        innovation = y - predicted
        gain = jnp.where(counts, Ph / size, 0.0)
        mean = scaled.tamed(mean, mean + gain * innovation)
        P = P - jnp.outer(gain, Ph)

        own = jnp.clip(innovation / jnp.sqrt(size), -_OUTLIER, _OUTLIER)
        learns = counts * jnp.maximum(1.0 / (20.0 + carry.age / dt), dt / forgetting.memory)
        noise = carry.noise * (1.0 + learns * (own**2 - 1.0))
        colour = carry.colour + learns * (own * carry.last - carry.colour)
        rho = jnp.clip(colour, 0.0, _REDDEST)
        # a mean of squares of coloured noise varies more (Priestley 1981, sec. 5.3)
        spread = jnp.sqrt(window * (1.0 + rho**2) / (1.0 - rho**2))
        surprise = carry.surprise + counts * window * (own**2 - carry.surprise)
        alarm = surprise > 1.0 + forgetting.alarm * spread
        alarm = alarm & (carry.age > 2.0 * forgetting.window)
        surprise = jnp.where(alarm, 1.0, surprise)
        age = jnp.where(alarm, 0.0, carry.age) + dt
        widened = P[n:, n:] * (1.0 + rho) / (1.0 - rho)
        known = (scaled.in_units(mean[n:]), scaled.covariance_in_units(widened))
        told = (*known, innovation, jnp.sqrt(noise), alarm)

        # coefficients lose certainty with age, yet never know less than at a start
        memory = jnp.minimum(forgetting.memory, forgetting.window + forgetting.growth * age)
        P = P.at[n:, n:].add(jnp.diag(jnp.where(alarm, prior, 0.0)))
        F = jax.jacfwd(scaled.moved)(mean, before, after, rest, dt)
        mean = scaled.moved(mean, before, after, rest, dt)
        P = F @ (P * jnp.exp(dt / memory)) @ F.T
        most = jnp.concatenate([jnp.full(n, jnp.inf), prior])
        cut = jnp.sqrt(jnp.minimum(1.0, most / jnp.diag(P)))
        P = P * cut[:, None] * cut[None, :]
        carried = (jnp.where(counts, own, 0.0), surprise, age)
        return _Memory(mean, 0.5 * (P + P.T), noise, colour, *carried), told

    first = scaled.at_rest(early[0])
    # a start that is wrong has a state at rest that is wrong as well
    by = jax.jacfwd(scaled.at_rest_of)(scaled.first, early[0])
    whole = jnp.concatenate([by, jnp.eye(prior.shape[0])])
    memory = _Memory(
        first,
        whole @ jnp.diag(prior) @ whole.T,
        jnp.asarray(noise_std, float) ** 2,
        colour=jnp.zeros(()),
        last=jnp.zeros(()),
        surprise=jnp.ones(()),
        age=jnp.zeros(()),
    )
    return lax.scan(step, memory, (early, late, y, counts))[1]
