"""Gain nonlinearity: the static characteristic is bent."""

import abc
from typing import ClassVar, Literal

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from vdmsi_jax.effects.base import AbstractEffect, Effort, Scales, Signals
from vdmsi_jax.parameters import parameter


class GainNonlinearity(AbstractEffect):
    """`u + quadratic u |u| + cubic u³`, bent alike to both sides as a motor's characteristic is, or
    `u + quadratic u² + cubic u³`, as that of a crank that stands askew; for commands of one sign
    they are the same.

    Attributes:
        by: what the quadratic term takes of the command beside its size: its sign, or nothing.
    """

    cause: ClassVar[str] = "gain_nonlinearity"
    shown_by: ClassVar[str] = "a ladder of amplitudes"

    quadratic: Float[Array, ""] = parameter("1/command", "of u |u|, or of u squared")
    cubic: Float[Array, ""] = parameter("1/command^2", "of u cubed")
    by: Literal["sign", "skew"] = eqx.field(static=True, default="sign")

    def probes(self, scales: Scales) -> list[tuple[float, ...]]:
        size = max(abs(scales.low), abs(scales.high), 1e-12)
        bends = (-0.3, -0.05, 0.05, 0.3)
        cubes = bends if self.by == "sign" else ()
        return [(k / size, 0.0) for k in bends] + [(0.0, k / size**2) for k in cubes]

    def command(self, u: Float[Array, " N"], signals: Signals) -> Float[Array, " N"]:
        bent = u * abs(u) if self.by == "sign" else u * u
        return u + self.quadratic * bent + self.cubic * u * u * u


class AbstractOfResponse(AbstractEffect):
    """What bends by the size of the response."""

    cause: ClassVar[str] = "gain_nonlinearity"
    shown_by: ClassVar[str] = "a ladder of amplitudes"

    quadratic: Float[Array, ""] = parameter("1/response", "of y |y|")
    cubic: Float[Array, ""] = parameter("1/response^2", "of y cubed")

    @property
    @abc.abstractmethod
    def bends(self) -> tuple[float, ...]:
        """Parts of the largest response that probes bend it by."""

    def probes(self, scales: Scales) -> list[tuple[float, ...]]:
        size = max(abs(scales.y_low), abs(scales.y_high), 1e-12)
        return [(k / size, 0.0) for k in self.bends] + [(0.0, k / size**2) for k in self.bends]


class BentResponse(AbstractOfResponse):
    """`y + quadratic y |y| + cubic y³` behind the dynamics: what is measured has a characteristic,
    as a tank's titration curve or the linkage of an encoder (a Wiener model; Billings, Nonlinear
    System Identification, 2013, ch. 2).

    Attributes:
        by: what bends it.
    """

    by: Literal["response"] = eqx.field(static=True, default="response")

    @property
    def bends(self) -> tuple[float, ...]:
        return (-0.3, -0.05, 0.05, 0.3)

    def measured(self, y: Float[Array, " N"], signals: Signals) -> Float[Array, " N"]:
        return y + self.quadratic * y * abs(y) + self.cubic * y * y * y


class Stiffening(AbstractOfResponse):
    """What pulls the response back is `y + quadratic y |y| + cubic y³` in place of `y`, inside the
    dynamics: a spring that stiffens (Duffing's), gravity on a pendulum, a tank's outflow. It stays
    between a tenth and ten times what a linear one pulls, or a soft one would push away.

    Attributes:
        by: what bends it.

    Source: Nayfeh and Mook, Nonlinear Oscillations (1979), ch. 4.
    """

    by: Literal["stiffness"] = eqx.field(static=True, default="stiffness")

    @property
    def bends(self) -> tuple[float, ...]:
        return (-0.3, 0.1, 0.6)

    def effort(self, at: Effort) -> Float[Array, ""]:
        return at.more_pull(1.0 + self.quadratic * abs(at.y) + self.cubic * at.y * at.y)


class PowerLaw(AbstractEffect):
    """What pulls the response back goes with a power of it other than the first, inside the
    dynamics: `y |y / size|^bend` in place of `y`. A tank drains with the root of its level (a bend
    of -1/2, Torricelli's law), a fan is braked by the square of its speed (+1). It stays between a
    tenth and ten times what a linear one pulls.

    Attributes:
        by: what bends it.
        size: the response at which both pull alike, its unit.

    Source: Ogunnaike and Ray, Process Dynamics, Modeling, and Control (1994), ch. 10.
    """

    cause: ClassVar[str] = "gain_nonlinearity"
    shown_by: ClassVar[str] = "a ladder of amplitudes"

    bend: Float[Array, ""] = parameter(
        "1", "exponent beyond the first power", lower=-0.95, upper=3.0
    )
    by: Literal["power"] = eqx.field(static=True, default="power")
    size: Float[Array, ""] = eqx.field(converter=jnp.asarray, default=1.0)

    def scaled(self, scales: Scales) -> "PowerLaw":
        return PowerLaw(self.bend, self.by, max(abs(scales.y_low), abs(scales.y_high), 1e-12))

    def probes(self, scales: Scales) -> list[tuple[float, ...]]:
        return [(-0.4,), (0.4,), (1.5,)]

    def effort(self, at: Effort) -> Float[Array, ""]:
        part = jnp.maximum(jnp.abs(at.y) / self.size, 1e-6)
        return at.more_pull(jnp.exp(self.bend * jnp.log(part)))
