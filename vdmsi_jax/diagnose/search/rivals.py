"""What each cause of a model is worth, and which others could stand in its place."""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace

from ..actuator import swing
from ..actuator.hypothesis import Hypothesis, Refit, without
from ..actuator.outcome import steadiness
from ..actuator.refit import PATIENT, refit
from ..actuator.screen import RAGGED, leading, screen
from ..actuator.stage import Slot, Stage
from ..actuator.starts import reduced
from ..actuator.sticking import held
from .baseline import order_of
from .disguise import all_pole, backward, stilled
from .found import PlantFinding
from .price import lack, score

_APART = 1.7  # standard errors over blocks, from which two causes are told apart
_CLOSE, _FORM, _FAR = 15.0, 0.1, 50.0  # lack, the same as a share of the gain, and lack again, up
# to which blocks are asked; beyond, it is no matter of form: 61 answers of four exams
_LOOPS = {"backlash", "coulomb_friction"}
_LOOP = 0.5  # share of the gain, up to which blocks are asked which of them it is
_LITTLE = 0.1  # share of the gain of one of them, up to which the other beside it mends its form
_LOOP_APART = 1.35  # standard errors that do: wrong ones had up to 1.2, right ones from 1.49 on
_OF_COMMAND = 0.2  # share of the gain of a play of the command, up to which friction is not told
# from it by blocks either: both hold what answers, and part in how it breaks away. Friction told as
# such a play lacked 0.10 to 0.17 of it in plain driving, at 2.5 and 3.8 standard errors; of such a
# play itself, 0.36
_WIDE = 0.2  # the width of a limit's corner, beyond which it may be a bend: limits had up to 0.04,
# bends that were told as limits from 0.32
_UNDYING = 1.02  # times the least damping, up to which a mode has as little as it may have
_LARGER = 100.0  # lack, up to which a cause in a larger plant is tried in a smaller one
_ABLE = 0.2  # share of the gain of a cause, that one in its place must promise or gain itself
_TRIED = 5  # causes of a screen that are tried in the place of one
_RIVALS = 8  # that are told


def worths(stage: Stage, final: Refit) -> tuple[PlantFinding, ...]:
    """Each cause of a model with what it is worth there, the strongest first."""
    numbers = final.hypothesis.active
    fits = refit(stage, [without(stage, final.hypothesis, number) for number in numbers])
    less = dict(zip(numbers, fits, strict=True))
    plainer = {k: _plainer(stage, k, f.hypothesis) for k, f in less.items()}
    other = {k: h for k, h in plainer.items() if h is not less[k].hypothesis}
    less |= dict(zip(other, refit(stage, list(other.values())), strict=True))
    found = [PlantFinding(k, 2.0 * (final.loglik - f.loglik), f) for k, f in less.items()]
    return tuple(sorted(found, key=lambda f: -f.gain))


def _plainer(stage: Stage, number: int, less: Hypothesis) -> Hypothesis:
    """A model without a cause, in a plant that cannot tell it: a delay by zeros in the right half
    plane, or what swings by poles that hardly decay."""
    cause = stage.slots[number].cause
    if cause == "transport_delay" and backward(less).size:
        return all_pole(stage, less)
    return stilled(stage, less) if cause == swing.CAUSE else less


def findings_of(
    stage: Stage,
    findings: Sequence[PlantFinding],
    final: Refit,
    seen: Mapping[tuple, Refit],
    failed: Collection[int] = (),
) -> tuple[tuple[PlantFinding, ...], Refit | None]:
    """Findings of a model with what could stand in their place, of causes that have not failed; and
    the best fit with another in the place of one."""
    found, tried = [], []
    for finding in findings:
        number, gain, less = finding.number, finding.gain, finding.less
        screened = screen(stage, less, fine=stage.slots[number].cause in RAGGED)
        probes = [c.beside(less.hypothesis) for c in screened if c.number == number]
        promised = next(iter(refit(stage, probes, rounds=1, further=0)), None)
        own = stage.slots[number]
        # data held out that refute a play do not refute friction for good, nor the other way round
        twins = {k for k in failed if {own.cause, stage.slots[k].cause} == _LOOPS}
        barred = {number, *failed} - twins
        able = (c for c in screened if c.number not in barred and c.gain > _ABLE * gain)
        leaders = leading(stage, able, _TRIED)
        fits = refit(stage, [c.beside(less.hypothesis) for c in leaders])
        kept = set(less.hypothesis.active)
        beside = [
            f
            for f in seen.values()
            if f.adds_one_to(kept) and not barred & set(f.hypothesis.active)
        ]
        fits += [
            f
            for f in beside
            # the cause itself, not a larger plant that imitates the one it stands for
            if (bare := seen.get((*order_of(f.hypothesis), frozenset(kept)))) is not None
            and score(stage, f) > score(stage, bare)
            and 2.0 * (f.loglik - bare.loglik) > _ABLE * gain
        ]
        # what was found in a larger plant and is nearly as good, in one of the same size
        order = order_of(final.hypothesis)
        large = [f for f in beside if f.hypothesis.poles > order[0]]
        large = [f for f in large if lack(stage, final, f) < _LARGER]
        large = _by_cause(stage, large, kept)
        again = refit(stage, [reduced(stage, f.hypothesis, order) for f in large.values()])
        fits += [f for f in again if 2.0 * (f.loglik - less.loglik) > _ABLE * gain]
        if own.cause == "backlash":
            fits += refit(stage, held(stage, final.hypothesis, number), rounds=PATIENT)
        fits = [f for f in fits if own.cause == swing.CAUSE or not _drifts(stage, f, kept)]
        best = _by_cause(stage, fits, kept)
        tried += best.values()
        rivals = [
            (k, lack(stage, final, f)) for k, f in best.items() if stage.slots[k].cause != own.cause
        ]
        rivals = sorted(rivals, key=lambda pair: pair[1])[:_RIVALS]
        alike = [
            k
            for k, lacks in rivals
            if _near(own.cause, stage.slots[k].cause, lacks, gain)
            if _of_command(own, stage.slots[k], lacks, gain)
            or steadiness(stage, best[k], final) < _apart(own.cause, stage.slots[k].cause)
        ]
        bends = [pair for pair in rivals if stage.slots[pair[0]].cause == "gain_nonlinearity"]
        alike += [k for k, lacks in bends[:1] if _may_bend(stage, final, number, lacks, gain)]
        lines = [k for k, _ in rivals if stage.slots[k].cause == "periodic_disturbance"]
        alike += lines[:1] if _undying(stage, final, number) else []
        twin = _twin(stage, finding, findings, final, seen)
        if twin is not None:
            rivals = [twin, *(r for r in rivals if r[0] != twin[0])]
            alike.append(twin[0])
        others = tuple(rivals)
        found.append(replace(finding, others=others, promised=promised, alike=tuple(alike)))
    best_other = max(tried, key=lambda f: score(stage, f), default=None)
    return tuple(found), best_other


def _twin(
    stage: Stage,
    finding: PlantFinding,
    findings: Sequence[PlantFinding],
    final: Refit,
    seen: Mapping[tuple, Refit],
) -> tuple[int, float] | None:
    """Where friction has a play of little worth beside it, or the other way round, which mends what
    its form misses: the best form of that one by itself, and what it lacks against the cause by
    itself, if nothing tells them apart."""
    own, gain = stage.slots[finding.number].cause, finding.gain
    little = {
        f.number
        for f in findings
        if {own, stage.slots[f.number].cause} == _LOOPS and f.gain < _LITTLE * gain
    }
    if not little:
        return None
    kept = set(final.hypothesis.active) - little - {finding.number}
    alone = _by_cause(stage, [f for f in seen.values() if f.adds_one_to(kept)], kept)

    def best(cause: str) -> int | None:
        forms = [k for k in alone if stage.slots[k].cause == cause]
        return max(forms, key=lambda k: score(stage, alone[k]), default=None)

    (other,) = _LOOPS - {own}
    one, twin = best(own), best(other)
    if one is None or twin is None:
        return None
    lacks = lack(stage, alone[one], alone[twin])
    apart = steadiness(stage, alone[twin], alone[one]) > _apart(own, other)
    return (twin, lacks) if _near(own, other, lacks, gain) and not apart else None


def _drifts(stage: Stage, fit: Refit, kept: set[int]) -> bool:
    """Whether what stands in a cause's place is a periodic disturbance that hardly swings."""
    swings = swing.number_of(stage, sorted(kept)) is None
    frequency = fit.hypothesis.frequency(stage) if swings else None
    return frequency is not None and swing.drifts(stage, frequency)


def _by_cause(stage: Stage, fits: Sequence[Refit], kept: set[int]) -> dict[int, Refit]:
    """The best fit with each cause beside those that are kept, by its number."""
    best: dict[int, Refit] = {}
    for f in fits:
        other = next(k for k in f.hypothesis.active if k not in kept)
        if other not in best or score(stage, f) > score(stage, best[other]):
            best[other] = f
    return best


def _may_bend(stage: Stage, fit: Refit, number: int, lacks: float, gain: float) -> bool:
    """Whether a limit with a round corner may be a bend that lacks so much: the corner alone is
    one, where no command goes beyond it, and where it is wide the limit is no formula of either. Of
    what follows the command late, which no form of a bend does, a bend may lack anything."""
    slot, u = stage.slots[number], stage.u[stage.mask]
    if slot.cause != "saturation" or "corner" not in slot.names:
        return False
    values = dict(zip(slot.names, fit.hypothesis.theta[list(slot.index)], strict=True))
    beyond = max(u.max() * values["upper"], -u.min() * values["lower"]) > 1.0
    little = lacks < max(_FAR, _FORM * gain)
    wide = values["corner"] > _WIDE and (little or "before" in values)
    return bool(not beyond or wide)


def _undying(stage: Stage, fit: Refit, number: int) -> bool:
    """Whether a mode has as little damping as it may have: what makes it swing on may be a line,
    whose form behind a friction or a play it meets better than a steady one does."""
    slot, (low, _) = stage.slots[number], stage.bounds
    if slot.cause != "resonance":
        return False
    damping = slot.index[slot.names.index("damping")]
    return bool(fit.hypothesis.theta[damping] < _UNDYING * low[damping])


def _near(cause: str, other: str, lacks: float, gain: float) -> bool:
    """Whether a cause lacks so little that the form of another may not be exact enough to part
    them: of a play and friction, which each make the other's loop, more than of the rest."""
    if {cause, other} == _LOOPS:
        return lacks < max(_CLOSE, _LOOP * gain)
    return lacks < min(_FAR, max(_CLOSE, _FORM * gain))


def _of_command(own: Slot, other: Slot, lacks: float, gain: float) -> bool:
    """Whether friction lacks too little to be told from a play of the command."""
    friction = other.cause == "coulomb_friction"
    return own.effect.hides_small and friction and lacks < _OF_COMMAND * gain


def _apart(cause: str, other: str) -> float:
    """Standard errors over blocks from which the two are told apart."""
    return _LOOP_APART if {cause, other} == _LOOPS else _APART
