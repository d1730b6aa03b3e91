"""Whether other parts of the logs may have to be fitted: what is held out shows what the rest does
not, which no fit can know."""

from collections.abc import Collection

import numpy as np

from ..answer.result import Diagnosis
from ..search.found import Search
from ..signals.unexplained import LARGE_HELD_OUT, SMALL, WORSE, slow_sizes

_ANOTHER = 2.5  # times the slow error on data fitted, from which on other data are of another kind
_NEXT_TO = 0.02  # of the time, that a change may lie before or behind a part


def is_another(own: Search) -> bool:
    """Whether a plant errs much more, and slowly, on the data held out than where it was fitted: of
    what happens there alone no fit can know."""
    stage = own.stage
    masks = (stage.mask, stage.held_out)
    sizes = slow_sizes(stage.y - own.final.y, stage.y, masks, stage.dt)
    return sizes[1] > LARGE_HELD_OUT and sizes[1] > _ANOTHER * sizes[0]


def breaks_where_judged(own: Search) -> bool:
    """Whether a change of regime was found whose moment lies in a part that is held out, or next to
    one: no fit can know it better."""
    stage = own.stage
    found = [(f, own.final) for f in own.findings] + [(f.finding, f.final) for f in own.failed]
    for finding, final in found:
        slot = stage.slots[finding.number]
        if slot.cause != "regime_change":
            continue
        clock = np.asarray(stage.signals.clock(getattr(slot.effect, "over", "run")))
        near = np.abs(clock - final.hypothesis.theta[slot.index[0]]) < _NEXT_TO * np.ptp(clock)
        if np.any(near & stage.held_out):
            return True
    return False


def only_where_judged(found: Diagnosis, judging: Collection[str]) -> bool:
    """Whether nothing but structure was found, and that in runs that no fit has seen alone: they
    may ask for what the others do not show, faster steps of the same size or turns at a higher
    speed."""
    left = [u for u in found.unexplained if u.size >= SMALL]
    alone = (
        u.kind == WORSE or (u.when and all(run in judging for run, *_ in u.when)) for u in left
    )
    nothing_else = found.verdict == "unexplained_structure" and not found.findings
    return nothing_else and all(alone)
