"""The examples of the documents run as they stand there."""

import re
from pathlib import Path

import equinox as eqx
import numpy as np

import vdmsi_jax as vj
from vdmsi_jax.effects import Scales

ROOT = Path(__file__).parents[1]


def example(document: str, after: str) -> str:
    """The first Python example of a document behind some words."""
    text = (ROOT / document).read_text().partition(after)[2]
    found = re.search(r"```python\n(.*?)```", text, re.S)
    assert found, f"{document} has no example behind {after!r}"
    return found.group(1)


def test_the_example_of_what_stands_in_memory_finds_the_plant_and_leaves_its_files(
    tmp_path, monkeypatch
):
    monkeypatch.chdir(tmp_path)
    made = {"vj": vj, "eqx": eqx}
    exec(example("README.md", "What stands in memory needs no file"), made)
    assert list(made["grid"].fits) == ["P1Z0"] and made["grid"].best.fit > 90.0
    assert made["drives"].x.shape == (2, 500)
    assert np.abs(made["driven"].delta).max() <= 0.25 + 1e-9
    kept = vj.load_model(tmp_path / "limited.json").plants["steering"].model
    assert repr(kept) == repr(made["limited"]) and made["log"].name == "known"
    assert {path.name for path in (tmp_path / "out").iterdir()} == {"identify.json", "report.html"}


def test_the_example_of_a_cause_of_one_s_own_acts_and_is_off_by_default():
    made = {"__name__": "example"}
    exec(example("docs/causes.md", "## A cause of one's own"), made)
    assert np.ptp(np.asarray(made["response"].y)) > 0.5
    u = np.linspace(0.0, 1.0, 50)
    off = vj.ExtendedPlant(made["lag"], [made["Ripple"]()]).simulate(u, 0.02)
    np.testing.assert_allclose(off.y, vj.ExtendedPlant(made["lag"], []).simulate(u, 0.02).y)


def test_the_cause_of_one_s_own_is_probed_so_densely_that_each_period_is_nearly_met():
    made = {"__name__": "example"}
    exec(example("docs/causes.md", "## A cause of one's own"), made)
    u = np.linspace(-0.4, 0.4, 2000)
    scales = Scales(-0.4, 0.4, *(1.0,) * 9)
    probes = np.array(made["Ripple"]().probes(scales))

    def ripples(periods):
        waves = np.sin(2.0 * np.pi * u[:, None] / periods)
        return waves / np.linalg.norm(waves, axis=0)

    alike = ripples(np.geomspace(0.8 / 20, 0.8 / 4, 300)).T @ ripples(probes[:, 1])
    assert alike.max(axis=1).min() > 0.6
