"""Kinds of error that the library has no name for, made by loops that share nothing with it."""

import numpy as np
import pytest

from vdmsi_jax.diagnose.residual.families import (
    MEMORY,
    of_body,
    of_plant,
    of_swing,
    plays,
)
from vdmsi_jax.diagnose.residual.regression import (
    PLAIN,
    Explained,
    better_than,
    explained,
    weighed,
)
from vdmsi_jax.diagnose.signals.windows import history

DT, N = 0.02, 3000
T = np.tile(DT * np.arange(N), (3, 1))
MASK = np.zeros((3, N), bool)
MASK[:2] = True


def steps(rng, lasts=(0.4, 3.0), size=1.0):
    rows = []
    for _ in range(3):
        row: list[float] = []
        while len(row) < N:
            row += [rng.uniform(-size, size)] * int(rng.uniform(*lasts) / DT)
        rows.append(row[:N])
    return np.array(rows)


def lagged(u, lag, gain=1.0):
    """First-order response; lag and gain may be arrays, or functions of state and rate."""
    y = np.zeros_like(u)
    for k in range(1, u.shape[1]):
        now = y[:, k - 1]
        tau = lag(now, u[:, k - 1] - now) if callable(lag) else lag
        g = gain[:, k - 1] if isinstance(gain, np.ndarray) else gain
        y[:, k] = now + DT / tau * (g * u[:, k - 1] - now)
    return y


def bouc_wen(x, share=0.1, width=0.5):
    z, out = np.zeros(len(x)), x.copy()
    for k in range(1, x.shape[1]):
        move = x[:, k] - x[:, k - 1]
        z += move * (1.0 - np.abs(z) / width * (0.3 + 0.7 * np.sign(move * z)))
        out[:, k] = x[:, k] - share * z
    return out


def noise(rng, std=0.01, memory=0.0):
    e = std * rng.standard_normal((3, N))
    for k in range(1, N):
        e[:, k] += memory * e[:, k - 1]
    return e


def hot(u):
    heat = np.zeros_like(u)
    for k in range(1, u.shape[1]):
        heat[:, k] = heat[:, k - 1] + DT / 12.0 * (u[:, k - 1] ** 2 - heat[:, k - 1])
    return 1.0 - 0.4 * heat


def judged(error, u, y, other=0.0):
    linear, families = of_plant(u, y, other + np.zeros_like(u), T, ("u", "y"), MASK, DT, 0.2)
    return explained(weighed(error, linear, families, MASK, ~MASK, DT))


EFFECTS = {
    "a hysteresis": lambda u: bouc_wen(lagged(u, 0.2)),
    "a gain that remembers past effort": lambda u: lagged(u, 0.2, gain=hot(u)),
    "a time constant that changes with the state": lambda u: lagged(
        u, lambda y, move: np.where(move > 0.0, 0.15, 0.28)
    ),
    "a gain that changes with the state": lambda u: np.sin(1.2 * lagged(u, 0.2)) / 1.2,
    "a gain that changes with the command": lambda u: lagged(u + 0.1 * np.sign(u), 0.2),
    "a change with time": lambda u: lagged(u, 0.2, gain=1.0 + 0.1 * T / T.max()),
}


@pytest.mark.parametrize("words", EFFECTS)
@pytest.mark.parametrize("memory", [0.0, 0.9])
def test_each_kind_is_told_by_its_words(words, memory):
    rng = np.random.default_rng(3)
    u = steps(rng)
    y = lagged(u, 0.2)
    found = judged(EFFECTS[words](u) - y + noise(rng, memory=memory), u, y)
    assert found is not None
    assert found.family.words == words
    assert found.share > 0.1


def test_the_other_command_is_told():
    rng = np.random.default_rng(5)
    u, other = steps(rng), steps(rng, size=3.0)
    y = lagged(u, 0.2)
    found = judged(0.02 * lagged(other, 0.3) * y + noise(rng), u, y, other)
    assert found is not None and "other command" in found.family.words


@pytest.mark.parametrize("memory", [0.0, 0.6, 0.95])
def test_noise_is_told_as_nothing(memory):
    for seed in range(8):
        rng = np.random.default_rng(seed)
        u = steps(rng)
        assert judged(noise(rng, memory=memory), u, lagged(u, 0.2)) is None


def test_an_error_of_nothing_at_all_is_told_as_nothing():
    u = steps(np.random.default_rng(1))
    assert judged(np.zeros_like(u), u, lagged(u, 0.2)) is None


def test_what_a_freer_linear_plant_could_do_is_no_news():
    rng = np.random.default_rng(2)
    u = steps(rng)
    y = lagged(u, 0.2)
    assert judged(lagged(u, 0.21, gain=1.01) - y + noise(rng), u, y) is None


def test_an_effect_of_the_fitted_runs_alone_is_told_by_no_name_of_a_kind():
    """That it is something is plain; what it is, other data would have to bear out."""
    rng = np.random.default_rng(4)
    u = steps(rng)
    y = lagged(u, 0.2)
    error = np.where(MASK, bouc_wen(y) - y, 0.0) + noise(rng)
    found = judged(error, u, y)
    assert found is not None and found.family.causes is None


def test_a_function_that_data_held_out_refute_is_none_however_plain_it_was():
    rng = np.random.default_rng(4)
    u = steps(rng)
    y = lagged(u, 0.2)
    bent = 0.1 * np.abs(y - 0.2)
    linear, families = of_plant(u, y, np.zeros_like(u), T, ("u", "y"), MASK, DT)
    of_states = [f for f in families if f.causes is None]

    def told(elsewhere: float) -> Explained:
        error = np.where(MASK, bent, elsewhere * bent) + noise(np.random.default_rng(5))
        return weighed(error, linear, of_states, MASK, ~MASK, DT)[0]

    assert told(1.0).sure()
    assert told(-1.0).statistic > PLAIN and not told(-1.0).sure()


def test_a_cause_gives_way_to_another_kind_that_explains_more_and_not_to_its_own():
    rng = np.random.default_rng(6)
    u = steps(rng)
    y = lagged(u, 0.2)
    error = bouc_wen(y) - y + noise(rng)
    kinds = of_plant(u, y, np.zeros_like(u), T, ("u", "y"), MASK, DT)
    found = weighed(error, *kinds, MASK, ~MASK, DT)
    whole = explained(found)
    assert whole is not None
    for cause, gain, gives_way in (
        ("saturation", 0.3 * whole.statistic, True),
        ("saturation", whole.statistic, False),
        ("backlash", 0.3 * whole.statistic, False),
    ):
        assert (better_than(cause, gain, found) is not None) == gives_way, cause


def test_a_cause_gives_way_to_a_memory_that_is_most_of_the_error_of_which_its_kind_is_little():
    rng = np.random.default_rng(6)
    u = steps(rng)
    y = lagged(u, 0.2)
    heat = history(u**2, 10.0, DT)
    error = -0.3 * heat / heat.max() * y + noise(rng)
    kinds = of_plant(u, y, np.zeros_like(u), T, ("u", "y"), MASK, DT)
    found = weighed(error, *kinds, MASK, ~MASK, DT)
    memory = next(f for f in found if f.family.words == MEMORY)
    assert memory.share > 0.6
    for cause, gain, better in (
        ("saturation", 2.0 * memory.statistic, memory),
        ("saturation", 4.0 * memory.statistic, None),
        ("transport_delay", 2.0 * memory.statistic, None),  # of no kind
    ):
        assert better_than(cause, gain, found) is better, cause


@pytest.mark.parametrize("of_gain", [True, False])
def test_a_swing_gives_way_to_a_gain_that_swings(of_gain):
    """A compressor that cycles makes a cylinder stronger and weaker, and adds nothing to it."""
    rng = np.random.default_rng(9)
    y = 1.0 + lagged(steps(rng), 0.2)
    wave = np.sin(2.0 * np.pi * 0.06 * (T + np.array([[0.0], [4.0], [9.0]])))
    error = 0.2 * (wave * y if of_gain else wave) + noise(rng)
    angle = 2.0 * np.pi * 0.06 * T[0]
    kinds = of_swing(y, np.stack([np.sin(angle), np.cos(angle)]), "y")
    linear = np.stack([np.ones_like(y), y])
    found = weighed(error, linear, kinds, MASK, np.zeros_like(MASK), DT)
    better = better_than("periodic_disturbance", 0.0, found)
    assert (better is not None) is of_gain


def test_what_the_form_of_a_known_cause_leaves_is_told_of_its_kind():
    rng = np.random.default_rng(8)
    u = steps(rng)
    y = lagged(u, 0.2)
    linear, families = of_plant(u, y, np.zeros_like(u), T, ("u", "y"), MASK, DT)
    found = weighed(np.sin(1.2 * y) / 1.2 - y + noise(rng), linear, families, MASK, ~MASK, DT)
    statistics = {f.family.words: f.statistic for f in found}
    lag, curve = (f"a {x} that changes with the state" for x in ("time constant", "gain"))
    assert statistics[lag] > 0.5 * statistics[curve]  # either could be it
    told = explained(found, ["gain_nonlinearity"])
    assert told is not None and told.family.words == curve


def test_tyres_whose_grip_runs_out():
    rng = np.random.default_rng(7)
    v, delta = 4.0 + steps(rng, (3.0, 6.0), 2.0), lagged(steps(rng, size=0.3), 0.15)
    turn = v * delta
    r = 6.0 * np.tanh(turn * v / 6.0) / v
    linear, families = of_body(v, delta, T, MASK, DT)
    found = explained(weighed(r - turn + noise(rng), linear, families, MASK, ~MASK, DT))
    assert found is not None and found.family.words == "tyres whose grip runs out"


def test_plays_rest_until_a_flank_carries_them():
    x = np.array([[0.0, 1.0, 0.5, -0.2, -2.0]])
    np.testing.assert_allclose(plays(x, [0.5])[0], [[0.0, 0.5, 0.5, 0.3, -1.5]])


def swaying(turn, hertz, damping):
    """Yaw rate of a body on tyres that need a way to build up their slip, beside its inertia."""
    omega, r, rate = 2.0 * np.pi * hertz, turn.copy(), np.zeros_like(turn)
    for k in range(1, turn.shape[1]):
        pull = omega**2 * (turn[:, k - 1] - r[:, k - 1]) - 2.0 * damping * omega * rate[:, k - 1]
        rate[:, k] = rate[:, k - 1] + DT * pull
        r[:, k] = r[:, k - 1] + DT * rate[:, k]
    return r


def test_a_body_that_sways_is_told_and_one_that_follows_is_not():
    """A body's small lag is every vehicle's, and in the model; a mode of its own is none."""
    rng = np.random.default_rng(11)
    v, delta = 4.0 + steps(rng, (3.0, 6.0), 1.0), lagged(steps(rng, size=0.3), 0.15)
    turn = v * delta
    linear, families = of_body(v, delta, T, MASK, DT)

    def told(r):
        return explained(weighed(r - turn + noise(rng), linear, families, MASK, ~MASK, DT))

    found = told(swaying(turn, 2.0, 0.2))
    assert found is not None and found.family.words == "a body that sways"
    assert told(turn) is None and told(turn + 0.05 * (lagged(turn, DT) - turn)) is None
