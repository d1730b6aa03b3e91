"""A delay is found on all samples, whatever the samples that are not held out have told of it."""

import numpy as np
import pytest

import known_plants as known
from vdmsi_jax.identify import identify

DT, N = 0.02, 1500
NEAR = 0.05  # points of FIT
LATE = {
    "resonance": (known.Truth((36.0,), (1.0, 2.4, 36.0), delay=0.24), 3),
    "other way first": (known.Truth((-2.0, 16.0), (1.0, 8.0, 16.0), delay=0.14), 2),
    "three lags": (known.Truth((60.0,), (1.0, 12.0, 47.0, 60.0), delay=0.1), 1),
}


@pytest.mark.parametrize("name", LATE)
def test_what_is_held_out_costs_no_order_its_optimum(name):
    truth, seed = LATE[name]
    u = known.steps(N, 150, seed=seed)
    y = known.response(truth, u, DT)
    y = y + known.coloured(N, 0.02 * np.std(y), 0.9, seed=100 + seed)
    log = known.log(u, y, DT)
    parts, whole = identify(log, "plant"), identify(log, "plant", held_out=0.0)
    assert parts.held_out.any() and not whole.held_out.any()
    proper = [order for order, fit in parts.fits.items() if fit.ok]
    assert len(proper) == 20
    best = {order: max(parts[order].fit, whole[order].fit) for order in proper}
    for order in proper:
        n, m = parts[order].n_poles, parts[order].n_zeros
        for inside in (f"P{n}Z{m - 1}", f"P{n - 1}Z{m - 1}"):
            if inside in proper:
                assert parts[order].fit >= parts[inside].fit
                # what an order reaches is in reach of those that contain it
                best[order] = max(best[order], best[inside])
        assert parts[order].fit >= best[order] - NEAR, order
    own = 100.0 * (1.0 - np.linalg.norm(y - known.response(truth, u, DT)) / np.std(y) / N**0.5)
    assert parts[truth.order].fit >= own
    assert parts[truth.order].value("delay") == pytest.approx(truth.delay, abs=2 * DT)
