"""From lines of results to rates: pure functions, nothing of the package, no files."""

import math
from collections import Counter
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass

import numpy as np

Line = dict
Name = tuple[str, str, str | None]

NEVER_STOPS = 0.5  # m/s: a drive whose speed command stays above this neither stops nor reverses

EXACT = {
    "transport_delay": ("delay",),
    "backlash": ("gap",),
    "offset": ("bias",),
    "gain_asymmetry": ("ratio",),
    "regime_change": ("time", "gain"),
    "resonance": ("frequency", "damping", "weight"),
    "understeer": ("gradient",),
    "tyre_relaxation": ("length",),
    "geometry_scale": ("scale",),
    "speed_scale": ("scale",),
    "drag": ("quadratic", "rolling"),
    "sensor_delay": ("delay",),
    "sensor_bias": ("bias",),
    "sensor_lag": ("time_constant",),
}
"""Parameters that mean the same in the generator and in the contract, by the same formula."""

LOOSE = {
    "dead_zone": ("half_width",),  # its edge is worn
    "saturation": ("upper", "lower"),  # of command or response, or a governor
    "rate_limit": ("rising", "falling"),  # of the torque in the powertrain
    "coulomb_friction": ("level",),  # with stick-slip
    "quantization": ("step",),  # its std is none of a regular problem
    "gain_drift": ("rate",),  # exponential against linear
    "speed_dependent_gain": ("slope",),  # a hyperbola against its chord
    "periodic_disturbance": ("frequency",),  # amplitude of command against response
}
"""Parameters that mean about the same: their errors are told apart from the intervals' coverage.

The others (a polynomial for another map, a profile of hills, a bank's slope by another compliance,
couplings of other units) have no common scale.
"""


def _same_drag(a: Name, b: Name, line: Line) -> bool:
    """The contract lists one deceleration at two places."""
    return {a[:2], b[:2]} == {("drag", "vehicle"), ("drag", "powertrain")}


def _same_level(a: Name, b: Name, line: Line) -> bool:
    """In a powertrain that neither stops nor reverses, dry friction and a dead zone take the same
    from every command, as a negative offset does; rolling drag is friction by another name."""
    level = {(word, "powertrain") for word in ("coulomb_friction", "dead_zone", "offset")}
    drags = {("drag", "powertrain"), ("drag", "vehicle")}
    if line["slowest"] <= NEVER_STOPS:
        return False
    if {a[:2], b[:2]} <= level:
        return True
    friction = ("coulomb_friction", "powertrain") in (a[:2], b[:2])
    return friction and ({a[:2], b[:2]} & drags) != set()


def _same_pull(a: Name, b: Name, line: Line) -> bool:
    """A bank pulls as wheels do that stand askew; only the crab, some mrad, is its own."""
    return {a[:2], b[:2]} == {("bank", "vehicle"), ("offset", "vehicle")}


EQUIVALENT: dict[str, Callable[[Name, Name, Line], bool]] = {
    "drag of the vehicle or the powertrain": _same_drag,
    "friction, dead zone and offset of a powertrain that never stops": _same_level,
    "a bank's pull and wheels askew": _same_pull,
}
"""Names that count as one, because (nearly) no log separates them. A narrow list on purpose."""


@dataclass(frozen=True)
class Verdict:
    """What a line says about one hidden cause.

    Attributes:
        detected: a finding, whatever its name, or the truth among the minor ones.
        in_set: the truth is the leading finding or cannot be told from it.
        named: the leading finding names it and nothing else.
        wrong: the leading finding names something else, and only that.
        spurious: findings, the leading one aside, whose sets lack the truth.
        by: the equivalence that was needed for `in_set`, or "".
        label: `cause@where` that leads, or "none" or "unexplained".
    """

    detected: bool
    in_set: bool
    named: bool
    wrong: bool
    spurious: int
    by: str
    label: str


def name(x: dict) -> Name:
    """Cause, place and, of a sensor, channel."""
    return x["cause"], x["where"], x["channel"] if x["where"] == "sensor" else None


def text(one: Name) -> str:
    """`sensor_delay@sensor:r`."""
    return f"{one[0]}@{one[1]}" + (f":{one[2]}" if one[2] else "")


def equal(truth: Name, told: Name, line: Line) -> str | None:
    """ "" where names agree, the equivalence by which they count as one, None where they differ.

    A rival comes without its channel, which then counts as right.
    """
    if truth[:2] == told[:2] and (told[2] is None or truth[2] == told[2]):
        return ""
    return next((why for why, same in EQUIVALENT.items() if same(truth, told, line)), None)


def names(finding: dict) -> list[Name]:
    """The finding's own name, then those that cannot be told from it."""
    return [name(finding), *((cause, where, None) for cause, where in finding["rivals"])]


def covers(finding: dict, truth: Name, line: Line) -> str | None:
    """How a finding's set holds the truth: as `equal`."""
    hows = [equal(truth, told, line) for told in names(finding)]
    hits = [how for how in hows if how is not None]
    return None if not hits else "" if "" in hits else hits[0]


def judged(line: Line) -> Verdict:
    """Judge the line of a single hidden cause."""
    truth, findings = name(line["truth"][0]), line["findings"]
    told = findings or [m for m in line["minor"] if covers(m, truth, line) is not None]
    if not told:
        label = "unexplained" if flagged(line) else "none"
        return Verdict(False, False, False, False, 0, "", label)
    lead = told[0]
    how = covers(lead, truth, line)
    alone = all(equal(name(lead), other, line) is not None for other in names(lead))
    others = sum(covers(f, truth, line) is None for f in told[1:])
    right = equal(truth, name(lead), line) is not None
    return Verdict(
        detected=True,
        in_set=how is not None,
        named=right and alone,
        wrong=how is None and alone,
        spurious=others,
        by=how or "",
        label=text(name(lead)),
    )


def separation(line: Line) -> float | None:
    """What the nearest other name lacks in twice the log-likelihood, beside the hidden cause in the
    leading finding: lambda_AB as this log shows it. None where that set does not hold the cause, or
    the line does not say (older ones)."""
    truth, lead = name(line["truth"][0]), next(iter(line["findings"]), None)
    if lead is None or "lacks" not in lead or covers(lead, truth, line) is None:
        return None
    tried = [(name(lead), 0.0), *(((c, w, None), lack) for c, w, lack in lead["lacks"])]
    own = [lack for told, lack in tried if equal(truth, told, line) is not None]
    others = [lack for told, lack in tried if equal(truth, told, line) is None]
    return min(others, default=math.inf) - min(own, default=math.inf)


def flagged(line: Line) -> bool:
    """Whether structure that no cause accounts for is spoken of."""
    return line["verdict"] == "unexplained_structure" or bool(line["unexplained"])


def found(line: Line) -> list[bool]:
    """Of each hidden cause, whether a finding of its own holds it."""
    free, hits = list(line["findings"]), []
    for truth in map(name, line["truth"]):
        hit = next((f for f in free if covers(f, truth, line) is not None), None)
        hits.append(hit is not None)
        if hit is not None:
            free.remove(hit)
    return hits


def stated_wrongly(line: Line) -> int:
    """Findings that state one name alone which is none of the hidden causes."""
    truths = [name(t) for t in line["truth"]]
    return sum(
        not f["rivals"] and all(covers(f, truth, line) is None for truth in truths)
        for f in line["findings"]
    )


def errors(line: Line, table: dict[str, tuple[str, ...]]) -> list[tuple[str, float, float | None]]:
    """(parameter, relative error, error over std) of hidden causes that are found by name."""
    made = []
    for truth in line["truth"]:
        told = [f for f in line["findings"] if equal(name(truth), name(f), line) == ""]
        for key in table.get(truth["cause"], ()) if told else ():
            value, std = told[0]["parameters"].get(key, (None, None))
            real = truth["parameters"].get(key)
            if value is None or not real:
                continue
            z = (value - real) / std if std else None
            made.append((f"{truth['cause']} {key}", abs(value - real) / abs(real), z))
    return made


def share_of_attainable(line: Line, least: float = 0.5) -> float | None:
    """Share of the attainable gain in FIT on held-out data that the leading finding realises, from
    what it says of the model without it; None where less than `least` percent points can be gained
    or its channel has no such bound."""
    if not line["findings"]:
        return None
    channel, before, after = line["findings"][0]["gain"]
    possible = line["attainable"].get(channel, -math.inf) - before
    return (after - before) / possible if possible >= least else None


def predicted_over_realised(line: Line) -> float | None:
    """Gain in FIT that the screen promised over the realised one, of the leading finding."""
    if not line["findings"] or line["findings"][0]["predicted"] is None:
        return None
    lead = line["findings"][0]
    _, before, after = lead["gain"]
    return (lead["predicted"] - before) / (after - before) if after > before else None


def wilson(hits: int, n: int, z: float = 1.96) -> tuple[float, float]:
    """Wilson's interval of a share."""
    if n == 0:
        return 0.0, 1.0
    p, q = hits / n, z * z / n
    middle, half = p + q / 2, z * math.sqrt(p * (1 - p) / n + q / (4 * n))
    return max(0.0, (middle - half) / (1 + q)), min(1.0, (middle + half) / (1 + q))


@dataclass(frozen=True)
class Rate:
    """`hits` of `n`, with Wilson's 95 % interval."""

    hits: int
    n: int

    @property
    def share(self) -> float:
        return self.hits / self.n if self.n else math.nan

    @property
    def interval(self) -> tuple[float, float]:
        return wilson(self.hits, self.n)

    def __str__(self) -> str:
        if not self.n:
            return "none"
        low, high = self.interval
        return (
            f"{100 * self.share:.1f} % ({self.hits} of {self.n}; {100 * low:.1f}–{100 * high:.1f})"
        )


def rate(values: Iterable[bool]) -> Rate:
    """How many are true."""
    several = [bool(v) for v in values]
    return Rate(sum(several), len(several))


def normal_share(z: float) -> float:
    """Phi."""
    return 0.5 * (1.0 + math.erf(z / math.sqrt(2.0)))


def law(lambda0: float, threshold: float = 5.35) -> float:
    """Phi(sqrt(lambda0) - threshold): 5.35 of the prototype, 4.7 of an oracle."""
    return normal_share(math.sqrt(lambda0) - threshold)


EDGES = (0.0, 4.0, 9.0, 16.0, 25.0, 36.0, 49.0, 64.0, 100.0, 200.0, 1000.0, math.inf)


def detection(lines: Sequence[Line]) -> list[tuple[float, Rate]]:
    """(geometric mean of lambda0, share detected) of single causes, by bins of lambda0."""
    bins = []
    for low, high in zip(EDGES[:-1], EDGES[1:], strict=True):
        inside = [line for line in lines if low <= line["lambda0"] < high]
        if inside:
            logs = np.log([max(line["lambda0"], 1e-3) for line in inside])
            bins.append((float(np.exp(logs.mean())), rate(judged(x).detected for x in inside)))
    return bins


def confusion(lines: Sequence[Line]) -> Counter[tuple[str, str]]:
    """How often each hidden cause (by word) was answered by what (word, `word elsewhere`, none or
    unexplained); a truth within the answer's set counts as itself."""
    table: Counter[tuple[str, str]] = Counter()
    for line in lines:
        word, verdict = line["truth"][0]["cause"], judged(line)
        told = verdict.label.partition("@")[0]
        if verdict.in_set:
            told = word
        elif told == word:
            told = "elsewhere"
        table[word, told] += 1
    return table


def quantiles(values: Iterable[float | None], *at: float) -> tuple[list[float], int]:
    """Quantiles of those that are there, and how many these are."""
    there = [v for v in values if v is not None and math.isfinite(v)]
    return ([float(np.quantile(there, q)) for q in at] if there else [math.nan] * len(at)), len(
        there
    )
