"""The answer in words that an engineer acts on."""

from dataclasses import replace

from .result import Diagnosis, Finding, Rival, Unexplained

_READ = {"aside": "the way aside", "forward": "the way forward", "psi": "the heading"}
_SPOILT = 0.05  # of the mean translation error, by which a path is worse
_MOST = 3  # rivals that a sentence names


def number(value: float) -> str:
    """Three significant digits."""
    return f"{value:.3g}"


def in_words(cause: str) -> str:
    """A cause of the contract as people write it."""
    return cause.replace("_", " ").replace("coulomb", "Coulomb")


def title(finding: Finding) -> str:
    """A finding's short name for tables and pictures: `backlash or Coulomb friction (steering)`.
    A sensor's cause is named after its channel."""
    names = (finding.cause, *finding.indistinguishable_from)
    place = finding.channel or finding.where
    return f"{' or '.join(map(in_words, names))} ({place})"


def sentence(f: Finding) -> str:
    """What it is, how large, what it costs, and what else it could be."""
    place = f"{f.channel} sensor" if f.channel else f.where
    sizes = []
    for name, e in list(f.parameters.items())[:3]:
        unit = "" if e.unit == "1" else f" {e.unit}"
        spread = f" ± {e.std:.2g}" if e.std == e.std else ""
        sizes.append(f"{in_words(name)} {number(e.value)}{spread}{unit}")
    form = f" {f.form}" if f.form else ""
    said = [f"{place[:1].upper()}{place[1:]}: {in_words(f.cause)}{form}, {', '.join(sizes)}."]
    said += _meaning(f)
    if "phase" in f.parameters:
        said.append("Every run begins at a phase of its own; this is the first's.")
    g = f.gain
    where = "on held-out driving" if g.held_out else "on the fitted data"
    moves = "rises" if g.after >= g.before else "falls"
    said.append(
        f"FIT of {_READ.get(g.channel, g.channel)} {where} {moves} from {g.before:.1f} to "
        f"{g.after:.1f} % with it."
    )
    if g.after < g.before and g.typical > 0.0:
        share = f"{100.0 * g.typical:.0f} %"
        said.append(f"An event spoils it: half of the stretches lose {share} of their error.")
    if g.ate_before is not None and g.ate_after is not None:
        if g.cost > 0.0:
            said.append(
                f"It costs {number(g.cost)} m of {number(g.ate_before)} m of mean translation "
                "error."
            )
        elif g.ate_after > (1.0 + _SPOILT) * g.ate_before:
            said.append(
                f"The path gets worse with it, from {number(g.ate_before)} to "
                f"{number(g.ate_after)} m of mean translation error."
            )
    close = [r for r in f.rivals if r.indistinguishable]
    if close:
        words = list(dict.fromkeys(_rival(r, f) for r in close))
        names = " or ".join(words[:_MOST] + ["others"] * (len(words) > _MOST))
        said.append(f"{names[:1].upper()}{names[1:]} cannot be told apart from these logs;")
        said[-1] += f" to separate them: {f.separating_experiment}."
    out = [r for r in f.rivals if not r.indistinguishable][:2]
    if out:
        names = " and ".join(_rival(r, f) for r in out)
        said.append(f"Ruled out: {names}.")
    return " ".join(said)


def _rival(rival: Rival, beside: Finding) -> str:
    """A rival, and of which sensor where the finding is of another's."""
    other = beside.channel is not None and rival.channel not in (None, beside.channel)
    return in_words(rival.cause) + (f" of {rival.channel}" if other else "")


def apart(f: Finding, why: str) -> Finding:
    """A finding that is minor, and why."""
    return replace(f, sentence=f"{f.sentence} It stands apart: {why}.")


def _meaning(f: Finding) -> list[str]:
    """What a ratio or a scale says, in a sentence, where its number alone does not."""
    size = next(iter(f.parameters.values())).value if f.parameters else 0.0
    percent = f"{number(100.0 * abs(size))} %"
    if f.cause == "gain_asymmetry":
        one, how, other = "Positive commands act", "strongly", "negative ones"
        if "effort" in f.form:
            one, other = "Pushing acts", "braking"
        if "pulls" in f.form:
            one, how, other = "It gives way to the positive side", "far", "to the negative"
        return [f"{one} {number(1.0 + size)} times as {how} as {other}."]
    if f.cause == "speed_scale":
        return [f"It moves {percent} {'faster' if size > 0.0 else 'slower'} than its speed says."]
    if f.cause == "geometry_scale":
        longer = "longer" if size > 0.0 else "shorter"
        return [f"It turns as if its wheelbase were {percent} {longer} than told."]
    return []


def verdict(d: Diagnosis) -> str:
    """The verdict in a line."""
    if d.contradictions:
        return "These logs contradict themselves, and what follows is of what is left of them"
    if d.verdict == "explained":
        return "Explained"
    if d.verdict == "unexplained_structure":
        return "There is structure that no known cause accounts for"
    if d.unexplained:
        return "No cause: what the baseline leaves unexplained is small"
    return "No cause: the baseline explains the logs to the noise"


def summary(d: Diagnosis) -> str:
    """The whole answer in a few sentences."""
    if d.verdict == "no_effect" and d.unexplained:
        said = ["No cause stands out, and what the identified plants leave unexplained is small."]
    elif d.verdict == "no_effect":
        said = ["The identified plants explain these logs to the noise; no cause stands out."]
    elif d.findings:
        said = [f.sentence for f in d.findings]
    else:
        said = ["There is structure that no cause of the library accounts for."]
    if d.ate is not None:
        before, after = d.ate["baseline"]["mean"], d.ate["model"]["mean"]
        both = f"{number(before)} m without, {number(after)} m with the causes"
        told = both if d.findings else f"{number(before)} m"
        said.append(f"Mean translation error on the held-out drive: {told}.")
    said += map(resting, d.levels)
    if d.small:
        names = ", ".join(map(title, d.small))
        said.append(f"Significant, yet small or not sure enough to be named: {names}.")
    for u in d.unexplained[:3]:
        why = f"; {u.test}" if u.test else ""
        said.append(f"Unexplained in {u.channel}: {100 * u.fraction:.1f} % of what remains{why}.")
    said += disturbances(d)
    return " ".join(said)


def resting(level: Finding) -> str:
    """Where a plant rests, as a sentence."""
    bias = level.parameters["bias"]
    unit = "" if bias.unit == "1" else f" {bias.unit}"
    return f"The {level.where} rests at {number(bias.value)}{unit}, which is no cause."


def left_over(left: Unexplained) -> str:
    """Structure without a known cause as a sentence."""
    on = f", which depends on {', '.join(left.depends_on)}" if left.depends_on else ""
    when = "; ".join(f"{run} {start:g} to {stop:g} s" for run, start, stop in left.when)
    share = f"{100.0 * left.fraction:.0f} % of the residual's variance is structure"
    where = f"Unexplained in {left.channel}: {share}{on}" + (f" ({when})" if when else "")
    return where + (f": {left.test}." if left.test else ".")


def disturbances(d: Diagnosis) -> list[str]:
    """The steady disturbances of a diagnosis, a sentence each."""
    road = any(record.vehicle is not None for record in d.records)
    return [disturbed(u, road) for u in d.disturbances]


def disturbed(u: Unexplained, road: bool) -> str:
    """A steady disturbance as a sentence, of a vehicle on a road or of another plant."""
    others = "wind or rough ground" if road else "a load from outside"
    return (
        f"{u.channel} is disturbed: {u.test} does not go with what is commanded, "
        f"as {others} would not."
    )
