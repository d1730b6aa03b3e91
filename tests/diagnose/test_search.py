"""The search over causes comes to an end."""

import inspect
from dataclasses import dataclass, replace
from types import SimpleNamespace

import numpy as np
import pytest

import vdmsi_jax as vj
from vdmsi_jax.diagnose.prepare import stage_of
from vdmsi_jax.diagnose.search import search
from vdmsi_jax.diagnose.signals.runs import lay_out


@dataclass(frozen=True)
class Fit:
    """A model, as the search looks at it, and what was found in it."""

    number: int
    less: object = None

    @property
    def hypothesis(self):
        return SimpleNamespace(kind=(1, 0, frozenset({self.number})), active=(self.number,))


@dataclass(frozen=True)
class Found:
    """What the search returns."""

    final: Fit
    findings: tuple
    screened: tuple = ()
    failed: tuple = ()


def looked_at(monkeypatch, first, takes_over, fails, without, smaller=None):
    """The models that a search looks at, from the first, where one takes the place of another, some
    fail on data held out, which leaves one `without` them or a smaller plant; and what it finds."""
    seen = []

    def failing(found):
        seen.append(found.final)
        assert len(seen) < 20
        return 0 if found.final in fails else None

    for name, does in {
        "baselines": lambda stage: {(1, 0): first},
        "score": lambda stage, fit: 0.0,
        "climbed": lambda stage, plain, grid: (first, {}),
        "_settled": lambda stage, now, seen, borne: now,
        "worths": lambda stage, now: (now,),
        "_whole": lambda whole, stage, plain, grid, now, findings: Found(now, findings),
        "_failing": failing,
        "Failed": lambda finding, fit: SimpleNamespace(finding=finding),
        "is_answered": lambda stage, fit: False,
        "findings_of": lambda stage, findings, *_: (findings, takes_over),
        "_takes_over": lambda *_: True,
        "_in_smaller_plant": lambda *_: smaller,
        "_instead": lambda *_: without,
        "_borne_out": lambda *_: None,
        "_foretold": lambda whole, findings: findings,
    }.items():
        monkeypatch.setattr(search, name, does)
    stage = SimpleNamespace(fitting=SimpleNamespace(but=lambda numbers: None))
    return seen, inspect.unwrap(search._search)(stage)


def test_what_takes_a_place_and_fails_does_not_come_again(monkeypatch):
    """Of two models the one takes the other's place, and fails on data held out, so that the first
    comes again: of a beam that snaps through the search had gone round for ever."""
    holds, fails = Fit(1), Fit(2)
    seen, found = looked_at(monkeypatch, holds, fails, {fails}, holds)
    assert seen == [holds, fails, holds]
    assert found.final is holds and len(found.failed) == 1


def test_what_fails_in_a_large_plant_comes_again_in_a_smaller_one_and_not_back(monkeypatch):
    """Each such model once, and the one that has failed does not take its place: in what follows it
    is as good as ever where it was fitted."""
    large, small, bare = Fit(1), Fit(2), Fit(3)
    seen, found = looked_at(monkeypatch, large, large, {large}, bare, small)
    assert seen == [large, small]
    assert found.final is small and not found.failed
    seen, found = looked_at(monkeypatch, large, large, {large, small}, bare, small)
    assert seen == [large, small, bare]
    assert found.final is bare and len(found.failed) == 1


@pytest.mark.parametrize(
    ("better", "fewer", "takes"),
    [(2.5, 0, True), (1.0, 0, False), (-1.5, 3, True), (-2.5, 3, False), (1.0, 2, False)],
)
def test_of_two_models_as_likely_the_one_with_fewer_parameters_is_told(
    monkeypatch, better, fewer, takes
):
    """A damped mode of four, which a delay of one tells as well in a plant of the same order."""
    now, other = (
        SimpleNamespace(score=s, hypothesis=SimpleNamespace(size=lambda stage, n=n: n))
        for s, n in ((100.0, 9), (100.0 + better, 9 - fewer))
    )
    monkeypatch.setattr(search, "score", lambda stage, fit: fit.score)
    monkeypatch.setattr(search, "rings_rather", lambda *_: False)
    assert inspect.unwrap(search._takes_over)(None, now, other, {}) is takes


def test_a_rounding_fails_whose_errors_are_not_in_what_is_left_without_it():
    """A plant behind a bus of steps of 0.25: with any other step its errors are others."""
    spec, made = vj.PlantSpec("plant", "u", "y"), []
    for run in range(2):
        rng = np.random.default_rng(run)
        u, y, level = np.repeat(rng.uniform(-1.0, 1.0, 60), 25), np.empty(1500), 0.0
        for k, command in enumerate(0.25 * np.round(u / 0.25)):
            y[k] = level
            level += 0.1 * (command - level)
        y += 0.02 * rng.standard_normal(y.size)
        made.append(vj.Record.from_arrays(dt=0.02, name=f"run_{run}", plants=(spec,), u=u, y=y))
    stage = stage_of(lay_out(made), spec)
    found = search.search(stage)
    (finding,) = found.findings
    assert stage.slots[finding.number].cause == "quantization"
    assert not search._hardly_shown(found, finding)
    h = found.final.hypothesis
    (step,) = stage.slots[finding.number].index
    assert h.theta[step] == pytest.approx(0.25, rel=0.01)
    for other in (0.11, 0.19, 0.31):
        theta = h.theta.copy()
        theta[step] = other
        changed = replace(found.final, hypothesis=replace(h, theta=theta))
        assert search._hardly_shown(replace(found, final=changed), finding)
