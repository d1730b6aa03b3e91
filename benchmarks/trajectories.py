"""1000 trajectories of 3000 samples against scipy `lfilter`.

Each lane is another plant of five poles and four zeros under the same commands, as when an order is
fitted from many starts. The peer is the fastest that scipy has: coefficients discretised once and
outside the timing, then one `lfilter` with its initial state per plant. Ours includes the
realisation and the matrix exponential of every plant, since a fit changes them at every step. The
gradient is that of a summed squared error over all coefficients, in reverse mode.

The difference of both that is printed is that of `lfilter`: against 40 digits it errs by 9e-9 of
the largest output at five slow poles, and the blocks of the state space by 2e-15.

    python benchmarks/trajectories.py [--json FILE] [--plants 1000]
"""

import argparse
import json
import time
from pathlib import Path

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import scipy.signal

from vdmsi_jax.models.transfer_function import TransferFunction

DT, SAMPLES, BATCH = 0.01, 3000, 50


def plants(count: int, seed: int = 0) -> tuple[np.ndarray, np.ndarray]:
    """Coefficients `(count, 5)` and `(count, 6)` of stable plants, poles from 1 to 30 rad/s."""
    rng = np.random.default_rng(seed)
    den = np.stack([np.poly(-rng.uniform(1.0, 30.0, 5)) for _ in range(count)])
    return rng.normal(size=(count, 5)) * den[:, 1:], den


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
    parser.add_argument("--plants", type=int, default=1000)
    options = parser.parse_args()
    jax.config.update("jax_enable_x64", True)

    count = options.plants
    num, den = plants(count)
    u = np.repeat(np.random.default_rng(1).normal(size=SAMPLES // 10), 10)
    models = eqx.filter_vmap(TransferFunction)(num, den)
    discrete = []
    for b, a in zip(num, den, strict=True):
        (bd,), ad, _ = scipy.signal.cont2discrete((b, a), DT)
        discrete.append((bd, ad, scipy.signal.lfilter_zi(bd, ad) * u[0]))

    def filtered():
        return [scipy.signal.lfilter(b, a, u, zi=zi)[0] for b, a, zi in discrete]

    def response(model):
        return model.simulate(u, DT).y

    @jax.jit
    def simulated(models):
        return jax.lax.map(response, models, batch_size=BATCH)

    @jax.jit
    def gradients(models):
        loss = jax.grad(lambda model: jnp.sum(response(model) ** 2))
        return jax.lax.map(loss, models, batch_size=BATCH)

    seconds = {
        "scipy lfilter": best(filtered) / count,
        "trajectory": best(lambda: simulated(models).block_until_ready()) / count,
        "gradient": best(lambda: jax.block_until_ready(gradients(models))) / count,
    }
    ratios = {
        "trajectory / lfilter": seconds["trajectory"] / seconds["scipy lfilter"],
        "gradient / trajectory": seconds["gradient"] / seconds["trajectory"],
    }
    expected = np.stack(filtered())
    scale = np.abs(expected).max(axis=1, keepdims=True)
    apart = float((np.abs(simulated(models) - expected) / scale).max())
    for name, value in seconds.items():
        print(f"  {name:24s}{1e6 * value:10.1f} us a plant")
    for name, value in ratios.items():
        print(f"  {name:24s}{value:10.2f}")
    print(f"  largest difference of both, relative to the largest output: {apart:.1e}")
    if options.json:
        result = {"seconds": seconds, "ratios": ratios, "difference": apart}
        options.json.write_text(json.dumps(result, indent=2))


if __name__ == "__main__":
    main()
