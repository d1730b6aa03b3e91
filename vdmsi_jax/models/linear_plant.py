"""A linear plant on a held command: dynamics, transport delay and offset, exact at every
instant."""

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from vdmsi_jax.models.state_space import StateSpace, propagate

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


class _DelayedHold(eqx.Module):
    """What a fractional delay adds to a trace: the command jumps once inside every sample."""

    jump: Float[Array, ""]  # s after the row
    states: Float[Array, "N n"]  # at the jump inside each sample
    command: Float[Array, " N"]  # held after the jump


class LinearTrace(eqx.Module):
    """The exact motion of a linear plant over a record: its response at any instant, not only at
    the rows.

    Made by `LinearPlant.trace`. It costs one simulation; `at` then costs two matrix products.
    """

    plant: "LinearPlant"
    states: Float[Array, "N+1 n"]
    command: Float[Array, " N"]  # acting at each row, that is, delayed
    delayed: _DelayedHold | None

    def rows(self) -> PlantResponse:
        """The response at the rows."""
        system, x = self.plant.system, self.states[:-1]
        y = self.plant.shift(system.output(x, self.command))
        return PlantResponse(y, system.output_rate(x, self.command), self.states[-1])

    def at(self, tau: Float[Array, " J"]) -> Float[Array, "N J"]:
        """Response `tau` seconds after each row, `0 <= tau < dt`, in the output unit.

        At the very instant of a delayed jump the command has jumped.
        """
        if self.delayed is None:
            return self.plant.shift(self._from(self.states[:-1], self.command, tau))
        after = tau >= self.delayed.jump
        before_jump = self._from(self.states[:-1], self.command, jnp.where(after, 0.0, tau))
        since_jump = jnp.where(after, tau - self.delayed.jump, 0.0)
        after_jump = self._from(self.delayed.states, self.delayed.command, since_jump)
        return self.plant.shift(jnp.where(after, after_jump, before_jump))

    def _from(self, x: Array, u: Array, tau: Array) -> Float[Array, "N J"]:
        system = self.plant.system
        Ad, Bd = jax.vmap(system.discretise)(tau)
        return x @ (system.C @ Ad).T + jnp.outer(u, Bd @ system.C + system.D)


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
        Ad, Bd = self.system.discretise(dt)
        if self.delay is None:
            following = jnp.concatenate([u[1:], u[-1:]])
            later = propagate(Ad, Bd, Ad @ x0 + Bd * u[0], following)[:-1]
            return LinearTrace(self, jnp.concatenate([x0[None], later]), u, None)

        # The command that acts from row k is u[k - whole], and `early` seconds before the next row
        # the following one. The same operations as above, and then nothing added at a delay of
        # zero: it is off bit for bit.
        whole, early = _whole_and_rest(self.delay, dt)
        last = u.shape[0] - 1
        rows = jnp.arange(u.shape[0]) - whole
        acting, following = u[jnp.clip(rows, 0, last)], u[jnp.clip(rows + 1, 0, last)]
        to_row, push_to_row = self.system.discretise(early)
        to_jump, push_to_jump = self.system.discretise(dt - early)
        at_jumps = propagate(Ad, Bd, to_jump @ x0 + push_to_jump * acting[0], following)[:-1]
        later = at_jumps @ to_row.T + jnp.outer(following, push_to_row)
        states = jnp.concatenate([x0[None], later])
        return LinearTrace(self, states, acting, _DelayedHold(dt - early, at_jumps, following))

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
