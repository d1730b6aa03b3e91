"""What is hunted: the cases, in an order of which every beginning is a fair sample.

`full` holds `small`, so that what one has done the other need not do.
"""

from dataclasses import dataclass

import numpy as np

from .generator import CATALOGUE, OUTSIDE, Case

PLANS = ("full", "small", "tiny")
SEEDS = 5  # vehicles of each cause
VEHICLES = 100  # that the causes share: few enough that some come twice, enough to be many
CLEAN, CLEAN_PLANTS, PAIRS, OUTSIDE_SEEDS = 500, 60, 40, 10

PLACES = [(word, where) for word in CATALOGUE for where in CATALOGUE[word]]
OUTER = [(word, where) for word in OUTSIDE for where in OUTSIDE[word]]
_STANDSTILL = {("dead_zone", "powertrain"), ("coulomb_friction", "powertrain")}


@dataclass(frozen=True)
class Task:
    """A case and why it is there: `cause`, `repeat` (a cause, with a repeated run), `clean`,
    `outside` or `pair`; `plant` for a single plant instead of a vehicle."""

    case: Case
    kind: str
    plant: bool = False

    @property
    def key(self) -> str:
        """Its name in the file of results."""
        case = self.case
        causes = "+".join(f"{word}@{where}" for word, where in case.cause) or "clean"
        parts = [causes, case.size, case.driving, f"seed{case.seed}"]
        parts += ["plant"] * (self.plant and not case.cause) + ["repeat"] * case.repeat
        return "/".join(parts)


def plan(name: str) -> list[Task]:
    """The tasks of a plan, shuffled by a fixed seed."""
    if name not in PLANS:
        raise ValueError(f"plan {name!r}; one of {', '.join(PLANS)}")
    tasks = _tiny() if name == "tiny" else _tasks(full=name == "full")
    order = np.random.default_rng(20240611).permutation(len(tasks))
    return [tasks[i] for i in order]


def task(causes: tuple[tuple[str, str], ...], kind: str, size="middle", seed=0, **how) -> Task:
    """A task whose case says itself whether it parks, so that its clean twin does the same."""
    if how.get("driving", "rich") == "rich" and _STANDSTILL & set(causes):
        how.setdefault("parking", True)
    plant = how.pop("plant", False) or any(where == "plant" for _, where in causes)
    return Task(Case(tuple(causes), size, seed, **how), kind, plant)


def _tasks(full: bool) -> list[Task]:
    tasks = []
    for number, cause in enumerate(PLACES):
        for k in range(SEEDS if full else 1):
            seed = 5000 + (number * SEEDS + k) % VEHICLES
            for size in ("small", "middle", "large") if full else ("middle",):
                for driving in ("rich", "plain") if full else ("rich",):
                    tasks.append(task((cause,), "cause", size, seed, driving=driving))
        if full:
            tasks.append(task((cause,), "repeat", "small", 5000 + number, repeat=True))
    for i in range(0, CLEAN, 1 if full else 25):
        style = ("rich", "plain", "rich", "two_level")[i % 4]
        tasks.append(task((), "clean", seed=6000 + i, driving=style, repeat=i // 4 % 5 == 0))
    for i in range(CLEAN_PLANTS if full else 0):
        style = ("rich", "plain", "two_level")[i % 3]
        tasks.append(task((), "clean", seed=6000 + i, driving=style, plant=True))
    for number, cause in enumerate(OUTER):
        for k in range(OUTSIDE_SEEDS if full else 1):
            tasks.append(task((cause,), "outside", seed=7000 + number * OUTSIDE_SEEDS + k))
    return tasks + _pairs(PAIRS if full else 6)


def _pairs(count: int) -> list[Task]:
    """Causes of different places, and every fourth pair of one place."""
    rng = np.random.default_rng(8000)
    of_vehicles = [cause for cause in PLACES if cause[1] != "plant"]
    tasks, seen = [], set()
    while len(tasks) < count:
        a, b = (of_vehicles[i] for i in rng.choice(len(of_vehicles), 2, replace=False))
        together = len(tasks) % 4 == 3
        pair = frozenset((a, b))
        if a[0] == b[0] or (a[1] == b[1]) != together or pair in seen:
            continue
        seen.add(pair)
        tasks.append(task((a, b), "pair", seed=8000 + len(tasks)))
    return tasks


def _tiny() -> list[Task]:
    return [
        task((("backlash", "steering"),), "cause", seed=5000),
        task((("understeer", "vehicle"),), "cause", seed=5001),
        task((("saturation", "plant"),), "cause", seed=5002),
        task((), "clean", seed=6000, repeat=True),
        task((("dropout", "steering"),), "outside", seed=7010),
        task((("backlash", "steering"), ("understeer", "vehicle")), "pair", seed=5003),
    ]
