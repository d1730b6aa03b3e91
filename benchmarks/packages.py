"""Packages for linear systems against this one on one record, in one run.

They do not do the same work, and the table says which: SIPPY and SysIdentPy fit discrete-time
models with as many zeros as such a model of a sampled plant has, python-control simulates transfer
functions and identifies none. What a model is worth is told alike for all, by the FIT of its free
run on the record of `identification.py`. Times are medians of the repeats, by turns and with one
BLAS thread; CPU time stands beside wall time, since this package uses several threads.

    python benchmarks/packages.py [--quick] [--json FILE] [--jax-sysid PYTHON]

jax-sysid needs an environment of its own (`python -m venv DIR; DIR/bin/pip install jax-sysid`),
whose Python is given as PYTHON; the two processes take turns.
"""

import argparse
import json
import os
import statistics
import subprocess
import sys
import time
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Any

import control
import jax
import numpy as np
import scipy.signal
from identification import DT, PLANT, SAMPLES, signals, timed
from scipy_peers import fit_percent
from sippy_unipi import system_identification
from sysidentpy.basis_function import Polynomial
from sysidentpy.model_structure_selection import FROLS
from sysidentpy.parameter_estimation import LeastSquares

from vdmsi_jax import Record, TransferFunction, identify

POLES = (1, 2, 3, 4, 5)
Floats = np.ndarray


def ours(u: Floats, y: Floats) -> list[Floats]:
    """The best of all orders PnZ0 to PnZn for each number of poles."""
    record = Record.from_arrays(dt=DT, name="steps", v_cmd=u, v=y)
    fits = identify(record, "powertrain", delay=False, held_out=0.0).fits.values()
    of = [[fit for fit in fits if fit.ok and fit.n_poles == n] for n in POLES]
    return [max(same, key=lambda fit: fit.fit).predicted for same in of]


def sippy(method: str, orders: Callable[[int], list[int]]) -> Callable[[Floats, Floats], list]:
    """SIPPY: a free run by `lfilter` costs nothing beside its fits."""

    def run(u: Floats, y: Floats) -> list[Floats]:
        predicted = []
        for n in POLES:
            asked = {f"{method}_orders": orders(n)}
            model: Any = system_identification(y, u, method, tsample=DT, **asked)
            num, den = model.G.num[0][0], model.G.den[0][0]
            num = np.concatenate([np.zeros(len(den) - len(num)), num])
            predicted.append(scipy.signal.lfilter(num, den, u))
        return predicted

    return run


def sysidentpy(u: Floats, y: Floats) -> list[Floats]:
    """SysIdentPy: ARX of a linear basis, all terms, and its free run."""
    predicted = []
    for n in POLES:
        model = FROLS(
            order_selection=False,
            n_terms=2 * n + 1,
            ylag=n,
            xlag=n,
            basis_function=Polynomial(degree=1),
            estimator=LeastSquares(),
        )
        model.fit(X=u[:, None], y=y[:, None])
        predicted.append(np.ravel(model.predict(X=u[:, None], y=y[:n, None])))
    return predicted


IDENTIFY = {
    "vdmsi_jax": ("20 orders, continuous, simulation error, zeros free", ours),
    "SIPPY OE": ("5 orders, discrete, simulation error", sippy("OE", lambda n: [n, n, 0])),
    "SIPPY ARMAX": ("5 orders, discrete, one step ahead", sippy("ARMAX", lambda n: [n, n, n, 0])),
    "SIPPY ARX": ("5 orders, discrete, one step ahead", sippy("ARX", lambda n: [n, n, 0])),
    "SysIdentPy": ("5 orders, discrete, one step ahead, and run free", sysidentpy),
}


class JaxSysid:
    """A process of another Python, which fits when it is called."""

    def __init__(self, python: str, u: Floats, y: Floats):
        script = Path(__file__).with_name("jax_sysid_peer.py")
        pipe = subprocess.PIPE
        self.cpu_time = 0.0  # s, of its fits up to now
        self.process = subprocess.Popen([python, script], stdin=pipe, stdout=pipe, text=True)
        self._tell(json.dumps({"u": u.tolist(), "y": y.tolist()}))

    def _tell(self, line: str) -> None:
        print(line, file=self.process.stdin, flush=True)

    def clock(self) -> float:
        """CPU time of this process and of the fits of the other, s."""
        return time.process_time() + self.cpu_time

    def __call__(self) -> list[Floats]:
        self._tell("fit")
        assert self.process.stdout is not None
        line = self.process.stdout.readline()
        if not line:
            raise SystemExit(f"{self.process.args[0]} does not run jax_sysid_peer.py (see above)")
        answer = json.loads(line)
        self.cpu_time += answer["cpu"]
        return [np.asarray(free) for free in answer["predicted"]]


def by_turns(runs: dict[str, Callable[[], Any]], repeats: int) -> tuple[dict, dict, dict]:
    """What each makes, and medians of its wall and CPU time; the first turn, which compiles, is not
    counted."""

    def turn(run: Callable[[], Any]) -> tuple[Any, float, float]:
        return timed(run, 1, run.clock if isinstance(run, JaxSysid) else time.process_time)

    turns = [{name: turn(run) for name, run in runs.items()} for _ in range(repeats + 1)]
    made = {name: turns[-1][name][0] for name in runs}
    wall, cpu = (
        {name: statistics.median(turn[name][k] for turn in turns[1:]) for name in runs}
        for k in (1, 2)
    )
    return made, wall, cpu


def identification(repeats: int, jax_sysid: str | None) -> dict[str, Any]:
    """What each package makes of one record."""
    u, y = signals(SAMPLES)
    runs: dict[str, Callable[[], Any]] = {
        name: lambda run=run: run(u, y) for name, (_, run) in IDENTIFY.items()
    }
    works = {name: work for name, (work, _) in IDENTIFY.items()}
    if jax_sysid:
        runs["jax-sysid"] = JaxSysid(jax_sysid, u, y)
        works["jax-sysid"] = "5 orders, discrete, simulation error"
    predicted, wall, cpu = by_turns(runs, repeats)
    print(f"\n{SAMPLES} samples; times; ratios; FIT of the free run with 1 to 5 poles")
    rows = {}
    for name, work in works.items():
        row = rows[name] = {
            "wall": wall[name],
            "cpu": cpu[name],
            "ratio": wall[name] / wall["vdmsi_jax"],
            "cpu ratio": cpu[name] / cpu["vdmsi_jax"],
            "fit": [fit_percent(y, p) for p in predicted[name]],
        }
        print(f"  {name:12s}{row['wall']:8.3f} s{row['cpu']:8.3f} s CPU", end="")
        print(f"{row['ratio']:7.2f}{row['cpu ratio']:7.2f}  ", end="")
        print("".join(f"{fit:8.3f}" for fit in row["fit"]), f" {work}")
    return rows


def simulation(repeats: int) -> dict[str, Any]:
    """One response of the paper's powertrain from rest, from coefficients to samples."""
    u, t = signals(SAMPLES)[0], np.arange(SAMPLES) * DT

    def by_control() -> Floats:
        sampled = control.c2d(control.tf(*PLANT), DT, "zoh")
        return control.forced_response(sampled, t, u).outputs

    model = TransferFunction(*PLANT)
    response = jax.jit(lambda model, u: model.simulate(u, DT, np.zeros(2)).y)
    runs = {"vdmsi_jax": lambda: np.asarray(response(model, u)), "python-control": by_control}
    made, wall, cpu = by_turns(runs, repeats)
    ratio = wall["python-control"] / wall["vdmsi_jax"]
    apart = float(np.abs(made["python-control"] - made["vdmsi_jax"]).max())
    print(f"\nOne response of {SAMPLES} samples, ms: ", end="")
    print(", ".join(f"{name} {1e3 * seconds:.3f}" for name, seconds in wall.items()), end="")
    print(f"; ratio {ratio:.1f}; they differ by {apart:.1e}")
    return {"wall": wall, "cpu": cpu, "ratio": ratio, "apart": apart}


def main() -> None:
    """Measure, print tables, and write JSON where asked."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--json", type=Path)
    parser.add_argument("--quick", action="store_true", help="one repeat")
    parser.add_argument("--jax-sysid", metavar="PYTHON", help="a Python that has jax-sysid")
    options = parser.parse_args()
    if "OPENBLAS_NUM_THREADS" not in os.environ:  # NumPy reads it when it is imported
        os.environ["OPENBLAS_NUM_THREADS"] = "1"
        os.execv(sys.executable, [sys.executable, *sys.argv])
    jax.config.update("jax_enable_x64", True)
    warnings.simplefilter("ignore")
    repeats = 1 if options.quick else 5
    result = {
        "identification": identification(repeats, options.jax_sysid),
        "simulation": simulation(20 * repeats),
    }
    if options.json:
        options.json.write_text(json.dumps(result, indent=2))


if __name__ == "__main__":
    main()
