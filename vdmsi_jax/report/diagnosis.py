"""The report of `vdmsi diagnose`."""

import math
from collections.abc import Mapping, Sequence

from .. import plots
from ..diagnose.answer.result import ChannelScore, Diagnosis, Estimate, Finding, Gain, Response
from ..diagnose.answer.words import disturbances, in_words, resting, title
from ..plots.diagnosis import worst_paths
from ..plots.style import pretty_unit, squared_unit
from .identification import what_was_read
from .page import Block, Bullets, Page, Picture, Section, Table, Text, Tiles
from .phrases import capital, ended, metres, points, share, with_unit
from .text import number, percent, typeset

VERDICTS = {
    "no_effect": "The simulation explains the logs to the noise. No cause had to be added.",
    "no_effect in part": "The simulation explains the logs but for little, which is stated under "
    "“What remains”. No cause had to be added.",
    "explained": "The simulation is wrong, and the causes below account for it.",
    "explained in part": "The simulation is wrong. The causes below account for most of it; what "
    "they leave is stated under “What remains”.",
    "unexplained_structure": "The simulation is wrong in a way that no known cause accounts for. "
    "Where, when, and on what it depends is stated under “What remains”.",
}
BASELINE = "The baseline is the identified linear model; the extended model has the causes in it."

_NOISE = {
    "repeat": "The noise of {} is what runs with the same commands differ by.",
    "brief": "What lasts may be no noise: that of {} was taken to be brief, and data held out bear "
    "out what was found so.",
}


def diagnosis_page(diagnosis: Diagnosis) -> Page:
    """What the simulation gets wrong, why, what the extension gains, what remains, and what to
    drive next."""
    d = diagnosis
    named = [title(finding) for finding in d.findings]
    if d.verdict == "unexplained_structure":
        named.append("structure without a known cause")
    return Page(
        title="Diagnosis: " + (", ".join(named) or "nothing but noise"),
        lead="From " + ", ".join(record.name for record in d.records),
        sections=[
            Section("In short", _in_short(d)),
            Section("What is wrong" if d.findings or d.unexplained else "Measured and simulated",
                    _what_is_wrong(d)),
            *(
                Section(f"{i}. {capital(title(finding))}", _finding(finding))
                for i, finding in enumerate(d.findings, start=1)
            ),
            *([Section("What the extension changes", _changes(d))] if d.findings else []),
            *([Section("Who is responsible", _budget(d))] if d.budget else []),
            Section("What remains", _remains(d)),
            Section("What these logs could have shown", _detectable(d)),
            Section("What to drive next", [_drive_next(d)]),
            Section("What was read", [*what_was_read(d.records), _held_out(d)]),
        ],
    )  # fmt: skip


def _in_short(d: Diagnosis) -> list[Block]:
    kind = "warning" if d.verdict == "unexplained_structure" else "note"
    partly = d.unexplained and d.verdict != "unexplained_structure"
    verdict = VERDICTS[f"{d.verdict} in part" if partly else d.verdict]
    if d.contradictions:
        verdict = "These logs contradict themselves, and what follows is of what is left of them."
    return [Text(verdict, kind=kind), Text(typeset(d.summary)), _tiles(d)]


def _tiles(d: Diagnosis) -> Tiles:
    tiles = []
    if d.ate:
        start, end = (d.ate[name]["mean"] for name in ("baseline", "model"))
        remark = f"from {metres(start)}; on the held-out drive"
        tiles.append(("mean translation error", metres(end), remark))
    for channel, before in d.channels.items():
        after = d.extended.get(channel, before)
        rise = "" if after.fit == before.fit else f"baseline {percent(before.fit)}; "
        remark = f"{rise}noise allows {percent(before.ceiling)}"
        tiles.append((f"FIT of {channel}", percent(after.fit), remark))
    return Tiles(tiles)


def _what_is_wrong(d: Diagnosis) -> list[Block]:
    blocks: list[Block] = [
        Text(f"{BASELINE} Both run freely from the commands alone. A residual is the measured less "
             "the simulated value."),
        _scores(d.channels, d.extended, d),
    ]  # fmt: skip
    for response in d.responses:
        blocks += [
            Picture(
                plots.to_svg(plots.overlay(response), f"{_id(response)}-overlay"),
                f"{capital(response.name)}: {response.channel} measured and simulated, and the "
                "residual; on the right the shaded window.",
            ),
            Picture(
                plots.to_svg(
                    plots.residual_against(response),
                    f"{_id(response)}-against",
                ),
                f"{capital(response.name)}: mean residual of {response.channel} against time, "
                "command, response and response rate, in bins, with the 95 % band of the mean. Of "
                "a model that lacks nothing, it is zero within its band.",
            ),
        ]
        seen = [path for path in d.paths if path.run in response.runs]
        if seen:
            runs = ", ".join(dict.fromkeys(path.run for path in seen))
            blocks.append(
                Picture(
                    plots.to_svg(plots.on_path(response, *seen), f"{_id(response)}-on-path"),
                    f"{capital(response.name)}: where on the road the residual of "
                    f"{response.channel} is large, in {runs}.",
                )
            )
    if d.paths and not d.findings:
        blocks.append(_paths(d))
    return blocks


def _scores(
    before: Mapping[str, ChannelScore], after: Mapping[str, ChannelScore], d: Diagnosis
) -> Table:
    """FIT and mean squared error of each channel, without and with the causes."""
    rows = []
    for channel, score in before.items():
        other = after.get(channel, score)
        unit = _unit(d, channel)
        rows.append(
            [channel, percent(score.fit), percent(other.fit), percent(score.ceiling)]
            + [with_unit(s.mse, squared_unit(unit)) for s in (score, other)]
            + [with_unit(score.noise_std, unit)]
        )
    header = ["channel", "FIT baseline", "FIT extended", "FIT that noise allows", "MSE baseline",
              "MSE extended", "noise (std)"]  # fmt: skip
    unseen = any(response.held_out.any() for response in d.responses)
    where = "the held-out data" if unseen else "the data of the fit, since none was held out"
    caption = f"On {where}. MSE is the mean squared error."
    for by, words in _NOISE.items():
        told = " and ".join(c for c, score in before.items() if score.noise_by == by)
        caption += f" {words.format(told)}" if told else ""
    return Table(header, rows, caption=caption)


def _finding(finding: Finding) -> list[Block]:
    blocks: list[Block] = [Text(typeset(finding.sentence))]
    if finding.form:
        blocks.append(Text(f"Of its forms, this one fitted best: {typeset(finding.form)}."))
    blocks += [_parameters(finding), Text("Evidence", kind="caption"), Bullets(_evidence(finding))]
    if finding.rivals:
        blocks.append(_rivals(finding))
    blocks += [Text(text, kind="note") for text in _open(finding)]
    return blocks


def _parameters(finding: Finding) -> Table:
    rows = []
    for name, estimate in finding.parameters.items():
        if math.isinf(estimate.value):
            rows.append([name.replace("_", " "), "no limit on this side", "–", "–"])
            continue
        half = 1.96 * estimate.std
        ends = f"{number(estimate.value - half)} … {number(estimate.value + half)}"
        interval = f"{ends} {pretty_unit(estimate.unit)}".removesuffix(" 1")
        rows.append(
            [
                name.replace("_", " "),
                with_unit(estimate.value, estimate.unit),
                with_unit(estimate.std, estimate.unit, 2),
                interval if math.isfinite(half) else "–",
            ]
        )
    return Table(["parameter", "estimate", "std", "95 % interval"], rows)


def _evidence(finding: Finding) -> list[str]:
    gain, said = finding.gain, []
    chance = "below 10⁻³⁰⁰" if finding.p_value < 1e-300 else number(finding.p_value, 2)
    said.append(
        f"It adds {number(finding.statistic)} to twice the log-likelihood, which measures how much "
        f"better the logs are explained. The probability that noise alone does that is {chance}."
    )
    where = "held-out data" if gain.held_out else "the data of the fit (none was held out)"
    said.append(
        f"On {where} the FIT of {gain.channel} goes from {percent(gain.before)} to "
        f"{percent(gain.after)}: {points(gain)} points (± is one standard error)."
    )
    said.append(
        f"It takes away {share(finding.share)} of the squared error of {gain.channel} there."
    )
    if gain.ate_before is not None and gain.ate_after is not None:
        said.append(
            f"On the road the mean translation error goes from {metres(gain.ate_before)} to "
            f"{metres(gain.ate_after)}."
        )
    return said


def _rivals(finding: Finding) -> Table:
    rows = [
        [
            in_words(rival.cause),
            rival.where if rival.channel is None else f"{rival.where} of {rival.channel}",
            number(rival.deficit),
            "cannot be told apart" if rival.indistinguishable else "ruled out",
        ]
        for rival in finding.rivals
    ]
    return Table(
        ["rival", "where", "deficit", "answer"],
        rows,
        caption="What was tried in its place. The deficit is how much worse the rival explains the "
        "logs, in twice the log-likelihood: near zero it explains them as well.",
        strong=[i for i, rival in enumerate(finding.rivals) if rival.indistinguishable],
    )


def _open(finding: Finding) -> list[str]:
    """What stays open after a finding, and what would close it."""
    alike = finding.indistinguishable_from
    if not alike and finding.separating_experiment is None:
        return []
    said = []
    if alike:
        names = " and ".join(map(in_words, alike))
        said.append(f"These logs cannot tell {in_words(finding.cause)} from {names}.")
    if finding.separating_experiment:
        said.append(f"To tell them apart, drive: {ended(finding.separating_experiment)}")
    else:
        said.append("No manoeuvre of the catalogue is predicted to tell them apart.")
    return [" ".join(said)]


def _changes(d: Diagnosis) -> list[Block]:
    rows = [
        [
            title(finding),
            finding.gain.channel,
            percent(finding.gain.before),
            percent(finding.gain.after),
            points(finding.gain),
            "–" if finding.predicted_gain is None else points(finding.predicted_gain, error=False),
            _road_gain(finding.gain),
        ]
        for finding in d.findings
    ]
    header = ["cause", "channel", "FIT without", "FIT with", "gain (points)", "predicted (points)",
              "translation error"]  # fmt: skip
    seen = "" if all(finding.gain.held_out for finding in d.findings) else (
        " Where no data could be held out, the gain is that of the fit itself and says less."
    )  # fmt: skip
    blocks: list[Block] = [
        Table(header, rows, caption="What each cause is worth on data that no fit has seen; ± is "
              "one standard error. Without it the model is fitted anew, and need not be the "
              f"baseline. Predicted is what the first steps from the screen had promised.{seen}"),
        Picture(
            plots.to_svg(plots.gains(d), "gains"),
            "FIT without and with each cause, with 95 % error bars of the gain, beside what the "
            "screen had predicted at first and the FIT that noise allows.",
        ),
    ]  # fmt: skip
    if d.ate:
        blocks.append(_road(d.ate))
    if d.paths:
        blocks.append(_paths(d))
    return blocks


def _road(ate: Mapping[str, Mapping[str, float]]) -> Table:
    rows = [
        [statistic, metres(ate["baseline"][statistic]), metres(value)]
        for statistic, value in ate["model"].items()
    ]
    caption = "Distance from the measured position on the held-out drive."
    return Table(["translation error", "baseline", "extended"], rows, caption=caption)


def _paths(d: Diagnosis) -> Picture:
    few = len(worst_paths(d.paths))
    drives = (
        "The held-out drive on the road, from the same start"
        if len(d.paths) == 1
        else f"Held-out drives on the road, each from the start that was measured ({few} of "
        f"{len(d.paths)}, along which the baseline errs most)"
    )
    simulated = "baseline and extended" if d.findings else "and baseline"
    return Picture(
        plots.to_svg(plots.paths_before_after(d), "paths"), f"{drives}: measured, {simulated}."
    )


def _budget(d: Diagnosis) -> list[Block]:
    causes = list(dict.fromkeys(cause for budget in d.budget for cause in budget.parts))
    rows = [
        [
            budget.name,
            with_unit(budget.total, budget.unit, 3),
            *(_part(budget.parts.get(cause), budget.total) for cause in causes),
            _part(budget.noise, budget.total),
            _part(budget.unexplained, budget.total),
        ]
        for budget in d.budget
    ]
    header = ["", "error of the baseline", *map(in_words, causes), "noise", "unexplained"]
    told = "mean squared error of a channel, mean translation error of the path"
    return [
        Picture(
            plots.to_svg(plots.budget(d), "budget"),
            f"Shares of the baseline's error ({told}). The share of a cause does not "
            "depend on the order in which causes are put in; a share below zero makes it worse.",
        ),
        Table(header, rows, caption="The same as a table", folded=True),
    ]


def _part(part: float | None, total: float) -> str:
    return "–" if part is None or not total > 0.0 else share(part / total)


def _remains(d: Diagnosis) -> list[Block]:
    blocks: list[Block] = []
    if d.unexplained:
        rows = [
            [
                left.channel,
                share(left.fraction),
                ", ".join(left.depends_on) or "–",
                "; ".join(f"{run}: {start:g} to {stop:g} s" for run, start, stop in left.when)
                or "throughout",
                left.test or "–",
            ]
            for left in d.unexplained
        ]
        header = ["channel", "structure in the residual", "depends on", "when", "found by"]
        caption = "Structure that no known cause accounts for, as a share of the variance."
        blocks.append(Table(header, rows, caption=caption, strong=range(len(rows))))
    else:
        blocks.append(Text("No significant structure is left in any channel."))
    blocks += [Text(said) for said in disturbances(d)]
    for response in d.responses:
        blocks.append(
            Picture(
                plots.to_svg(plots.innovations(response), f"{_id(response)}-innovations"),
                f"{capital(response.name)}: what the extended model leaves of {response.channel}, "
                "once the predictable part of the noise is taken out. Noise alone stays within the "
                "shaded 95 % bands.",
            )
        )
    blocks += [Text(resting(level)) for level in d.levels]
    if d.small:
        rows = [
            [title(f), _values(f.parameters), points(f.gain), typeset(f.sentence)] for f in d.small
        ]
        header = ["cause", "size", "gain (points of FIT)", ""]
        caption = "Significant, but small or not sure enough to be named."
        blocks.append(Table(header, rows, caption=caption))
    return blocks


def _detectable(d: Diagnosis) -> list[Block]:
    blocks: list[Block] = [Text(text, kind="warning") for text in d.unseen]
    if not d.detectable:
        return [*blocks, Text("The smallest sizes that would have shown were not worked out.")]
    rows = [
        [
            in_words(cause.cause),
            f"{cause.channel} {cause.where}" if cause.channel else cause.where,
            cause.parameter.replace("_", " "),
            with_unit(cause.smallest, cause.unit, 2)
            if math.isfinite(cause.smallest)
            else "not excited",
            ", ".join(map(in_words, cause.inseparable)) or "–",
        ]
        for cause in d.detectable
    ]
    header = ["cause", "where", "parameter", "smallest size", "looks like"]
    caption = (
        "The smallest size of each cause that these logs would have shown, and the causes that "
        "look alike in them. “Not excited” means that no size would have shown."
    )
    return [*blocks, Table(header, rows, caption=caption)]


def _drive_next(d: Diagnosis) -> Block:
    """Each manoeuvre once, the open questions of findings first, with what it is good for."""
    reasons: dict[str, list[str]] = {}
    for finding in (*d.findings, *d.minor):
        if finding.separating_experiment:
            alike = " from ".join(
                [in_words(finding.cause)]
                + [" and ".join(map(in_words, finding.indistinguishable_from))]
            ).removesuffix(" from ")
            reasons.setdefault(finding.separating_experiment, []).append(f"to tell {alike}")
    for cause in d.detectable:
        if cause.manoeuvre:
            text = f"{in_words(cause.cause)} ({cause.channel or cause.where})"
            reasons.setdefault(cause.manoeuvre, []).append(text)
    if not reasons:
        return Text("Nothing is open that a manoeuvre of the catalogue would settle.")
    return Bullets(
        [f"{capital(what.rstrip('.'))}: {', '.join(_brief(why))}." for what, why in reasons.items()]
    )


def _brief(reasons: Sequence[str]) -> list[str]:
    told = [reason for reason in reasons if reason.startswith("to tell")]
    shown = [reason for reason in reasons if not reason.startswith("to tell")]
    return [*told, *([f"shows {' and '.join(shown)} better"] if shown else [])]


def _held_out(d: Diagnosis) -> Text:
    return Text(f"Held out from every fit: {ended(d.held_out)}")


def _values(parameters: Mapping[str, Estimate]) -> str:
    return ", ".join(
        f"{name.replace('_', ' ')} {with_unit(estimate.value, estimate.unit, 3)}"
        for name, estimate in parameters.items()
        if not math.isinf(estimate.value)
    )


def _road_gain(gain: Gain) -> str:
    if gain.ate_before is None or gain.ate_after is None:
        return "–"
    return f"{metres(gain.ate_before).removesuffix(' m')} → {metres(gain.ate_after)}"


def _unit(d: Diagnosis, channel: str) -> str:
    """A channel's unit, from the logs or from the pictures."""
    logs = (record.units[channel] for record in d.records if channel in record.units)
    pictures = (response.unit for response in d.responses if response.channel == channel)
    return next(logs, next(pictures, "1"))


def _id(response: Response) -> str:
    return f"{response.name}-{response.channel}".replace(" ", "-")
