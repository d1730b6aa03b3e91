"""Off is nothing at all: bit for bit, at every port and for whole responses."""

import inspect
import itertools
from dataclasses import replace

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from effects.worlds import ON_A_PLANT, REGISTRY, WORLDS, benches, label
from vdmsi_jax.effects import AbstractEffect, Effort
from vdmsi_jax.effects.base import BODY, PORTS
from vdmsi_jax.models.extended_plant import respond
from vdmsi_jax.models.observer_form import observer, slowness_of

ALONG = ("command", "held", "output", "measured", "sensor")  # signal and what is beside it

every_effect = pytest.mark.parametrize("effect", REGISTRY, ids=label)
every_world = pytest.mark.parametrize("world", WORLDS, ids=lambda world: world.name)


def forms(effect):
    """The effect off, as it is and with its constants, if it has any, set for every world."""
    scaled = [effect.scaled(world.scales) for world in WORLDS]
    return [effect, *(made for made in scaled if made is not effect)]


def signal(n=96):
    """Both signs, plateaus, zeros of both signs, jumps, tiny and huge values."""
    rng = np.random.default_rng(3)
    y = rng.normal(size=n) * 10.0 ** rng.integers(-6, 4, n)
    y[10:20], y[30:34], y[40] = y[10], 0.0, -0.0
    return y


def test_these_are_all_ports():
    public = {name for name, _ in inspect.getmembers(AbstractEffect) if not name.startswith("_")}
    told = {
        "cause",
        "shown_by",
        "weight",
        "refines",
        "of",
        "ports",
        "remembers",
        "hides_small",
        "scaled",
        "probes",
    }
    assert PORTS == {*ALONG, *BODY, "load", "effort"}
    assert public - told == PORTS | {"rested"}


@every_effect
def test_a_signal_passes_the_ports_untouched(effect):
    y = signal()
    _, beside = WORLDS[0].rich()
    beside = eqx.tree_at(
        lambda s: (s.t, s.v, s.other, s.distance), beside, replace_fn=lambda x: x[: y.size]
    )
    fine = jnp.asarray(np.repeat(y, beside.substeps))
    told = replace(beside, before=jnp.asarray(0.3))
    for made, around, port in itertools.product(forms(effect), (beside, told), ALONG):
        into = jnp.asarray(y) if port in ("command", "measured") else fine
        out = getattr(made, port)(into, around)
        assert out.dtype == np.float64
        np.testing.assert_array_equal(out, into, err_msg=port)
    for made in forms(effect):
        np.testing.assert_array_equal(made.load(beside), np.zeros(fine.size))
        for level in map(jnp.asarray, y):
            np.testing.assert_array_equal(made.rested(level), level)


@every_effect
def test_no_force_acts(effect):
    rng = np.random.default_rng(4)
    n = 400
    u, y, rate = (rng.normal(size=n) * 10.0 ** rng.integers(-6, 4, n) for _ in range(3))
    gain = rng.choice([-1.0, 1.0], n) * 10.0 ** rng.uniform(-6, 3, n)
    rate[:20], y[20:40], u[40:60] = 0.0, 0.0, 0.0
    stuck, size = (rng.random(n) < 0.5).astype(float), np.abs(gain)
    for made in forms(effect):
        force = jax.vmap(lambda *at, made=made: made.effort(Effort(*at)))(
            *map(
                jnp.asarray,
                (u, y, rate, gain, stuck, gain[::-1], size, size[::-1], np.full(n, 0.01)),
            )
        )
        np.testing.assert_array_equal(force, 0.0)


@every_effect
def test_a_body_moves_untouched(effect):
    y = jnp.asarray(signal())
    v = jnp.asarray(np.abs(signal())[::-1])
    for made in forms(effect):
        for port in BODY:
            beside = {"curvature": (v,), "relaxed": (v, jnp.asarray(1e-3))}.get(port, ())
            np.testing.assert_array_equal(getattr(made, port)(y, *beside), y, err_msg=port)


@pytest.mark.parametrize("h", [1e-5, 2.5e-4, 1e-3, 0.1, 100.0])
@pytest.mark.parametrize("name", ["TyreRelaxation", "SensorLag"])
def test_lags_are_off_at_every_sample_period(name, h):
    effect = next(e for e in REGISTRY if type(e).__name__ == name)
    y = jnp.asarray(signal())
    if name == "SensorLag":
        _, beside = WORLDS[0].rich()
        beside = eqx.tree_at(lambda s: s.h, beside, jnp.asarray(h))
        np.testing.assert_array_equal(effect.sensor(y, beside), y)
    else:
        np.testing.assert_array_equal(effect.relaxed(y, jnp.full(y.shape, 0.5), jnp.asarray(h)), y)


@jax.jit
def _bare(u, signals, a, b, pace):
    system, rest = observer(a, b, pace)
    return respond(system, rest, (), u, signals)


@eqx.filter_jit
def _with(effects, u, signals, a, b, pace):
    system, rest = observer(a, b, pace)
    slowness = slowness_of(a, b, pace, signals.leads)
    return respond(system, rest, effects, u, eqx.tree_at(lambda s: s.slowness, signals, slowness))


@pytest.mark.parametrize("poles", [1, 2, 4])
@every_world
def test_a_plant_with_all_effects_off_responds_as_one_without(world, poles):
    u, signals = world.rich()
    effects = tuple(e.scaled(world.scales) for e in ON_A_PLANT)
    plant = world.plant(poles)
    plain = _bare(jnp.asarray(u), signals, *plant)
    assert np.ptp(plain) > 0.5 * abs(world.gain) * world.size
    np.testing.assert_array_equal(_with(effects, jnp.asarray(u), signals, *plant), plain)


@pytest.mark.parametrize("bench", benches(), ids=lambda bench: bench.name)
def test_lanes_with_all_effects_off_are_one_answer(bench):
    many = bench.program.many(bench.world, np.repeat(bench.off[None], 3, axis=0))
    one = bench.program.one(bench.world, jnp.asarray(bench.off))
    assert one.dtype == np.float64
    np.testing.assert_array_equal(many[0], many[2])
    np.testing.assert_allclose(many[0], one, rtol=0.0, atol=1e-12 * np.ptp(one))
