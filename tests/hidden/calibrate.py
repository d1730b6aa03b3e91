"""What causes gain on drives that have none: the evidence behind prices and thresholds.

    python tests/hidden/calibrate.py --out FOLDER [--drives N] [--part K/N]

Drives of the generator without a cause, with seeds that no hunt has. Of each, every cause that the
search refits says how much of twice the log-likelihood it gains over the best plain plant, before
data held out are asked; its price (`vdmsi_jax/diagnose/search/price.py`) must be above that.
Likewise the kinds of error without a name (`vdmsi_jax/diagnose/residual/regression.py`). A line for
each drive goes to FOLDER/results.jsonl, a rerun does what is missing, and FOLDER/README.md tells
what came of it.
"""

import argparse
import sys
from collections.abc import Iterable, Sequence
from dataclasses import replace
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

import numpy as np  # noqa: E402

from hidden.generator import Case, generate, siso  # noqa: E402
from hidden.hunt import append, code_version, keep_programs, part, read, tell  # noqa: E402
from hidden.hunt_case import records  # noqa: E402
from hidden.hunt_scores import rate  # noqa: E402

FIRST_SEED = 40_000
STYLES = ("rich", "plain", "rich", "two_level")
Line = dict


def main(arguments: Sequence[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--out", type=Path, required=True, help="folder of results and report")
    parser.add_argument("--drives", type=int, default=200)
    parser.add_argument("--part", type=part, default=(1, 1), help="K/N: every Nth drive")
    options = parser.parse_args(arguments)
    options.out.mkdir(parents=True, exist_ok=True)
    file = options.out / "results.jsonl"
    done = {line["seed"] for line in read(file)}
    own = range(options.drives)[options.part[0] - 1 :: options.part[1]]
    missing = [k for k in own if FIRST_SEED + k not in done]
    keep_programs()
    for k in missing:
        append(file, looked_at(k) | {"code": code_version()})
        tell(f"drive {k} of {options.drives}")
    lines = [line for line in read(file) if line["seed"] < FIRST_SEED + options.drives]
    (options.out / "README.md").write_text(report(lines))
    return 0


def looked_at(k: int) -> Line:
    """What every cause and every kind gains on one drive; each fourth is a single plant's."""
    plant = k % 4 == 3
    case = Case((), "middle", FIRST_SEED + k, driving=STYLES[k // 4 % 4], repeat=k % 5 == 0)
    (drive,) = (siso if plant else generate)([case])
    logs = records(drive)
    key = f"seed{case.seed}"
    return {"key": key, "seed": case.seed, "driving": case.driving, "plant": plant} | gains(logs)


def gains(logs: Sequence) -> Line:
    """The causes' gains and prices, those of the body, and the kinds' statistics."""
    import jax

    from vdmsi_jax.diagnose.body.search import search_body
    from vdmsi_jax.diagnose.diagnose import plants_of
    from vdmsi_jax.diagnose.prepare import body_of, stage_of
    from vdmsi_jax.diagnose.signals.runs import lay_out

    causes: dict[str, list[float]] = {}
    kinds: dict[str, list[float]] = {}
    with jax.enable_x64(True), np.errstate(all="ignore"):
        runs, searches = lay_out(list(logs)), {}
        for spec in plants_of(logs):
            searches[spec.output] = _actuator(stage_of(runs, spec), spec, causes, kinds)
        body = body_of(runs, searches)
        if body is not None:
            _vehicle(runs, body, search_body(body).plain, causes, kinds)
    return {"causes": causes, "kinds": kinds}


def _actuator(whole, spec, causes: dict, kinds: dict):
    """Adds what causes and kinds gain on an actuator; returns its plain model."""
    from vdmsi_jax.diagnose.actuator.outcome import completed
    from vdmsi_jax.diagnose.residual.questions import asked
    from vdmsi_jax.diagnose.residual.regression import weighed
    from vdmsi_jax.diagnose.search.baseline import baselines
    from vdmsi_jax.diagnose.search.found import Search
    from vdmsi_jax.diagnose.search.price import score
    from vdmsi_jax.diagnose.search.selection import climbed

    stage = whole.fitting
    grid = baselines(stage)
    plain = max(grid.values(), key=lambda f: score(stage, f))
    for f in climbed(stage, plain, grid)[1].values():
        if len(f.hypothesis.active) == 1:
            _most(causes, *_of_actuator(stage, plain, f))
    (plain,) = completed(whole, [plain])
    _kinds(kinds, weighed(*asked(spec, whole, plain.y)))
    return Search(whole, plain, plain, plain, ())


def _vehicle(runs, body, plain, causes: dict, kinds: dict) -> None:
    """Adds what causes and kinds gain on the body."""
    from vdmsi_jax.diagnose.residual.questions import asked_of_body
    from vdmsi_jax.diagnose.residual.regression import weighed

    for label, gain, price in _of_body(body, plain):
        _most(causes, label, gain, price)
    if "r" in body.measured:
        _kinds(kinds, weighed(*asked_of_body(runs, body, plain)))


def _of_actuator(stage, plain, f) -> tuple[str, float, float]:
    """Label, gain and price of the cause of a fit."""
    from vdmsi_jax.diagnose.search.price import price, score

    bare = replace(f.hypothesis, active=(), swing=None)
    cost = price(stage, f.hypothesis) - price(stage, bare)
    (number,) = f.hypothesis.active
    return stage.slots[number].cause, score(stage, f) + cost - score(stage, plain), cost


def _of_body(body, plain) -> Iterable[tuple[str, float, float]]:
    from vdmsi_jax.diagnose.body.body import CAUSES
    from vdmsi_jax.diagnose.body.fit import refit_body
    from vdmsi_jax.diagnose.body.screen import screen_body
    from vdmsi_jax.diagnose.body.search import body_price

    promising = [s for s in screen_body(body, plain) if s[0] > 0.0]
    for f in refit_body(body, [((k,), theta) for _, k, theta in promising]):
        (number,) = f.active
        cause = CAUSES[number]
        label = f"{cause.cause} ({cause.channel or cause.where})"
        yield label, 2.0 * (f.loglik - plain.loglik), body_price(f.active)


def _most(causes: dict, label: str, gain: float, price: float) -> None:
    if np.isfinite(price) and gain > causes.get(label, [-np.inf])[0]:
        causes[label] = [round(float(gain), 2), round(float(price), 2)]


def _kinds(kinds: dict, found: Iterable) -> None:
    for f in found:
        if f.statistic > kinds.get(f.family.words, [-np.inf])[0]:
            told = (f.statistic, f.held_out, f.share)
            kinds[f.family.words] = [round(float(x), 3) for x in told]


def report(lines: Sequence[Line]) -> str:
    """What was found, as text."""
    from vdmsi_jax.diagnose.residual.regression import HELD, SURE

    over = [any(g > p for g, p in line["causes"].values()) for line in lines]
    parts = [
        f"# What causes gain on {len(lines)} drives that have none",
        "Written by `python tests/hidden/calibrate.py`, whose text says what was done. Gains are "
        "twice the log-likelihood beyond the best plain plant, or body, of the fitted runs; the "
        "largest of a cause's forms and places; data held out have not been asked.",
        f"Drives on which some cause is worth its price: {rate(over)}.",
        "| cause | drives | price | gain: median | 95 % | 99 % | most | over its price |\n"
        "| --- | --- | --- | --- | --- | --- | --- | --- |",
    ]
    rows = []
    for name in sorted({name for line in lines for name in line["causes"]}):
        own = [line["causes"][name] for line in lines if name in line["causes"]]
        gains, prices = np.array(own).T
        low, high, higher = np.quantile(gains, (0.5, 0.95, 0.99))
        beyond = int(np.sum(gains > prices))
        cost = f"{prices.min():.0f}" + (f" to {prices.max():.0f}" if np.ptp(prices) > 0.5 else "")
        rows.append(
            f"| {name} | {len(own)} | {cost} | {low:.1f} | {high:.1f} | {higher:.1f} | "
            f"{gains.max():.1f} | {beyond} |"
        )
    parts[-1] += "\n" + "\n".join(rows)
    parts.append(
        f"Kinds of error without a name are told from {SURE:g} on, and {HELD:g} on data held out."
        "\n\n"
        "| kind | drives | median | 99 % | most | held out, of those above half | told |\n"
        "| --- | --- | --- | --- | --- | --- | --- |"
    )
    rows = []
    for name in sorted({name for line in lines for name in line["kinds"]}):
        own = np.array([line["kinds"][name] for line in lines if name in line["kinds"]])
        half = own[own[:, 0] > 0.5 * SURE]
        held = f"{half[:, 1].min():.0f} to {half[:, 1].max():.0f}" if len(half) else "none"
        told = int(np.sum((own[:, 0] > SURE) & (own[:, 1] > HELD)))
        low, high = np.quantile(own[:, 0], (0.5, 0.99))
        rows.append(
            f"| {name} | {len(own)} | {low:.1f} | {high:.1f} | {own[:, 0].max():.1f} | {held} | "
            f"{told} |"
        )
    parts[-1] += "\n" + "\n".join(rows)
    return "\n\n".join(parts) + "\n"


if __name__ == "__main__":
    sys.exit(main())
