"""What a sensor adds: a delay, a bias, a lag. They change what is measured, not what moves."""

from typing import ClassVar

import jax.numpy as jnp
from jaxtyping import Array, Float

from vdmsi_jax.effects.base import AbstractEffect, Scales, Signals, lag, late
from vdmsi_jax.parameters import parameter


class SensorDelay(AbstractEffect):
    """The measurement of the channel is older than its time stamp."""

    cause: ClassVar[str] = "sensor_delay"
    shown_by: ClassVar[str] = "a chirp of 0.1 to 6 Hz"

    delay: Float[Array, ""] = parameter("s", "age of the measurement")

    def probes(self, scales: Scales) -> list[tuple[float, ...]]:
        return [(k * scales.dt,) for k in (-3, 1, 3, 8)]

    def sensor(self, y: Float[Array, " M"], signals: Signals) -> Float[Array, " M"]:
        return late(y, self.delay / signals.h)


class SensorBias(AbstractEffect):
    """A constant is added to the measurement of the channel."""

    cause: ClassVar[str] = "sensor_bias"
    shown_by: ClassVar[str] = "standing still, and driving straight"

    bias: Float[Array, ""] = parameter("response", "added to the measurement")

    def probes(self, scales: Scales) -> list[tuple[float, ...]]:
        return [(k * scales.response,) for k in (-0.05, 0.05)]

    def sensor(self, y: Float[Array, " M"], signals: Signals) -> Float[Array, " M"]:
        return y + self.bias


class SensorLag(AbstractEffect):
    """A first-order filter in the sensor."""

    cause: ClassVar[str] = "sensor_lag"
    shown_by: ClassVar[str] = "a chirp of 0.1 to 6 Hz"

    time_constant: Float[Array, ""] = parameter("s", "of the filter", lower=0.0)

    def probes(self, scales: Scales) -> list[tuple[float, ...]]:
        return [(k * scales.dt,) for k in (0.5, 2, 8)]

    def sensor(self, y: Float[Array, " M"], signals: Signals) -> Float[Array, " M"]:
        return lag(y, jnp.broadcast_to(self.time_constant / signals.h, y.shape))
