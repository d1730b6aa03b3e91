"""Transfer functions PxZy of the paper's eq. (2), with transport delay and offset, and their
realisation."""

from collections.abc import Sequence
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer
from jaxtyping import Array, ArrayLike, Complex, Float

from vdmsi_jax.models import exchange
from vdmsi_jax.models.linear_plant import LinearPlant, LinearTrace
from vdmsi_jax.models.plant import AbstractPlant
from vdmsi_jax.models.state_space import StateSpace


def improper_reason(poles: int, zeros: int) -> str | None:
    """Why a plant of so many poles and zeros cannot be realised, or `None` if it can."""
    if zeros <= poles:
        return None
    return f"improper: {zeros} zeros exceed {poles} poles, so eq. (5) has no realisation"


class TransferFunction(AbstractPlant):
    """An actuator as the paper writes it: `y = num(s) / den(s) u(t - delay) + offset`.

    Every leaf is a parameter to differentiate, fit or batch by. The leading coefficient of `den` is
    1 by construction and takes no part in any computation, so its derivative is zero.

    Attributes:
        num: numerator, descending powers of s, at most as long as `den`.
        den: denominator, descending powers of s, the first coefficient being 1.
        delay: transport delay in s; `None` means that there is none, statically. A negative one
            looks ahead, so that a fit may cross zero.
        offset: added to the output, in its unit; `None` means that there is none.
    """

    num: Float[Array, " m"]
    den: Float[Array, " n"]
    delay: Float[Array, ""] | None = None
    offset: Float[Array, ""] | None = None

    def __init__(
        self,
        num: Float[ArrayLike, " m"] | Sequence[float],
        den: Float[ArrayLike, " n"] | Sequence[float],
        *,
        delay: Float[ArrayLike, ""] | None = None,
        offset: Float[ArrayLike, ""] | None = None,
    ):
        """Normalises `den` to a leading 1.

        Raises:
            ValueError: no pole, more zeros than poles (eq. (5) cannot realise it), a leading
                coefficient of `den` that is zero, or arrays that are not vectors.
        """
        # NumPy's numbers stay its own until the end: it divides them without compiling anything
        num, den = (x if isinstance(x, jax.Array) else np.asarray(x, float) for x in (num, den))
        if num.ndim != 1 or den.ndim != 1 or num.size == 0 or den.size < 2:
            raise ValueError(
                "num and den are vectors of coefficients in descending powers of s, "
                f"den with at least one pole; got shapes {num.shape} and {den.shape}"
            )
        reason = improper_reason(den.size - 1, num.size - 1)
        if reason is not None:
            raise ValueError(f"{reason}; give at most {den.size} numerator coefficients")
        if not isinstance(den, Tracer) and np.asarray(den)[0] == 0.0:
            raise ValueError("the leading coefficient of den is zero; leave it out")
        self.num, self.den = jnp.asarray(num / den[0], float), jnp.asarray(den / den[0], float)
        self.delay = None if delay is None else jnp.asarray(delay, float)
        self.offset = None if offset is None else jnp.asarray(offset, float)

    @property
    def order(self) -> str:
        """The paper's name: `P2Z1` has two poles and one zero."""
        return f"P{self.den.shape[-1] - 1}Z{self.num.shape[-1] - 1}"

    @property
    def _monic(self) -> Float[Array, " n"]:
        """The denominator with its leading 1 as a constant, which has no derivative."""
        return jnp.asarray(self.den).at[0].set(1.0)

    def poles(self) -> Complex[Array, " n"]:
        """Roots of the denominator, rad/s."""
        return _roots(self._monic)

    def zeros(self) -> Complex[Array, " m"]:
        """Roots of the numerator, rad/s; NaN where its leading coefficient is zero (the zero is at
        infinity)."""
        return _roots(self.num)

    def dc_gain(self) -> Float[Array, ""]:
        """Output per unit of a constant command at rest, offset left out; infinite for an
        integrator."""
        return self.num[-1] / self.den[-1]

    def frequency_response(self, omega: Float[ArrayLike, "*w"]) -> Complex[Array, "*w"]:
        """Gain and phase at `omega` rad/s, the delay included, the offset left out."""
        s = 1j * jnp.asarray(omega)
        response = jnp.polyval(self.num, s) / jnp.polyval(self._monic, s)
        return response if self.delay is None else response * jnp.exp(-s * self.delay)

    def step_response(self, t: Float[ArrayLike, " k"]) -> Float[Array, " k"]:
        """Response at the times `t` (s, any spacing) to a unit step at 0 from rest, the offset left
        out."""
        return _step_response(self, jnp.asarray(t, float))

    def to_state_space(self, order: int | None = None) -> StateSpace:
        """The dynamics without delay and offset, realised well-conditioned.

        The observer companion form in a time scaled so that the fastest pole is of order one:
        entries stay of order one however stiff the plant, states are in the output's unit, and an
        initial state shows in the output even where a pole and a zero cancel. The scale is a power
        of two, so that scaling adds no rounding and the coordinates do not move under a
        differentiation.

        Args:
            order: number of states, at least that of the poles; the surplus is decoupled, stable
                padding.

        Raises:
            ValueError: `order` is below the number of poles.
        """
        return self.to_plant(order).system

    def to_plant(self, order: int | None = None) -> LinearPlant:
        """The plant to be simulated: `to_state_space(order)` with what a start at rest, the delay
        and the offset need."""
        n = self.den.shape[0] - 1
        size = n if order is None else order
        if size < n:
            raise ValueError(f"{self.order} needs {n} states, not {size}; give order={n} or more")
        scale = _time_scale(self.den)
        powers = scale ** -jnp.arange(n + 1, dtype=self.den.dtype)
        num = jnp.zeros_like(self.den).at[n + 1 - self.num.shape[0] :].set(self.num)
        a, b = (self.den * powers)[1:], (num * powers)[1:]
        D = num[0]
        push = b - D * a
        A = -jnp.eye(size, dtype=a.dtype)
        A = A.at[:n, :n].set(jnp.eye(n, k=1, dtype=a.dtype).at[:, 0].add(-a)) * scale
        B = jnp.zeros(size, a.dtype).at[:n].set(push * scale)
        C = jnp.zeros(size, a.dtype).at[0].set(1.0)
        integrates = a[-1] == 0.0
        level = jnp.where(integrates, 0.0, push[-1] / jnp.where(integrates, 1.0, a[-1]))
        rest = jnp.zeros(size, a.dtype).at[0].set(level).at[1:n].set(a[:-1] * level - push[:-1])
        return LinearPlant(
            StateSpace(A, B, C, D), rest, _slowest(self.den), self.delay, self.offset
        )

    def trace(
        self,
        u: Float[ArrayLike, " N"],
        dt: Float[ArrayLike, ""],
        x0: Float[Array, "*n"] | None = None,
    ) -> LinearTrace:
        """The motion over a record, to be read at any instant; arguments as in `simulate`."""
        return self.to_plant().trace(u, dt, x0)

    def jump(self, dt: Float[ArrayLike, ""]) -> Float[Array, ""] | None:
        """Time after each row at which the delayed command jumps, s; `None` without a delay."""
        return self.to_plant().jump(dt)

    def to_scipy(self) -> Any:
        """`scipy.signal.TransferFunction`. Raises ValueError with a delay or offset to lose."""
        return exchange.to_scipy(self)

    def to_control(self) -> Any:
        """`control.TransferFunction`. Raises ValueError with a delay or offset to lose."""
        return exchange.to_control(self)

    @classmethod
    def from_scipy(cls, system: Any) -> "TransferFunction":
        """From a continuous `scipy.signal` system in any of its forms.

        Raises:
            ValueError: it is discrete, improper, or has several inputs or outputs.
        """
        return cls(*exchange.coefficients_from_scipy(system))

    @classmethod
    def from_control(cls, system: Any) -> "TransferFunction":
        """From a continuous python-control system, transfer function or state space.

        Raises:
            ValueError: it is discrete, improper, or has several inputs or outputs.
        """
        return cls(*exchange.coefficients_from_control(system))


@eqx.filter_jit
def _step_response(model: TransferFunction, t: Array) -> Array:
    system = model.to_state_space()
    since = t if model.delay is None else t - model.delay
    begun = since >= 0
    _, states = jax.vmap(system.discretise)(jnp.where(begun, since, 0.0))
    return jnp.where(begun, states @ system.C + system.D, 0.0)


def _roots(coefficients: Array) -> Complex[Array, " k"]:
    """Roots by the companion matrix in scaled time, which keeps slow roots beside fast ones."""
    k = coefficients.shape[0] - 1
    if k == 0:
        return jnp.zeros(0, complex)
    monic = coefficients / coefficients[0]
    scale = _time_scale(monic)
    return (
        jnp.roots(monic * scale ** -jnp.arange(k + 1, dtype=monic.dtype), strip_zeros=False) * scale
    )


def _time_scale(monic: Array) -> Float[Array, ""]:
    """A power of two near the largest root's modulus (Fujiwara's bound); 1 where all roots are
    zero."""
    sizes = _root_sizes(jax.lax.stop_gradient(monic))
    exponent = jnp.round(jnp.log2(jnp.max(sizes)))
    return jnp.exp2(jnp.where(jnp.isfinite(exponent), exponent, 0.0))


def _slowest(monic: Array) -> Float[Array, ""]:
    """The same estimate for the smallest root, from the reversed polynomial; 0 where a root is
    zero."""
    reverse = jax.lax.stop_gradient(monic)[::-1]
    largest_inverse = jnp.max(_root_sizes(reverse / reverse[0]))
    return jnp.where(reverse[0] == 0.0, 0.0, 1.0 / largest_inverse)


def _root_sizes(monic: Array) -> Array:
    degrees = jnp.arange(1, monic.shape[0], dtype=monic.dtype)
    return jnp.abs(monic[1:]) ** (1.0 / degrees)
