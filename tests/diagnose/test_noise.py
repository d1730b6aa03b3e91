"""What noise is known by: runs with the same commands, references, and what they change."""

import numpy as np
import pytest

import vdmsi_jax as vj
from vdmsi_jax.diagnose.prepare import repeats
from vdmsi_jax.diagnose.signals.colour import spectrum, whiten
from vdmsi_jax.diagnose.signals.noise import (
    BriefNoise,
    KnownNoise,
    OwnNoise,
    Pair,
    pairs,
    repeated,
    slow_noise,
)
from vdmsi_jax.diagnose.signals.runs import lay_out

DT, ROWS = 0.02, 2000
LOGS = ("a", "b", "c", "d")
PLANT = vj.PlantSpec("servo", "u", "y")


def steps(seed: int, rows: int = ROWS) -> np.ndarray:
    return np.repeat(np.random.default_rng(seed).uniform(-1.0, 1.0, rows // 40 + 1), 40)[:rows]


def wandering(seed: int, rows: int = ROWS, seconds: float = 1.5) -> np.ndarray:
    """Noise of unit size that keeps its value for some time."""
    rng, keep = np.random.default_rng(seed), np.exp(-DT / seconds)
    e = np.zeros(rows)
    e[0] = rng.standard_normal()
    for k in range(1, rows):
        e[k] = keep * e[k - 1] + np.sqrt(1.0 - keep**2) * rng.standard_normal()
    return e


def lagged(u: np.ndarray, start: float, seconds: float = 0.3) -> np.ndarray:
    y, keep = np.empty(len(u)), np.exp(-DT / seconds)
    now = start
    for k, command in enumerate(u):
        y[k] = now
        now = keep * now + (1.0 - keep) * command
    return y


def everywhere(runs: int, rows: int = ROWS) -> np.ndarray:
    return np.ones((runs, rows), bool)


def test_runs_with_the_same_commands_are_found_whenever_they_were_begun():
    u = steps(1, ROWS + 300)
    commands = np.stack([u[:ROWS], steps(2), u[170 : 170 + ROWS], u[:ROWS] + 0.001])[None]
    found = pairs(commands, everywhere(4), LOGS, DT)
    assert found == (Pair(0, 2, 170, 0, ROWS - 170), Pair(0, 3, 0, 0, ROWS))
    same = Pair(0, 2, 170, 0, ROWS - 170).cut(commands[0])
    assert np.array_equal(*same)


def test_other_commands_or_none_or_a_short_stretch_of_them_are_no_repeat():
    u, other = steps(1), steps(2)
    assert pairs(np.stack([u, other])[None], everywhere(2), LOGS, DT) == ()
    assert pairs(np.stack([[u, u], [u, other]]), everywhere(2), LOGS, DT) == ()
    assert pairs(np.full((1, 2, ROWS), 3.0), everywhere(2), LOGS, DT) == ()
    assert pairs(np.stack([u, u])[None], everywhere(2), ("a", "a"), DT) == ()  # parts of one log
    short = everywhere(2)
    short[1, 300:] = False  # 6 s
    assert pairs(np.stack([u, u])[None], short, LOGS, DT) == ()


def test_the_noise_is_that_of_the_runs_without_what_their_starts_leave():
    u = steps(3)
    noise = np.stack([0.05 * wandering(4), 0.05 * wandering(5)])
    y = np.stack([lagged(u, 2.0), lagged(u, -1.0)]) + noise
    known = everywhere(2)
    known[0, 700:760] = False
    found = repeated(pairs(np.stack([u, u])[None], known, LOGS, DT), y, known, 0.3, DT)
    assert found is not None and found.by == "repeat"
    assert not found.counted[0, 700:760].any()
    truth = ((noise[0] - noise[1]) / np.sqrt(2.0))[found.counted[0]]
    assert found.std == pytest.approx(float(np.std(truth)), rel=0.05)
    assert found.coefficients(1)[0] == pytest.approx(np.exp(-DT / 1.5), abs=0.01)
    assert 0.8 * found.std < found.slow < found.std


def test_what_is_slow_and_does_not_come_again_is_that_of_the_noise():
    u = steps(3)
    pair = pairs(np.stack([u, u])[None], everywhere(2), LOGS, DT)
    structure = 0.3 * np.sin(0.5 * DT * np.arange(u.size))  # comes again
    gusts = np.stack([0.05 * wandering(4), 0.05 * wandering(5)])
    slow = slow_noise(pair, structure + gusts, everywhere(2), DT)
    assert slow == pytest.approx(0.05, rel=0.4)
    assert slow_noise(pair, np.stack([structure] * 2), everywhere(2), DT) == 0.0
    assert slow_noise((), structure + gusts, everywhere(2), DT) == 0.0
    assert slow_noise(pair, structure + gusts, ~everywhere(2), DT) == 0.0


def test_one_log_given_twice_tells_no_noise():
    u = steps(3)
    y = np.stack([lagged(u, 0.0)] * 2) + 0.01 * wandering(4)
    pair = pairs(np.stack([u, u])[None], everywhere(2), LOGS, DT)
    assert pair and repeated(pair, y, everywhere(2), 0.3, DT) is None


def test_a_known_colour_serves_all_hypotheses_and_its_innovations_are_sums_of_squares():
    noise = KnownNoise.reference(wandering(6), DT)
    left = np.stack([wandering(7), 3.0 * wandering(8)])[:, None]
    mask = everywhere(1)
    colours = noise.colours(left, mask, 5)
    assert np.array_equal(colours[0], colours[1])
    padded = np.pad(left, ((0, 0), (0, 0), (0, 5)))  # the filter's tail counts
    wanted = np.sum(whiten(padded, colours) ** 2, axis=(1, 2))
    assert noise.innovations(spectrum(left), 5) == pytest.approx(wanted, rel=1e-9)
    own = OwnNoise()
    assert np.all(own.innovations(spectrum(left), 5) <= noise.innovations(spectrum(left), 5))
    assert not np.array_equal(*own.colours(left, mask, 5))


def test_brief_noise_forgets_and_its_innovations_are_sums_of_squares():
    brief, own, mask = BriefNoise(0.2, DT), OwnNoise(), everywhere(1)
    left = np.stack([wandering(7), 3.0 * wandering(8)])[:, None]
    colours = brief.colours(left, mask, 5)
    for coefficients in colours:
        roots = np.roots(np.concatenate([[1.0], -coefficients]))
        assert np.all(np.abs(roots) < np.exp(-DT / 0.2))
    assert np.abs(np.roots([1.0, *-own.colours(left, mask, 5)[0]])).max() > np.exp(-DT / 0.6)
    padded = np.pad(left, ((0, 0), (0, 0), (0, 5)))
    wanted = np.sum(whiten(padded, colours) ** 2, axis=(1, 2))
    assert brief.innovations(spectrum(left), 5) == pytest.approx(wanted, rel=1e-6)
    assert np.all(wanted > 1.2 * own.innovations(spectrum(left), 5))


def test_a_reference_is_checked_and_goes_with_the_sample_period():
    noise = KnownNoise.reference(wandering(6), DT)
    slower = noise.at(2.0 * DT).coefficients(1)[0]
    assert slower == pytest.approx(np.exp(-2.0 * DT / 1.5), abs=0.02)
    with pytest.raises(vj.InputError, match="sample it as the logs"):
        noise.at(0.5 * DT)
    with pytest.raises(vj.InputError, match="constant, or not finite"):
        KnownNoise.reference(np.zeros(ROWS), DT)
    with pytest.raises(vj.InputError, match="too few"):
        KnownNoise.reference(wandering(6)[:50], DT)


def logs(*commands: np.ndarray, dead: float = 0.0, wander: float = 0.15) -> list[vj.Record]:
    """Logs of a lag behind a dead zone, beside noise that wanders."""
    made = []
    for run, u in enumerate(commands):
        pushed = np.sign(u) * np.maximum(np.abs(u) - dead, 0.0)
        white = 0.01 * np.random.default_rng(20 + run).standard_normal(len(u))
        y = lagged(pushed, 0.2 * run) + wander * wandering(10 + run) + white
        made.append(vj.Record.from_arrays(dt=DT, name=f"run_{run}", plants=(PLANT,), u=u, y=y))
    return made


@pytest.mark.slow
def test_what_runs_with_the_same_commands_do_not_share_is_noise():
    alone = vj.diagnose(logs(steps(1), steps(2), steps(3)))
    assert alone.verdict == "unexplained_structure"
    assert "slow error" in alone.unexplained[0].test
    assert alone.channels["y"].noise_by == "own"
    again = vj.diagnose(logs(steps(1), steps(1), steps(3)))
    assert again.verdict == "no_effect" and not again.unexplained
    assert again.channels["y"].noise_by == "repeat"
    assert again.channels["y"].noise_std == pytest.approx(0.15, rel=0.2)


def test_a_reference_does_the_same_and_must_be_of_a_response():
    records = logs(steps(1), steps(2), steps(3))
    noise = KnownNoise.reference(0.15 * wandering(30) + 0.01 * wandering(31, seconds=1e-3), DT)
    found = vj.diagnose(records, noise={"y": noise})
    assert found.verdict == "no_effect" and found.channels["y"].noise_by == "reference"
    with pytest.raises(vj.InputError, match="the response of no plant"):
        vj.diagnose(records, noise={"v": noise})


def test_a_cause_is_found_beside_noise_that_a_repeat_tells():
    found = vj.diagnose(logs(steps(1), steps(1), steps(3), dead=0.1, wander=0.05))
    assert [f.cause for f in found.findings] == ["dead_zone"]
    assert found.findings[0].parameters["half_width"].value == pytest.approx(0.1, rel=0.15)


def test_a_vehicle_whose_steering_is_not_known_to_be_alike_is_no_repeat():
    geometry, noise = vj.VehicleGeometry(l_f=1.2, l_r=1.5), np.random.default_rng(3)

    def drives(**channels):
        made = []
        for run in range(2):
            own = {c: x + 0.01 * noise.standard_normal(ROWS) for c, x in channels.items()}
            v_cmd = 5.0 + steps(1)
            v = lagged(v_cmd, 5.0) + 0.01 * noise.standard_normal(ROWS)
            own |= {"v_cmd": v_cmd, "v": v}
            if "delta" in channels:
                own["r"] = own["v"] * own["delta"] / 2.7
            made.append(vj.Record.from_arrays(dt=DT, name=f"{run}", vehicle=geometry, **own))
        return lay_out(made)

    assert len(repeats(drives())) == 1  # no steering at all
    assert repeats(drives(delta=0.1 * steps(2))) == ()
