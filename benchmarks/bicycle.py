"""1000 bicycle scenarios of 40 s at 100 Hz against a numba loop and scipy `solve_ivp`.

Each peer does the same work: two actuators with two states each and the bicycle, commands held
between the rows, every scenario with its own commands and all 4001 rows of the pose as result.
The numba peer is a fixed-step RK4 on all eight states, one step per sample, compiled, in a loop
over the scenarios on one core. `solve_ivp` is restarted at every jump of a command, as it must be,
and its tolerance gives it about the accuracy of RK4.

    python benchmarks/bicycle.py [--json FILE] [--scenarios 1000]
"""

import argparse
import json
import time
from pathlib import Path

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from numba import njit
from scipy.integrate import solve_ivp

from vdmsi_jax.models.bicycle import Bicycle
from vdmsi_jax.models.transfer_function import TransferFunction
from vdmsi_jax.models.vehicle import Vehicle
from vdmsi_jax.simulate import Commands, Quadrature, Solver, simulate, simulate_many

DT, ROWS = 0.01, 4001
L_F, L_R = 1.75, 1.2
POWERTRAIN = ((2.21, 143.90), (1.0, 18.15, 143.20))  # the paper's table 2 without feed-through
STEERING = ((23.15, 60.0), (1.0, 25.44, 60.0))


@njit(cache=True, error_model="numpy")
def _derivative(s, out, u, d, pn, pd, sn, sd):
    v = pn[0] * s[3] + pn[1] * s[4]
    delta = sn[0] * s[5] + sn[1] * s[6]
    beta = np.arctan(L_R / (L_F + L_R) * np.tan(delta))
    out[0] = v * np.cos(s[2] + beta)
    out[1] = v * np.sin(s[2] + beta)
    out[2] = v / L_R * np.sin(beta)
    out[3] = -pd[1] * s[3] - pd[2] * s[4] + u
    out[4] = s[3]
    out[5] = -sd[1] * s[5] - sd[2] * s[6] + d
    out[6] = s[5]


@njit(cache=True, error_model="numpy")
def rk4(v_cmd, delta_cmd, dt, pn, pd, sn, sd, rows):
    """Controller-form states; the pose at every row into `rows` (N, 3)."""
    s = np.zeros(7)
    s[4], s[6] = v_cmd[0] / pd[2], delta_cmd[0] / sd[2]
    k1, k2, k3, k4, w = np.empty(7), np.empty(7), np.empty(7), np.empty(7), np.empty(7)
    for k in range(v_cmd.shape[0]):
        rows[k] = s[:3]
        u, d = v_cmd[k], delta_cmd[k]
        _derivative(s, k1, u, d, pn, pd, sn, sd)
        for i in range(7):
            w[i] = s[i] + 0.5 * dt * k1[i]
        _derivative(w, k2, u, d, pn, pd, sn, sd)
        for i in range(7):
            w[i] = s[i] + 0.5 * dt * k2[i]
        _derivative(w, k3, u, d, pn, pd, sn, sd)
        for i in range(7):
            w[i] = s[i] + dt * k3[i]
        _derivative(w, k4, u, d, pn, pd, sn, sd)
        for i in range(7):
            s[i] += dt / 6.0 * (k1[i] + 2.0 * k2[i] + 2.0 * k3[i] + k4[i])


def scenarios(count: int, seed: int = 0) -> tuple[np.ndarray, np.ndarray]:
    """Commands `(count, ROWS)` that step once a second."""
    rng = np.random.default_rng(seed)
    steps = -(-ROWS // 100)
    v = np.repeat(rng.uniform(1.0, 5.0, (count, steps)), 100, axis=1)[:, :ROWS]
    delta = np.repeat(rng.uniform(-0.3, 0.3, (count, steps)), 100, axis=1)[:, :ROWS]
    return v, delta


def by_solve_ivp(v_cmd: np.ndarray, delta_cmd: np.ndarray) -> np.ndarray:
    """One scenario, restarted at each jump."""
    plants = [np.array(c) for c in (*POWERTRAIN, *STEERING)]
    state = np.zeros(7)
    state[4], state[6] = v_cmd[0] / plants[1][2], delta_cmd[0] / plants[3][2]
    rows = np.empty((ROWS, 3))
    jumps = 1 + np.flatnonzero(np.diff(v_cmd) != 0)
    for i, j in zip([0, *jumps], [*jumps, ROWS - 1], strict=True):
        if i == j:
            continue

        def field(t, s, i=i):
            out = np.empty(7)
            _derivative(s, out, v_cmd[i], delta_cmd[i], *plants)
            return out

        at = np.arange(i, j + 1) * DT
        done = solve_ivp(field, (at[0], at[-1]), state, t_eval=at, rtol=1e-7, atol=1e-8)
        rows[i : j + 1], state = done.y[:3].T, done.y[:, -1]
    return rows


def best(run, repeats: int = 5) -> float:
    """Least wall time of some runs, after one that compiles."""
    run()
    times = []
    for _ in range(repeats):
        begin = time.perf_counter()
        run()
        times.append(time.perf_counter() - begin)
    return min(times)


def main() -> None:
    """Measure, print a table, and write JSON where asked."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--json", type=Path)
    parser.add_argument("--scenarios", type=int, default=1000)
    options = parser.parse_args()
    jax.config.update("jax_enable_x64", True)

    count = options.scenarios
    v, delta = scenarios(count)
    vehicle = Vehicle(Bicycle(L_F, L_R), TransferFunction(*POWERTRAIN), TransferFunction(*STEERING))
    commands, single = Commands(v, delta, DT), Commands(v[0], delta[0], DT)
    plants = [np.array(c) for c in (*POWERTRAIN, *STEERING)]
    rows = np.empty((count, ROWS, 3))

    def loop():
        for k in range(count):
            rk4(v[k], delta[k], DT, *plants, rows[k])

    def pose(trajectory):
        return jax.block_until_ready((trajectory.x, trajectory.y, trajectory.psi))

    @eqx.filter_jit
    def many(commands):
        done = simulate_many(vehicle, commands)
        return done.x, done.y, done.psi

    truth = np.stack(pose(simulate(vehicle, single)), -1)

    @eqx.filter_jit
    def error(vehicle):
        done = simulate(vehicle, single)
        return jnp.mean(jnp.hypot(done.x - truth[:, 0] - 1.0, done.y - truth[:, 1]))

    gradient = eqx.filter_jit(eqx.filter_grad(error))

    def numba_one():
        rk4(v[0], delta[0], DT, *plants, rows[0])

    seconds = {
        "numba RK4, one": best(numba_one, 20),
        "numba RK4, a scenario of many": best(loop, 3) / count,
        "quadrature, one": best(lambda: pose(simulate(vehicle, single)), 20),
        "quadrature, a scenario of many": best(lambda: jax.block_until_ready(many(commands)))
        / count,
        "solver (diffrax), one": best(lambda: pose(simulate(vehicle, single, method=Solver())), 3),
        "solve_ivp, one": best(lambda: by_solve_ivp(v[0], delta[0]), 1),
        "mean ATE, one": best(lambda: jax.block_until_ready(error(vehicle)), 20),
        "gradient of the mean ATE, one": best(lambda: jax.block_until_ready(gradient(vehicle)), 20),
    }
    numba_one()
    reference = by_solve_ivp(v[0], delta[0])
    exact = np.stack(pose(simulate(vehicle, single, method=Quadrature(nodes=6))), -1)
    ratios = {
        "many: quadrature / numba RK4": seconds["quadrature, a scenario of many"]
        / seconds["numba RK4, a scenario of many"],
        "solve_ivp / quadrature of many": seconds["solve_ivp, one"]
        / seconds["quadrature, a scenario of many"],
        "gradient / forward": seconds["gradient of the mean ATE, one"] / seconds["mean ATE, one"],
        "gradient / plain simulation": seconds["gradient of the mean ATE, one"]
        / seconds["quadrature, one"],
    }
    errors = {
        "quadrature": float(np.abs(truth - exact).max()),
        "numba RK4": float(np.abs(rows[0] - exact).max()),
        "solve_ivp": float(np.abs(reference - exact).max()),
    }
    for title, table, unit in (
        ("time", {k: 1e3 * s for k, s in seconds.items()}, "ms"),
        ("ratio", ratios, ""),
        ("largest error after 40 s", errors, "m"),
    ):
        print(f"\n{title}")
        for name, value in table.items():
            print(f"  {name:36s}{value:12.3g} {unit}")
    if options.json:
        result = {"seconds": seconds, "ratios": ratios, "errors": errors}
        options.json.write_text(json.dumps(result, indent=2))


if __name__ == "__main__":
    main()
