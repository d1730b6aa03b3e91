"""The evidence behind prices: one drive looked at, and the table of several."""

import pytest

from hidden import calibrate


def line(seed, gain, price=36.0, statistic=5.0):
    return {
        "key": f"seed{seed}",
        "seed": seed,
        "causes": {"backlash": [gain, price]},
        "kinds": {"a hysteresis": [statistic, 20.0, 0.1]},
    }


def test_the_table_counts_what_is_over_its_price():
    lines = [line(40_000, 10.0), line(40_001, 40.0), line(40_002, 12.0, statistic=31.0)]
    told = calibrate.report(lines)
    assert "33.3 % (1 of 3" in told
    assert "| backlash | 3 | 36 | 12.0 |" in told and told.count("| 40.0 | 1 |") == 1
    assert "| a hysteresis | 3 | 5.0 |" in told and "| 20 to 20 | 1 |" in told


@pytest.mark.slow
def test_a_drive_without_a_cause_is_looked_at_whole():
    found = calibrate.looked_at(3)
    assert found["plant"] and found["seed"] >= calibrate.FIRST_SEED
    assert {"resonance", "quantization"} <= set(found["causes"])
    assert all(gain < price for gain, price in found["causes"].values())
    assert all(statistic < 30.0 for statistic, *_ in found["kinds"].values())
