"""A controller that makes the command of noisy measurements, in plain NumPy at a millisecond."""

import numpy as np
import pytest
from scipy.signal import lfilter

import vdmsi_jax as vj
from vdmsi_jax.diagnose.actuator.feedback import answered, trembles
from vdmsi_jax.diagnose.signals.colour import autoregression, whiten

DT, ROWS, FINE, ORDER = 0.02, 2500, 20, 10


def controlled(
    seed: int,
    *,
    gain: float = 1.5,
    load: float = 0.5,
    play: float = 0.0,
    smooth: bool = False,
    inside: bool = False,
):
    """Commands and responses of three runs of a drive (lags of 0.08 and 0.44 s, 1.25 at rest), its
    load wandering over 0.8 s: a controller makes each row's command of the row's noisy speed, or,
    with no `gain`, the set-point is the command. The response plays, and set-points are `smooth`
    or steps. The controller may work `inside` the rows by a sensor of its own without noise."""
    rng, h = np.random.default_rng(seed), DT / FINE
    commands, responses = [], []
    for _ in range(3):
        wanted = np.repeat(rng.uniform(-3.0, 3.0, ROWS // 125), 125)
        if smooth:
            t, phase = DT * np.arange(ROWS), rng.uniform(0.0, 6.0, 3)
            wanted = sum(np.sin(w * t + p) for w, p in zip((0.3, 0.7, 1.5), phase, strict=True))
        noise, u, y = 0.02 * rng.standard_normal(ROWS), np.empty(ROWS), np.empty(ROWS)
        kicks = load * np.sqrt(2.0 * h / 0.8) * rng.standard_normal((ROWS, FINE))
        force = speed = told = total = pushed = 0.0
        every = h if inside else DT
        for k in range(ROWS):
            y[k] = told + noise[k]
            for i, kick in enumerate(kicks[k]):
                if i == 0 or inside:
                    error = wanted[k] - (told if inside else y[k])
                    total += 0.8 * every * error
                    push = gain * error + total if gain else wanted[k]
                if i == 0:
                    u[k] = push
                pushed += kick - h / 0.8 * pushed
                force += h / 0.08 * (push - force)
                speed += h / 0.35 * (force - 0.8 * speed + pushed)
                told = min(max(told, speed - 0.5 * play), speed + 0.5 * play)
        commands.append(u)
        responses.append(y)
    return np.stack(commands), np.stack(responses)


def records(commands, responses):
    """Logs of them."""
    plant = vj.PlantSpec("drive", "u", "y")
    return [
        vj.Record.from_arrays(dt=DT, name=f"run_{k}", plants=(plant,), u=u, y=y)
        for k, (u, y) in enumerate(zip(commands, responses, strict=True))
    ]


def news_of(x):
    """What the past of a response and of its command does not tell of it, by least squares."""
    u, y = x
    rows = [np.roll(z, k, axis=1) for z in (u, y) for k in range(1, ORDER + 1)]
    use = np.zeros(y.shape, bool)
    use[:, ORDER:] = True
    X = np.stack(rows)[:, use]
    left = y.copy()
    left[use] -= np.linalg.lstsq(X.T, y[use], rcond=None)[0] @ X
    return np.where(use, left, 0.0), use


@pytest.mark.parametrize("smooth", [False, True])
def test_a_command_made_of_the_noise_follows_the_response(smooth):
    closed = controlled(1, smooth=smooth)

    left, use = news_of(closed)

    assert answered(closed[0], left, use, ORDER)


@pytest.mark.parametrize("smooth", [False, True])
@pytest.mark.parametrize("play", [0.0, 0.5])
def test_a_planned_command_follows_nothing_whatever_is_left(smooth, play):
    planned = controlled(2, gain=0.0, play=play, smooth=smooth)

    left, use = news_of(planned)

    assert not answered(planned[0], left, use, ORDER)
    slower = lfilter([0.0, 1.25 * DT / 0.8], [1.0, DT / 0.8 - 1.0], planned[0])
    wrong = (planned[1] - slower)[None]
    wrong = whiten(wrong, autoregression(wrong, use, ORDER))[0]
    assert not answered(planned[0], wrong, use, ORDER)


@pytest.mark.parametrize("smooth", [False, True])
@pytest.mark.parametrize("gain", [0.0, 1.5])
def test_a_command_trembles_where_a_controller_answers_a_noisy_sensor(gain, smooth):
    u, _ = controlled(3, gain=gain, smooth=smooth)

    assert trembles(u, np.ones(u.shape, bool)) is (gain > 0.0)


def test_a_command_of_noise_is_planned():
    u = np.random.default_rng(4).standard_normal((3, ROWS))

    assert not trembles(u, np.ones(u.shape, bool))


@pytest.mark.slow
@pytest.mark.parametrize(
    "how", [{}, {"smooth": True}, {"inside": True}, {"load": 1.0}], ids=lambda how: "+".join(how)
)
def test_a_load_that_a_controller_answers_is_no_structure(how):
    found = vj.diagnose(records(*controlled(3, **how)))

    assert found.verdict == "no_effect"
    plant = found.model.plants["drive"].baseline
    assert plant.num.size < plant.den.size


@pytest.mark.slow
def test_play_in_such_a_loop_is_found():
    found = vj.diagnose(records(*controlled(4, load=0.1, play=0.4)))

    assert [f.cause for f in found.findings] == ["backlash"]
    assert found.findings[0].parameters["gap"].value == pytest.approx(0.4, rel=0.15)
