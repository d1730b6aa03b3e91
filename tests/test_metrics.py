"""Errors by hand, and against evo run as a program (it is GPL and no dependency)."""

import json
import os
import shutil
import subprocess
import sys
import zipfile
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jaxtyping import TypeCheckError

from vdmsi_jax.metrics import (
    Alignment,
    aligned,
    ate,
    fit,
    heading_error,
    mse,
    read_tum,
    relative_pose_error,
    translation_error,
    write_tum,
)

EVO = 1e-9  # m; what the project promises


def paths(rows=400, seed=0):
    """A winding path, and an estimate of it that drifts, turned and moved as a whole."""
    rng = np.random.default_rng(seed)
    psi = np.cumsum(0.05 * rng.normal(size=rows))
    truth = np.stack([np.cumsum(np.cos(psi)) * 0.1, np.cumsum(np.sin(psi)) * 0.1, psi], axis=1)
    estimate = truth + np.cumsum(0.003 * rng.normal(size=(rows, 3)), axis=0)
    c, s = np.cos(0.7), np.sin(0.7)
    place = estimate[:, :2] @ np.array([[c, s], [-s, c]]) + [3.0, -8.0]
    return truth, np.column_stack([place, estimate[:, 2] + 0.7])


def test_fit_and_mse_by_hand():
    y, y_hat = np.array([0.0, 1.0, 2.0, 3.0]), np.array([0.0, 1.0, 2.0, 2.0])
    np.testing.assert_allclose(fit(y, y_hat), 100.0 * (1.0 - 1.0 / np.sqrt(5.0)))
    np.testing.assert_allclose(mse(y, y_hat), 0.25)
    assert float(fit(y, y)) == 100.0
    assert float(fit(y, np.full(4, y.mean()))) == 0.0
    assert float(fit(np.ones(4), y)) == -np.inf


def test_paper_fit_and_mse_imply_its_noise():
    """Anchor: FIT 0.889 and MSE 2.87e-3 are an output of 0.483 and a residual of 0.054 m/s."""
    y = np.tile([0.483, -0.483], 500)
    y_hat = y - np.tile([0.0536, 0.0536, -0.0536, -0.0536], 250)
    np.testing.assert_allclose(fit(y, y_hat), 88.9, atol=0.05)
    np.testing.assert_allclose(mse(y, y_hat), 2.87e-3, rtol=2e-3)


def test_table_three_improvements_are_those_of_its_entries():
    """Anchor: the stated improvements agree with the errors within their rounding."""
    table = {
        72.88: (21.65, 5.87), 70.44: (8.27, 2.44), 72.07: (10.53, 2.94),
        84.37: (8.35, 1.30), 78.05: (3.20, 0.70), 80.26: (4.03, 0.80),
    }  # fmt: skip
    for stated, (vdm, vdm_si) in table.items():
        assert abs(100.0 * (1.0 - vdm_si / vdm) - stated) <= 0.12


def test_rigid_motion_is_no_error_once_aligned():
    truth, _ = paths()
    c, s = np.cos(-2.5), np.sin(-2.5)
    moved = np.column_stack([truth[:, :2] @ np.array([[c, s], [-s, c]]) + 5.0, truth[:, 2] - 2.5])
    for alignment in (Alignment.START, Alignment.SE2):
        assert float(ate(truth, moved, alignment)["max"]) < 1e-12
        assert np.abs(heading_error(truth, moved, alignment)).max() < 1e-12
    assert float(ate(truth, moved, Alignment.NONE)["max"]) > 1.0
    translation, turn = relative_pose_error(truth, moved, distance=3.0)
    assert max(translation.max(), np.abs(turn).max()) < 1e-12


def test_alignment_is_the_least_squares_one():
    truth, estimate = paths()
    best = float(ate(truth, estimate, Alignment.SE2)["rmse"])
    fitted = np.asarray(aligned(truth, estimate, Alignment.SE2))
    for angle, shift in ((1e-3, 0.0), (-1e-3, 0.0), (0.0, 1e-2), (0.0, -1e-2)):
        c, s = np.cos(angle), np.sin(angle)
        other = fitted[:, :2] @ np.array([[c, s], [-s, c]]) + shift
        away = np.hypot(*(truth[:, :2] - other).T)
        assert np.sqrt(np.mean(away**2)) > best


def test_heading_error_is_wrapped():
    truth = np.zeros((2, 3))
    estimate = np.array([[0.0, 0.0, 0.0], [0.0, 0.0, 2.0 * np.pi - 0.1]])
    np.testing.assert_allclose(heading_error(truth, estimate), [0.0, -0.1], atol=1e-12)


def test_error_of_an_anchored_path_has_a_gradient():
    """The first distance is zero, where the distance itself has no derivative."""
    truth, estimate = paths()

    @jax.jit
    def error(scale):
        return ate(truth, jnp.asarray(estimate) * jnp.array([scale, scale, 1.0]))["mean"]

    forward, reverse = jax.jacfwd(error)(1.0), jax.grad(error)(1.0)
    slope = (error(1.0 + 1e-6) - error(1.0 - 1e-6)) / 2e-6
    np.testing.assert_allclose([forward, reverse], slope, rtol=1e-7)
    assert float(translation_error(truth, estimate, Alignment.START)[0]) == 0.0


def test_relative_error_by_hand():
    """A wheel radius that is wrong by two per cent errs by two per cent of every stretch."""
    truth = np.column_stack([np.arange(101) * 0.1, np.zeros(101), np.zeros(101)])
    translation, turn = relative_pose_error(truth, truth * [1.02, 1.0, 1.0], distance=2.0)
    assert translation.size == 81
    np.testing.assert_allclose(translation, 0.04, rtol=1e-12)
    assert (turn == 0.0).all()
    consecutive, _ = relative_pose_error(truth, truth * 1.02, distance=2.05, overlapping=False)
    np.testing.assert_allclose(consecutive, 0.042, rtol=1e-9)
    for distance in (-1.0, 11.0):
        with pytest.raises(ValueError, match="no stretch"):
            relative_pose_error(truth, truth, distance=distance)


def test_poses_must_be_alike():
    with pytest.raises((ValueError, TypeCheckError)):  # the latter where annotations are executed
        ate(np.zeros((3, 3)), np.zeros((4, 3)))


def test_tum_is_written_without_loss(tmp_path):
    truth, _ = paths()
    t = 1700000000.0 + 0.01 * np.arange(len(truth))
    write_tum(tmp_path / "path.tum", t, truth)
    back_t, back = read_tum(tmp_path / "path.tum")
    np.testing.assert_array_equal(back_t, t)
    np.testing.assert_array_equal(back[:, :2], truth[:, :2])
    wrapped = np.arctan2(np.sin(truth[:, 2]), np.cos(truth[:, 2]))
    np.testing.assert_allclose(back[:, 2], wrapped, atol=1e-14)
    (tmp_path / "short.tum").write_text("0 1 2\n")
    with pytest.raises(ValueError, match="not 3 numbers"):
        read_tum(tmp_path / "short.tum")


@pytest.fixture(scope="module")
def evo(tmp_path_factory):
    """Run an evo program on two paths and read the statistics that it prints."""
    beside = Path(sys.executable).parent
    program = shutil.which("evo_ape", path=f"{beside}{os.pathsep}{os.environ['PATH']}")
    if program is None:
        pytest.skip("evo is not installed")
    folder = tmp_path_factory.mktemp("evo")
    t, (truth, estimate) = 0.01 * np.arange(400), paths()
    write_tum(folder / "truth.tum", t, truth)
    write_tum(folder / "estimate.tum", t, estimate)
    environment = os.environ | {"HOME": str(folder), "MPLBACKEND": "Agg"}

    def run(name, *options):
        command = [Path(program).with_name(name), "tum", "truth.tum", "estimate.tum", *options]
        result = folder / "result.zip"
        result.unlink(missing_ok=True)
        subprocess.run(
            [*map(str, command), "--save_results", str(result)],
            cwd=folder, env=environment, check=True, capture_output=True, text=True, timeout=120,
        )  # fmt: skip
        with zipfile.ZipFile(result) as archive:
            return json.loads(archive.read("stats.json"))

    return run


@pytest.mark.parametrize(
    ("alignment", "options"),
    [
        (Alignment.NONE, ()),
        (Alignment.START, ("--align_origin",)),
        (Alignment.SE2, ("--align", "--project_to_plane", "xy")),
    ],
)
def test_ate_is_that_of_evo(evo, alignment, options):
    expected = evo("evo_ape", *options)
    for name, value in ate(*paths(), alignment).items():
        np.testing.assert_allclose(value, expected[name], atol=EVO)


def test_relative_error_is_that_of_evo(evo):
    expected = evo("evo_rpe", "--delta", "3.05", "--delta_unit", "m", "--pairs_from_reference")
    translation, _ = relative_pose_error(*paths(), distance=3.05, overlapping=False)
    np.testing.assert_allclose(translation.max(), expected["max"], atol=EVO)
    np.testing.assert_allclose(np.sqrt(np.mean(translation**2)), expected["rmse"], atol=EVO)


def test_fit_where_there_is_nothing_to_fit():
    """No variation leaves nothing to explain, even to a perfect model; a perfect fit of what varies
    has a derivative."""
    for level in (0.1, 1.0):
        assert fit(np.full(7, level), np.full(7, level)) == -np.inf
        assert fit(np.full(7, level), np.full(7, 1.1)) == -np.inf
    wave = jnp.sin(jnp.arange(9.0))
    assert float(jax.grad(lambda k: fit(wave, k * wave))(1.0)) == 0.0


def test_numpy_gives_numpy_and_compiles_nothing():
    truth, estimate = paths()
    seen = translation_error(truth, estimate, Alignment.SE2)
    assert isinstance(seen, np.ndarray)
    same = translation_error(jnp.asarray(truth), estimate, Alignment.SE2)
    assert isinstance(same, jax.Array)
    np.testing.assert_allclose(seen, same, atol=1e-12)
