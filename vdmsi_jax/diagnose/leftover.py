"""What all causes together leave: structure, in each channel, that the library has no name for."""

from collections.abc import Mapping

import numpy as np

from ..config import PlantSpec
from .body import CAUSES
from .body_fit import residual
from .body_search import BodySearch
from .colour import whiten
from .found import Failed, Search
from .judge import Scored
from .prepare import Runs, derived, steering_angle
from .result import Unexplained
from .stage import Stage
from .unexplained import LARGE, LARGE_HELD_OUT, history, slow_error, structure

_LOUD = 60.0  # of twice the log-likelihood, from which a cause that fails on other data is told
_SEEN = 0.005  # of the squared error, from which on it is
_PUZZLING = 0.2  # of it, from which on it casts doubt on what was found beside


def leftover(
    runs: Runs, searches: Mapping[PlantSpec, Search], bodily: BodySearch | None
) -> list[Unexplained]:
    """What the final models leave in the responses of the plants and in the yaw rate."""
    found = []
    for spec, own in searches.items():
        found += _of_stage(runs, spec, own)
    if bodily is not None:
        found += _of_body(runs, bodily)
    return found


def _broken(label: str, channel: str, fraction: float) -> Unexplained:
    """A cause that explains what was fitted and fails on what was held out."""
    words = f"{label} would explain the data fitted, and fails on the data held out"
    return Unexplained(channel, fraction, ("run",), (), words, puzzling=fraction > _PUZZLING)


def _failed(stage: Stage, failed: Failed) -> float:
    """Share of the squared error that a cause took where it was fitted."""
    less, final = failed.finding.less, failed.final
    return max(Scored("", stage.y, less.y, final.y, final.colour).taken(stage.mask), 0.0)


def _of_stage(runs: Runs, spec: PlantSpec, own: Search) -> list[Unexplained]:
    stage, final = own.stage, own.final
    e = np.where(stage.mask | stage.held_out, stage.y - final.y, 0.0)
    evenly = _evenly(runs, spec)
    white = whiten(e[None], final.colour[None])[0] * evenly
    rate = np.gradient(final.y, stage.dt, axis=1)
    regressors = {spec.input: stage.u, spec.output: final.y, f"rate of {spec.output}": rate}
    regressors["t"] = np.asarray(stage.signals.t)
    for seconds in (1.0, 8.0):
        past = history(np.abs(stage.u), seconds, stage.dt)
        regressors[f"the past {seconds:.0f} s of {spec.input}"] = past
    if np.any(np.asarray(stage.signals.other)):
        regressors["the other command"] = np.asarray(stage.signals.other)
    masks = (stage.mask, stage.held_out)
    found = structure(spec.output, e * evenly, white, *masks, regressors, runs.names, stage.dt)
    for use, least in zip(masks, (LARGE, LARGE_HELD_OUT), strict=True):
        slow = slow_error(spec.output, e, white, stage.y, use, stage.dt, least)
        if slow is not None:
            found.append(slow)
            break
    for failed in own.failed:
        slot = stage.slots[failed.finding.number]
        label = f"{slot.cause} ({slot.where})"
        fraction = _failed(stage, failed)
        if failed.finding.gain > _LOUD and fraction > _SEEN:
            found.append(_broken(label, spec.output, fraction))
    return found


def _evenly(runs: Runs, spec: PlantSpec) -> np.ndarray | float:
    """What makes noise as large everywhere: an angle that was made of the yaw rate has that one's
    noise over the speed."""
    angle = steering_angle(runs) if spec.output == "delta" else None
    if angle is None or not derived(runs, angle):
        return 1.0
    speed = np.where(angle[1], np.abs(runs.channel("v")), 0.0)
    return speed / max(float(np.mean(speed[angle[1]])), 1e-300)


def _of_body(runs: Runs, found: BodySearch) -> list[Unexplained]:
    body, final = found.body, found.final
    if "r" not in body.measured:
        return []
    regressors = {"v": body.v, "delta": body.delta, "t": runs.time()}
    regressors["lateral acceleration"] = body.v**2 * body.delta
    masks = (body.mask["r"], body.held_out["r"])
    e = residual(body, final, "r", masks[0] | masks[1])
    white = whiten(e[None], final.colour["r"][None])[0]
    left = structure("r", e, white, *masks, regressors, runs.names, body.dt)
    for failed in found.failed:
        if failed.finding.gain > _LOUD and failed.share > _SEEN and not failed.usual:
            cause = CAUSES[failed.finding.number]
            place = f"{cause.where} {cause.channel}" if cause.channel else cause.where
            left.append(_broken(f"{cause.cause} ({place})", failed.channel, failed.share))
    return left
