"""The three future works as `vdmsi reproduce` tells of them, computed anew in the slow tests. What
they rest on is tested against other code in `test_online`, `test_acceleration`, `test_fusion`."""

import json
from typing import Any

import numpy as np
import pytest
from scipy.stats import chi2

from vdmsi_jax.reproduce import beyond
from vdmsi_jax.reproduce.drawn import PARTS, draw
from vdmsi_jax.reproduce.future import (
    Followed,
    Imu,
    Online,
    Outage,
    _nees_bounds,
    imu,
    online,
    outages,
)
from vdmsi_jax.reproduce.population import MODELS, STATISTICS, Experiment, Population
from vdmsi_jax.reproduce.steering_model import Absorbed, Middle
from vdmsi_jax.scenarios import PAPER_DT


@pytest.mark.slow  # compiles for a quarter of a minute, as the next two do
def test_the_recursion_is_as_good_as_the_fit_and_recovers():
    result = online(seeds=12)
    assert result.ratio <= 1.2
    assert result.recovered <= 5.0
    assert result.gain_error[0] > 0.2 and result.gain_error[500] < 0.01
    assert np.all(result.held[500:] > 0.7)


@pytest.mark.slow
def test_an_imu_tells_more_than_the_derivative():
    result = imu(seeds=6)
    assert result.imu < 0.5 * result.derivative_of_speed


@pytest.mark.slow
def test_outages_cost_less_with_vdm_si():
    (outage,) = outages(seeds=40, lengths=[10.0])
    assert outage.error["VDM-SI"] < 0.4 * outage.error["VDM"]
    assert 2.0 < outage.nees["VDM-SI"] < 4.2


def made_up() -> dict[str, Any]:
    """What every study of `beyond` returns, without its computing."""
    drawn, rng = draw(6, seed=0), np.random.default_rng(0)
    ate = {model: {name: rng.uniform(1.0, 2.0, 6) for name in STATISTICS} for model in MODELS}
    at_exit = {model: rng.uniform(1.0, 2.0, 6) for model in MODELS}
    one = Experiment(ate, at_exit, {part: rng.uniform(size=6) for part in PARTS})
    middle = Middle(0.0212, 0.02, 0.022)
    unit, excitation = "rad/s", "to one side"
    row = Absorbed(
        "drift of the sensor", unit, -5e-3, excitation, middle, middle, 0.0, *[middle] * 3
    )
    t = PAPER_DT * np.arange(1000)
    outage = Outage(10.0, 6, *({"VDM": 1.0, "VDM-SI": 0.3} for _ in range(4)), (2.4, 3.6))
    return {
        "population": Population(drawn, drawn, drawn, {"bend": one, "s_curve": one}),
        "absorbed": [row],
        "explanations": [row],
        "online": Online(0.2, 0.1, t, t, t, 1.7, Followed(t, t, t, t)),
        "imu": Imu(0.01, 0.02, 0.03),
        "outages": [outage],
    }


def test_all_of_it_is_plain_numbers_and_of_the_form_that_is_shipped(monkeypatch):
    for name, result in made_up().items():
        monkeypatch.setattr(beyond, name, lambda *_, result=result, **__: result)
    document = beyond.beyond(vehicles=6).document()
    again = json.loads(json.dumps(document, allow_nan=False))
    assert again["population"]["vehicles"] == 6
    assert len(again["online"]["gain_error"]) == 100
    shipped = beyond.recorded()

    def alike(a: Any, b: Any) -> bool:
        if isinstance(a, dict):
            return isinstance(b, dict) and set(a) == set(b) and all(alike(a[k], b[k]) for k in a)
        return not isinstance(a, list) or not a or alike(a[0], b[0])

    assert alike(again, shipped), "run `make record`"


def test_the_bounds_of_the_nees_are_those_of_chi_squared():
    exact = chi2.ppf([0.025, 0.975], 3 * 60) / 60
    np.testing.assert_allclose(_nees_bounds(60), exact, rtol=1e-4)
