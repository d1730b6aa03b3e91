"""What a step of `lax.scan` over small matrix products costs; it must not grow with the record.

It does in jax 0.11.1, which `pyproject.toml` therefore excludes. Run this before lifting that pin.
"""

import time

import jax
import jax.numpy as jnp
import numpy as np

jax.config.update("jax_enable_x64", True)


@jax.jit
def responses(u):
    A, B = 0.9 * jnp.eye(5) + 0.01, 0.1 * jnp.ones(5)
    return jax.lax.scan(lambda x, u_k: (A @ x + B * u_k, x[0]), jnp.zeros(5), u)[1]


def seconds_per_step(samples: int, repeats: int = 7) -> float:
    """Median over the repeats, compiled."""
    u = jnp.asarray(np.random.default_rng(0).standard_normal(samples))
    responses(u).block_until_ready()
    times = []
    for _ in range(repeats):
        start = time.perf_counter()
        responses(u).block_until_ready()
        times.append(time.perf_counter() - start)
    return float(np.median(times)) / samples


if __name__ == "__main__":
    short, long = seconds_per_step(3_000), seconds_per_step(30_000)
    print(f"jax {jax.__version__}: {short * 1e9:.0f} ns a step at 3000 samples, ", end="")
    print(f"{long * 1e9:.0f} ns at 30 000 (ratio {long / short:.2f})")
    raise SystemExit(long > 3 * short)
