"""The grid of 20 proper orders on 3000 samples against scipy, and what the whole command costs.

Peers fit the same record to the same FIT; how near every cell of theirs comes to ours is printed
beside the time. `scipy_peers.py` has them: `least_squares` on `lsim`, as a user would write it, and
a careful one on `lfilter`. python-control, SIPPY and SysIdentPy fit no transfer functions in
continuous time; `packages.py` times what they do instead.

All run with one BLAS thread: with more, the small products of the peers wait for each other, and
the careful one took up to twenty times as long. Wall time decides, medians of the repeats; CPU time
stands beside it, since it tells more on a machine that does other work. Processes are started
afresh for the command and for the memory.

    python benchmarks/identification.py [--quick] [--json FILE] [--only grid|command|length ...]
"""

import argparse
import json
import os
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import jax
import numpy as np
import scipy.signal
from scipy_peers import by_lfilter, by_lsim

from vdmsi_jax import Record, identify

DT, SAMPLES = 0.01, 3000
PLANT = ((0.0631, 2.21, 143.90), (1.0, 18.15, 143.20))  # the paper's powertrain (table 2)
NOISE = 0.054  # m/s, what its FIT and MSE imply
ORDERS = [(n, m) for n in range(1, 6) for m in range(n + 1)]
FEW = [(1, 0), (2, 1), (2, 2), (3, 1)]  # of the slow peer in the quick mode
SAME = (0.01, 0.05)  # points of FIT
DEMO = Path(__file__).parents[1] / "configs" / "demo" / "powertrain_steps.csv"
LENGTHS = (3_000, 30_000, 300_000)


def signals(samples: int, seed: int = 0) -> tuple[np.ndarray, np.ndarray]:
    """Commands that step once a second, and the measured response of the paper's powertrain."""
    rng = np.random.default_rng(seed)
    u = np.repeat(rng.uniform(-1.0, 1.0, -(-samples // 100)), 100)[:samples]
    y = scipy.signal.lsim(PLANT, u, np.arange(samples) * DT, interp=False)[1]
    return u, y + NOISE * rng.standard_normal(samples)


def timed(
    run: Callable[[], Any], repeats: int, clock: Callable[[], float] = time.process_time
) -> tuple[Any, float, float]:
    """Result, and medians of wall time and of CPU time, which `clock` tells."""
    wall, cpu, result = [], [], None
    for _ in range(repeats):
        begin, used = time.perf_counter(), clock()
        result = run()
        wall.append(time.perf_counter() - begin)
        cpu.append(clock() - used)
    return result, statistics.median(wall), statistics.median(cpu)


def grid(quick: bool) -> dict[str, Any]:
    """Our grid and that of the peers on the same record."""
    u, y = signals(SAMPLES)
    record = Record.from_arrays(dt=DT, name="steps", v_cmd=u, v=y)

    def ours() -> dict[str, float]:
        fits = identify(record, "powertrain", delay=False, held_out=0.0).fits
        return {name: fit.fit for name, fit in fits.items() if fit.model is not None}

    _, compiling, _ = timed(ours, 1)
    slow_orders = FEW if quick else ORDERS
    found, peers = {}, {}
    # the short ones by turns, so that a busy moment hits all
    short: dict[str, Callable[[], Any]] = {
        "vdmsi_jax": ours,
        "scipy lfilter, with care": lambda: dict(by_lfilter(u, y, DT, ORDERS)),
        "scipy lfilter, every start": lambda: dict(by_lfilter(u, y, DT, ORDERS, 99)),
    }
    turns = [[timed(run, 1) for run in short.values()] for _ in range(3 if quick else 7)]
    for i, name in enumerate(short):
        found[name] = turns[-1][i][0]
        peers[name] = {
            "wall": statistics.median(turn[i][1] for turn in turns),
            "cpu": statistics.median(turn[i][2] for turn in turns),
        }
    slow = "scipy least_squares + lsim"
    found[slow], wall, cpu = timed(lambda: dict(by_lsim(u, y, DT, slow_orders)), 1)
    peers[slow] = {"wall": wall, "cpu": cpu}
    reference = found["vdmsi_jax"]
    for name, table in peers.items():
        gaps = [found[name][order] - reference[order] for order in found[name]]
        table["orders"] = len(gaps)
        for same in SAME:
            table[f"within {same}"] = sum(abs(gap) < same for gap in gaps) / len(gaps)
        table["below"], table["above"] = min(gaps), max(gaps)
        table["ratio"] = table["wall"] / peers["vdmsi_jax"]["wall"]
        table["cpu ratio"] = table["cpu"] / peers["vdmsi_jax"]["cpu"]

    print(
        f"\n{len(ORDERS)} orders, {SAMPLES} samples, warm (the first call took {compiling:.1f} s)"
    )
    print(
        f"  {'':28s}{'orders':>7s}{'wall s':>9s}{'CPU s':>8s}{'ratio':>8s}{'CPU ratio':>11s}",
        end="",
    )
    print("".join(f"{f'within {same}':>13s}" for same in SAME), end="")
    print(f"{'worst':>8s}{'best':>8s}  FIT against ours")
    for name, t in peers.items():
        print(
            f"  {name:28s}{t['orders']:7d}{t['wall']:9.2f}{t['cpu']:8.2f}{t['ratio']:8.1f}", end=""
        )
        print(f"{t['cpu ratio']:11.1f}", end="")
        print("".join(f"{t[f'within {same}']:13.0%}" for same in SAME), end="")
        print(f"{t['below']:8.3f}{t['above']:8.3f}")
    if quick:
        print(f"  lsim: {len(FEW)} of {len(ORDERS)} small orders only, its ratio is too low")
    print("\n  FIT   " + "".join(f"{name:>28s}" for name in found))
    for order in reference:
        cells = (found[name].get(order) for name in found)
        print(f"  {order:6s}" + "".join(f"{'' if c is None else f'{c:.3f}':>28s}" for c in cells))
    return {"seconds": peers, "first call": compiling, "fit": found}


def process(arguments: list[str], environment: dict[str, str] | None = None) -> dict[str, Any]:
    """Run Python afresh: wall and CPU seconds, peak memory in MB, both outputs."""
    with tempfile.TemporaryFile() as out, tempfile.TemporaryFile() as err:
        begin = time.perf_counter()
        child = subprocess.Popen(
            [sys.executable, *arguments],
            stdout=out,
            stderr=err,
            cwd=Path(__file__).parents[1],
            env={**os.environ, **(environment or {})},
        )
        _, status, usage = os.wait4(child.pid, 0)
        wall = time.perf_counter() - begin
        child.returncode = os.waitstatus_to_exitcode(status)
        out.seek(0)
        err.seek(0)
        said, errors = out.read().decode(), err.read().decode()
    if child.returncode:
        raise RuntimeError(f"{arguments} ended with {child.returncode}:\n{errors[-2000:]}")
    cpu, peak = usage.ru_utime + usage.ru_stime, usage.ru_maxrss / 1024
    return {"wall": wall, "cpu": cpu, "MB": peak, "out": said, "err": errors}


def import_share() -> dict[str, float]:
    """Seconds of import by package, of all that `vdmsi identify` imports."""
    modules = "vdmsi_jax.cli, vdmsi_jax.terminal, vdmsi_jax.identify.vehicle, vdmsi_jax.data.read"
    lines = process(["-X", "importtime", "-c", f"import {modules}"])["err"].splitlines()
    total: dict[str, float] = {}
    for line in lines:
        cells = line.removeprefix("import time:").split("|")
        if len(cells) == 3 and cells[0].strip().isdigit():
            package = cells[2].strip().split(".")[0]
            total[package] = total.get(package, 0.0) + 1e-6 * int(cells[0])
    largest = dict(sorted(total.items(), key=lambda item: -item[1])[:8])
    return {"all": sum(total.values()), **largest}


def command(quick: bool) -> dict[str, Any]:
    """`vdmsi identify` on one log of 30 s, without report: compiled anew, and from the cache."""
    repeats = 1 if quick else 3
    runs: dict[str, list[dict[str, Any]]] = {"cold": [], "cached": []}
    for _ in range(repeats):
        with tempfile.TemporaryDirectory() as folder:
            call = ["-c", "from vdmsi_jax.cli import main; main()", "identify", str(DEMO)]
            call += ["--out", f"{folder}/out", "--no-report"]
            cache = {"JAX_COMPILATION_CACHE_DIR": f"{folder}/cache"}
            runs["cold"].append(process(call, cache))
            runs["cached"].append(process(call, cache))
    table = {
        name: {key: statistics.median(run[key] for run in many) for key in ("wall", "cpu", "MB")}
        for name, many in runs.items()
    }
    imports = import_share()
    print(f"\nvdmsi identify {DEMO.name} --no-report, the whole process, median of {repeats}")
    print(f"  {'':10s}{'wall s':>8s}{'CPU s':>8s}{'peak MB':>9s}")
    for name, t in table.items():
        print(f"  {name:10s}{t['wall']:8.2f}{t['cpu']:8.2f}{t['MB']:9.0f}")
    said = ", ".join(f"{name} {seconds:.2f}" for name, seconds in imports.items())
    print(f"  of which imports, s by package itself (traced, so slowed): {said}")
    return {"process": table, "imports": imports}


_ONE_LENGTH = """
import json, sys
sys.path.insert(0, {folder!r})
from identification import one_length
print(json.dumps(one_length({samples}, {small})))
"""


def one_length(samples: int, small: bool) -> dict[str, float]:
    """One grid on a record of this length, in this process, warm."""
    jax.config.update("jax_enable_x64", True)
    u, y = signals(samples)
    record = Record.from_arrays(dt=DT, name="steps", v_cmd=u, v=y)
    grid = {"poles": (1, 2), "zeros": (0, 1, 2)} if small else {}

    def run() -> None:
        identify(record, "powertrain", delay=False, held_out=0.0, **grid)

    _, first, _ = timed(run, 1)
    _, wall, cpu = timed(run, 3 if samples <= SAMPLES else 1)
    return {"first": first, "wall": wall, "cpu": cpu}


def length(quick: bool) -> list[dict[str, Any]]:
    """Time per sample and memory over the length of the record, each in a process of its own."""
    rows = []
    for small in (True, False):
        for samples in LENGTHS[: 2 if quick or not small else None]:
            if quick and not small:
                continue
            script = _ONE_LENGTH.format(
                folder=str(Path(__file__).parent), samples=samples, small=small
            )
            run = process(["-c", script])
            row = json.loads(run["out"].splitlines()[-1])
            orders = 5 if small else len(ORDERS)
            rows.append({"samples": samples, "orders": orders, "MB": run["MB"], **row})
    print("\nlength of the record (5 orders: up to P2Z2)")
    print(f"  {'orders':>8s}{'samples':>9s}{'wall s':>9s}{'CPU s':>9s}{'us a sample':>13s}", end="")
    print(f"{'first call s':>14s}{'peak MB':>9s}")
    for row in rows:
        print(f"  {row['orders']:8d}{row['samples']:9d}{row['wall']:9.2f}{row['cpu']:9.2f}", end="")
        print(f"{1e6 * row['wall'] / row['samples']:13.1f}{row['first']:14.1f}{row['MB']:9.0f}")
    return rows


PARTS = {"grid": grid, "command": command, "length": length}


def main() -> None:
    """Measure, print tables, and write JSON where asked."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--json", type=Path)
    parser.add_argument("--quick", action="store_true", help="fewer repeats, fewer slow cells")
    parser.add_argument("--only", nargs="+", choices=PARTS, default=list(PARTS))
    options = parser.parse_args()
    if "OPENBLAS_NUM_THREADS" not in os.environ:  # NumPy reads it when it is imported
        os.environ["OPENBLAS_NUM_THREADS"] = "1"
        os.execv(sys.executable, [sys.executable, *sys.argv])
    jax.config.update("jax_enable_x64", True)
    result = {part: PARTS[part](options.quick) for part in options.only}
    if options.json:
        options.json.write_text(json.dumps(result, indent=2))


if __name__ == "__main__":
    main()
