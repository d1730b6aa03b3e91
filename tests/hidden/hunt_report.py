"""The hunt's answer: hunt.md with the bar and what was reached, and two pictures."""

import math
from collections import Counter
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from . import hunt_pictures as pictures
from . import hunt_scores as score
from .hunt_scores import Line, Rate, rate

_MOST_SHOWN = 25


def write(lines: Sequence[Line], folder: Path, plan: str, planned: int) -> None:
    """Write hunt.md, confusion.png and detection.png into the folder."""
    (folder / "hunt.md").write_text(markdown(lines, plan, planned))
    singles = _singles(_finished(lines))
    if singles:
        pictures.confusion(singles).savefig(folder / "confusion.png", dpi=120)
        pictures.detection(singles).savefig(folder / "detection.png", dpi=120)


def markdown(lines: Sequence[Line], plan: str, planned: int) -> str:
    """The report as text."""
    crashed = [line for line in lines if "error" in line]
    whole = _finished(lines)
    versions = Counter(line.get("code", "unknown") for line in lines)
    seconds, _ = score.quantiles([line["seconds"] for line in whole], 0.5, 0.9, 1.0)
    title = f"# The hunt: {len(lines)} of {planned} cases of the {plan} plan"
    parts = [
        title,
        "Written by `python tests/hidden/hunt.py`. A share stands with its hits and Wilson's 95 % "
        "interval; a figure without cases is `none`. What the hidden causes are: "
        "`tests/hidden/generator`; what counts as right: `tests/hidden/hunt_scores.py`.",
        f"Crashed: {len(crashed)} of {len(lines)}. Seconds a case: median {seconds[0]:.1f}, 90 % "
        f"{seconds[1]:.1f}, most {seconds[2]:.1f}. Code: "
        + ", ".join(f"{v} ({n})" for v, n in versions.most_common())
        + ("; **lines of several versions are mixed**." if len(versions) > 1 else "."),
        "## The bar",
        _table(("point", "bar", "reached"), bar(whole)),
        "## By size and driving",
        _by_setting(whole),
        "## Detection against λ₀",
        "λ₀ is the energy of the cause in innovations, behind a projection off five Laguerre "
        "filters of the command (of the yaw rate: off its rate); the projection is not that of the "
        "diagnosis's own baseline. The laws are Φ(√λ₀ − 5.35) of the prototype and "
        "Φ(√λ₀ − 4.7) of an oracle.",
        _detection_table(_singles(whole)),
        "![detection](detection.png)",
        "## What was taken for what",
        "![confusion](confusion.png)",
        "## By cause",
        _by_cause(_singles(whole)),
        "## Names that count as one",
        _equivalents(_singles(whole)),
        "## Sizes of parameters",
        _parameters(whole),
        "## Cases that fell short",
        _short(whole, crashed),
    ]
    return "\n\n".join(parts) + "\n"


def bar(whole: Sequence[Line]) -> list[tuple[str, str, str]]:
    """Rows of the bar's points: number, demand, what was reached."""
    clean, singles = _of(whole, "clean"), _singles(whole)
    outside, pairs = _of(whole, "outside"), _of(whole, "pair")
    verdicts = {id(line): score.judged(line) for line in singles}
    alarms = [line for line in singles if line["findings"]]
    parted = [x for x in alarms if (score.separation(x) or 0.0) >= 20.0]
    loud = [x for x in pairs if min(t["lambda0"] for t in x["truth"]) >= 50.0]
    repeated = [x for x in singles if x["repeat"]]
    shares, n = score.quantiles(map(score.share_of_attainable, singles), 0.1, 0.5)
    small = [x for x in singles if x["size"] == "small"]
    promised, n_small = score.quantiles(map(score.predicted_over_realised, small), 0.1, 0.5, 0.9)
    near = rate(abs(p - 1.0) <= 0.1 for p in _there(map(score.predicted_over_realised, small)))
    opened = [f for x in whole for f in x["findings"] if f["rivals"]]
    exact = _errors(whole, score.EXACT)
    z = np.array([e[2] for e in exact if e[2] is not None])
    either = _errors(whole, score.EXACT | score.LOOSE)
    middle = [e[1] for x in whole if x["size"] == "middle" for e in _errors([x], score.EXACT)]

    def of(lines, what):
        return rate(what(verdicts[id(line)]) for line in lines)

    return [
        ("1", "false alarms ≤ 1 % of clean logs", str(rate(bool(x["findings"]) for x in clean))),
        ("", "the same, drives with a repeat", _alarms([x for x in clean if x["repeat"]])),
        ("", "minor findings on clean logs", str(rate(bool(x["minor"]) for x in clean))),
        ("2", "a single wrong name ≤ 1 % of answers", str(of(alarms, lambda v: v.wrong))),
        ("", "truth in the answer's set ≥ 99 % of alarms", str(of(alarms, lambda v: v.in_set))),
        ("", "a spurious further cause", str(of(alarms, lambda v: v.spurious > 0))),
        ("3", "detected ≥ 95 % where λ₀ ≥ 49", _detected(_above(singles, 49.0))),
        ("", "the same, of which only as minor", str(
            rate(not x["findings"] for x in _above(singles, 49.0) if verdicts[id(x)].detected))),
        ("", "detected where λ₀ ≥ 32 with a repeat ≥ 95 %", _detected(_above(repeated, 32.0))),
        ("", "named alone and rightly ≥ 98 % where λ_AB ≥ 20 (as the log shows it: what the "
         "nearest other name lacks; of lines that say it)", str(of(parted, lambda v: v.named))),
        ("", "the same of all alarms with λ₀ ≥ 49, whatever λ_AB is", str(
            of(_above(alarms, 49.0), lambda v: v.named))),
        ("4", "≥ 99 % of the attainable held-out gain", f"median {shares[1]:.3f}, 10 % quantile "
         f"{shares[0]:.3f} (n = {n})"),
        ("", "predicted gain within 10 % of the realised one, small causes", f"{near}; ratio: "
         f"{promised[0]:.2f}, {promised[1]:.2f}, {promised[2]:.2f} at 10, 50, 90 % "
         f"(n = {n_small})"),
        ("5", "both of two causes of λ₀ ≥ 50 each ≥ 90 %", str(
            rate(all(score.found(x)) for x in loud))),
        ("", "at least one of them", str(rate(any(score.found(x)) for x in loud))),
        ("", "a wrong name alone beside or instead of them", _wrong(pairs)),
        ("6", "outside causes: \"unexplained\" ≥ 95 %", str(rate(map(score.flagged, outside)))),
        ("", "outside causes: a wrong name alone ≤ 2 %", _wrong(outside)),
        ("", "outside causes: a wrong name alone and not flagged", _wrong(
            [x for x in outside if not score.flagged(x)], len(outside))),
        ("", "clean logs: false \"unexplained\" ≤ 2 %", str(rate(map(score.flagged, clean)))),
        ("7", "every \"A or B\" says what separates them", str(
            rate(f["experiment"] for f in opened))),
        ("8", "95 % intervals cover 93–97 % (same formula)", str(rate(abs(z) <= 1.96))),
        ("", "root mean square of error over std (1)", _rms(z)),
        ("", "relative error of parameters, same formula, middle size", _median(middle)),
        ("", "relative error of all comparable parameters", _median([e[1] for e in either])),
        ("9", "seconds of one diagnosis of 3 × 60 s (not a whole process)", _median(
            [x["seconds"] for x in whole], "{:.1f}")),
    ]  # fmt: skip


def _finished(lines: Sequence[Line]) -> list[Line]:
    return [line for line in lines if "error" not in line]


def _of(lines: Sequence[Line], *kinds: str) -> list[Line]:
    return [line for line in lines if line["kind"] in kinds]


def _singles(lines: Sequence[Line]) -> list[Line]:
    return _of(lines, "cause", "repeat")


def _above(lines: Sequence[Line], least: float) -> list[Line]:
    return [line for line in lines if line["lambda0"] >= least]


def _detected(lines: Sequence[Line]) -> str:
    return str(rate(score.judged(line).detected for line in lines))


def _alarms(lines: Sequence[Line]) -> str:
    return str(rate(bool(line["findings"]) for line in lines))


def _wrong(lines: Sequence[Line], of: int | None = None) -> str:
    hits = sum(score.stated_wrongly(line) > 0 for line in lines)
    return str(Rate(hits, len(lines) if of is None else of))


def _errors(lines: Sequence[Line], table) -> list[tuple[str, float, float | None]]:
    return [error for line in lines for error in score.errors(line, table)]


def _there(values) -> list[float]:
    return [v for v in values if v is not None]


def _rms(z: np.ndarray) -> str:
    if not z.size:
        return "none"
    return f"{math.sqrt(float(np.mean(z**2))):.2f}, median |z| {np.median(abs(z)):.2f} (0.67)"


def _median(values: Sequence[float], form: str = "{:.3f}") -> str:
    (half, most), n = score.quantiles(values, 0.5, 0.9)
    return f"median {form.format(half)}, 90 % {form.format(most)} (n = {n})" if n else "none"


def _table(head: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    lines = [head, ["---"] * len(head), *rows]
    return "\n".join("| " + " | ".join(map(str, row)) + " |" for row in lines)


def _row(label: str, lines: Sequence[Line]) -> list[str]:
    verdicts = [score.judged(line) for line in lines]
    alarms = [v for v, x in zip(verdicts, lines, strict=True) if x["findings"]]
    return [
        label,
        str(rate(v.detected for v in verdicts)),
        str(rate(v.in_set for v in alarms)),
        str(rate(v.named for v in alarms)),
        str(sum(v.wrong for v in alarms)),
        str(sum(v.spurious > 0 for v in alarms)),
    ]


_HEAD = ("", "detected", "truth in the set, of alarms", "named alone", "wrong alone", "spurious")


def _by_setting(whole: Sequence[Line]) -> str:
    groups: dict[str, list[Line]] = {}
    for line in _singles(whole):
        label = f"{line['driving']}, {line['size']}" + ", a repeat" * line["repeat"]
        groups.setdefault(label, []).append(line)
    return _table(_HEAD, [_row(label, groups[label]) for label in sorted(groups)])


def _by_cause(singles: Sequence[Line]) -> str:
    groups: dict[str, list[Line]] = {}
    for line in singles:
        groups.setdefault(score.text(score.name(line["truth"][0])), []).append(line)
    return _table(_HEAD, [_row(label, groups[label]) for label in sorted(groups)])


def _detection_table(singles: Sequence[Line]) -> str:
    rows = [
        (f"{x:.3g}", str(r), f"{100 * score.law(x):.0f} %", f"{100 * score.law(x, 4.7):.0f} %")
        for x, r in score.detection(singles)
    ]
    return _table(("λ₀", "detected", "prototype's law", "oracle's law"), rows)


def _equivalents(singles: Sequence[Line]) -> str:
    used = Counter(score.judged(line).by for line in singles)
    rows = [
        (why, " ".join((same.__doc__ or "").split()), str(used[why]))
        for why, same in score.EQUIVALENT.items()
    ]
    return _table(("names", "why", "answers that this made right"), rows)


def _parameters(whole: Sequence[Line]) -> str:
    groups: dict[str, list[tuple[str, float, float | None]]] = {}
    for error in _errors(whole, score.EXACT | score.LOOSE):
        groups.setdefault(error[0], []).append(error)
    rows = []
    for label in sorted(groups):
        errors = groups[label]
        covered = rate(abs(z) <= 1.96 for _, _, z in errors if z is not None)
        exact = "yes" if label.split()[0] in score.EXACT else "no"
        median = float(np.median([e[1] for e in errors]))
        rows.append((label, exact, f"{100 * median:.1f} %", str(covered)))
    head = ("parameter", "same formula", "median error", "covered by the 95 % interval")
    return _table(head, rows)


def _short(whole: Sequence[Line], crashed: Sequence[Line]) -> str:
    """Lists of keys, so that each can be run again."""
    singles = _singles(whole)
    lists = {
        "crashed": [(x, x["error"]) for x in crashed],
        "false alarms": [(x, _said(x)) for x in _of(whole, "clean") if x["findings"]],
        "false unexplained": [(x, _left(x)) for x in _of(whole, "clean") if score.flagged(x)],
        "wrong name alone": [(x, _said(x)) for x in singles if score.judged(x).wrong],
        "truth not in the set, several names": [
            (x, _said(x)) for x in singles
            if x["findings"] and not score.judged(x).in_set and not score.judged(x).wrong
        ],
        "spurious further causes": [(x, _said(x)) for x in singles if score.judged(x).spurious],
        "missed though λ₀ ≥ 49": [
            (x, f"λ₀ {x['lambda0']:.0f}, {x['verdict']}; {_gap(x)}")
            for x in _above(singles, 49.0) if not score.judged(x).detected
        ],
        "only minor though λ₀ ≥ 49": [
            (x, f"λ₀ {x['lambda0']:.0f}; {_gap(x)}")
            for x in _above(singles, 49.0)
            if score.judged(x).detected and not x["findings"]
        ],
        "outside, not flagged": [
            (x, _said(x)) for x in _of(whole, "outside") if not score.flagged(x)
        ],
        "pairs, not both": [
            (x, _said(x)) for x in _of(whole, "pair") if not all(score.found(x))
        ],
    }  # fmt: skip
    parts = []
    for title, cases in lists.items():
        shown = [f"- `{x['key']}`: {words}" for x, words in cases[:_MOST_SHOWN]]
        more = len(cases) - len(shown)
        shown += [f"- and {more} more"] if more else []
        parts.append(f"{title[:1].upper()}{title[1:]}: {len(cases)}\n\n" + "\n".join(shown))
    return "\n\n".join(part.rstrip() for part in parts)


def _said(line: Line) -> str:
    told = [" or ".join(map(score.text, score.names(f))) for f in line["findings"]]
    return "; ".join(told) or line["verdict"]


def _gap(line: Line) -> str:
    """FIT by channel of baseline, extended model, and the best: nothing between the first and the
    last means that the baseline answers as the cause would."""
    fits = [
        f"{c} {before:.2f}, {after:.2f} of {line['attainable'][c]:.2f}"
        for c, (before, after) in line["fit"].items()
        if c in line["attainable"]
    ]
    return "FIT " + "; ".join(fits)


def _left(line: Line) -> str:
    return "; ".join(
        f"{u['channel']} {u['fraction']:.3f}, {u['test']}" for u in line["unexplained"]
    )
