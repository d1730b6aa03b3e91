"""Where a pair of poles would explain a residual, against responses that scipy makes."""

import numpy as np
import pytest
from scipy.signal import cont2discrete, lfilter

import known_plants as known
from vdmsi_jax.identify import identify
from vdmsi_jax.identify.pairs import promising_pairs

DT, N = 0.01, 3000
NUM, DEN = [40.0], [1.0, 9.0, 40.0]


def _response(num, den, u):
    b, a, _ = cont2discrete((num, den), DT)
    return lfilter(b.ravel(), a, u)


@pytest.mark.parametrize("frequency", [21.7, 143.0, 291.0, 402.0, 563.0])
def test_the_pair_that_is_missing_promises_most(frequency):
    """Behind the plant, slow or so fast that the sampling shows its mirror image, whose phase may
    be the same."""
    u = known.steps(N, 150, seed=1)
    pair = [1.0, 0.8, frequency**2]
    full = _response(frequency**2 * np.array(NUM), np.polymul(DEN, pair), u)
    left = full - _response(NUM, DEN, u)
    found = promising_pairs(u, left, DT, np.array(NUM), np.array(DEN), 0, 4)
    assert min(abs(p.imag - frequency) for p in found[:2]) < 2.0
    assert all(p.real < 0.0 for p in found)


@pytest.mark.parametrize("frequency", [21.7, 143.0, 291.0])
def test_a_mode_beside_the_plant_is_found_whatever_its_phase(frequency):
    u = known.steps(N, 150, seed=2)
    pair = [1.0, 0.8, frequency**2]
    left = _response([3.0 * frequency, frequency**2], pair, u) + known.white(N, 0.5, 3)
    found = promising_pairs(u, left, DT, np.array(NUM), np.array(DEN), 2, 4)
    assert min(abs(p.imag - frequency) for p in found[:2]) < 2.0


def test_pairs_that_are_told_lie_apart():
    u = known.steps(N, 150, seed=3)
    found = promising_pairs(u, known.white(N, 1.0, 4), DT, np.array(NUM), np.array(DEN), 2, 16)
    frequencies = np.sort([p.imag for p in found])
    assert len(found) == 16
    assert np.min(np.diff(frequencies)) > 1.0 / (N * DT)


def test_a_grid_finds_two_weak_modes_far_apart():
    """Of 26 and 243 rad/s, each a twentieth of the response: P5 has both, from no start near."""
    u = known.steps(N, 150, seed=5)
    slow = _response([26.0**2, 0.0], [1.0, 1.0, 26.0**2], u)
    fast = _response([243.0**2, 0.0], [1.0, 2.0, 243.0**2], u)
    y = _response([8.0], [1.0, 8.0], u)
    for mode in (slow, fast):
        y = y + 0.05 * y.std() / mode.std() * mode
    y = y + known.white(N, 0.002, 6)
    fit = identify(known.log(u, y, DT), "plant", delay=False, held_out=0.0)["P5Z4"]
    frequencies = sorted(abs(p) for p in np.roots(fit.model.den) if p.imag > 0)
    np.testing.assert_allclose(frequencies, [26.0, 243.0], rtol=0.01)
