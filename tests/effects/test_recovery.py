"""The size of every cause of an actuator, found in data that plain loops made.

A loop of one millisecond with the cause; two runs of 20 s at 50 Hz with noise of 0.2 % of the
range. A fit starts at the true plant with the cause at its nearest probe. All data have one shape,
so all fits share the compiled programs.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cache

import jax.numpy as jnp
import numpy as np
import pytest

from effects import plain
from effects.worlds import label
from vdmsi_jax.diagnose.actuator.hypothesis import Hypothesis, Refit
from vdmsi_jax.diagnose.actuator.lanes import FIRST_CAUSE, LEADS, POLES
from vdmsi_jax.diagnose.actuator.refit import refit
from vdmsi_jax.diagnose.actuator.screen import screen
from vdmsi_jax.diagnose.actuator.stage import Slot, Stage
from vdmsi_jax.effects import ACTUATOR, Scales, Signals

ROWS, DT, SUBSTEPS = 1000, 0.02, 4
TAU, FIRST = 0.25, 0.06  # s
NOISE = 0.015
PACE = 1.0 / TAU

WITHIN = 0.03
"""Of a parameter (of the largest of a profile): sub-steps of 5 ms against 1 ms, and noise."""

ABRUPT = (*(WITHIN,) * 3, 0.1)
"""Of a jump of the gain: how long it takes is known to a few rows."""

DRIVES = [plain.drive(ROWS, DT, seed, k * ROWS * DT) for k, seed in enumerate((1, 2))]
LENGTH = max(d.distance[-1] for d in DRIVES)
SLOPES = (
    *(0.0, 0.02, 0.05, 0.08, 0.06, 0.02, -0.03, -0.04),
    *(-0.07, -0.05, 0.0, 0.03, 0.06, 0.04, 0.01, -0.02),
    *(-0.05, -0.06, -0.02, 0.03, 0.04, 0.05, 0.02, 0.0),
)


@dataclass(frozen=True)
class Case:
    """A cause in the plain loop, and what a fit must find.

    Attributes:
        within: of each parameter (absolute where it is zero), replaces `WITHIN`; infinite where it
            is not judged.
        lift: added to the commands.
        second_order: whether it is also looked for behind a lag before the one in which it acts;
            `alone` if only there.
        ragged: whether a response that sticks makes the likelihood ragged: the best fit from all
            probes counts, as in a search.
        screened: whether a screen finds the size, since no fit can.
        reverses: whether the vehicle goes both ways.
    """

    cause: plain.Cause
    truth: tuple[float, ...]
    within: tuple[float, ...] | None = None
    lift: float = 0.0
    second_order: bool | str = False
    ragged: bool = False
    screened: bool = False
    reverses: bool = False


def coupling(strength, of):
    return Case(plain.coupled(strength, of), (strength,))


CASES = {
    "GainNonlinearity sign": Case(plain.bent(0.15, -0.028), (0.15, -0.028)),
    "GainNonlinearity skew": Case(plain.skewed(0.15, -0.028), (0.15, -0.028)),
    "SpeedDependentGain command": Case(plain.slower_at_speed(-0.02), (-0.02,)),
    "CrossCoupling signed": coupling(1.7, lambda u, d: d.other),
    "CrossCoupling size": coupling(-2.3, lambda u, d: np.abs(d.other)),
    "CrossCoupling square": coupling(6.1, lambda u, d: d.other**2),
    "CrossCoupling slowed": coupling(-0.62, lambda u, d: np.abs(d.other) * u),
    "CrossCoupling cornering": coupling(-0.21, lambda u, d: d.other**2 * u * np.abs(u)),
    "CrossCoupling speed": coupling(-0.09, lambda u, d: d.v),
    "CrossCoupling acceleration": Case(  # the effect averages over 0.2 s to both sides
        plain.coupled(0.31, lambda u, d: np.gradient(d.v, d.dt)), (0.31,), within=(0.06,)
    ),
    "GainAsymmetry command": Case(plain.two_gains(0.27), (0.27,)),
    "GainDrift run": Case(plain.drift(0.011), (0.011, 0.0), within=(0.06, 0.01)),
    "GainDrift session": Case(plain.drift(0.011, True), (0.011, 0.0), within=(0.06, 0.01)),
    "GainDrift run, that fades": Case(
        plain.warming(0.04, 7.0), (0.04, 1 / 7.0), within=(0.06, 0.1)
    ),
    "RegimeChange run": Case(plain.new_gain(9.83, -0.23), (9.83, -0.23, 0.0, 0.0), ABRUPT),
    "RegimeChange session": Case(
        plain.new_gain(28.17, -0.23, session=True), (28.17, -0.23, 0.0, 0.0), ABRUPT
    ),
    "RegimeChange run, that slows": Case(
        plain.new_gain(9.83, -0.23, 0.12), (9.83, -0.23, 0.12, 0.0), (WITHIN, WITHIN, 0.1, 0.2)
    ),
    "RegimeChange run, as a ramp": Case(
        plain.sinking_gain(9.83, -0.23, 1.7), (9.83, -0.23, 0.0, 1.7), (WITHIN, WITHIN, 0.01, 0.1)
    ),
    "Quantization nearest": Case(plain.stepped(0.37), (0.37,), screened=True),
    "Quantization floor": Case(plain.counted(0.37), (0.37,), screened=True),
    "Quantization truncation": Case(plain.cast(0.37), (0.37,), screened=True),
    "DeadZone command": Case(plain.dead_zone(0.46), (0.46,), second_order=True),
    "LateDeadZone spool": Case(
        plain.dead_spool(0.46), (0.46, FIRST), (WITHIN, 0.1), second_order="alone"
    ),
    "Saturation command": Case(plain.command_limits(1.9, -2.3), (1 / 1.9, 1 / 2.3)),
    "RoundSaturation corner": Case(
        plain.soft_limits(2.6, -2.9, 0.27), (1 / 2.6, 1 / 2.9, 0.27), within=(WITHIN, WITHIN, 0.1)
    ),
    "LateSaturation late": Case(
        plain.late_limits(2.6, -2.9, 0.15),
        (1 / 2.6, 1 / 2.9, 0.15, FIRST),
        within=(WITHIN, WITHIN, 0.1, 0.1),
        second_order="alone",
    ),
    "TransportDelay": Case(plain.delay(0.087), (0.087,), second_order=True),
    "RateLimit command": Case(plain.ramp(9.0, 7.0), (1 / 9.0, 1 / 7.0)),
    "Resonance": Case(plain.mode(2.3, 0.07, 0.33), (2.3, 0.07, 0.33, 0.0)),
    "RoadGrade": Case(plain.hills(SLOPES, LENGTH, TAU), SLOPES, within=(0.05,) * len(SLOPES)),
    "GainAsymmetry effort": Case(plain.weak_push(-0.31), (-0.31,)),
    # forward only: below 5 cm/s rolling resistance fades out instead of holding
    "Drag": Case(plain.resistance(0.13, 2.1, TAU), (0.13, 2.1), lift=6.0),
    # behind a single lag the drive is all that moves
    "RateLimit drive": Case(plain.motor_limit(5.0, 4.0, TAU), (1 / 5.0, 1 / 4.0)),
    "RateLimit response": Case(
        plain.motor_limit(5.0, 4.0, TAU), (1 / 5.0, 1 / 4.0), second_order=True
    ),
    "CoulombFriction rate": Case(
        plain.dry_friction(0.42, 0.42),
        (0.42, 0.0, 0.0),
        (WITHIN, 0.05, np.inf),
        second_order=True,
        ragged=True,
    ),
    # a break loose is early or late by whole sub-steps: many optima, and few events that tell
    "CoulombFriction rate, held by more": Case(
        plain.dry_friction(0.42, 0.66),
        (0.42, 0.24, 0.0),
        (0.07, 0.25, np.inf),
        second_order=True,
        ragged=True,
    ),
    # a speed at rest creeps by up to a hundredth of the range, where the loop's is held
    "CoulombFriction response": Case(
        plain.brake(0.42, TAU), (0.42, 0.0, 0.0), (0.05, np.inf, np.inf), ragged=True
    ),
    "EndStop stop": Case(plain.rim(1.7, -1.5, TAU), (1 / 1.7, 1 / 1.5)),
    "Stiffening stiffness": Case(plain.stiffened(0.4, 0.3), (0.4, 0.3), within=0.08),
    "GainAsymmetry stiffness": Case(plain.one_sided(-0.31), (-0.31,)),
    # which gain goes with which level is left to the plant
    "PowerLaw power": Case(plain.drained(-0.5, 3.0), (-0.5,), within=0.08, lift=4.0),
    "BentResponse response": Case(plain.bent_response(0.15, -0.028), (0.15, -0.028)),
    "Saturation response": Case(plain.stops(1.7, -1.5), (1 / 1.7, 1 / 1.5)),
    "Backlash command": Case(plain.slack(0.38), (0.38,), second_order=True),
    "Backlash response": Case(plain.backlash(0.38), (0.38,), second_order=True),
    "LoadedBacklash load": Case(
        plain.pulled_back(0.38, 1.3), (0.38, 1.3), (0.05, 0.1), second_order=True, ragged=True
    ),
    "CoastingBacklash inertia": Case(
        plain.coasting(0.38, 0.3), (0.38, 0.3), (0.05, 0.1), second_order=True, ragged=True
    ),
    "FollowedBacklash between": Case(
        plain.driven_backlash(0.38), (0.38, TAU), (WITHIN, 0.05), second_order="alone", ragged=True
    ),
    "PeriodicDisturbance": Case(plain.hum(0.81, 0.2, -0.15), (0.81, 0.2, -0.15), screened=True),
    "Offset itself": Case(plain.added(-0.21), (-0.21,)),
    "Offset travel": Case(plain.added_by_travel(-0.21), (-0.21,), reverses=True),
    "SpeedDependentGain response": Case(plain.less_at_speed(-0.02), (-0.02,)),
}

NAMES = [label(effect) for effect in ACTUATOR]
RUNS_OF_CASES = [(n, 1) for n, c in CASES.items() if c.second_order != "alone"]
RUNS_OF_CASES += [(n, 2) for n, c in CASES.items() if c.second_order]


def number_of(name: str) -> int:
    """Of the effect of a case; behind a comma the case is told from another one of the effect."""
    return NAMES.index(name.split(",")[0])


@cache
def stage_of(name: str, poles: int) -> Stage:
    """The data of a case."""
    case = CASES[name]
    drives = [replace(d, u=d.u + case.lift) for d in DRIVES]
    if case.reverses:
        drives = [replace(d, v=d.v - 10.0) for d in drives]
    clean = [plain.respond(d, case.cause, TAU, FIRST if poles == 2 else 0.0) for d in drives]
    u, y = np.array([d.u for d in drives]), np.array(clean)
    y = y + np.random.default_rng(11).normal(scale=NOISE, size=y.shape)
    rate = float(np.quantile(np.abs(np.diff(y, axis=1)) / DT, 0.95))
    t, v, other, distance = (
        np.array([getattr(d, n) for d in drives]) for n in ("t", "v", "other", "distance")
    )
    scales = Scales(
        *np.quantile(u, [0.02, 0.98]).tolist(), *np.quantile(y, [0.02, 0.98]).tolist(), rate=rate,
        speed=10.0, distance=float(distance.max()), duration=ROWS * DT, dt=DT, time_constant=TAU,
        noise=NOISE, session=2 * ROWS * DT,
    )  # fmt: skip
    signals = Signals(
        *map(jnp.asarray, (t, v, other, distance)),
        jnp.ones(()), jnp.zeros(2), jnp.asarray(DT / SUBSTEPS), SUBSTEPS,
        begun=jnp.asarray([[d.begun] for d in drives]),
    )  # fmt: skip
    effects = tuple(e.scaled(scales) for e in ACTUATOR)
    everything = np.ones(u.shape, bool)
    return Stage(
        "plant", u, y, everything, ~everything, signals, effects, tuple(range(len(effects))),
        ("plant",) * len(effects), scales, PACE, DT,
    )  # fmt: skip


def plant_of(stage: Stage, poles: int) -> np.ndarray:
    """The vector of the plant as it is, without a cause."""
    theta = stage.off.copy()
    den = np.poly([-1.0 / TAU, -1.0 / FIRST][:poles]) / PACE ** np.arange(poles + 1)
    theta[:poles], theta[POLES + poles - 1] = den[1:], den[-1]
    return theta


def starts_of(stage: Stage, slot: Slot, case: Case, poles: int) -> Iterator[np.ndarray]:
    """Vectors to start from: the nearest probe, or all; for a force behind a lag, leads of zero and
    of a fifth of the time constant."""
    index = list(slot.index)
    probes = np.asarray(slot.effect.probes(stage.scales), float)
    away = np.linalg.norm((probes - case.truth) / stage.usual[index], axis=1)
    for probe in probes if case.ragged else probes[[np.argmin(away)]]:
        assert np.any(np.abs(probe - case.truth) > 0.01 * np.abs(case.truth))
        for lead in (0.0, 0.2) if poles > 1 and slot.forces else (0.0,):
            theta = plant_of(stage, poles)
            theta[index], theta[LEADS[0]] = probe, lead * TAU * PACE
            yield theta


def found(name: str, poles: int) -> Refit:
    """The best fit."""
    case, stage = CASES[name], stage_of(name, poles)
    number = number_of(name)
    if case.screened:
        (plant,) = refit(stage, [Hypothesis(poles, 0, (), plant_of(stage, poles))])
        starts = [c.theta for c in screen(stage, plant) if c.number == number]
    else:
        starts = list(starts_of(stage, stage.slots[number], case, poles))
    fits = refit(stage, [Hypothesis(poles, 0, (number,), theta) for theta in starts])
    return max(fits, key=lambda fit: fit.loglik)


def test_every_effect_has_a_case():
    assert {number_of(name) for name in CASES} == set(range(len(ACTUATOR)))


@pytest.mark.parametrize(("name", "poles"), RUNS_OF_CASES)
def test_the_size_is_found(name, poles):
    case, fit = CASES[name], found(name, poles)
    slot = stage_of(name, poles).slots[number_of(name)]
    truth = np.array(case.truth)
    size = np.abs(truth)
    if len(set(slot.known)) == 1:  # a profile
        size = np.max(size)
    values = fit.hypothesis.theta[list(slot.index)]
    if fit.hypothesis.swing is not None:  # each run's own
        values[1:] = fit.hypothesis.swing.mean(axis=0)
    error = np.abs(values - truth) / np.where(size > 0.0, size, 1.0)
    assert np.all(error < (case.within or WITHIN)), (values, truth, np.sqrt(fit.variance) / NOISE)
    if poles > 1 and slot.forces:
        np.testing.assert_allclose(fit.hypothesis.theta[LEADS[0]] / PACE, FIRST, rtol=0.25)


def test_what_a_stage_leaves_out_is_nothing():
    """Lanes without memory go from row to row, and causes that are off are not computed: the same
    as with every cause on at next to no size."""
    stage = stage_of("Offset itself", 1)
    vectors, nudged = [], []
    for slot in stage.slots:
        for probe in slot.effect.probes(stage.scales)[-2:]:
            vectors.append(plant_of(stage, 2))
            vectors[-1][list(slot.index)] = probe
            nudged.append(vectors[-1] + 1e-12 * stage.usual)
            nudged[-1][:FIRST_CAUSE] = vectors[-1][:FIRST_CAUSE]
            nudged[-1][list(slot.index)] = probe
    answers = stage.simulate(np.array(vectors))
    np.testing.assert_allclose(stage.simulate(np.array(nudged)), answers, rtol=0.0, atol=1e-8)
