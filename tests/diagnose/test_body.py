"""Causes of the body, from speeds and angles as they are and yaw rates made by plain NumPy."""

from dataclasses import replace

import numpy as np
import pytest

from vdmsi_jax.config import VehicleGeometry
from vdmsi_jax.data.record import Record
from vdmsi_jax.diagnose.body.body import BANK, CAUSES, INDEX, WINDOW, Body, increments
from vdmsi_jax.diagnose.body.fit import fit_body
from vdmsi_jax.diagnose.body.lane import BodyFit
from vdmsi_jax.diagnose.body.search import BodySearch, body_price, body_score, search_body
from vdmsi_jax.diagnose.findings.body_naming import of_body
from vdmsi_jax.diagnose.findings.budget import of_turning
from vdmsi_jax.diagnose.residual import of_body as of_body_left
from vdmsi_jax.diagnose.residual.of_body import jumps_of_pose
from vdmsi_jax.diagnose.signals.noise import Pair
from vdmsi_jax.diagnose.signals.runs import lay_out
from vdmsi_jax.models.bicycle import Bicycle

DT, ROWS, FINE = 0.02, 2500, 20


def turning(
    seed: int,
    *,
    late: float = 0.0,
    inertia: float = 0.0,
    bias: float = 0.0,
    wander: float = 0.0,
    judged: bool = False,
    speed_late: float = 0.0,
) -> Body:
    """Two runs whose speed and angle swing; the yaw rate is told `late` seconds after it was, the
    speed `speed_late`, and the yaw rate follows with a time constant of `inertia` seconds per m/s.
    A constant and a slow noise of 0.4 s, rad/s, are added to it. If `judged`, the second run is
    held out."""
    rng = np.random.default_rng(seed)
    t = DT / FINE * np.arange(ROWS * FINE)
    v, delta, r = [], [], []
    for run in range(2):
        speed = 8.0 + 4.0 * np.sin(2.0 * np.pi * t / 31.0 + run)
        angle = 0.08 * np.sin(2.0 * np.pi * (0.1 + 0.03 * t) * t + rng.uniform(0.0, 6.28))
        goal, at, turned = speed * np.tan(angle) / 2.7, 0.0, np.empty(len(t))
        for k in range(len(t)):
            lag = max(inertia * speed[k], 1e-4)
            turned[k] = at = at + (1.0 - np.exp(-DT / FINE / lag)) * (goal[k] - at)
        seen = np.interp(t - late, t, turned)[::FINE] + 0.01 * rng.standard_normal(ROWS)
        keep, slow = np.exp(-DT / 0.4), 0.0
        for k, step in enumerate(rng.standard_normal(ROWS)):
            slow = keep * slow + np.sqrt(1.0 - keep**2) * wander * step
            seen[k] += bias + slow
        told = np.interp(t - speed_late, t, speed)[::FINE]
        v, delta, r = [*v, told], [*delta, angle[::FINE]], [*r, seen]
    zero, here = np.zeros((2, ROWS)), {"r": np.ones((2, ROWS), bool)}
    held = {"r": np.zeros((2, ROWS), bool)}
    here["r"][1], held["r"][1] = not judged, judged
    bicycle = Bicycle(1.2, 1.5)
    return Body(
        np.array(v), np.array(delta), zero, zero, {"r": np.array(r)}, here, held, bicycle, DT
    )


def posed(
    v: np.ndarray, delta: np.ndarray, pose: list[np.ndarray], wheelbase: float, **channels
) -> Body:
    """One run, (1, ROWS) each, with its pose and what else is measured; nothing is held out."""
    window = round(WINDOW / DT)
    channels |= zip(("psi", "forward", "aside"), increments(*pose, window), strict=True)
    inside = np.ones((1, ROWS), bool)
    inside[:, -window:] = False
    here, nowhere = ({c: m for c in channels} for m in (inside, ~np.ones((1, ROWS), bool)))
    zero, bicycle = np.zeros((1, ROWS)), Bicycle(wheelbase, 0.0)
    return Body(v, delta, zero, zero, channels, here, nowhere, bicycle, DT)


def found_in(body: Body) -> dict[str, float]:
    """Causes and their values."""
    found = search_body(body)
    return {
        CAUSES[f.number].cause: float(found.final.theta[INDEX[f.number][0]]) for f in found.findings
    }


@pytest.mark.slow
def test_a_yaw_rate_that_is_far_too_late_is_found_though_no_small_step_leads_there():
    found = found_in(turning(1, late=0.12))
    assert set(found) == {"sensor_delay"}
    assert found["sensor_delay"] == pytest.approx(0.12, abs=0.01)


def test_a_speed_that_is_told_late_shows_in_the_yaw_rate():
    """Without a pose, too: else what it leaves in the yaw rate is called unexplained."""
    found = found_in(turning(1, speed_late=0.3))
    assert set(found) == {"sensor_delay"}
    assert found["sensor_delay"] == pytest.approx(0.3, abs=0.02)


def test_a_body_that_is_slow_where_it_is_fast_has_inertia():
    found = found_in(turning(2, inertia=0.006))
    assert set(found) == {"yaw_inertia"}
    assert found["yaw_inertia"] == pytest.approx(0.006, rel=0.15)


def test_the_causes_share_the_error_of_the_yaw_rate():
    found = search_body(turning(2, inertia=0.006, bias=0.03))
    budget = of_turning(found, of_body(found))
    assert (budget.name, budget.unit) == ("r", "(rad/s)^2")
    parts = sum(budget.parts.values())
    assert parts + budget.noise + budget.unexplained == pytest.approx(budget.total)
    left = budget.total - parts
    assert 0.01**2 < left < 2.0 * 0.01**2
    assert budget.noise == pytest.approx(left)
    assert set(budget.parts) == {"yaw_inertia (vehicle)", "sensor_bias (sensor r)"}
    assert min(budget.parts.values()) > 0.2 * budget.total  # whatever the order
    half = of_turning(found, of_body(found), structure=0.5)
    assert half.unexplained == pytest.approx(0.5 * left)
    biased = search_body(turning(2, bias=0.03))
    alone = of_turning(biased, of_body(biased))
    assert alone.parts["sensor_bias (sensor r)"] == pytest.approx(0.03**2, rel=0.05)
    assert alone.noise == pytest.approx(0.01**2, rel=0.05)


def test_a_bias_that_the_noise_s_colour_would_swallow_is_found():
    found = found_in(turning(3, bias=0.02, wander=0.012))
    assert set(found) == {"sensor_bias"}
    assert found["sensor_bias"] == pytest.approx(0.02, abs=0.004)


def test_a_bias_that_is_not_worth_its_price_is_found_where_data_held_out_bear_it_out():
    body = turning(6, bias=0.018, wander=0.018, judged=True)
    (cause,) = found_in(body)  # such noise does not tell a bias from a wheel that is off
    assert cause in ("sensor_bias", "offset")
    assert not found_in(replace(body, held_out={c: ~m & False for c, m in body.mask.items()}))


def test_a_slow_noise_alone_is_no_bias():
    assert not found_in(turning(4, wander=0.012))
    assert not found_in(turning(4, wander=0.018, judged=True))


def test_runs_with_the_same_commands_tell_the_colour_where_both_are_fitted():
    alone = turning(5)
    again = replace(alone, repeats=(Pair(0, 1, 40, 0, ROWS - 40),))
    left = np.stack([np.arange(ROWS) ** 2.0, np.arange(ROWS) * 1.0])
    rows, counted = again.noise("r", left)
    moved = (left[0, 40:] - left[1, :-40]) / np.sqrt(2.0)
    assert np.array_equal(rows[0, : ROWS - 40], moved)
    order = again.order["r"]
    assert counted[0, order : ROWS - 40].all() and not counted[0, ROWS - 40 :].any()
    for body in (alone, replace(again, mask={"r": alone.mask["r"] & [[True], [False]]})):
        assert np.array_equal(body.noise("r", left)[0], left)


def test_a_speed_that_lags_is_told_by_the_pose_though_the_angle_was_made_of_it():
    rng, lag, wheelbase = np.random.default_rng(6), 0.14, 2.7
    t = DT / FINE * np.arange(ROWS * FINE)
    speed = 3.0 + np.repeat(np.sign(np.sin(2.0 * np.pi * t[::FINE] / 3.7)), FINE)
    told = np.empty(len(t))
    v, lagging = 3.0, 3.0
    keep, kept = (np.exp(-DT / FINE / tau) for tau in (0.3, lag))
    for k, goal in enumerate(speed):
        v = goal + keep * (v - goal)
        lagging = v + kept * (lagging - v)
        speed[k], told[k] = v, lagging
    angle = 0.2 * np.sin(2.0 * np.pi * 0.17 * t)
    psi = np.cumsum(speed * np.tan(angle) / wheelbase) * DT / FINE
    x, y = (np.cumsum(speed * f(psi)) * DT / FINE for f in (np.cos, np.sin))
    pose = [p[None, ::FINE] + 0.002 * rng.standard_normal((1, ROWS)) for p in (x, y, psi)]
    made = np.arctan(np.tan(angle) * speed / told)[None, ::FINE]
    found = found_in(replace(posed(told[None, ::FINE], made, pose, wheelbase), by_yaw_rate=True))
    assert set(found) == {"sensor_lag"}
    assert found["sensor_lag"] == pytest.approx(lag, rel=0.1)


def swerving(jump: float = 0.0, late: float = 0.0) -> Body:
    """A run whose curvature follows the angle by 15 ms, told by yaw rate and pose; for two seconds
    the position is off by so many metres, and the heading is told `late` seconds after it was."""
    rng, wheelbase, keep = np.random.default_rng(8), 2.7, np.exp(-DT / FINE / 0.015)
    t = DT / FINE * np.arange(ROWS * FINE)
    speed = 4.0 + 2.0 * np.sin(2.0 * np.pi * 0.35 * t)
    angle = 0.2 * np.sin(2.0 * np.pi * (0.1 + 0.01 * t) * t)
    followed, at = np.empty(len(t)), angle[0]
    for k, goal in enumerate(angle.tolist()):
        followed[k] = at = goal + keep * (at - goal)
    rate = speed * np.tan(followed) / wheelbase

    def way(rates):
        return (np.cumsum(rates) - 0.5 * rates) * DT / FINE

    psi = way(rate)
    x, y = (way(speed * f(psi)) for f in (np.cos, np.sin))
    x = x + np.where((t > 20.0) & (t < 22.0), jump, 0.0)

    def told(values, noise):
        return values[None, ::FINE] + noise * rng.standard_normal((1, ROWS))

    psi = np.interp(t - late, t, psi)
    pose = [told(values, 0.002) for values in (x, y, psi)]
    return posed(speed[None, ::FINE], angle[None, ::FINE], pose, wheelbase, r=told(rate, 0.003))


def test_tyres_that_follow_the_angle_late_leave_the_speed_as_it_is():
    """A lag of the curvature alone had been told as a speed that comes late."""
    assert not found_in(swerving())


def test_a_heading_that_comes_later_than_the_position_beside_it_is_found():
    """As of a compass that is smoothed: before it had a name, half a second was not told at all."""
    found = search_body(swerving(late=0.2))
    causes = [CAUSES[f.number] for f in found.findings]
    assert [(c.cause, c.channel) for c in causes] == [("sensor_delay", "psi")]
    late = float(found.final.theta[INDEX[found.findings[0].number][0]])
    assert late == pytest.approx(0.2, abs=0.01)


@pytest.mark.parametrize("jump", [0.0, 0.3])
def test_jumps_of_a_pose_are_told_by_their_moments(jump):
    body = swerving(jump)
    plain = fit_body(body, [()])[0]
    found = BodySearch(body, plain, plain, ())
    left = jumps_of_pose((("run", 0.0),), found)
    assert [u.channel for u in left] == ["pose"] * (jump > 0.0)
    assert all(19.0 <= start and stop <= 23.0 for u in left for _, start, stop in u.when)


@pytest.mark.parametrize("made", [False, True])
def test_jumps_of_a_pose_are_asked_beside_a_speed_that_was_measured_alone(monkeypatch, made):
    """One that was made of the position has them itself."""
    body = swerving(0.3)
    channels = {c: body.measured["forward"][0] for c in ("v", "v_cmd")}
    log = Record.from_arrays(dt=DT, vehicle=VehicleGeometry(1.3, 1.3), **channels)
    runs = lay_out([replace(log, windows={"v": 0.2} if made else {})])
    for other in ("_of_yaw_rate", "_of_compass"):
        monkeypatch.setattr(of_body_left, other, lambda *_: [])
    monkeypatch.setattr(of_body_left.stand_ins, "of_body", lambda *_: [])
    plain = fit_body(body, [()])[0]
    found = of_body_left.BodyLeft.of(runs, BodySearch(body, plain, plain, ())).found
    assert [u.channel for u in found] == ["pose"] * (not made)


@pytest.mark.slow
def test_a_sensor_is_late_by_a_lag_or_by_a_delay():
    """A filter of two poles is between the two, and was both, each small beside the other."""
    body = turning(9, late=0.05)
    keep, r = np.exp(-DT / 0.06), body.measured["r"].copy()
    for k in range(1, ROWS):
        r[:, k] = keep * r[:, k - 1] + (1.0 - keep) * r[:, k]
    found = found_in(replace(body, measured={"r": r}))
    assert len({"sensor_lag", "sensor_delay"} & set(found)) == 1


@pytest.mark.parametrize(
    ("slope", "pull", "strange"), [(-0.15, -0.0055, False), (-0.15, -0.0195, True)]
)
def test_a_bank_pulls_no_more_than_its_slope_can(slope, pull, strange):
    """As a road of the hunt does, and as the wheels of a sedan that stand askew were told."""
    theta = np.zeros(max(map(max, INDEX)) + 1)
    theta[list(INDEX[BANK])] = slope, pull
    none = np.zeros((0, 0))
    fits = [BodyFit(on, theta, 0.0, {}, {}, {}, {}, {}, (), none) for on in ((), (BANK,))]
    without, leaning = (body_score(fit) for fit in fits)
    assert (without - leaning > body_price((BANK,)) + 1.0) == strange


@pytest.mark.parametrize(("size", "base"), [(1.0, 1.05), (0.95, 1.0), (1.0, 1.0)])
def test_a_position_without_a_heading_tells_wheels_from_wheelbase(size, base):
    """Yaw rate and way forward, with noise: another wheelbase, wheels of another size, none."""
    rng, t = np.random.default_rng(7), DT * np.arange(ROWS)
    v = 8.0 + 4.0 * np.sin(0.2 * t)
    delta = 0.08 * np.sin(2.0 * np.pi * (0.1 + 0.006 * t) * t)
    r = size * v * np.tan(delta) / (2.7 * base)
    way = np.convolve(size * v, np.ones(round(WINDOW / DT)) * DT)[round(WINDOW / DT) - 1 :][:ROWS]
    seen = {"r": r + 0.01 * rng.standard_normal(ROWS), "forward": way}
    seen["forward"] = way + 0.05 * rng.standard_normal(ROWS)
    inside = np.ones((1, ROWS), bool)
    inside[:, -round(WINDOW / DT) :] = False
    here, nowhere = ({c: m for c in seen} for m in (inside, ~np.ones((1, ROWS), bool)))
    zero, measured = np.zeros((1, ROWS)), {c: y[None] for c, y in seen.items()}
    body = Body(v[None], delta[None], zero, zero, measured, here, nowhere, Bicycle(2.7, 0.0), DT)
    told = {"geometry_scale": base - 1.0, "speed_scale": size - 1.0}
    found = found_in(body)
    assert found.keys() == {c for c, value in told.items() if value}
    assert all(value == pytest.approx(told[c], abs=0.003) for c, value in found.items())
