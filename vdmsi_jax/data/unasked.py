"""Channels that commands wait for and that a log of poses still tells: speed, yaw rate, steering
angle, where neither the log nor its configuration has them; and the heading of a position."""

from collections.abc import Mapping

import numpy as np

from ..config import Config, Derivation
from .derive import Channels
from .noise import white_noise_std

_SHORTEST, _LONGEST = 5, 0.5  # samples; s
_CLEAR = 0.1  # noise of a slope, of the spread of the command that it answers to
_SLOW = 0.25  # of the highest speed, below which noise drowns the steering angle


def unasked(
    channels: Channels, config: Config, least: Mapping[str, float]
) -> Mapping[str, Derivation]:
    """Derivations of what is missing, in their order.

    Args:
        channels: what there is; a sentence about what will be derived is added.
        config: whose pairs of channels are left as they are, where it names some.
        least: of the parabolas that differentiate, s; those of other logs of the vehicle, so that
            the noise of all is alike.
    """
    there, vehicle = set(channels.values), config.vehicle
    if vehicle is None or config.plants:
        return {}
    if "psi" not in there:
        return _heading(channels)
    made: dict[str, Derivation] = {}
    if "v" not in there:
        if not {"x", "y", "v_cmd"} <= there:
            return {}
        window = max(_window(channels, "x", "v_cmd"), least.get("v", 0.0))
        made["v"] = Derivation("speed_from_pose", window=window)
    if "delta_cmd" in there and not {"delta", "r"} & there:
        speed = channels.values["v" if "v" in there else "v_cmd"]
        fast = float(np.quantile(np.abs(speed), 0.95))
        window = _window(channels, "psi", "delta_cmd", fast / abs(vehicle.wheelbase))
        window = max(window, least.get("r", 0.0))
        made["r"] = Derivation("yaw_rate_from_heading", window=window)
        if fast > 0.0:
            made["delta"] = Derivation("steering_from_yaw_rate", min_speed=_SLOW * fast)
    if made:
        windows = [how.window for how in made.values() if how.window is not None]
        channels.told.append(
            f"derived {', '.join(made)} from the pose, by parabolas over {max(windows):.3g} s; "
            f"[derive] may say otherwise"
        )
    return made


def _heading(channels: Channels) -> Mapping[str, Derivation]:
    """Of a position that moves, beside a speed and a yaw rate of a sensor that lives, or else a
    steering angle."""
    values = channels.values
    if not {"x", "y", "v"} <= set(values) or np.ptp(values["x"]) + np.ptp(values["y"]) == 0.0:
        return {}
    if "r" in values and np.ptp(values["r"]) > 0.0:
        by, how = "r", Derivation("heading_from_path")
    elif "delta" in values:
        by, how = "delta and v", Derivation("heading_from_path_and_steering")
    else:
        return {}
    channels.told.append(
        f"derived psi from {by}, turned to the course of x and y: it counts as no measurement, and "
        f"a diagnosis turns simulated paths about their start to fit; [derive] may say otherwise"
    )
    return {"psi": how}


def _window(channels: Channels, measured: str, command: str, gain: float = 1.0) -> float:
    """Length of the parabola that differentiates a measurement, s: the shortest whose slope is
    clear of noise."""
    sigma = white_noise_std([channels.values[measured][piece] for piece in channels.pieces])
    wanted = _CLEAR * gain * float(np.std(channels.values[command]))
    samples = _SHORTEST
    while (samples + 1) * channels.dt < _LONGEST:
        half = samples // 2
        slope = sigma / (channels.dt * np.sqrt(half * (half + 1) * (2 * half + 1) / 3.0))
        if not slope > wanted:
            break
        samples += 2
    return (samples - 1) * channels.dt
