"""The search over causes comes to an end."""

import inspect
from dataclasses import dataclass
from types import SimpleNamespace

from vdmsi_jax.diagnose.search import search


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


def test_what_takes_a_place_and_fails_does_not_come_again(monkeypatch):
    """Of two models the one takes the other's place, and fails on data held out, so that the first
    comes again: of a beam that snaps through the search had gone round for ever."""
    holds, fails, looked_at = Fit(1), Fit(2), []

    def failing(found):
        looked_at.append(found.final)
        assert len(looked_at) < 20
        return 0 if found.final is fails else None

    for name, does in {
        "baselines": lambda stage: {(1, 0): holds},
        "score": lambda stage, fit: 0.0,
        "climbed": lambda stage, plain, grid: (holds, {}),
        "eliminate": lambda stage, now, seen, borne: now,
        "worths": lambda stage, now: (now,),
        "_whole": lambda whole, stage, plain, grid, now, findings: Found(now, findings),
        "_failing": failing,
        "Failed": lambda finding, fit: SimpleNamespace(finding=finding),
        "findings_of": lambda stage, findings, *_: (findings, fails),
        "_takes_over": lambda *_: True,
        "_instead": lambda *_: holds,
        "_borne_out": lambda *_: None,
        "_foretold": lambda whole, findings: findings,
    }.items():
        monkeypatch.setattr(search, name, does)
    stage = SimpleNamespace(fitting=SimpleNamespace(but=lambda numbers: None))
    found = inspect.unwrap(search._search)(stage)
    assert looked_at == [holds, fails, holds]
    assert found.final is holds and len(found.failed) == 1
