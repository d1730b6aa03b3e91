"""The powertrain from an IMU: identified by the acceleration that it makes, used by the speed.

A velocity command that passes through `G(s)` makes the acceleration `s G(s)`, so a plant with the
output `a` is `G` with one zero more, at zero, and the IMU's bias is its offset. The acceleration is
measured and not the derivative of a noisy speed, which is what the paper leaves to future work.
"""

from dataclasses import dataclass

import numpy as np

from vdmsi_jax.config import PlantSpec
from vdmsi_jax.errors import InputError
from vdmsi_jax.identify.result import Fit, Floats
from vdmsi_jax.models.transfer_function import TransferFunction

IMU_POWERTRAIN = PlantSpec("powertrain", "v_cmd", "a")
"""The powertrain with the IMU's acceleration as its output: `identify(log, IMU_POWERTRAIN)`, or in
a configuration `[[plants]]` with `output = "a"`."""


@dataclass(frozen=True)
class SpeedResponse:
    """The response of the speed that makes an identified acceleration.

    Attributes:
        model: from velocity command to speed.
        parameter_names: of its coefficients, and of its delay where there is one.
        parameters: (p,) in this order.
        covariance: (p, p) of them.
        bias: of the IMU, m/s²; zero where no offset was fitted.
        bias_std: its standard deviation, m/s².
    """

    model: TransferFunction
    parameter_names: tuple[str, ...]
    parameters: Floats
    covariance: Floats
    bias: float
    bias_std: float

    @property
    def std(self) -> dict[str, float]:
        """Standard deviation of each parameter, by name."""
        deviation = np.sqrt(np.maximum(np.diag(self.covariance), 0.0))
        return dict(zip(self.parameter_names, deviation.tolist(), strict=True))


def measures_acceleration(plant: PlantSpec) -> bool:
    """Whether a plant answers to a velocity command by the acceleration."""
    return (plant.input, plant.output) == (IMU_POWERTRAIN.input, IMU_POWERTRAIN.output)


def speed_of(a: Floats) -> Floats:
    """What a piece of acceleration sums up to, per sample, less the straight line that bias makes
    of it: the acceleration itself answers a step by a pulse, and no lag can be read off that."""
    speed, t = np.cumsum(a), np.linspace(-1.0, 1.0, a.size)
    return speed - np.polyval(np.polyfit(t, speed, 1), t)


def speed_response(fit: Fit) -> SpeedResponse:
    """The speed's response from a fit of the acceleration.

    The fit does not know that its numerator has a root at zero (a constant command makes no lasting
    acceleration). That is imposed afterwards by conditioning the estimate on `b0 = 0`, which is the
    constrained least-squares estimate as far as the residual is linear around the fit (Soderstrom
    and Stoica, System Identification, 1989, complement C4.1). `identify(..., zeros=(1, 2, 3))`
    leaves out the orders that have no root to give.

    Args:
        fit: of a plant from `v_cmd` to `a`.

    Raises:
        InputError: it is none, has no model, or has no zero.
    """
    name = f"the fit {fit.order} of {fit.plant.name}"
    if not measures_acceleration(fit.plant):
        problem = f"is from {fit.plant.input} to {fit.plant.output}"
        raise InputError(name, "plant", problem, "identify the plant from v_cmd to a")
    if fit.model is None or len(fit.model.num) < 2:
        problem = fit.status if fit.model is None else "has no zero, so its speed would jump"
        raise InputError(name, "order", problem, "take one with a zero or more: zeros=(1, 2, 3)")
    at = fit.parameter_names.index("b0")
    variance = fit.covariance[at, at]
    gain = fit.covariance[:, at] / variance if variance > 0.0 else np.zeros(len(fit.parameters))
    parameters = fit.parameters - gain * fit.parameters[at]
    covariance = fit.covariance - gain[:, None] * fit.covariance[at]
    value = dict(zip(fit.parameter_names, parameters.tolist(), strict=True))
    std = np.sqrt(np.maximum(np.diag(covariance), 0.0))
    n, m = len(fit.model.den) - 1, len(fit.model.num) - 1
    num = [value[f"b{i}"] for i in range(m, 0, -1)]
    den = [1.0, *(value[f"a{i}"] for i in range(n - 1, -1, -1))]
    own = [i for i, name in enumerate(fit.parameter_names) if name not in ("b0", "offset")]
    lowered = {f"b{i}": f"b{i - 1}" for i in range(1, m + 1)}
    names = tuple(lowered.get(n, n) for n in (fit.parameter_names[i] for i in own))
    offset = fit.parameter_names.index("offset") if "offset" in value else None
    return SpeedResponse(
        TransferFunction(num, den, delay=value.get("delay")),
        names,
        parameters[own],
        covariance[np.ix_(own, own)],
        0.0 if offset is None else float(parameters[offset]),
        0.0 if offset is None else float(std[offset]),
    )
