"""The smallest size of a cause of the body that logs would have shown, and logs that hold it."""

import numpy as np
import pytest

from tests.diagnose.test_body import turning
from vdmsi_jax.diagnose.body.body import CAUSES, Body
from vdmsi_jax.diagnose.body.fit import fit_body
from vdmsi_jax.diagnose.body.search import search_body
from vdmsi_jax.diagnose.findings.body_detectability import detectable_in_body
from vdmsi_jax.diagnose.findings.detectability import SURE

SEEDS = range(20, 24)


def known(body: Body):
    """Sizes by cause and channel."""
    return {(d.cause, d.channel): d for d in detectable_in_body(search_body(body))}


def gained(body: Body, cause: str, channel: str | None) -> float:
    """Twice the log-likelihood that a cause gains where it is fitted."""
    number = next(i for i, c in enumerate(CAUSES) if (c.cause, c.channel) == (cause, channel))
    without, less = fit_body(body, [(), (number,)])
    return 2.0 * (less.loglik - without.loglik)


@pytest.mark.parametrize(
    ("cause", "channel", "how"),
    [
        ("sensor_bias", "r", "bias"),
        ("sensor_delay", "r", "late"),
        ("sensor_delay", "v", "speed_late"),
        ("yaw_inertia", None, "inertia"),
    ],
)
def test_logs_show_a_cause_of_twice_that_size_and_none_of_half_of_it(cause, channel, how):
    size = known(turning(8))[cause, channel].smallest

    half, twice = (
        np.mean([gained(turning(seed, **{how: k * size}), cause, channel) for seed in SEEDS])
        for k in (0.5, 2.0)
    )

    assert half < 0.75 * SURE < 1.5 * SURE < twice


def test_what_every_vehicle_has_a_little_of_hides_no_more_than_that():
    sizes = known(turning(8))

    # lags of the yaw rate and of the curvature up to 20 ms each are every vehicle's
    assert 0.02 < sizes["sensor_lag", "r"].smallest < 0.05
    assert sizes["sensor_delay", "r"].smallest < sizes["sensor_lag", "r"].smallest


def test_what_a_straight_drive_does_not_excite_is_said():
    body = turning(8)
    straight = known(
        Body(body.v, 0.0 * body.delta, body.dv, body.ddelta, {"r": body.measured["r"]},
             body.mask, body.held_out, body.bicycle, body.dt)
    )  # fmt: skip

    assert np.isinf(straight["understeer", None].smallest)
    assert straight["understeer", None].manoeuvre
    assert np.isfinite(straight["sensor_bias", "r"].smallest)
