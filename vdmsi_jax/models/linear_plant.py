"""A linear plant on a held command: dynamics, transport delay and offset, exact at every
instant."""

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from vdmsi_jax.models.state_space import Motion, StateSpace, propagate

REST_RECORDS = 100.0  # a pole slower than so many times the record has no time to come to rest


class PlantResponse(eqx.Module):
    """The answer of a plant to a record of commands, at the instants of the rows.

    Attributes:
        y: response at each row, with that row's command already applied; output unit.
        dy: its exact derivative at the same instants while the command is held; output unit per
            second. The jumps of `y` where a command jumps (feed-through) are no part of it.
        x_end: state one sample after the last row, where a following record would start.
    """

    y: Float[Array, " N"]
    dy: Float[Array, " N"]
    x_end: Float[Array, " n"]


class LinearTrace(eqx.Module):
    """The exact motion of a linear plant over a record: its response at any instant.

    Made by `LinearPlant.trace`. It costs one simulation; `at` then costs a few matrix products.

    The command jumps at each row, or, where a delay is no multiple of the sample period, `early`
    seconds before it. The motion is therefore known at the jumps, and read from the last one.
    """

    plant: "LinearPlant"
    start: Float[Array, " n"]  # state at the first row
    first: Float[Array, ""]  # command acting at the first row
    following: Float[Array, " N"]  # command acting after the jump at or before the next row
    jumps: Motion  # states at these jumps
    early: Float[Array, ""] | None
    dt: Float[Array, ""]

    def rows(self) -> PlantResponse:
        """The response at the rows."""
        system = self.plant.system
        now = None if self.early is None else jnp.zeros_like(self.early)[None]
        y = self._since_row(system.C, system.D, now)[:, 0]
        dy = self._since_row(system.C @ system.A, system.C @ system.B, now)[:, 0]
        x_end = self.jumps.last()
        if self.early is not None:
            to_row, push = system.discretise(self.early)
            x_end = to_row @ x_end + push * self.following[-1]
        return PlantResponse(self.plant.shift(y), dy, x_end)

    def at(self, tau: Float[Array, " J"]) -> Float[Array, "N J"]:
        """Response `tau` seconds after each row, `0 <= tau < dt`, in the output unit.

        At the very instant of a delayed jump the command has jumped.
        """
        system = self.plant.system
        if self.early is None:
            return self.plant.shift(self._since_row(system.C, system.D, tau))
        jump = self.dt - self.early
        jumped = tau >= jump
        before = self._since_row(system.C, system.D, jnp.where(jumped, 0.0, tau))
        functions, gains = self._later(system.C, system.D, jnp.where(jumped, tau - jump, 0.0))
        after = self.jumps.read(functions) + jnp.outer(self.following, gains)
        return self.plant.shift(jnp.where(jumped, after, before))

    def _since_row(self, c: Array, d: Array, tau: Array | None) -> Float[Array, "N J"]:
        """`c x + d u` at `tau` after each row while that row's command acts; `None`: at the row."""
        functions, gains = self._later(c, d, tau)
        head = self.start @ functions + gains * self.first
        if self.early is not None and tau is not None:
            functions, gains = self._later(c, d, tau + self.early)
        later = self.jumps.read(functions) + jnp.outer(self.following, gains)
        return jnp.concatenate([head[None], later[:-1]])

    def _later(self, c: Array, d: Array, tau: Array | None) -> tuple[Array, Array]:
        """`c x + d u` after `tau` seconds, as functions of the state and gains of the command
        now."""
        if tau is None:
            return c[:, None], d[None]
        Ad, Bd = jax.vmap(self.plant.system.discretise)(tau)
        return (c @ Ad).T, Bd @ c + d


class LinearPlant(eqx.Module):
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

    def jump(self, dt: float | Float[Array, ""]) -> Float[Array, ""] | None:
        """Time after each row at which the delayed command jumps, in `(0, dt]` s; `None` without a
        delay."""
        if self.delay is None:
            return None
        return dt - _whole_and_rest(self.delay, dt)[1]

    def initial_state(
        self, u0: Float[Array, ""], duration: float | Float[Array, ""]
    ) -> Float[Array, " n"]:
        """The state at rest under `u0`, or zero for a plant too slow to have come to rest.

        A pole slower than `REST_RECORDS` times the record is a near-integrator: its state at rest
        is huge and says nothing about the plant (the paper's steering model would start at -1.5e6
        rad).
        """
        at_rest = self.slowest * duration * REST_RECORDS > 1.0
        return jnp.where(at_rest, self.rest * u0, 0.0)

    def trace(
        self,
        u: Float[Array, " N"],
        dt: float | Float[Array, ""],
        x0: Float[Array, " n"] | None = None,
    ) -> LinearTrace:
        """The motion under the commands `u`, held for `dt` seconds each.

        Args:
            u: commands; `u[k]` acts from row `k` (plus the delay) on; before the record the command
                was `u[0]`.
            dt: sample period, s.
            x0: state at the first row; `None` for `initial_state`.
        """
        if x0 is None:
            x0 = self.initial_state(u[0], u.shape[0] * dt)
        dt = jnp.asarray(dt, x0.dtype)
        if self.delay is None:
            following, early = jnp.concatenate([u[1:], u[-1:]]), None
            Ad, Bd = self.system.discretise(dt)
            to_jump = Ad @ x0 + Bd * u[0]
            return LinearTrace(
                self, x0, u[0], following, propagate(Ad, Bd, to_jump, following), early, dt
            )

        # Row k sees u[k - whole]. At a delay of zero all that follows is as above, bit for bit.
        whole, early = _whole_and_rest(self.delay, dt)
        rows = jnp.arange(u.shape[0]) - whole
        first, following = u[0], u[jnp.clip(rows + 1, 0, u.shape[0] - 1)]
        (Ad, to_jump), (Bd, push) = jax.vmap(self.system.discretise)(jnp.stack([dt, dt - early]))
        jumps = propagate(Ad, Bd, to_jump @ x0 + push * first, following)
        return LinearTrace(self, x0, first, following, jumps, early, dt)

    def simulate(
        self,
        u: Float[Array, " N"],
        dt: float | Float[Array, ""],
        x0: Float[Array, " n"] | None = None,
    ) -> PlantResponse:
        """Response at the rows; arguments as in `trace`."""
        return self.trace(u, dt, x0).rows()


def _whole_and_rest(delay: Array, dt: float | Array) -> tuple[Array, Array]:
    """`delay = whole * dt - early` with an integer `whole` and `0 <= early < dt`; the derivative
    goes into `early`."""
    whole = jnp.ceil(jax.lax.stop_gradient(delay) / dt)
    return whole.astype(int), whole * dt - delay
