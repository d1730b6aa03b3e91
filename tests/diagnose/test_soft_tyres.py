"""A vehicle on soft tyres: how it turns in is of no form that the library has exactly, and how it
turns in the end is understeer. Plain NumPy: a single track whose tyres relax (Pacejka, Tire and
Vehicle Dynamics, 2012, chs. 1 and 7), at a thousandth of a second."""

import numpy as np
import pytest

from vdmsi_jax.diagnose.body.body import CAUSES, INDEX, WINDOW, Body, increments
from vdmsi_jax.diagnose.body.search import search_body
from vdmsi_jax.models.bicycle import Bicycle

FRONT, REAR, G = 1.25, 1.4, 9.81
DT, SECONDS, FINE = 0.01, 40.0, 10
ROWS = round(SECONDS / DT)
INERTIA = 1.2 * FRONT * REAR  # yaw inertia by mass, m^2


def drive(seed: int, style: str) -> tuple[np.ndarray, np.ndarray]:
    """Speed and road-wheel angle."""
    rng, t = np.random.default_rng(seed), DT * np.arange(ROWS)
    v = 6.0 + 1.7 * np.sin(2.0 * np.pi * t / 19.0 + seed)
    if style == "steps":
        held = np.repeat(rng.uniform(-0.2, 0.2, 20), ROWS // 20)
        delta = np.convolve(held, np.ones(15) / 15.0, "same")
    else:
        phase = 2.0 * np.pi * np.cumsum(np.linspace(0.15, 0.8, ROWS)) * DT
        delta = (0.05 + 0.12 * np.sin(np.pi * t / SECONDS)) * np.sin(phase)
    return v, delta


def moved(v, delta, stiff_front: float, stiff_rear: float):
    """Yaw rate and pose of the centre of gravity, (runs, N) each."""
    load = np.array([REAR, FRONT]) * G / (FRONT + REAR)  # by mass
    (front, rear), sigma = np.array([stiff_front, stiff_rear]) * load, 0.15 * (FRONT + REAR)
    aside, r, ahead, behind, x, y, psi = np.zeros((7, len(v)))
    out, h = np.empty((4, *v.shape)), DT / FINE
    for k in range(ROWS):
        out[:, :, k] = r, x, y, psi
        speed, angle = v[:, k], delta[:, k]
        for _ in range(FINE):
            slip = angle - np.arctan2(aside + FRONT * r, speed)
            ahead = ahead + h * speed / sigma * (front * slip - ahead)
            slip = -np.arctan2(aside - REAR * r, speed)
            behind = behind + h * speed / sigma * (rear * slip - behind)
            x = x + h * (speed * np.cos(psi) - aside * np.sin(psi))
            y = y + h * (speed * np.sin(psi) + aside * np.cos(psi))
            psi = psi + h * r
            aside = aside + h * (ahead + behind - speed * r)
            r = r + h * (FRONT * ahead - REAR * behind) / INERTIA
    return out


def body_of(stiff_front: float, stiff_rear: float) -> Body:
    """Three runs, of which the last judges."""
    rng, styles = np.random.default_rng(0), ("steps", "slalom", "steps")
    v, delta = np.swapaxes([drive(seed, style) for seed, style in enumerate(styles)], 0, 1)
    r, x, y, psi = (
        a + s * rng.standard_normal(a.shape)
        for a, s in zip(
            moved(v, delta, stiff_front, stiff_rear), (0.008, 0.03, 0.03, 0.005), strict=True
        )
    )
    window = round(WINDOW / DT)
    moves = dict(zip(("psi", "forward", "aside"), increments(x, y, psi, window), strict=True))
    channels = {"r": r} | moves
    fitted = np.ones(r.shape, bool)
    fitted[:, -window:] = False
    judging = fitted & (np.arange(3) == 2)[:, None]
    masks = ({c: m for c in channels} for m in (fitted & ~judging, judging))
    zero, bicycle = np.zeros(r.shape), Bicycle(FRONT, REAR)
    return Body(v, delta, zero, zero, channels, *masks, bicycle, DT)


@pytest.mark.slow
def test_understeer_is_told_whatever_form_the_turning_in_has():
    soft, firm = 9.0, 25.0
    gradient = (1.0 / soft - 1.0 / firm) / (G * (FRONT + REAR))
    found = search_body(body_of(soft, firm))
    told = {
        CAUSES[f.number].cause: float(found.final.theta[INDEX[f.number][0]]) for f in found.findings
    }
    assert told["understeer"] == pytest.approx(gradient, rel=0.3)


@pytest.mark.slow
def test_firm_tyres_all_alike_have_none():
    found = search_body(body_of(40.0, 40.0))
    assert "understeer" not in {CAUSES[f.number].cause for f in found.findings}
