"""Causes of the body, the road and the sensors against formulas: what they do, and how large."""

from collections.abc import Callable
from dataclasses import dataclass

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import pytest

from effects.worlds import filled, label
from vdmsi_jax.effects import SENSOR, VEHICLE, Signals

N, H = 4000, 0.001
T = H * np.arange(N)
V = 12.0 + 5.0 * np.sin(1.3 * T)
DELTA = 0.06 * np.sin(2.1 * T + 0.3) + 0.02
KAPPA = np.tan(DELTA) / 2.95
WAY = np.concatenate([[0.0], np.cumsum(V[1:] * H)])

SMALL_STEPS = 2e-3
"""Relative: integrals by sums of steps of 1 ms."""


def lagged(y: np.ndarray, steps: np.ndarray) -> np.ndarray:
    """A lag by Euler's method in a hundredth of each step."""
    out, at = np.empty_like(y), y[0]
    out[0] = at
    for k in range(1, len(y)):
        for i in range(100):
            between = y[k - 1] + (i + 0.5) / 100 * (y[k] - y[k - 1])
            at += steps[k] / 100 * (between - at)
        out[k] = at
    return out


def area(values: np.ndarray, along: np.ndarray) -> float:
    return float(np.sum(0.5 * (values[1:] + values[:-1]) * np.diff(along)))


def slope(x: np.ndarray, y: np.ndarray) -> float:
    return float(np.sum(x * y) / np.sum(x * x))


@dataclass(frozen=True)
class Case:
    """What a cause makes of its port's signal, and the size by a formula from what it made.

    Attributes:
        port: where it acts, with what stands beside the signal.
        made: the signal behind it.
        back: the parameter from the signal behind it.
    """

    truth: tuple[float, ...]
    port: str
    before: np.ndarray
    beside: tuple
    made: Callable[[], np.ndarray]
    back: Callable[[np.ndarray], float]
    parameter: int = 0
    tolerance: float = 1e-9


def at_rows() -> Signals:
    signals = Signals.plain(N, H)
    return eqx.tree_at(lambda s: s.v, signals, jnp.asarray(V))


CASES = {
    "SpeedScale": [
        Case((0.04,), "speed", V, (), lambda: 1.04 * V, lambda out: slope(V, out) - 1.0)
    ],
    "Misalignment angle": [
        Case((-0.007,), "angle", DELTA, (), lambda: DELTA - 0.007, lambda out: np.mean(out - DELTA))
    ],
    "Bank": [
        Case(
            (0.05, -0.004), "angle", DELTA, (), lambda: DELTA - 0.004,
            lambda out: np.mean(out - DELTA), parameter=1,
        ),
        Case(
            (0.05, -0.004), "course", DELTA / 2, (), lambda: DELTA / 2 + 0.003,
            lambda out: np.mean(out - DELTA / 2) / 0.06,
        ),
    ],
    "GeometryScale": [
        Case(
            (0.08,), "curvature", KAPPA, (V,), lambda: KAPPA / 1.08,
            lambda out: slope(out, KAPPA) - 1.0,
        )
    ],
    "Understeer": [
        Case(
            (0.0023,), "curvature", KAPPA, (V,), lambda: KAPPA / (1.0 + 0.0023 * V**2),
            lambda out: slope(out * V**2, KAPPA - out),
        )
    ],
    "YawOffset turning": [
        Case(
            (0.035,), "curvature", KAPPA, (V,), lambda: KAPPA + 0.035 * V / (V**2 + 0.05**2),
            lambda out: np.mean(V * (out - KAPPA)), tolerance=5e-3,
        )
    ],
    "TyreRelaxation": [
        Case(
            (0.7,), "relaxed", KAPPA, (V, H), lambda: lagged(KAPPA, V * H / 0.7),
            lambda out: slope(np.gradient(out, WAY), KAPPA - out), tolerance=SMALL_STEPS,
        )
    ],
    "YawInertia": [
        Case(
            (0.006,), "relaxed", KAPPA, (V, H), lambda: lagged(KAPPA, H / (0.006 * V)),
            lambda out: slope(V * np.gradient(out, T), KAPPA - out), tolerance=SMALL_STEPS,
        )
    ],
    "SensorLag": [
        Case(
            (0.09,), "sensor", DELTA, (at_rows(),), lambda: lagged(DELTA, np.full(N, H / 0.09)),
            lambda out: area(DELTA - out, T) / (out[-1] - out[0]), tolerance=SMALL_STEPS,
        )
    ],
    "SensorDelay": [
        Case(
            (0.0634,), "sensor", 3.0 * T, (at_rows(),), lambda: 3.0 * np.maximum(T - 0.0634, 0.0),
            lambda out: np.mean((3.0 * T - out)[100:]) / 3.0,
        )
    ],
    "SensorBias": [
        Case((0.4,), "sensor", V, (at_rows(),), lambda: V + 0.4, lambda out: np.mean(out - V))
    ],
}  # fmt: skip

EFFECTS = {label(effect): effect for effect in VEHICLE + SENSOR}


def test_every_effect_has_a_case():
    assert set(CASES) == set(EFFECTS)


@pytest.mark.parametrize(
    ("name", "case"),
    [pytest.param(n, c, id=f"{n} {c.port}") for n, cases in CASES.items() for c in cases],
)
def test_the_signal_and_the_size_are_those_of_the_formula(name, case):
    (effect,) = filled((EFFECTS[name],), np.array(case.truth))
    beside = (x if isinstance(x, Signals) else jnp.asarray(x) for x in case.beside)
    out = np.asarray(getattr(effect, case.port)(jnp.asarray(case.before), *beside))
    size = np.abs(case.before).max()
    made = case.made()
    at_kink = np.abs(out - made) > 1e-4 * size  # a delay's start, between two samples
    assert at_kink.sum() <= 1
    np.testing.assert_allclose(case.back(out), case.truth[case.parameter], rtol=case.tolerance)
