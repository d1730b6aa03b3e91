"""Linear models of jax-sysid, fitted in a Python of their own, for `packages.py`.

jax-sysid pins a JAX older than this package runs on, so that it cannot be imported beside it. This
file imports nothing of the package. It reads one line of JSON with the signals `u` and `y`; then it
answers every further line by one with `cpu`, the CPU seconds that its fits took, and
`predicted`, the free runs of the models with 1 to 5 states. Models have no feed-through, their
initial state is fitted, and both signals are divided by their spread, as its author advises; Adam
and then L-BFGS, more of either changes the FIT by less than 0.002 points.
"""

import json
import sys
import time

import jax
import numpy as np
from jax_sysid.models import LinearModel

ADAM, LBFGS = 500, 1000  # iterations at the most


def free_run(u: np.ndarray, y: np.ndarray, n_states: int) -> np.ndarray:
    """The free run (samples,) of a model fitted to a command and a response (samples,)."""
    per_u, per_y = u.std(), y.std()
    model = LinearModel(n_states, 1, 1, feedthrough=False)
    model.loss(rho_x0=1e-8, rho_th=1e-8)
    model.optimization(adam_epochs=ADAM, lbfgs_epochs=LBFGS, iprint=-1)
    model.fit(y[:, None] / per_y, u[:, None] / per_u)
    return np.ravel(model.predict(model.x0, u[:, None] / per_u)[0]) * per_y


def main() -> None:
    """Fit as often as asked; answers alone go to standard output."""
    answers, sys.stdout = sys.stdout, sys.stderr  # L-BFGS tells of itself
    jax.config.update("jax_platform_name", "cpu")
    jax.config.update("jax_enable_x64", True)
    signals = json.loads(sys.stdin.readline())
    u, y = (np.asarray(signals[name]) for name in ("u", "y"))
    for _ in sys.stdin:
        used = time.process_time()
        predicted = [free_run(u, y, n).tolist() for n in (1, 2, 3, 4, 5)]
        answer = {"cpu": time.process_time() - used, "predicted": predicted}
        print(json.dumps(answer), file=answers, flush=True)


if __name__ == "__main__":
    main()
