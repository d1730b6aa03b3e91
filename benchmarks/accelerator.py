"""Many scenarios on an accelerator against the processor of the same machine.

Each scenario is a vehicle of its own (two actuators and the bicycle, parameters drawn about the
paper's) that drives 40 s at 100 Hz; a gradient is that of its distance from where the undisturbed
vehicle ends, over all its parameters, as in a study of sensitivity. Lanes at once (`batch_size`)
are those that are fastest on either: fifty on a processor, all of them on an accelerator. Without
an accelerator only the processor is timed.

    python benchmarks/accelerator.py [--json FILE] [--scenarios 1000 10000]
"""

import argparse
import json
import os
import time
from pathlib import Path

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from vdmsi_jax.models.bicycle import Bicycle
from vdmsi_jax.models.transfer_function import TransferFunction
from vdmsi_jax.models.vehicle import Vehicle
from vdmsi_jax.simulate import Commands, simulate, simulate_many

DT, ROWS = 0.01, 4001
POWERTRAIN = ((2.21, 143.90), (1.0, 18.15, 143.20))  # the paper's table 2 without feed-through
STEERING = ((23.15, 60.0), (1.0, 25.44, 60.0))
LANES = {"cpu": (50,), "gpu": (1000, 10_000)}


def vehicle(scale) -> Vehicle:
    """The paper's vehicle with each of its ten numbers times one of `scale` (10,)."""
    powertrain, steering = (
        TransferFunction(jnp.array(num) * s[:2], jnp.array(den) * jnp.append(1.0, s[2:4]))
        for (num, den), s in ((POWERTRAIN, scale[:4]), (STEERING, scale[4:8]))
    )
    return Vehicle(Bicycle(1.75 * scale[8], 1.2 * scale[9]), powertrain, steering)


def commands() -> Commands:
    """Steps, once a second."""
    rng = np.random.default_rng(0)
    v, delta = rng.uniform(1.0, 5.0, 41), rng.uniform(-0.3, 0.3, 41)
    return Commands(np.repeat(v, 100)[:ROWS], np.repeat(delta, 100)[:ROWS], DT)


def best(run, repeats: int = 2) -> tuple[float, np.ndarray]:
    """Least wall time of some runs, after one that compiles, and what they return."""
    jax.block_until_ready(run())
    times = []
    for _ in range(repeats):
        begin = time.perf_counter()
        result = jax.block_until_ready(run())
        times.append(time.perf_counter() - begin)
    return min(times), np.asarray(result)


def measured(device, scales: np.ndarray) -> tuple[dict[str, float], list[np.ndarray]]:
    """Seconds of all scenarios and of their gradients, by lanes at once; and both results."""
    seconds, results = {}, []
    with jax.default_device(device):
        scales = jax.device_put(scales, device)
        told = commands()
        end = simulate(vehicle(jnp.ones(10)), told).poses[-1]

        def apart(scale):
            return jnp.linalg.norm(simulate(vehicle(scale), told).poses[-1, :2] - end[:2])

        for lanes in LANES[device.platform]:

            @eqx.filter_jit
            def poses(scales, lanes=lanes):
                vehicles = eqx.filter_vmap(vehicle)(scales)
                return simulate_many(vehicles, told, batch_size=lanes).poses

            @eqx.filter_jit
            def gradients(scales, lanes=lanes):
                return jax.lax.map(jax.grad(apart), scales, batch_size=lanes)

            if lanes <= max(len(scales), 50):
                results = []
                for name, run in (("poses", poses), ("gradients", gradients)):
                    least, result = best(lambda run=run: run(scales))
                    seconds[f"{name}, {lanes} at once"] = least
                    results.append(result)
    return seconds, results


def main() -> None:
    """Measure, print a table, and write JSON where asked."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--json", type=Path)
    parser.add_argument("--scenarios", type=int, nargs="+", default=[1000, 10_000])
    options = parser.parse_args()
    jax.config.update("jax_enable_x64", True)
    devices = [jax.devices("cpu")[0]]
    devices += [d for d in jax.devices()[:1] if d.platform in LANES and d not in devices]

    report = {}
    for count in options.scenarios:
        scales = 1.0 + 0.05 * np.random.default_rng(1).normal(size=(count, 10))
        print(f"\n{count} scenarios")
        firsts = None
        for device in devices:
            seconds, results = measured(device, scales)
            firsts = firsts or results
            apart = [float(np.abs(a - b).max()) for a, b in zip(results, firsts, strict=True)]
            cores = f" ({os.cpu_count()} cores)" if device.platform == "cpu" else ""
            name = f"{device.device_kind}{cores}"
            report[f"{count}, {name}"] = {"seconds": seconds, "apart": apart}
            for what, value in seconds.items():
                print(f"  {name:32s}{what:28s}{1e6 * value / count:10.1f} us a scenario")
            print(f"  {name:32s}poses and gradients apart    {apart[0]:.1e} m, {apart[1]:.1e}")
    if options.json:
        options.json.write_text(json.dumps(report, indent=2))


if __name__ == "__main__":
    main()
