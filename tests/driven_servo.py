"""Logs of a servo, made by plain NumPy at a millisecond."""

import numpy as np

import vdmsi_jax as vj

DT, ROWS, FINE = 0.02, 1500, 20


def driven(
    seed: int,
    *,
    delay: float = 0.0,
    awake: bool = False,
    swing: float = 0.0,
    ramps: tuple[float, float] = (np.inf, np.inf),
    friction: float = 0.0,
    fails: float = np.inf,
    noise: float = 0.01,
):
    """Three logs of a damped servo of 2 Hz behind a lag, the command late by `delay` seconds and
    ramped upward and downward, the servo with dry friction, in units of the command; a sine of 1.3
    Hz that begins each run anywhere is added to the response. `fails` seconds after the first log
    began a seventh of the command is lost for good. It is at rest under the first command
    when a log begins, or, `awake`, at zero with that command on its way."""
    rng = np.random.default_rng(seed)
    made = []
    for run in range(3):
        u = np.repeat(rng.uniform(-1.0, 1.0, ROWS // 30), 30)
        late = np.concatenate([np.full(round(delay * 1000), u[0]), np.repeat(u, FINE)])
        x = lagged = ramped = 0.0 if awake else u[0]
        v, y = 0.0, []
        natural, h = 2.0 * np.pi * 2.0, 0.001
        for k, command in enumerate(late[: ROWS * FINE]):
            if run * ROWS * DT + k * h >= fails:
                command = command * 6.0 / 7.0
            if k % FINE == 0:
                y.append(x)
            ramped += np.clip(command - ramped, -h * ramps[1], h * ramps[0])
            lagged += h / 0.05 * (ramped - lagged)
            v += h * (natural**2 * (lagged - x) - 2.0 * 0.8 * natural * v)
            v -= np.clip(v, -h * natural**2 * friction, h * natural**2 * friction)
            x += h * v
        wave = swing * np.sin(2.0 * np.pi * 1.3 * DT * np.arange(ROWS) + rng.uniform(0.0, 6.28))
        y = np.asarray(y) + wave + noise * rng.standard_normal(ROWS)
        plant = vj.PlantSpec("servo", "u", "y")
        made.append(vj.Record.from_arrays(dt=DT, name=f"run_{run}", plants=(plant,), u=u, y=y))
    return made
