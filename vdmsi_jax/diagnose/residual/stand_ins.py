"""Causes that were found, and only stand in for a kind of error that has no name in the library."""

from dataclasses import replace

import numpy as np

from ...config import PlantSpec
from ..actuator import swing
from ..actuator.hypothesis import Refit, responses, without
from ..actuator.lanes import LEADS
from ..actuator.stage import Stage
from ..answer.result import Unexplained
from ..body.body import CAUSES
from ..body.search import BodyFinding, BodySearch
from ..search.found import PlantFinding, Search
from ..search.judge import Scored
from ..signals.runs import Runs
from ..signals.unexplained import PUZZLING
from .families import BY_DIRECTION, PACE
from .questions import asked, asked_of_body, by_name, evenly_of
from .regression import Explained, better_than, weighed

_LEVEL = 0.5  # of what an offset gains, which no kind tells, since a plant has it anyway
_STILL = 0.3  # of what a cause does to a response, that it does at rest at the least


def of_plant(runs: Runs, spec: PlantSpec, own: Search) -> list[tuple[PlantFinding, Unexplained]]:
    """Causes that were found in a plant, and that a kind of error without a name tells better."""
    stage, evenly, found = own.stage, evenly_of(runs, spec), []
    for finding in own.findings:
        cause = stage.slots[finding.number].cause
        y = own.without(finding).y
        kinds = weighed(*by_name(asked(spec, stage, y, evenly)))
        worth = finding.gain * (_LEVEL if cause == "offset" else 1.0)
        better = better_than(cause, worth, kinds)
        if better is None and cause == swing.CAUSE:
            frequency = own.final.hypothesis.frequency(stage)
            better = better_than(cause, 0.0, weighed(*asked(spec, stage, y, evenly, frequency)))
        if better is not None:
            found.append((finding, _instead(spec.output, cause, better)))
        elif pace := _pace(own, finding):
            words = f"{pace} would explain it better than {cause}"
            share = took(stage, finding, own.final)
            left = Unexplained(spec.output, share, (spec.output,), (), words, share > PUZZLING)
            found.append((finding, left))
    return found


def of_body(runs: Runs, bodily: BodySearch) -> list[tuple[BodyFinding, Unexplained]]:
    """The same of the yaw rate."""
    found: list[tuple[BodyFinding, Unexplained]] = []
    if "r" not in bodily.body.measured:
        return found
    answers = {
        f: weighed(*by_name(asked_of_body(runs, bodily.body, f.less))) for f in bodily.findings
    }
    for doubted in (False, True):
        outdone = []
        for finding, kinds in answers.items():
            cause = CAUSES[finding.number].cause
            better = better_than(cause, finding.gain, kinds, doubted=doubted)
            if better is not None:
                outdone.append((finding, _instead("r", cause, better)))
        if not outdone:
            break
        answers = {f: kinds for f, kinds in answers.items() if f not in dict(outdone)}
        found += outdone
    return found


def _pace(own: Search, finding: PlantFinding) -> str:
    """What a cause stands in for where only the time that a plant takes is another, and no gain at
    rest; empty else. A vehicle's drive pushes and brakes by different parts."""
    slot = own.stage.slots[finding.number]
    if slot.where == "plant" and getattr(slot.effect, "by", None) == "effort":
        return BY_DIRECTION
    return PACE if _moves_alone(own, finding) else ""


def _moves_alone(own: Search, finding: PlantFinding) -> bool:
    """Whether a cause bends what pulls the response back only while that moves: where it rests, a
    controller in the plant makes up for it, so that no characteristic is bent."""
    stage, h = own.stage, own.final.hypothesis
    if getattr(stage.slots[finding.number].effect, "by", None) not in ("stiffness", "power"):
        return False
    bare, at_rest = without(stage, h, finding.number), []
    for known in (h, bare):
        theta = known.theta.copy()
        theta[list(LEADS)] = 0.0
        at_rest.append(replace(known, theta=theta))
    plain, *still = responses(stage, [bare, *at_rest])
    rests, moves = (
        float(np.std(x[stage.mask])) for x in (np.subtract(*still), own.final.y - plain)
    )
    return rests < _STILL * moves


def _instead(channel: str, cause: str, better: Explained) -> Unexplained:
    kind, on, share = better.family.words, better.family.depends_on, max(better.share, 0.0)
    words = f"{kind} would explain it better than {cause}"
    return Unexplained(channel, share, on, (), words, puzzling=share > PUZZLING, kind=kind)


def took(stage: Stage, finding: PlantFinding, final: Refit) -> float:
    """Share of the squared error that a cause takes in a model where that was fitted."""
    scored = Scored.of_stage(stage, finding.less, final)
    return max(scored.taken(stage.mask), 0.0)
