"""The three future works as `vdmsi reproduce` tells of them. What they rest on is tested against
other code in `test_online`, `test_acceleration` and `test_fusion`."""

import json

import numpy as np
import pytest

from vdmsi_jax.reproduce.beyond import beyond
from vdmsi_jax.reproduce.future import imu, online, outages


def test_the_recursion_is_as_good_as_the_fit_and_recovers():
    result = online(seeds=12)
    assert result.ratio <= 1.2
    assert result.recovered <= 5.0
    assert result.gain_error[0] > 0.2 and result.gain_error[500] < 0.01
    assert np.all(result.held[500:] > 0.7)


def test_an_imu_tells_more_than_the_derivative():
    result = imu(seeds=6)
    assert result.imu < 0.5 * result.derivative_of_speed


def test_outages_cost_less_with_vdm_si():
    (outage,) = outages(seeds=40, lengths=[10.0])
    assert outage.error["VDM-SI"] < 0.4 * outage.error["VDM"]
    assert 2.0 < outage.nees["VDM-SI"] < 4.2


@pytest.mark.slow
def test_all_of_it_is_plain_numbers():
    document = beyond(vehicles=20).document()
    again = json.loads(json.dumps(document, allow_nan=False))
    assert again["population"]["vehicles"] == 20
    assert len(again["population"]["ate"]) == 6
    assert {"steering_model", "online", "imu", "outages"} < set(again)
