"""The first look: lag and delay by correlation, on the samples that count."""

import numpy as np
import pytest

from vdmsi_jax import first_look as module
from vdmsi_jax.first_look import first_look

LAG, DELAY, LONGEST = 12.0, 7, 40  # samples
N = 3000


def lagged(n: int = N, seed: int = 0) -> tuple[np.ndarray, np.ndarray]:
    """Steps, and what a lag behind a delay makes of them."""
    rng = np.random.default_rng(seed)
    u = np.repeat(rng.uniform(-1.0, 1.0, n // 50 + 1), 50)[:n]
    y, state = np.empty(n), u[0]
    for k in range(n):
        y[k] = state
        state += -np.expm1(-1.0 / LAG) * (u[max(k - DELAY, 0)] - state)
    return u, y + 0.5 + 0.01 * rng.standard_normal(n)


def look(u, y, counts):
    return first_look([u], [y], [counts], LONGEST)


def test_lag_and_delay_are_those_of_the_plant():
    u, y = lagged()
    found = look(u, y, np.ones(N, bool))
    assert found.delays[0] == DELAY
    assert found.lag == pytest.approx(LAG, rel=0.2)  # of the ladder, whose rungs are 1.4 apart


@pytest.mark.parametrize("garbage", [1e3, np.nan])
def test_what_does_not_count_has_no_say(garbage):
    u, y = lagged()
    counts = np.random.default_rng(1).random(N) > 0.1
    counts[1000:1200] = False
    kept = look(u, y, counts)
    assert look(u, np.where(counts, y, garbage), counts) == kept
    assert kept.delays[0] == DELAY


def test_a_constant_response_is_explained_by_nothing():
    """What its mean leaves is the rounding of numbers, of which a lag had explained 1200 %."""
    u, _ = lagged()
    for constant in (0.0, -0.0171476135):
        y = np.full(N, constant)
        assert look(u, y, np.ones(N, bool)).explained == 0.0
        assert look(y, u, np.ones(N, bool)).explained == 0.0


def test_scattered_holes_cost_nothing():
    """They had parted a segment, and delays longer than a part were not seen."""
    u, y = lagged()
    counts = np.random.default_rng(2).random(N) > 0.01
    assert not counts.all()
    whole, holed = look(u, y, np.ones(N, bool)), look(u, y, counts)
    assert holed.lag == whole.lag and holed.delays[0] == whole.delays[0]


def test_segments_are_looked_at_together():
    parts = [lagged(1000, seed) for seed in range(3)]
    counts = [np.ones(1000, bool), np.zeros(1000, bool), np.ones(1000, bool)]
    u, y = zip(*parts, strict=True)
    found = first_look(list(u), list(y), counts, LONGEST)
    assert found.delays[0] == DELAY
    without = first_look([u[0], u[2]], [y[0], y[2]], [counts[0], counts[2]], LONGEST)
    assert found == without


def test_a_long_segment_is_looked_at_in_pieces(monkeypatch):
    monkeypatch.setattr(module, "_LONGEST", 1000)
    u, y = lagged()
    u[:1000] = 0.0  # nothing moves in the first piece
    y[:1000] = y[999]
    found = look(u, y, np.ones(N, bool))
    assert found.delays[0] == DELAY
    assert found.lag == pytest.approx(LAG, rel=0.2)
