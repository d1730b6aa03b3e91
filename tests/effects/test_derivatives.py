"""Derivatives of every response with respect to every parameter, and batches of parameters."""

import numpy as np
import pytest

from effects.worlds import benches, label

STEPPED = {"quantization"}
"""Causes whose response is piecewise constant in a parameter: its derivative tells nothing."""

INTERIOR = 1.0137
"""Probes are multiplied by this: some stand at a kink, such as a delay of whole samples."""

STEP = 1e-6
"""Of a parameter's size, for differences: few samples pass a kink on the way."""

ROUNDING = 1e-9
"""Rounding errors of such a difference, at most this of the response: where a derivative is zero,
nothing else is left."""

AGREE = 2e-4
"""Of the largest derivative: kinks that the difference passes, and its rounding errors."""

MOVING = 8
"""Rows until a run that begins at rest moves by more than rounding errors, which play would see."""

every_bench = pytest.mark.parametrize("bench", benches(), ids=lambda bench: bench.name)


def sizes(bench, place):
    """Typical size of each parameter among the probes."""
    probes = np.abs(np.asarray(place.effect.probes(bench.scales), float))
    return np.max(probes, axis=0)


def interior(bench):
    """Probes away from kinks, each with the direction of each of its effect's parameters: vectors,
    directions (scaled by size) and names."""
    vectors, directions, names = [], [], []
    for place in bench.places:
        if place.effect.cause in STEPPED:
            continue
        low, high = np.array([(k.lower, k.upper) for k in place.known]).T
        for vector in bench.probed(place, INTERIOR):
            own = vector[list(place.index)]
            if np.any(own < low) or np.any(own > high):
                continue
            for i, size in zip(place.index, sizes(bench, place), strict=True):
                vectors.append(vector)
                directions.append(size * np.eye(vector.size)[i])
                names.append(label(place.effect))
    return np.array(vectors), np.array(directions), np.array(names)


def apart(a, b):
    """Largest difference of each row, over the row's largest value."""
    size = np.abs(b).max(axis=1)
    return np.abs(a - b).max(axis=1) / np.where(size > 0.0, size, 1.0)


@every_bench
def test_derivatives_are_finite_off_and_at_every_probe(bench):
    vectors = np.concatenate([bench.off[None], *map(bench.probed, bench.places)])
    weights = np.random.default_rng(1).normal(size=bench.program.one(bench.world, bench.off).shape)
    gradients = bench.program.reverse(bench.world, vectors, weights)
    assert gradients.dtype == np.float64
    assert np.isfinite(gradients).all()


@every_bench
def test_derivatives_are_those_of_differences(bench):
    vectors, directions, names = interior(bench)
    slopes = bench.program.forward(bench.world, vectors, directions)
    up = bench.program.many(bench.world, vectors + STEP * directions)
    down = bench.program.many(bench.world, vectors - STEP * directions)
    differences = (up - down) / (2.0 * STEP)
    zero = np.abs(slopes - differences).max(axis=1) < ROUNDING * np.abs(up).max(axis=1)
    wrong = (apart(slopes, differences) > AGREE) & ~zero
    assert not wrong.any(), set(names[wrong])


@every_bench
def test_both_modes_agree(bench):
    vectors, directions, names = interior(bench)
    slopes = bench.program.forward(bench.world, vectors, directions)
    weights = np.random.default_rng(1).normal(size=slopes.shape[1])
    gradients = bench.program.reverse(bench.world, vectors, weights)
    forward = slopes @ weights
    reverse = np.sum(gradients * directions, axis=1)
    scale = np.abs(slopes) @ np.abs(weights)
    wrong = np.abs(forward - reverse) > 1e-9 * scale
    assert not wrong.any(), set(names[wrong])


@every_bench
def test_the_derivative_off_is_the_one_to_the_side_that_is_allowed(bench):
    """A fit by gradients that starts from off must see which way to go."""
    off = bench.off
    vectors, directions, names = [], [], []
    for place in bench.places:
        if place.effect.cause in STEPPED:
            continue
        for i, known, size in zip(place.index, place.known, sizes(bench, place), strict=True):
            assert known.upper > off[i]
            vectors.append(off)
            directions.append(size * np.eye(off.size)[i])
            names.append(f"{label(place.effect)} {i}")
    vectors, directions, names = np.array(vectors), np.array(directions), np.array(names)
    slopes = bench.program.forward(bench.world, vectors, directions)
    up = bench.program.many(bench.world, vectors + STEP * directions)
    plain = bench.program.many(bench.world, vectors)
    wrong = apart(slopes[:, MOVING:], ((up - plain) / STEP)[:, MOVING:]) > AGREE
    assert not wrong.any(), set(names[wrong])


@every_bench
def test_a_batch_of_parameters_is_the_loop(bench):
    vectors = np.array([bench.probed(place)[-1] for place in bench.places])
    many = bench.program.many(bench.world, vectors)
    for vector, expected in zip(vectors, many, strict=True):
        one = bench.program.one(bench.world, vector)
        np.testing.assert_allclose(one, expected, rtol=0.0, atol=1e-11 * np.abs(expected).max())


def test_any_values_of_parameters_and_constants_are_one_compilation():
    for bench in benches():
        vectors = np.concatenate([bench.probed(place) for place in bench.places])
        bench.program.many(bench.world, vectors)
        bench.program.forward(bench.world, vectors[:2], vectors[:2])
        weights = np.ones_like(bench.program.one(bench.world, vectors[0]))
        bench.program.reverse(bench.world, vectors[:2], weights)
    assert all(times == 1 for bench in benches() for times in bench.program.traced.values())
