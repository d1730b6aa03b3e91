"""What a diagnosis tells of each channel: how well it is explained, and what was measured."""

from collections.abc import Mapping, Sequence

import numpy as np

from ...config import PlantSpec
from ...data.record import Record
from ..answer.result import ChannelScore, Response
from ..body.fit import residual
from ..body.search import BodySearch, judges_of
from ..search.found import Search
from ..search.judge import fit_percent
from ..signals.colour import whiten
from ..signals.runs import Runs


def units_of(records: Sequence[Record], spec: PlantSpec) -> tuple[str, str]:
    """Units of the command and the response of a plant."""
    units = records[0].units
    return units.get(spec.input, "rad"), units.get(spec.output, "rad")


def channel_scores(
    searches: Mapping[PlantSpec, Search], bodily: BodySearch | None, extended: bool
) -> dict[str, ChannelScore]:
    """How the models with or without their causes explain each channel, on data held out."""
    found = {}
    for spec, own in searches.items():
        stage, fit = own.stage, own.final if extended else own.baseline
        use = own.judges
        left = (stage.y - own.final.y)[stage.mask]
        noise = float(np.std(left)) if stage.noise.std is None else stage.noise.std
        found[spec.output] = _score(stage.y[use], (stage.y - fit.y)[use], noise, stage.noise.by)
    if bodily is not None and "r" in bodily.body.measured:
        body, fit = bodily.body, bodily.final if extended else bodily.plain
        mask, use = body.mask["r"], judges_of(body, "r")[0]
        left = residual(body, bodily.final, "r", mask)[mask]
        e = residual(body, fit, "r", use)[use]
        found["r"] = _score(body.measured["r"][use], e, float(np.std(left)))
    return found


def _score(y: np.ndarray, e: np.ndarray, noise: float, by: str = "own") -> ChannelScore:
    ceiling = fit_percent(y, np.full(y.shape, noise))
    return ChannelScore(fit_percent(y, e), float(np.mean(e**2)), noise, ceiling, by)


def responses(
    records: Sequence[Record],
    runs: Runs,
    searches: Mapping[PlantSpec, Search],
    bodily: BodySearch | None,
) -> list[Response]:
    """What was commanded and measured, and what the models say with and without their causes."""
    made = []
    for spec, own in searches.items():
        stage, units = own.stage, units_of(records, spec)
        known = stage.mask | stage.held_out
        e = np.where(known, stage.y - own.final.y, 0.0)
        made.append(
            Response(
                spec.name,
                spec.input,
                spec.output,
                units[1],
                runs.names,
                stage.dt,
                runs.time(),
                stage.u,
                stage.y,
                own.baseline.y,
                own.final.y,
                whiten(e[None], own.final.colour[None])[0],
                known,
                stage.held_out,
                command_unit=units[0],
            )  # fmt: skip
        )
    if bodily is not None and "r" in bodily.body.measured:
        body = bodily.body
        known = body.mask["r"] | body.held_out["r"]
        fits = (bodily.plain, bodily.final)
        before, after = (body.measured["r"] - residual(body, f, "r", known) for f in fits)
        e = np.where(known, body.measured["r"] - after, 0.0)
        made.append(
            Response(
                "vehicle",
                "delta",
                "r",
                "rad/s",
                runs.names,
                body.dt,
                runs.time(),
                body.delta,
                body.measured["r"],
                before,
                after,
                whiten(e[None], bodily.final.colour["r"][None])[0],
                known,
                body.held_out["r"],
                command_unit="rad",
            )  # fmt: skip
        )
    return made
