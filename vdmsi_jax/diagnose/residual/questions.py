"""What to ask `regression` about an error: which kinds of it, of a plant's response or of a yaw
rate, with what stands beside them."""

import numpy as np

from ...config import PlantSpec
from ..actuator import swing
from ..actuator.stage import Stage
from ..body.body import Body
from ..body.fit import residual
from ..body.lane import BodyFit
from ..signals.angle import derived, steering_angle
from ..signals.runs import Runs
from ..signals.windows import thinned
from .families import Family, of_body, of_plant, of_swing

_MANY = 30_000  # samples, beyond which kinds of error are asked by means of several

Question = tuple[np.ndarray, np.ndarray, list[Family], np.ndarray, np.ndarray, float]


def asked(
    spec: PlantSpec,
    stage: Stage,
    y: np.ndarray,
    evenly: np.ndarray | float = 1.0,
    frequency: float | None = None,
) -> Question:
    """What to ask `regression.weighed` about a plant whose model responds with `y`; `evenly` makes
    its noise as large everywhere. The command is that of the row before, since a controller may
    have made that of the row itself of the row's noise. With a `frequency`, Hz, what swings so is
    asked alone, of what was fitted: each run has its own phase.
    """
    e = np.where(stage.mask | stage.held_out, stage.y - y, 0.0) * evenly
    given = np.concatenate([stage.u[:, :1], stage.u[:, :-1]], axis=1)
    other, t = (np.asarray(x) for x in (stage.signals.other, stage.signals.t))
    every = -(-e.size // _MANY)
    weights = thinned(evenly * np.ones_like(e), every)
    e, u, y, other, t, mask, held_out = (
        thinned(x, every) for x in (e, given, y, other, t, stage.mask, stage.held_out)
    )
    dt = every * stage.dt
    named, span = (spec.input, spec.output), stage.scales.time_constant
    linear, families = of_plant(u, y, other, t, named, mask, dt, span)
    if frequency is not None:
        families = of_swing(y, thinned(swing.columns(stage, frequency), every), spec.output)
        held_out = np.zeros_like(held_out)
    return e, linear * weights, [f.times(weights) for f in families], mask, held_out, dt


def asked_of_body(runs: Runs, body: Body, fit: BodyFit) -> Question:
    """The same about the yaw rate of a body."""
    masks = (body.mask["r"], body.held_out["r"])
    e = residual(body, fit, "r", masks[0] | masks[1])
    every = -(-e.size // _MANY)
    e, v, delta, t, mask, held_out = (
        thinned(x, every) for x in (e, body.v, body.delta, runs.time(), *masks)
    )
    return e, *of_body(v, delta, t, mask, every * body.dt), mask, held_out, every * body.dt


def by_name(question: Question) -> Question:
    """The same, of the kinds that have a name alone."""
    e, linear, families, mask, held_out, dt = question
    return e, linear, [f for f in families if f.causes is not None], mask, held_out, dt


def evenly_of(runs: Runs, spec: PlantSpec) -> np.ndarray | float:
    """What makes noise as large everywhere: an angle that was made of the yaw rate has that one's
    noise over the speed."""
    angle = steering_angle(runs) if spec.output == "delta" else None
    if angle is None or not derived(runs):
        return 1.0
    speed = np.where(angle[1], np.abs(runs.channel("v")), 0.0)
    return speed / max(float(np.mean(speed[angle[1]])), 1e-300)
