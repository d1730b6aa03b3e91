"""What is left of the response of one plant, which no other is asked for."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from ...config import PlantSpec
from ..actuator.feedback import is_answered, trembles
from ..actuator.stage import Stage
from ..answer.result import Unexplained
from ..search.found import PlantFinding, Search
from ..search.search import FREE
from ..signals.colour import whiten
from ..signals.disturbance import IMITATORS, demands, moving
from ..signals.runs import Runs
from ..signals.unexplained import (
    PUZZLING,
    SMALL,
    beside_response,
    extent,
    slow_error,
    structure,
)
from . import stand_ins
from .leftover import (
    LOUD,
    SEEN,
    is_rounding,
    of_a_kind,
    puzzles,
    refuted,
    steps_of,
    taken_for_noise,
)
from .questions import asked, evenly_of
from .regression import explained, weighed
from .travelled import line_over

_STEP = 0.1  # by which what repeats with the place may differ from the step of a rounding
_LOUD_ECHO = 300.0  # the same where a controller makes the commands, which know of the error
_MOST = 0.5  # of the response's spread, an error from which on a model says little of it: of seven
# exams no clean log, and none of a cause that the library has, was left with more than 0.4


@dataclass(frozen=True, eq=False)
class PlantLeft:
    """What the final model of a plant leaves.

    Attributes:
        found: structure, disturbances among it.
        outdone: the causes that only stand in for a kind of error that the library lacks.
        echoing: whether a controller makes the commands.
    """

    found: tuple[Unexplained, ...]
    outdone: tuple[tuple[PlantFinding, Unexplained], ...]
    echoing: bool

    @classmethod
    def of(cls, runs: Runs, spec: PlantSpec, own: Search) -> "PlantLeft":
        """Look at what the model leaves."""
        loaded = is_answered(own.stage, own.final)
        echoes = loaded or trembles(own.stage.u, own.stage.mask)
        found = _structure(runs, spec, own, loaded, echoes)
        return cls(tuple(found), tuple(stand_ins.of_plant(runs, spec, own)), echoes)


def _structure(
    runs: Runs, spec: PlantSpec, own: Search, loaded: bool, echoes: bool
) -> list[Unexplained]:
    stage, final = own.stage, own.final
    loud = _LOUD_ECHO if echoes else LOUD
    e = np.where(stage.mask | stage.held_out, stage.y - final.y, 0.0)
    evenly = evenly_of(runs, spec)
    white = whiten(e[None], final.colour[None])[0] * evenly
    masks = (stage.mask, stage.held_out)
    causes = [stage.slots[finding.number].cause for finding in own.findings]
    kind = explained(weighed(*asked(spec, stage, final.y, evenly)), causes)
    found = of_a_kind(spec.output, kind, causes, e, stage.y, stage.mask)
    steps = steps_of(runs.records, spec.output)
    found += _of_the_way(spec.output, final.y, e, white, stage, steps)
    found += structure(spec.output, e * evenly, white, *masks, runs.begins, stage.dt)
    needs = demands(stage.u, final.y, stage.mask | stage.held_out, stage.dt)
    moves = moving(np.asarray(stage.signals.v), stage.mask | stage.held_out)
    known = stage.noise.slow
    if loaded:  # what is asked goes with the error, and not the other way round
        needs = needs[:0]
    about = spec.output, e, white, stage.y, needs, masks, stage.dt
    slow = slow_error(*about, known, moves, stage.scales.time_constant)
    if slow is not None and not any(u.of_form and u.fraction > slow.fraction for u in found):
        found.append(replace(slow, answered=loaded))  # which the form of a cause does not leave
    use, beside = stage.mask | stage.held_out, bool(causes)
    if not (loaded or puzzles(found) or is_rounding(steps, e[use])):
        found += taken_for_noise(spec.output, e, white, stage.y, use, beside, _MOST)
    # what may have drawn the noise, or the disturbance, of the data fitted; a mean that is another
    # in each run is slow, and told by that if it is large
    drawn = IMITATORS if slow is not None and slow.steady else {"resonance", "offset"}
    broken: dict[str, tuple[float, float]] = {}  # of several forms or plants with it, the most
    for failed in own.failed:
        slot = stage.slots[failed.finding.number]
        label = f"{slot.cause} ({slot.where})"
        fraction = stand_ins.took(stage, failed.finding, failed.final)
        if slot.cause in drawn or slot.cause in causes:  # of which another form is borne out
            continue
        if slot.weight < FREE and failed.finding.gain > loud and fraction > SEEN:
            size = math.sqrt(fraction * failed.finding.less.error(stage))
            told = fraction, size / extent(stage.y[stage.mask])
            broken[label] = max(broken.get(label, (0.0, 0.0)), told)
    found += [refuted(label, spec.output, *shares) for label, shares in broken.items()]
    return beside_response(found, e, stage.y, stage.mask | stage.held_out)


def _of_the_way(
    channel: str,
    response: np.ndarray,
    e: np.ndarray,
    white: np.ndarray,
    stage: Stage,
    steps: Sequence[float],
) -> list[Unexplained]:
    """What repeats with the way, which is the integral of the response: that of a speed. Or with
    the way of the vehicle, or with the place, which is the response itself: that of a position,
    unless it is logged in such steps."""
    use = stage.mask | stage.held_out
    along = np.cumsum(response, axis=1) * stage.dt
    unit = "m of way" if channel == "v" else f"of the integral of {channel}"
    ways = [(along, f"integral of {channel}", unit, False)]
    travelled = np.asarray(stage.signals.distance)
    if channel != "v" and np.ptp(travelled) > 0.0:  # a wheel out of balance shakes the steering
        ways.append((travelled, "way", "m of way", False))
    ways.append((response, channel, f"of {channel}", True))
    lines = ((line_over(x, e, white, use, stage.dt, place), *told) for x, *told, place in ways)
    line, on, unit = next((one for one in lines if one[0] is not None), (None, "", ""))
    if line is None or any(abs(line.period - step) < _STEP * step for step in steps):
        return []
    words = f"it repeats every {line.period:.3g} {unit}"
    size = float(np.sqrt(line.share * np.mean(e[use] ** 2))) / extent(stage.y[use])
    if size < SMALL:
        words += f"; {100.0 * size:.1f} % of the response's spread"
        return [Unexplained(channel, line.share, (on,), (), words, size=size)]
    return [Unexplained(channel, line.share, (on,), (), words, puzzling=line.share > PUZZLING)]
