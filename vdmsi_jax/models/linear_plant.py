"""A linear plant on a held command: dynamics, transport delay and offset, exact at every
instant."""

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, ArrayLike, Bool, Float

from vdmsi_jax.models.plant import AbstractPlant, AbstractTrace, PlantResponse
from vdmsi_jax.models.state_space import Motion, StateSpace, propagate

_REST_RECORDS = 100.0  # a pole slower than so many times the record has no time to come to rest


class _Lead(eqx.Module):
    """By how much the command jumps before the rows, and the exact step from a jump to its row."""

    early: Float[Array, ""]
    to_row: Float[Array, "n n"]
    push: Float[Array, " n"]


class LinearTrace(AbstractTrace):
    """The exact motion of a linear plant over a record: its response at any instant.

    Made by `LinearPlant.trace`. It costs one simulation; `at` then costs a few matrix products.

    The command jumps at each row, or, where a delay is no multiple of the sample period, somewhat
    before it. The motion is known at the jumps, and read from the last one.
    """

    plant: "LinearPlant"
    start: Float[Array, " n"]  # state at the first row
    first: Float[Array, ""]  # command acting at the first row
    following: Float[Array, " N"]  # command acting from the jump at or before the next row
    jumps: Motion  # states at these jumps
    lead: _Lead | None
    dt: Float[Array, ""]

    def rows(self) -> PlantResponse:
        """The response at the rows."""
        A, B, C, D = (getattr(self.plant.system, name) for name in "ABCD")
        y = self._from_rows(C[:, None], D[None])[:, 0]
        dy = self._from_rows((C @ A)[:, None], (C @ B)[None])[:, 0]
        x_end = self.jumps.last()
        if self.lead is not None:
            x_end = self.lead.to_row @ x_end + self.lead.push * self.following[-1]
        return PlantResponse(self.plant.shift(y), dy, x_end)

    def at(self, tau: Float[Array, " J"]) -> Float[Array, "N J"]:
        """Response `tau` seconds after each row, `0 <= tau < dt`, in the output unit.

        At the very instant of a delayed jump the command has jumped.
        """
        if self.lead is None:
            return self.plant.shift(self._from_rows(*self.plant.system.ahead(tau)))
        jump = self.dt - self.lead.early
        jumped = tau >= jump
        since = jnp.concatenate([jnp.where(jumped, 0.0, tau), jnp.where(jumped, tau - jump, 0.0)])
        functions, gains = self.plant.system.ahead(since)
        split = tau.shape[0]
        before = self._from_rows(functions[:, :split], gains[:split])
        after = self._from_jumps(functions[:, split:], gains[split:])
        return self.plant.shift(jnp.where(jumped, after, before))

    def travelled(self) -> Float[Array, " N"]:
        """Integral of the response over the sample that follows each row, exactly."""
        if self.lead is None:
            way = self._from_rows(*self.plant.system.area_ahead(self.dt))
        else:
            way = self._from_rows(*self.plant.system.area_ahead(self.dt - self.lead.early))
            way = way + self._from_jumps(*self.plant.system.area_ahead(self.lead.early))
        offset = self.plant.offset
        return way[:, 0] if offset is None else way[:, 0] + offset * self.dt

    def _from_rows(self, functions: Array, gains: Array) -> Float[Array, "N J"]:
        """`x @ functions + gains u` of the states and commands at the rows."""
        head = self.start @ functions + gains * self.first
        if self.lead is not None:
            gains = self.lead.push @ functions + gains
            functions = self.lead.to_row.T @ functions
        return jnp.concatenate([head[None], self._from_jumps(functions, gains)[:-1]])

    def _from_jumps(self, functions: Array, gains: Array) -> Float[Array, "N J"]:
        """The same at the jump that follows each row."""
        return self.jumps.read(functions) + jnp.outer(self.following, gains)


class LinearPlant(AbstractPlant):
    """A state-space system with what a real actuator adds to it: a transport delay and an offset.

    Users write plants as `TransferFunction`; this is what a transfer function becomes to be
    simulated. Plants of different order become one batch by realising them at a common order
    (`TransferFunction.to_plant(order)`).

    Attributes:
        system: the dynamics.
        rest: state at rest per unit of a constant command.
        slowest: lower estimate of the slowest pole's modulus, rad/s; 0 for an integrator.
        delay: transport delay of the command in s, `None` where there is none (statically: nothing
            is computed).
        offset: added to the output, output unit; `None` where there is none.
    """

    system: StateSpace
    rest: Float[Array, " n"]
    slowest: Float[Array, ""]
    delay: Float[Array, ""] | None = None
    offset: Float[Array, ""] | None = None

    def shift(self, y: Float[Array, "*N"]) -> Float[Array, "*N"]:
        """`y` with the offset added."""
        return y if self.offset is None else y + self.offset

    def jump(self, dt: Float[ArrayLike, ""]) -> Float[Array, ""] | None:
        """Time after each row at which the delayed command jumps, in `(0, dt]` s; `None` without a
        delay."""
        if self.delay is None:
            return None
        dt = jnp.asarray(dt, float)
        return dt - whole_and_rest(self.delay, dt)[1]

    def rests(self, duration: float | Float[Array, ""]) -> Bool[Array, ""]:
        """Whether a plant can have come to rest before a record of so many seconds: a pole slower
        than `_REST_RECORDS` times the record is a near-integrator, whose state at rest is huge and
        says nothing about the plant (the paper's steering model would start at -1.5e6 rad)."""
        return self.slowest * duration * _REST_RECORDS > 1.0

    def initial_state(
        self, u0: Float[Array, ""], duration: float | Float[Array, ""]
    ) -> Float[Array, " n"]:
        """The state at rest under `u0`, or zero for a plant that has none (`rests`)."""
        return jnp.where(self.rests(duration), self.rest * u0, 0.0)

    def trace(
        self,
        u: Float[ArrayLike, " N"],
        dt: Float[ArrayLike, ""],
        x0: Float[Array, "*n"] | None = None,
    ) -> LinearTrace:
        """The motion under the commands `u`, held for `dt` seconds each.

        Args:
            u: commands; `u[k]` acts from row `k` (plus the delay) on; before the record the command
                was `u[0]`.
            dt: sample period, s.
            x0: state at the first row; `None` for `initial_state`.
        """
        u, dt = jnp.asarray(u, float), jnp.asarray(dt, float)
        if x0 is None:
            x0 = self.initial_state(u[0], u.shape[0] * dt)
        if self.delay is None:
            lead, following = None, jnp.concatenate([u[1:], u[-1:]])
            Ad, Bd = to_jump, push = self.system.discretise(dt)
        else:  # row k sees u[k - whole]; at a delay of zero all is as above, bit for bit
            whole, early = whole_and_rest(self.delay, dt)
            rows = jnp.arange(u.shape[0]) - whole
            following = u[jnp.clip(rows + 1, 0, u.shape[0] - 1)]
            spans = jnp.stack([dt, dt - early, early])
            (Ad, to_jump, to_row), (Bd, push, push_to_row) = jax.vmap(self.system.discretise)(spans)
            lead = _Lead(early, to_row, push_to_row)
        jumps = propagate(Ad, Bd, to_jump @ x0 + push * u[0], following)
        return LinearTrace(self, x0, u[0], following, jumps, lead, dt)

    def to_plant(self, order: int | None = None) -> "LinearPlant":
        """Itself, padded to `order` states. Raises ValueError if it needs more."""
        n = self.rest.shape[0]
        size = n if order is None else order
        if size < n:
            raise ValueError(f"the plant needs {n} states, not {size}; give order={n} or more")
        more = (0, size - n)
        A = jnp.pad(self.system.A, (more, more)) - jnp.diag(jnp.arange(size) >= n)
        B, C, rest = (jnp.pad(v, more) for v in (self.system.B, self.system.C, self.rest))
        system = StateSpace(A, B, C, self.system.D)
        return LinearPlant(system, rest, self.slowest, self.delay, self.offset)


def whole_and_rest(delay: Array, dt: ArrayLike) -> tuple[Array, Array]:
    """`delay = whole * dt - early` with an integer `whole` and `0 <= early < dt`; the derivative
    goes into `early`."""
    whole = jnp.ceil(jax.lax.stop_gradient(delay) / dt)
    return whole.astype(int), whole * dt - delay


def delayed(
    u: Float[Array, " N"], delay: Float[Array, ""], dt: ArrayLike
) -> tuple[Float[Array, " N"], Float[Array, " N"], Float[Array, ""]]:
    """The held command that acts at each row, that which acts at the end of its sample, and for how
    long the latter does, s. Before the first row it is the first."""
    whole, rest = whole_and_rest(delay, dt)
    at = jnp.arange(u.shape[0]) - whole
    early, late = (u[jnp.clip(i, 0, u.shape[0] - 1)] for i in (at, at + 1))
    return early, late, rest
