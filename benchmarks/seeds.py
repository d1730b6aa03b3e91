"""Optima, bias, spread and coverage over noise seeds: the figures of the README.

    OPENBLAS_NUM_THREADS=1 python benchmarks/seeds.py [seeds of the powertrain] [of Rao-Garnier]

The references (best optima known, Cramer-Rao bound) are made here, by scipy and NumPy alone, in
`tests/seeds.py`. Takes about half an hour on two cores with 50 and 100 seeds.
"""

import sys
from collections import Counter
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tests"))

import jax  # noqa: E402
import numpy as np  # noqa: E402

import seeds  # noqa: E402

jax.config.update("jax_enable_x64", True)


def main(powertrain: int = 50, rao_garnier: int = 100) -> None:
    np.set_printoptions(precision=3, suppress=True)
    cells = seeds.powertrain_cells(range(powertrain), tell=lambda line: print(line, flush=True))
    print(f"cells within {seeds.NEAR}: {cells.near:.4f}; worst {cells.worst:.4f}")
    print(f"orders with the truth, below its own FIT: at most {cells.worst_of_truth:.4f}")
    for colour in (0.0, seeds.COLOUR):
        found = seeds.powertrain_estimates(range(powertrain), colour=colour)
        _tell(f"powertrain, noise of colour {colour}", found, found.spread)
    found = seeds.rao_garnier_estimates(range(rao_garnier))
    _tell("Rao-Garnier", found, seeds.RAO_GARNIER_BOUND * abs(found.truth))


def _tell(name: str, found: seeds.Estimates, bound: np.ndarray) -> None:
    print(f"{name}: {found.covered:.4f} of the 95 % intervals cover")
    print("  spread over bound", found.spread / bound, "bias over bound", found.bias / bound)
    print("  std told over spread", found.std.mean(0) / found.spread)
    print("  chosen", dict(Counter(found.chosen)), "by BIC", dict(Counter(found.by_bic)))


if __name__ == "__main__":
    main(*map(int, sys.argv[1:]))
