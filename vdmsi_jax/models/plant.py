"""What the vehicle asks of an actuator, whatever it is made of."""

import abc
from typing import TYPE_CHECKING

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer
from jaxtyping import Array, ArrayLike, Float

from vdmsi_jax.shown import shown

if TYPE_CHECKING:
    from vdmsi_jax.models.linear_plant import LinearPlant


class PlantResponse(eqx.Module):
    """The answer of a plant to a record of commands, at the instants of the rows.

    Attributes:
        y: response at each row, with that row's command already applied; output unit.
        dy: its derivative at the same instants while the command is held; output unit per second.
            The jumps of `y` where a command jumps (feed-through) are no part of it.
        x_end: state one sample after the last row, where a following record would start; `None`
            where the plant remembers more than a start can be given.
    """

    y: Float[Array, " N"]
    dy: Float[Array, " N"]
    x_end: Float[Array, " n"] | None


def refuse_no_period(dt: Float[ArrayLike, "*batch"]) -> None:
    """Refuse a sample period that is not more than zero, where its value is known.

    Raises:
        ValueError: time would stand still or go backward.
    """
    if not isinstance(dt, Tracer) and not np.all(np.asarray(dt) > 0.0):
        raise ValueError(f"dt = {dt} is no sample period; give seconds, more than zero")


class AbstractTrace(eqx.Module):
    """The motion of a plant over a record: its response at any instant, not only at the rows."""

    @abc.abstractmethod
    def rows(self) -> PlantResponse:
        """The response at the rows."""

    @abc.abstractmethod
    def at(self, tau: Float[Array, " J"]) -> Float[Array, "N J"]:
        """Response `tau` seconds after each row, `0 <= tau < dt`."""

    @abc.abstractmethod
    def travelled(self) -> Float[Array, " N"]:
        """Integral of the response over the sample that follows each row, unit times second."""


class AbstractPlant(eqx.Module):
    """One command, held between the rows of a record, makes one response."""

    def __repr__(self) -> str:
        return shown(self)

    @abc.abstractmethod
    def trace(
        self,
        u: Float[ArrayLike, " N"],
        dt: Float[ArrayLike, ""],
        x0: Float[Array, "*n"] | None = None,
    ) -> AbstractTrace:
        """The motion under the commands `u`, held for `dt` seconds each.

        Args:
            u: commands; `u[k]` acts from row `k` (plus a delay) on; before the record the command
                was `u[0]`.
            dt: sample period, s.
            x0: state at the first row; `None` for the plant's own idea of a start at rest.
        """

    @abc.abstractmethod
    def jump(self, dt: Float[ArrayLike, ""]) -> Float[Array, ""] | None:
        """Time after each row, in `(0, dt]` s, at which the response may be no smooth function of
        time because a delayed command jumps; `None` where that happens at rows only."""

    @abc.abstractmethod
    def to_plant(self, order: int | None = None) -> "LinearPlant":
        """The same plant in the common linear form with `order` states.

        Raises:
            ValueError: it is not linear, or needs more states.
        """

    def simulate(
        self,
        u: Float[ArrayLike, " N"],
        dt: Float[ArrayLike, ""],
        x0: Float[Array, "*n"] | None = None,
    ) -> PlantResponse:
        """Exact response to commands that are held between the rows.

        Row `k` holds the output at `t_k` and the command issued at `t_k`, which the output sees at
        once through a feed-through. Both modes of differentiation work, in a delay too; many plants
        or records run under `jax.vmap`, thousands in bounded memory under
        `jax.lax.map(..., batch_size=50)`. Arguments as in `trace`.

        Returns:
            The response `y` and its rate `dy`, both `(N,)`, and the state `x_end` at the end.

        Raises:
            ValueError: the sample period is not more than zero.
        """
        refuse_no_period(dt)
        return _rows(self, jnp.asarray(u, float), jnp.asarray(dt, float), x0)


@eqx.filter_jit
def _rows(plant: AbstractPlant, u: Array, dt: Array, x0: Array | None) -> PlantResponse:
    return plant.trace(u, dt, x0).rows()
