"""What all causes together leave: structure, in each channel, that the library has no name for."""

from collections.abc import Mapping

import numpy as np

from ..config import PlantSpec
from .body_fit import residual
from .body_search import BodySearch
from .colour import whiten
from .naming import Named
from .prepare import Runs
from .result import Unexplained
from .search import Search
from .unexplained import history, slow_error, structure

_LOUD = 60.0  # of twice the log-likelihood, from which a cause that fails on other data is told


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


def loud(cause: Named) -> bool:
    """Whether a cause that does not hold on other data was more than chance where it was fitted."""
    return cause.statistic > _LOUD


def broken(cause: Named, channel: str) -> Unexplained:
    """A cause that explains what was fitted and fails on what was held out."""
    share = 0.0
    if cause.search is not None and cause.finding is not None:
        stage = cause.search.stage
        less, final = (stage.y - f.y for f in (cause.finding.less, cause.search.final))
        before, after = (float(np.mean(e[stage.mask] ** 2)) for e in (less, final))
        share = max(1.0 - after / max(before, 1e-300), 0.0)
    words = f"{cause.label} would explain the data fitted, and fails on the data held out"
    return Unexplained(channel, share, ("run",), (), words, puzzling=True)


def _of_stage(runs: Runs, spec: PlantSpec, own: Search) -> list[Unexplained]:
    stage, final = own.stage, own.final
    e = np.where(stage.mask | stage.held_out, stage.y - final.y, 0.0)
    white = whiten(e[None], final.colour[None])[0]
    rate = np.gradient(final.y, stage.dt, axis=1)
    regressors = {spec.input: stage.u, spec.output: final.y, f"rate of {spec.output}": rate}
    regressors["t"] = np.asarray(stage.signals.t)
    for seconds in (1.0, 8.0):
        past = history(np.abs(stage.u), seconds, stage.dt)
        regressors[f"the past {seconds:.0f} s of {spec.input}"] = past
    if np.any(np.asarray(stage.signals.other)):
        regressors["the other command"] = np.asarray(stage.signals.other)
    masks = (stage.mask, stage.held_out)
    found = structure(spec.output, e, white, *masks, regressors, runs.names, stage.dt)
    slow = slow_error(spec.output, e, white, stage.y, stage.mask, stage.dt)
    return found if slow is None else [*found, slow]


def _of_body(runs: Runs, found: BodySearch) -> list[Unexplained]:
    body, final = found.body, found.final
    if "r" not in body.measured:
        return []
    regressors = {"v": body.v, "delta": body.delta, "t": runs.time()}
    regressors["lateral acceleration"] = body.v**2 * body.delta
    masks = (body.mask["r"], body.held_out["r"])
    e = residual(body, final, "r", masks[0] | masks[1])
    white = whiten(e[None], final.colour["r"][None])[0]
    return structure("r", e, white, *masks, regressors, runs.names, body.dt)
