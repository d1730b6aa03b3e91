"""Road grade: hills, as a profile of the slope over the distance travelled."""

from typing import ClassVar

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from vdmsi_jax.effects.base import AbstractEffect, Scales, Signals
from vdmsi_jax.parameters import parameter
from vdmsi_jax.units import STANDARD_GRAVITY

KNOTS = 24


class RoadGrade(AbstractEffect):
    """Gravity along the road, as the command that is spent on it; every run begins at the same
    place. Past the last knot the slope falls to zero over the distance of two knots.

    Attributes:
        span: distance between the first knot, where a run begins, and the last, m.
    """

    cause: ClassVar[str] = "road_grade"
    shown_by: ClassVar[str] = "the same road twice"
    weight: ClassVar[float] = 10.0

    slope: Float[Array, " knots"] = parameter(
        "1",
        "slope (rise over run) at knots of equal distance, linear between",
        off=(0.0,) * KNOTS,
        spread=0.04,  # roads: a knot that little is known of must not be a cliff
    )
    span: Float[Array, ""] = eqx.field(converter=jnp.asarray, default=100.0)

    def scaled(self, scales: Scales) -> "RoadGrade":
        return RoadGrade(self.slope, max(scales.distance, 1.0))

    def probes(self, scales: Scales) -> list[tuple[float, ...]]:
        hills = [(0.02 * (-1.0) ** (k // 2),) for k in range(KNOTS)]
        one = [tuple(0.03 * (j == k) for j in range(KNOTS)) for k in range(KNOTS)]
        return [tuple(h[0] for h in hills), *one]

    def load(self, signals: Signals) -> Float[Array, " M"]:
        at = signals.distance / self.span * (KNOTS - 1)
        knots = jnp.arange(KNOTS)
        hats = jnp.maximum(0.0, 1.0 - jnp.abs(at[:, None] - knots))
        pull = STANDARD_GRAVITY * signals.slowness * (hats @ self.slope)
        steps = pull.shape[0] * signals.substeps
        return jnp.repeat(pull, signals.substeps, total_repeat_length=steps)
