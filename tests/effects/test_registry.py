"""The registry against the contract: every word is there, described, and has probes that are on."""

import inspect
from dataclasses import replace
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from effects.worlds import REGISTRY, WORLDS, benches, label, places
from vdmsi_jax.effects import ACTUATOR, AbstractEffect, Signals
from vdmsi_jax.effects.backlash import Backlash
from vdmsi_jax.effects.base import PORTS
from vdmsi_jax.effects.dead_zone import DeadZone
from vdmsi_jax.effects.gain_asymmetry import GainAsymmetry
from vdmsi_jax.effects.rate_limit import RateLimit
from vdmsi_jax.effects.regime_change import RegimeChange
from vdmsi_jax.effects.saturation import Saturation
from vdmsi_jax.errors import InputError
from vdmsi_jax.models.extended_plant import ExtendedPlant, respond
from vdmsi_jax.models.observer_form import observer
from vdmsi_jax.models.transfer_function import TransferFunction
from vdmsi_jax.parameters import parameters, with_values

WORDS = set(
    """
    transport_delay dead_zone backlash saturation rate_limit coulomb_friction gain_asymmetry
    gain_nonlinearity quantization offset gain_drift regime_change resonance periodic_disturbance
    speed_dependent_gain understeer tyre_relaxation geometry_scale speed_scale road_grade bank drag
    cross_coupling sensor_delay sensor_bias sensor_lag
    """.split()
)
"""The table of the contract."""
OURS = {"yaw_inertia"}  # words of the project's own

every_effect = pytest.mark.parametrize("effect", REGISTRY, ids=label)
every_bench = pytest.mark.parametrize("bench", benches(), ids=lambda bench: bench.name)


def test_every_word_has_an_effect_and_every_effect_such_a_word():
    assert {effect.cause for effect in REGISTRY} == WORDS | OURS


def test_no_cause_is_registered_twice_in_one_form():
    names = [label(effect) for effect in REGISTRY]
    assert len(set(names)) == len(names)


@pytest.mark.parametrize(
    ("made", "told"),
    [
        (lambda: Backlash(0.5, at="output"), "Backlash: at: unknown value 'output'.*response"),
        (lambda: GainAsymmetry(0.2, by="comand"), "by: unknown value.*did you mean 'command'"),
        (lambda: RegimeChange(0.5, 0.2, over="ru"), "over: unknown value 'ru'; did you mean 'run'"),
    ],
)
def test_a_form_that_no_effect_has_is_none_of_another(unchecked, made, told):
    with pytest.raises(InputError, match=told):
        made()


def test_a_dead_zone_is_the_same_both_ways_before_the_gain_differs():
    zone, gain = DeadZone(0.2), GainAsymmetry(1.0, by="command")
    u, order = jnp.array([-0.5, -0.1, 0.1, 0.5]), [label(effect) for effect in ACTUATOR]
    for effect in sorted((gain, zone), key=lambda effect: order.index(label(effect))):
        u = effect.command(u, Signals.plain(4, 0.1))
    np.testing.assert_allclose(u, [-0.3, 0.0, 0.0, 0.6])


def test_a_limit_of_the_command_stays_where_it_is_when_the_gain_behind_it_changes():
    """A valve whose command is cut off at 0.3, and a hose that leaks from 0.15 s on."""
    limit, leak = Saturation(1 / 0.3, 1 / 0.3), RegimeChange(0.15, -0.2)
    u, order = jnp.array([0.2, 0.5, 0.5, 0.2]), [label(effect) for effect in ACTUATOR]
    for effect in sorted((leak, limit), key=lambda effect: order.index(label(effect))):
        u = effect.command(u, Signals.plain(4, 0.1))
    np.testing.assert_allclose(u, [0.2, 0.3, 0.24, 0.16], rtol=1e-6)


@every_effect
def test_the_list_for_users_has_the_cause_its_parameters_and_what_shows_it(effect):
    told = {"share": "weight", "sine": "amplitude", "cosine": "phase"}
    text = (Path(__file__).parents[2] / "docs" / "causes.md").read_text()
    rows = "".join(row for row in text.splitlines() if row.startswith(f"| `{effect.cause}`"))
    missing = [n for n in parameters(effect) if f"`{told.get(n, n)}`" not in rows]
    assert rows and not missing and f"| {effect.shown_by} |" in rows


@every_effect
def test_an_effect_is_described(effect):
    cls = type(effect)
    text = inspect.cleandoc(cls.__dict__["__doc__"] or "")
    assert len(text.split()) > 2 and not text.startswith(f"{cls.__name__}(")
    assert inspect.getmodule(cls).__doc__
    assert parameters(effect)
    for name, known in parameters(effect).items():
        assert known.unit.strip() and len(known.doc.split()) >= 2, name
        assert known.shown in ("value", "inverse")
        assert known.lower <= np.min(known.off) and np.max(known.off) <= known.upper


@every_effect
def test_the_help_of_an_effect_lists_its_parameters_with_units_and_what_switches_them_off(effect):
    text = inspect.getdoc(type(effect)) or ""
    for name, known in parameters(effect).items():
        assert f"    {known.describe(name)}\n" in f"{text}\n"
        assert f"{name} ({known.unit}): {known.doc}" in text
        assert ("takes the limit itself" in known.describe(name)) == (known.shown == "inverse")
    assert text.count("Attributes:") == 1


def test_limits_may_be_given_as_people_think_of_them():
    u, signals = jnp.array([-5.0, -1.0, 1.0, 5.0]), Signals.plain(4, 1.0)
    for lower in (-3.0, 3.0):
        limits = Saturation.of(lower=lower, upper=2.0, at="command")
        np.testing.assert_allclose(limits.command(u, signals), [-3.0, -1.0, 1.0, 2.0])
    ramp = RateLimit.of(rising=0.5, at="command").held(jnp.array([0.0, 5.0, 5.0, -5.0]), signals)
    np.testing.assert_allclose(ramp, [0.0, 0.5, 1.0, -5.0])
    assert Saturation.of(upper=np.inf).upper == 0.0
    assert jax.jit(lambda limit: Saturation.of(upper=limit).upper)(2.0) == 0.5
    assert GainAsymmetry.of(ratio=0.2).ratio == 0.2


def test_a_limit_in_the_place_of_its_inverse_is_refused_where_that_shows():
    with pytest.raises(ValueError, match=r"Saturation.of\(lower=-2\) takes the limit itself"):
        Saturation(lower=-2.0)
    with pytest.raises(ValueError, match="lets nothing through"):
        Saturation.of(upper=0.0)


def test_an_effect_prints_its_numbers():
    assert repr(DeadZone(0.25)) == "DeadZone(half_width=0.25)"
    limited = Saturation.of(lower=-1, upper=4.0)
    assert repr(limited) == "Saturation.of(upper=4.0, lower=1.0)"
    assert repr(Saturation.of(upper=2.0, at="response")).startswith(
        "Saturation.of(upper=2.0, lower=inf"
    )
    assert "effects=(Saturation.of(" in repr(
        ExtendedPlant(TransferFunction([2.0], [1.0, 2.0]), limited)
    )
    traced = []
    jax.jit(lambda effect: traced.append(repr(effect)))(limited)
    assert traced[0].startswith("Saturation(upper=f64[]")
    assert "num=[2.0]" in repr(
        ExtendedPlant(TransferFunction([2.0], [1.0, 2.0]), (DeadZone(0.25),))
    )


@every_effect
def test_an_effect_is_off_by_default_and_scaling_leaves_its_parameters(effect):
    for made in (effect, *(effect.scaled(world.scales) for world in WORLDS)):
        assert label(made) == label(effect)
        for name, known in parameters(made).items():
            value = getattr(made, name)
            assert value.dtype == np.float64
            np.testing.assert_array_equal(value, np.asarray(known.off))


@every_effect
def test_a_form_acts_where_its_class_can_and_every_port_of_a_class_has_a_form(effect):
    cls = type(effect)
    able = {port for port in PORTS if getattr(cls, port) is not vars(AbstractEffect)[port]}
    assert effect.ports and effect.ports <= able
    forms = [other for other in REGISTRY if type(other) is cls]
    assert set().union(*(form.ports for form in forms)) == able


@pytest.mark.parametrize("effect", [e for e in ACTUATOR if not e.remembers], ids=label)
def test_what_acts_at_the_rows_alone_needs_no_steps_between_them(effect):
    for world in (WORLDS[0], WORLDS[1]):
        u, signals = world.rich()
        made = effect.scaled(world.scales)
        probes = made.probes(world.scales)
        on = with_values(made, [jnp.asarray(x) for x in probes[len(probes) // 2]])
        by_rows = replace(signals, h=jnp.asarray(world.dt), substeps=1)
        a, b, pace = world.plant()
        (system, rest), now = observer(a, b, pace), jnp.asarray(u)
        coarse, fine = (respond(system, rest, (on,), now, told) for told in (by_rows, signals))
        np.testing.assert_allclose(coarse, fine, rtol=0.0, atol=1e-9 * np.ptp(fine))
        moved = np.abs(fine - respond(system, rest, (), now, signals))
        assert moved.max() > 1e-4 * np.ptp(fine)


def test_a_play_of_the_command_and_only_that_hides_its_small_movements():
    plays = [effect for effect in REGISTRY if effect.hides_small]
    assert [(effect.cause, effect.at) for effect in plays] == [("backlash", "command")]
    u = jnp.array([0.0, 1.0, 0.9, 1.0, 0.95, 1.0])
    played = replace(plays[0], gap=jnp.asarray(0.3)).command(u, Signals.plain(u.size, 0.1))
    np.testing.assert_array_equal(played[1:], played[1])


@every_bench
def test_probes_are_finite_within_bounds_and_on(bench):
    for place in bench.places:
        probes = place.effect.probes(bench.scales)
        name = label(place.effect)
        assert probes, name
        low, high = np.array([(k.lower, k.upper) for k in place.known]).T
        for probe in probes:
            assert len(probe) == len(place.index), name
            values = np.asarray(probe, float)
            assert np.isfinite(values).all(), name
            assert np.all((low <= values) & (values <= high)), (name, probe)
            assert np.any(values != bench.off[list(place.index)]), name


@every_bench
def test_a_probe_changes_the_response_to_a_rich_command(bench):
    """At least one probe of each effect by 1e-4 of the response; all of them finitely."""
    plain = bench.program.many(bench.world, bench.off[None])[0]
    size = np.ptp(plain)
    for place in bench.places:
        answers = bench.program.many(bench.world, bench.probed(place))
        assert np.isfinite(answers).all(), label(place.effect)
        change = np.abs(answers - plain).max(axis=1) / size
        assert change.max() > 1e-4, label(place.effect)


def test_places_cover_the_vector():
    for bench in benches():
        index = [i for place in places(bench.effects) for i in place.index]
        assert index == list(range(bench.off.size))
