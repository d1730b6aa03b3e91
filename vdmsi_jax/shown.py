"""How modules are printed: with their numbers, where those are few and known."""

from typing import Any

import equinox as eqx
import jax
import numpy as np
from jax.core import Tracer

_MOST = 16  # numbers of an array that are printed
_WIDTH = 100


def shown(module: Any) -> str:
    """A module of equinox in words, with six digits of its numbers. Of long arrays, and of those
    that are traced, the type and the shape stand there."""

    def number(leaf: Any) -> Any:
        known = isinstance(leaf, jax.Array | np.ndarray) and not isinstance(leaf, Tracer)
        if not known or leaf.size > _MOST or leaf.dtype.kind not in "fiu":
            return leaf
        return np.array([float(f"{x:.6g}") for x in np.ravel(leaf)]).reshape(leaf.shape).tolist()

    return eqx.tree_pformat(jax.tree.map(number, module), width=_WIDTH)
