"""Drawn vehicles: their two ways of moving against each other, their fits, and what comes of
hundreds of them."""

import itertools

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from vdmsi_jax.models.commands import Commands
from vdmsi_jax.reproduce.batch import in_batches, least_squares, significant
from vdmsi_jax.reproduce.drawn import PARTS, draw, taken_at_word, with_only
from vdmsi_jax.reproduce.population import MODELS, STATISTICS, TRACKS, _shapley, population
from vdmsi_jax.reproduce.pursuit import PAPER_DT, duration, path_of, pursue, speed_command
from vdmsi_jax.simulate import simulate

METRES = 0.03  # between one step a sample by the midpoint, and the quadrature


@pytest.fixture(scope="module")
def driven():
    """Six vehicles along the S-curve, VDM in their place from 8 s on."""
    track, drawn = TRACKS["s_curve"], draw(6, seed=3)
    v_cmd = jnp.asarray(speed_command(duration(track)))
    path = jnp.asarray(path_of(track, 120))
    run = in_batches(lambda d, m: pursue(d, m, path, v_cmd, jnp.asarray(800)), 6)
    return drawn, v_cmd, run(drawn, taken_at_word(6))


def test_the_closed_loop_moves_the_vehicle_as_the_simulation_does(driven):
    drawn, v_cmd, pursued = driven
    commands = Commands(jnp.broadcast_to(v_cmd, pursued.delta_cmd.shape), pursued.delta_cmd, 0.01)
    every = [
        simulate(drawn[i].vehicle(), Commands(v_cmd, commands.delta_cmd[i], PAPER_DT)).poses
        for i in range(6)
    ]
    # a row of the loop is the end of the sample that the simulation's next row begins
    apart = np.asarray(jnp.stack(every) - pursued.truth)
    assert np.abs(apart[..., :2]).max() < METRES


def test_the_vehicle_stays_on_its_track_as_long_as_it_sees(driven):
    _, _, pursued = driven
    track = TRACKS["s_curve"]
    line = track.at(np.linspace(0.0, track.length, 2000))[:, :2]
    seen = np.asarray(pursued.truth)[:, :800:20, :2]
    off = np.linalg.norm(seen[:, :, None] - line, axis=-1).min(axis=-1)
    assert off.max() < 0.5
    looks = np.s_[:, :800:5]  # between looks the model goes on by itself
    np.testing.assert_array_equal(pursued.believed[looks], pursued.truth[looks])
    blind = np.asarray(pursued.believed - pursued.truth)[:, -1, :2]
    assert np.all(np.hypot(*blind.T) > 0.1)


def test_parts_make_a_vehicle_and_none_of_them_makes_vdm():
    drawn = draw(4, seed=1)
    whole = with_only(drawn, jnp.ones(len(PARTS), bool))
    assert all(
        jnp.array_equal(a, b)
        for a, b in zip(jax.tree.leaves(whole), jax.tree.leaves(drawn), strict=True)
    )
    bare = with_only(drawn, jnp.zeros(len(PARTS), bool))
    for a, b in zip(jax.tree.leaves(bare), jax.tree.leaves(taken_at_word(4)), strict=True):
        np.testing.assert_array_equal(a, b)


def test_causes_are_there_as_often_as_asked():
    drawn = draw(2000, seed=0)
    shares = [float(jnp.mean(cause != 0.0)) for cause in (drawn.steering.gap, drawn.understeer)]
    assert np.all(np.abs(np.array(shares) - 0.3) < 0.05)
    assert set(np.unique(drawn.causes)) == {0, 1, 2, 3}


def test_shapley_values_share_out_the_whole():
    """Of a game whose value is that of its players and of one pair of them."""
    sets = np.array(list(itertools.product([0, 1], repeat=len(PARTS))))
    alone = np.arange(1.0, len(PARTS) + 1)
    worth = sets @ alone + 10.0 * sets[:, 0] * sets[:, 5]
    shares = _shapley(worth[None])
    expected = alone + np.array([5.0, 0.0, 0.0, 0.0, 0.0, 5.0])
    np.testing.assert_allclose([shares[part][0] for part in PARTS], expected)


def test_least_squares_is_numpys():
    rng = np.random.default_rng(0)
    A, sizes = rng.standard_normal((200, 3)), jnp.array([1.0, 0.1, 10.0])
    y = A @ np.array([1.0, -0.2, 30.0]) + 0.1 * rng.standard_normal(200)
    every, none = jnp.ones(3, bool), jnp.full(3, -jnp.inf)
    fit = least_squares(lambda x: jnp.asarray(A) @ x - y, jnp.zeros(3), sizes, none, every)
    exact, (cost,), *_ = np.linalg.lstsq(A, y)
    std = np.sqrt(np.diag(np.linalg.inv(A.T @ A)) * cost / 197)
    np.testing.assert_allclose(fit.parameters, exact, rtol=1e-7)
    np.testing.assert_allclose(fit.std, std, rtol=1e-6)
    held = least_squares(
        lambda x: jnp.asarray(A) @ x - y,
        jnp.zeros(3),
        sizes,
        none,
        jnp.array([True, False, True]),
    )
    exact = np.linalg.lstsq(A[:, [0, 2]], y)[0]
    np.testing.assert_allclose(held.parameters, [exact[0], 0.0, exact[1]], rtol=1e-7)
    stays = significant(fit, jnp.array([False, True, True]), 1e3)
    assert list(map(bool, stays)) == [True, False, abs(exact[1]) > 1e3 * std[2]]


@pytest.mark.slow
def test_two_hundred_vehicles_reach_what_the_paper_reached():
    result = population(200, seed=0)
    for scenario, experiment in result.experiments.items():
        for statistic in STATISTICS:
            assert np.median(result.improvement(scenario, statistic)) >= 70.0
            further = result.improvement(scenario, statistic, model="extended", over="VDM-SI")
            assert np.median(further[result.drawn.causes > 0]) >= 50.0
        total = sum(experiment.budget.values())
        mean = experiment.ate["VDM"]["mean"][: len(total)]
        np.testing.assert_allclose(total, mean, atol=0.03)  # of commands that lag 2 ms
        exits = experiment.at_exit
        assert np.median(1.0 - exits["VDM-SI"] / exits["VDM"]) >= 0.6
    assert [set(MODELS) <= set(row) for row in result.table()] == [True] * 6
    assert len(result.exit_table()) == len(result.budget_table()) == 2
    assert sum(row["vehicles"] for row in result.causes_table()) == 400
    found = np.asarray(result.extended.steering.gap != 0.0)
    assert np.mean(found == np.asarray(result.drawn.steering.gap != 0.0)) > 0.95
