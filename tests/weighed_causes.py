"""Causes with what they are worth, to be weighed."""

from dataclasses import replace

import made_up_diagnosis
from vdmsi_jax.config import PlantSpec
from vdmsi_jax.diagnose.actuator.stage import Stage
from vdmsi_jax.diagnose.answer.result import ChannelScore, Estimate, Finding, Gain, Rival
from vdmsi_jax.diagnose.findings.naming import Named
from vdmsi_jax.diagnose.findings.weighing import Weighing
from vdmsi_jax.diagnose.search.found import Search
from vdmsi_jax.diagnose.search.judge import Trial
from vdmsi_jax.diagnose.signals.noise import Noise, OwnNoise
from vdmsi_jax.diagnose.signals.runs import Runs


def searched(noise: Noise) -> Search:
    """By which causes are known as its own, and its noise."""
    search, stage = object.__new__(Search), object.__new__(Stage)
    object.__setattr__(stage, "noise", noise)
    object.__setattr__(search, "stage", stage)
    return search


SEARCH, OTHER = searched(OwnNoise()), searched(OwnNoise())
SPEC = PlantSpec("servo", "u", "y")
SCORE = ChannelScore(80.0, mse=1.0, noise_std=0.1, ceiling=95.0)
RUNS = Runs(("run",), (), (0,), (2000,), (0.0,), ((),), dt=0.05)  # of 100 s
WEIGHING = Weighing({SPEC: SEARCH}, RUNS, {"y": SCORE}, {"y": SCORE})


def named(cause: str, *rivals: str, search: Search = SEARCH) -> Named:
    alike = tuple(Rival(word, "plant", 1.0, True) for word in rivals)
    return Named(cause, "plant", None, "", {}, 500.0, 1, alike, search=search)


def gain(part: float) -> Gain:
    """Of a cause that takes this part of what the baseline errs by."""
    return Gain("y", 90.0, 91.0, 0.1, mse_before=0.05 + part, mse_after=0.05)


def trial(part: float) -> Trial:
    return Trial(gain(part), None, 1.0, 5.0, 0.5, False)


def tried(*causes: Named) -> list[tuple[Named, Trial]]:
    return [(cause, trial(0.2)) for cause in causes]


def finding(cause: str, share: float) -> Finding:
    return replace(made_up_diagnosis.siso().findings[0], cause=cause, share=share)


def judged(cause: Named, before: float, after: float) -> tuple[Trial, Finding]:
    """Of a cause by FIT, in percent, without and with it, steadily."""
    mse = [(1.0 - fit / 100.0) ** 2 * 25.0 for fit in (before, after)]
    own = Gain("y", before, after, 0.05, *mse, held_out=True, typical=0.01)
    share = 1.0 - mse[1] / mse[0]
    told = replace(finding(cause.cause, share), parameters={}, gain=own, statistic=100.0)
    told = replace(told, parameters={"gap": Estimate(0.02, 0.001, "m")})
    return Trial(own, None, 100.0, 8.0, 0.9), told
