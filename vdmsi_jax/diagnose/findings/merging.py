"""Causes that are one: of an actuator and of its sensor, of wheels and of what reads them."""

from collections.abc import Sequence
from dataclasses import replace

from ..answer.result import Estimate, Rival
from .naming import Named

_HALF = 0.5  # of a value, by which two that are one may differ, however uncertain they are


def merged(causes: list[Named]) -> list[Named]:
    """Causes of actuators and of the body, with those that are one sensor's told as such: a delay
    or an offset of an actuator that the body takes back is its sensor's, and so is what cannot be
    told from it."""
    kept = list(causes)
    for channel, plant in (("delta", "steering"), ("v", "powertrain")):
        for word, actuator in (("sensor_delay", "transport_delay"), ("sensor_bias", "offset")):
            seen, own = _of_sensor(kept, word, channel), _first(kept, actuator, plant)
            if seen is None:
                continue
            if own is None and seen.where == "sensor":
                weaker = [c for c in kept if c.where == plant and c.statistic < seen.statistic]
                like = [c for c in weaker if _may_be(c, actuator)]
                rivals = (Rival(c.cause, plant, seen.statistic, False) for c in like)
                joint = replace(seen, rivals=(*seen.rivals, *rivals))
                kept = [joint if c is seen else c for c in kept if c not in like]
            elif own is not None and _same_size(own, seen):
                joint = replace(
                    own, cause=word, where="sensor", channel=channel, body=seen.body,
                    statistic=own.statistic + seen.statistic,
                    rivals=(Rival(actuator, plant, seen.statistic, False),
                            *(r for r in own.rivals if r.cause != word)),
                )  # fmt: skip
                kept = [joint if c is own else c for c in kept if c is not seen]
    return kept


def _of_sensor(causes: Sequence[Named], word: str, channel: str) -> Named | None:
    """The fault of a sensor that the body tells: by its name, by that of a lag which may be the
    delay, or, of an angle, as wheels that stand otherwise."""
    own = [c for c in causes if c.channel == channel and c.where == "sensor"]
    told = next((c for c in own if c.cause == word or _may_be(c, word)), None)
    if told is not None or (word, channel) != ("sensor_bias", "delta"):
        return told
    askew = _first(causes, "offset", "vehicle")
    turns_wheels = askew is not None and askew.parameters["bias"].unit == "rad"
    return askew if turns_wheels else None


def _may_be(cause: Named, other: str) -> bool:
    """Whether the logs do not tell a cause from another of the same part."""
    return any(
        (r.cause, r.where) == (other, cause.where) and r.indistinguishable for r in cause.rivals
    )


def _same_size(own: Named, seen: Named) -> bool:
    """Whether what an actuator has and what the body takes back may be one size."""
    a, b = (next(iter(c.parameters.values())) for c in (own, seen))
    sign = -1.0 if seen.where == "vehicle" else 1.0
    sure = min(4.0 * (a.std + b.std), _HALF * abs(a.value))
    return abs(a.value - sign * b.value) < max(0.35 * abs(a.value), sure)


def of_yaw_rate(cause: Named, per_angle: float) -> Named:
    """A fault of the angle's sensor as one of the yaw rate's, which the angle was made of.

    Args:
        cause: any.
        per_angle: yaw rate per angle at the usual speed, 1/s.
    """
    if (cause.where, cause.channel) != ("sensor", "delta"):
        return cause
    told = dict(cause.parameters)
    if cause.cause == "sensor_bias":
        value, std = (per_angle * x for x in (told["bias"].value, told["bias"].std))
        told["bias"] = Estimate(value, std, "rad/s")
    return replace(cause, channel="r", parameters=told)


def _first(causes: Sequence[Named], cause: str, where: str) -> Named | None:
    return next((c for c in causes if (c.cause, c.where) == (cause, where)), None)
