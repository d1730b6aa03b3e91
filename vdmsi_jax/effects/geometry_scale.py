"""Geometry scale: the wheelbase, or the steering ratio, is another than the one told."""

from typing import ClassVar

from jaxtyping import Array, Float

from vdmsi_jax.effects.base import AbstractEffect, Scales
from vdmsi_jax.parameters import parameter


class GeometryScale(AbstractEffect):
    """True over told wheelbase: the curvature is divided by it."""

    cause: ClassVar[str] = "geometry_scale"
    shown_by: ClassVar[str] = "constant steering at several angles"

    scale: Float[Array, ""] = parameter("1", "true over told wheelbase, minus 1", lower=-0.9)

    def probes(self, scales: Scales) -> list[tuple[float, ...]]:
        return [(-0.05,), (0.05,)]

    def curvature(self, kappa: Float[Array, " M"], v: Float[Array, " M"]) -> Float[Array, " M"]:
        return kappa / (1.0 + self.scale)
