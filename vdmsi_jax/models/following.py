"""How the plain vehicle model (VDM) follows its commands: the choices that need no identification.

A velocity command says nothing about acceleration, so a VDM needs a stated rule, and that rule
decides its error. There are three:

- `FollowedAtOnce` with `SpeedInput.VELOCITY`: the vehicle has the commanded speed at once.
- `FollowedAtOnce` with `SpeedInput.ACCELERATION`: the increments of the command are the vehicle's,
  on top of the speed that it started with.
- `RateLimited`: the vehicle approaches the command at no more than its maximum acceleration (the
  paper's table 1 gives 4.5 m/s²).
"""

import equinox as eqx
import jax.numpy as jnp
from jax import lax
from jaxtyping import Array, ArrayLike, Float

from vdmsi_jax.models.linear_plant import LinearPlant
from vdmsi_jax.models.plant import AbstractPlant, AbstractTrace, PlantResponse
from vdmsi_jax.models.state_space import StateSpace
from vdmsi_jax.parameters import floats


class HeldTrace(AbstractTrace):
    """A response that is the held command itself."""

    command: Float[Array, " N"]
    dt: Float[Array, ""]

    def rows(self) -> PlantResponse:
        """The command, which does not change between the rows."""
        return PlantResponse(self.command, jnp.zeros_like(self.command), jnp.zeros(0))

    def at(self, tau: Float[Array, " J"]) -> Float[Array, "N J"]:
        """The command, whatever `tau`."""
        return jnp.broadcast_to(self.command[:, None], (self.command.shape[0], tau.shape[0]))

    def travelled(self) -> Float[Array, " N"]:
        """The command times the sample period."""
        return self.command * self.dt


class FollowedAtOnce(AbstractPlant):
    """The response is the command: no dynamics, no delay."""

    def trace(
        self,
        u: Float[ArrayLike, " N"],
        dt: Float[ArrayLike, ""],
        x0: Float[Array, "*n"] | None = None,
    ) -> HeldTrace:
        """The command itself. There is no state, and `x0` is ignored."""
        return HeldTrace(jnp.asarray(u, float), jnp.asarray(dt, float))

    def jump(self, dt: Float[ArrayLike, ""]) -> None:
        """Nothing happens between the rows."""
        return None

    def to_plant(self, order: int | None = None) -> LinearPlant:
        """A unit feed-through with padding states only, to share a batch with real plants."""
        size = 1 if order is None else order
        nothing = jnp.zeros(size)
        system = StateSpace(-jnp.eye(size), nothing, nothing, jnp.ones(()))
        return LinearPlant(system, nothing, jnp.ones(()))


class RampTrace(AbstractTrace):
    """A response that approaches each held command on a straight line and then stays there."""

    start: Float[Array, " N"]  # at each row
    command: Float[Array, " N"]
    rate: Float[Array, ""]
    dt: Float[Array, ""]

    def rows(self) -> PlantResponse:
        """The response at the rows; its rate is that of the ramp until the command is reached."""
        way = self.command - self.start
        last = self.start[-1] + self._gained(self.dt[None])[-1]
        return PlantResponse(self.start, jnp.sign(way) * self.rate, last)

    def at(self, tau: Float[Array, " J"]) -> Float[Array, "N J"]:
        """The ramp, or the command once it is reached."""
        return self.start[:, None] + self._gained(tau)

    def travelled(self) -> Float[Array, " N"]:
        """The area under the ramp and the rest, exactly."""
        way = self.command - self.start
        ramp = jnp.minimum(jnp.abs(way) / self.rate, self.dt)
        return self.start * self.dt + jnp.sign(way) * self.rate * ramp * (self.dt - 0.5 * ramp)

    def _gained(self, tau: Array) -> Float[Array, "N J"]:
        reach = self.rate * tau[None]
        return jnp.clip((self.command - self.start)[:, None], -reach, reach)


class RateLimited(AbstractPlant):
    """The response moves to the command at `rate` and no faster; for a powertrain `rate` is the
    vehicle's maximum acceleration in m/s².

    Attributes:
        rate: greatest rate of the response, output unit per second, more than zero.
    """

    rate: Float[Array, ""] = eqx.field(converter=floats)

    def trace(
        self,
        u: Float[ArrayLike, " N"],
        dt: Float[ArrayLike, ""],
        x0: Float[Array, "*n"] | None = None,
    ) -> RampTrace:
        """The ramps. `x0` is the response at the first row, `()` or `(1,)`; `None`: the command."""
        u, dt = jnp.asarray(u, float), jnp.asarray(dt, float)
        reach = self.rate * dt

        def approach(y: Array, command: Array) -> tuple[Array, Array]:
            return y + jnp.clip(command - y, -reach, reach), y

        y0 = u[0] if x0 is None else jnp.reshape(x0, ())
        return RampTrace(lax.scan(approach, y0, u)[1], u, self.rate, dt)

    def jump(self, dt: Float[ArrayLike, ""]) -> None:
        """The kink where a command is reached differs from row to row and is not told here."""
        return None

    def to_plant(self, order: int | None = None) -> LinearPlant:
        """Raises ValueError: a limited rate is not linear."""
        raise ValueError("RateLimited is not linear; simulate it with the method Arcs()")
