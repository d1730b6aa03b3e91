"""From vectors to words: a cause with its parameters as the contract names them."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from ...models.observer_form import made_up_for
from ..actuator import swing
from ..actuator.hypothesis import Hypothesis, Refit
from ..actuator.lanes import LEADS
from ..actuator.stage import Slot
from ..answer.result import RESTS, Estimate, Rival
from ..body.search import BodyFinding
from ..search.found import PlantFinding, Search
from ..signals.colour import whiten

CLEAR = 2.0  # standard errors from which a drift is told as bent, and a change as slowing
_BREAKS_AWAY = 1.125  # times the level: static friction below that is none; of gaps told as
# friction it was up to 1.09, of friction with a breakaway from 1.16
_FORM = 0.015
"""Of a size, the standard deviation that is not noise: what the form of a cause in a machine and in
the library differ by. Measured: of 235 sizes that the hunt hid, in forms of its own, intervals of
noise alone held 90.6 %, with this 94.9 %; of 167 that others hid, 82 % and 92 %."""
_POINTS = ("frequency", "time", "phase", "step")  # of a line, a jump or a grid: no form moves them

_FORMS = {
    ("at", "command"): "of the command",
    ("at", "response"): "of the response",
    ("at", "drive"): "of the drive in a position loop",
    ("at", "corner"): "of the command, with a round corner",
    ("at", "stop"): "of the response, by an end stop",
    ("at", "load"): "of the response, which a load pulls back",
    ("at", "inertia"): "of the response, whose load coasts on",
    ("at", "between"): "before the last lag, with which the response follows",
    ("at", "late"): "of what follows the command late",
    ("at", "spool"): "of what follows the command late, as a valve's spool",
    ("by", "sign"): "alike to both sides",
    ("by", "skew"): "to one side",
    ("by", "response"): "of the response",
    ("by", "stiffness"): "of what pulls the response back",
    ("by", "power"): "of what pulls the response back, by a power of it",
    ("by", "command"): "by the sign of the command",
    ("by", "effort"): "by the sign of the effort",
    ("by", "floor"): "rounding down",
    ("by", "truncation"): "rounding toward zero",
    ("over", "session"): "over the session",
    ("against", "rate"): "against the motion of the response",
    ("against", "response"): "against the speed itself",
    ("by", "signed"): "by the other command",
    ("by", "size"): "by the size of the other command",
    ("by", "square"): "by the square of the other command",
    ("by", "slowed"): "in proportion to both commands",
    ("by", "cornering"): "by the squares of both commands",
    ("by", "speed"): "by the speed",
    ("by", "acceleration"): "by the acceleration",
    ("by", "travel"): "to the other side in reverse",
}


@dataclass(frozen=True, eq=False)
class Named:
    """A cause on its way to a finding.

    Attributes:
        cause, where, channel, form, parameters: as in `Finding`.
        statistic: twice the log-likelihood; `freedom` of its parameters.
        rivals: as in `Finding`.
        search, finding: the stage that found it and what it found there; None for one of the body,
            which is `body`.
    """

    cause: str
    where: str
    channel: str | None
    form: str
    parameters: Mapping[str, Estimate]
    statistic: float
    freedom: int
    rivals: tuple[Rival, ...]
    search: Search | None = None
    finding: PlantFinding | None = None
    body: BodyFinding | None = None

    @property
    def label(self) -> str:
        """`cause (where)`."""
        place = self.where if self.channel is None else f"{self.where} {self.channel}"
        return f"{self.cause} ({place})"

    @property
    def hides_small(self) -> bool:
        """As in `AbstractEffect`."""
        if self.search is None or self.finding is None:
            return False
        return self.search.stage.slots[self.finding.number].effect.hides_small


def of_stage(search: Search, units: tuple[str, str]) -> list[Named]:
    """The causes of an actuator.

    Args:
        search: what was found.
        units: of command and response.
    """
    found = []
    for finding in search.findings:
        slot = search.stage.slots[finding.number]
        parameters = estimates(slot, search.final, search, units)
        slowest = search.stage.scales.time_constant
        alike = _same_force(slot.cause, slot.where, parameters, slowest)
        rivals = []
        for k, lack in finding.others:
            other = search.stage.slots[k]
            if other.cause == alike:  # by a form that follows the same law
                rivals.append(Rival(other.cause, other.where, 0.0, True))
            else:
                rivals.append(Rival(other.cause, other.where, lack, k in finding.rivals))
        found.append(
            Named(
                slot.cause,
                slot.where,
                None,
                RESTS if rests(search, slot) else form_of(slot),
                parameters,
                finding.gain,
                len(slot.index),
                one_each(rivals),
                search,
                finding,
            )  # fmt: skip
        )
    return found


def rests(search: Search, slot: Slot) -> bool:
    """Whether a cause is the level at which a plant rests: an offset beyond all that its command
    moves it, as of an oven in a warm room. It belongs to the plant."""
    if slot.cause != "offset":
        return False
    bias = search.final.hypothesis.theta[slot.index[0]]
    return bool(abs(bias) > search.stage.scales.response)


def _same_force(
    cause: str, where: str, parameters: Mapping[str, Estimate], slowest: float
) -> str | None:
    """The cause that is the same force: drag without its quadratic part is dry friction, play of
    what a load pulls back before the plant has moved (in its `slowest` time constant, s) a dead
    zone, and a gap inside a servo's loop, whose motor crosses it at once, friction of half of it
    without a breakaway, where the wheels move as slowly as what damps them lets them."""
    if cause == "drag":
        quadratic = parameters["quadratic"]
        return "coulomb_friction" if abs(quadratic.value) < 3.0 * quadratic.std else None
    if cause == "coulomb_friction" and where == "steering":
        level = parameters["level"].value
        static = parameters.get("static", parameters["level"]).value
        return "backlash" if static < _BREAKS_AWAY * level else None
    if "centring" in parameters:
        return "dead_zone" if parameters["centring"].value * slowest > 1.0 else None
    return None


def one_each(rivals: Sequence[Rival]) -> tuple[Rival, ...]:
    """The best form of each rival."""
    best: dict[tuple[str, str, str | None], Rival] = {}
    for rival in sorted(rivals, key=lambda r: r.deficit):
        best.setdefault((rival.cause, rival.where, rival.channel), rival)
    return tuple(best.values())


def form_of(slot: Slot) -> str:
    """Which of its forms a cause has, in words."""
    for (name, value), words in _FORMS.items():
        if getattr(slot.effect, name, None) == value:
            return words
    return ""


def estimates(
    slot: Slot, fit: Refit, search: Search, units: tuple[str, str]
) -> dict[str, Estimate]:
    """The parameters of a cause by the contract's names, with units."""
    if slot.cause == swing.CAUSE:
        return _swinging(slot, fit, search, units)
    free = fit.hypothesis.free(search.stage).tolist()
    told: dict[str, Estimate] = {}
    for j, (name, i, known) in enumerate(zip(slot.names, slot.index, slot.known, strict=True)):
        variance = fit.covariance[free.index(i), free.index(i)] if i in free else math.nan
        std = float(np.sqrt(variance)) if variance >= 0 else math.nan
        if slot.cause == "quantization":  # no slope tells it: how far the same rounding allows
            largest = max(abs(search.stage.scales.low), abs(search.stage.scales.high))
            std = float(fit.hypothesis.theta[i] ** 2 / (6.0 * largest))
        estimate = float(fit.hypothesis.theta[i])
        if slot.cause == "coulomb_friction" and i in free:
            estimate, std = _felt(fit, free, i)
        value, std = known.tell(estimate, std)
        told[name] = Estimate(value, std, told_unit(slot, j, units))
    if slot.cause == "coulomb_friction":
        return _friction(told, fit, [free.index(i) for i in slot.index[:2] if i in free])
    return _renamed(slot.cause, told)


def _friction(told: Mapping[str, Estimate], fit: Refit, both: Sequence[int]) -> dict[str, Estimate]:
    """Level, and the static one where it is told from it; or where only that one is: of what hardly
    slides nobody knows what slides."""
    level, more = told["level"], told["breakaway"]
    std = _push(fit.hypothesis) * math.sqrt(max(float(fit.covariance[np.ix_(both, both)].sum()), 0))
    static = Estimate(level.value + more.value, std, level.unit)
    above = more.value > CLEAR * more.std
    alone = level.value < CLEAR * level.std and static.value > CLEAR * static.std
    return {"level": level, "static": static} if above or alone else {"level": level}


def _felt(fit: Refit, free: Sequence[int], at: int) -> tuple[float, float]:
    """A force as the command that pushes as hard, and its standard deviation."""
    h = fit.hypothesis
    value = h.theta[at] * _push(h)
    slopes = np.zeros(len(free))
    for k, i in enumerate(free):
        theta, step = h.theta.copy(), 1e-5 * max(abs(float(h.theta[i])), 1e-9)
        theta[i] += step
        slopes[k] = (theta[at] * _push(replace(h, theta=theta)) - value) / step
    return float(value), math.sqrt(max(float(slopes @ fit.covariance @ slopes), 0.0))


def _push(h: Hypothesis) -> float:
    """By what a force pushes harder than the same command where a controller makes up for what
    lasts: at the frequency of the two slowest poles. One where none does."""
    lead, more = h.theta[list(LEADS)]
    if h.poles < 2 or lead == 0.0:
        return 1.0
    s = 1j * np.sqrt(np.prod(np.sort(np.abs(np.roots(h.den)))[:2]))
    pushes = abs(1.0 + h.num[-1] * (lead * s + more * s * s) / np.polyval(h.num, s))
    return float(1.0 + (pushes - 1.0) * made_up_for(lead * h.den[-1] / h.den[-2]))


def _swinging(
    slot: Slot, fit: Refit, search: Search, units: tuple[str, str]
) -> dict[str, Estimate]:
    """Frequency, amplitude and phase; the phase is that of the first run."""
    stage, h = search.stage, fit.hypothesis
    frequency, free = h.frequency(stage), list(h.free(stage))
    assert frequency is not None and h.swing is not None
    at = free.index(slot.index[0])
    wave = whiten(swing.columns(stage, frequency)[None], fit.colour[None])[0]
    amplitude, phase, first = swing.strength(stage, h.swing, frequency)
    seen = stage.mask | stage.held_out  # a run that is held out has a swing of its own, too
    energies = np.array([0.5 * np.sum(wave[:, use] ** 2) for use in seen])
    own = math.sqrt(fit.variance / max(float(energies[first]), 1e-300))
    whole = math.sqrt(fit.variance / max(float(energies.sum()), 1e-300))
    std = math.sqrt(max(float(fit.covariance[at, at]), 0.0))
    unit = told_unit(slot, 1, units)
    return {
        "frequency": Estimate(frequency, std, told_unit(slot, 0, units)),
        "amplitude": Estimate(amplitude, whole, unit),
        "phase": Estimate(phase, own / max(amplitude, 1e-300), "rad"),
    }


def _renamed(cause: str, told: dict[str, Estimate]) -> dict[str, Estimate]:
    if cause in ("saturation", "rate_limit"):
        reached = {k: e for k, e in told.items() if e.std < abs(e.value) < math.inf} or told
        if cause == "saturation" and "lower" in reached:
            reached["lower"] = replace(told["lower"], value=-told["lower"].value)
        return {k: e for k, e in reached.items() if math.isfinite(e.value)}
    if cause == "resonance":
        return {"frequency": told["frequency"], "damping": told["damping"], "weight": told["share"]}
    if cause == "gain_drift":
        bend = told["bend"]
        return told if abs(bend.value) > CLEAR * bend.std else {"rate": told["rate"]}
    if cause == "regime_change":
        little = {k for k in ("slowing", "ramp") if abs(told[k].value) <= CLEAR * told[k].std}
        return {name: e for name, e in told.items() if name not in little}
    return told


def with_form(told: Mapping[str, Estimate]) -> dict[str, Estimate]:
    """Parameters whose standard deviations hold what is not known of a cause's form, too."""
    return {
        name: e if name in _POINTS else replace(e, std=math.hypot(e.std, _FORM * e.value))
        for name, e in told.items()
    }


def told_unit(slot: Slot, j: int, units: tuple[str, str]) -> str:
    """Unit of a parameter as it is told, from those of command and response."""
    unit = slot.known[j].unit
    if slot.known[j].shown == "inverse":
        unit = unit.removeprefix("1/").strip("()")
    at = getattr(slot.effect, "at", None)
    if at == "response":
        unit = unit.replace("command", "response")
    if at == "command":
        unit = unit.replace("response", "command")
    for word, own in zip(("command", "response"), units, strict=True):
        if own == "1":  # is nothing to divide by
            unit = unit.replace(f"/{word}^2", "").replace(f"/{word}", "")
        unit = unit.replace(f"/{word}", f"/({own})" if "/" in own else f"/{own}").replace(word, own)
    return unit.replace("/s/s", "/s^2")
