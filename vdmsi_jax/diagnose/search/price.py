"""What hypotheses must gain to be worth their parameters, and how they compare."""

import math

import numpy as np

from ...effects.periodic_disturbance import PeriodicDisturbance
from ..actuator import swing
from ..actuator.hypothesis import GROWTH, Hypothesis, Refit, growth
from ..actuator.stage import LASTS, Slot, Stage
from .disguise import backward, lingers, rings_backward

# What causes gain on drives without any stands in docs/calibration, by tests/hidden/calibrate.py.
ORDER_COST = 10.0  # of each coefficient of the plant, in twice the log-likelihood
CAUSE_COST = 20.0  # of a cause, beside
PARAMETER_COST = 8.0  # of each of its parameters
DISGUISED_COST = CAUSE_COST + PARAMETER_COST
"""Of zeros in the right half plane, a plant's or a resonance's: an actuator that first moves the
wrong way is a delay told by a rational function, and pays as one. Likewise a mode that the command
does not move and that outlasts the runs: it is an offset. One that swings through all of them is a
periodic disturbance, and pays as that."""
RARE_COST = 20.0
"""Of zeros in the right half plane, beside: hardly an actuator first moves the wrong way, and most
are late. Not where a cause is told, beside which they tell what its form lacks."""
EARLY = 2.0
"""Samples by which a response may seem to come before its command, where stamps are uneven or what
is measured was differenced: no cause, and yet in the model."""
CHANGE = 0.02
"""Of a gain, below which it does not change."""
PHASE_COST = 4.0  # of what swings, in each further run
_SWING_WEIGHT = PeriodicDisturbance.weight
WAIT_COST = 2.0  # of what was on its way, in each run
_CURVES = ("gain_nonlinearity", "saturation", "dead_zone")
FORM_COST = 15.0  # of each static curve beyond the first: two of them mend the form of one


def price(stage: Stage, h: Hypothesis) -> float:
    """What a hypothesis must gain in twice the log-likelihood to be worth its parameters; nothing
    is worth a response that comes before its command by more than stamps of time are off, or at
    all where a controller makes the command, which then is the answer to the response; nor a
    change of gain that is none: the lag that comes with it would be one pole more of the plant; nor
    a drift that is over at once, nor what swings too seldom to be told from a level of each run or
    a trend, nor a plant that grows by itself."""
    slots = [stage.slots[number] for number in h.active]
    early = 0.0 if stage.in_loop else -EARLY * stage.dt
    if any(s.cause == "transport_delay" and h.theta[s.index[0]] < early for s in slots):
        return math.inf
    if any(s.cause == "regime_change" and abs(h.theta[s.index[1]]) < CHANGE for s in slots):
        return math.inf
    if any(s.cause == "gain_drift" and _is_over(stage, h, s) for s in slots):
        return math.inf
    frequency = h.frequency(stage)
    if frequency is not None and swing.drifts(stage, frequency):
        return math.inf
    if growth(stage, [h])[0] > GROWTH:
        return math.inf
    causes = sum(CAUSE_COST + PARAMETER_COST * slot.weight for slot in slots)
    phases = 0 if h.swing is None else len(h.swing) - 1  # beyond the one that is counted
    waits = len(stage.u) if any(s.cause == "transport_delay" for s in slots) else 0
    forms = max(sum(s.cause in _CURVES for s in slots) - 1, 0)
    causes += PHASE_COST * phases + WAIT_COST * waits + FORM_COST * forms
    return _plant_price(stage, h) + causes


def _is_over(stage: Stage, h: Hypothesis, slot: Slot) -> bool:
    """Whether a gain has drifted to its last value, but for a twentieth, nearly at once."""
    bend = h.theta[slot.index[slot.names.index("bend")]]
    lasts = LASTS * stage.scales.clock(getattr(slot.effect, "over", "run"))
    return bool(bend * lasts > 3.0)


def _plant_price(stage: Stage, h: Hypothesis) -> float:
    wrong_way = bool(backward(h).size)
    cost = ORDER_COST * (h.poles + h.zeros + 1) + RARE_COST * (wrong_way and not h.active)
    cost += DISGUISED_COST * (wrong_way + rings_backward(stage, h) + lingers(stage, h))
    line = CAUSE_COST + PARAMETER_COST * _SWING_WEIGHT + PHASE_COST * (len(stage.u) - 1)
    each = 0.5 * line - ORDER_COST  # of the two poles that are counted
    return cost + each * int(np.sum(swing.goes_on(stage, np.roots(h.den))))


def score(stage: Stage, fit: Refit) -> float:
    """Twice the log-likelihood less the price."""
    return 2.0 * fit.loglik - price(stage, fit.hypothesis)


def lack(stage: Stage, final: Refit, other: Refit) -> float:
    """What a model with another cause lacks, in twice the log-likelihood: two for each parameter
    more of its causes, and the price of a larger plant, which may imitate the cause."""

    def burden(h: Hypothesis) -> float:
        return 2.0 * (h.size(stage) - h.poles - h.zeros - 1) + _plant_price(stage, h)

    more = burden(other.hypothesis) - burden(final.hypothesis)
    return 2.0 * (final.loglik - other.loglik) + more
