"""Drives of the hunt whose answers were wrong once."""

import pytest

from hidden.generator import Case
from hidden.hunt_case import examined, made
from hidden.hunt_plan import Task
from vdmsi_jax import diagnose


def line_of(word: str, where: str, size: str, seed: int) -> dict:
    """What the hunt writes of a cause in plain driving."""
    task = Task(Case(((word, where),), size, seed, driving="plain"), "cause", where == "plant")
    (ready,) = made([task])
    return examined(*ready, diagnose)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("word", "where", "size", "seed", "why"),
    [
        ("transport_delay", "plant", "large", 5013, "the command rested where data were held out"),
        ("saturation", "powertrain", "large", 5047, "the limit was only tried in a larger plant"),
        ("rate_limit", "steering", "large", 5067, "a slow error of the speed had drawn hills"),
        ("transport_delay", "powertrain", "middle", 5001, "a slow error was most of the error"),
        ("coulomb_friction", "plant", "large", 5089, "it had been a play of the command alone"),
    ],
)
def test_a_cause_is_among_those_told_and_nothing_else_is(word, where, size, seed, why):
    line = line_of(word, where, size, seed)
    (found,) = line["findings"]
    assert word in {found["cause"], *(cause for cause, _ in found["rivals"])}, why
    assert line["verdict"] == "explained"
    assert all(after > before - 1.0 for before, after in line["fit"].values())
