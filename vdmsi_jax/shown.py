"""How modules are printed: with their numbers, where those are few and known."""

import re
from typing import Any

import equinox as eqx
import jax
import numpy as np
from jax.core import Tracer

from .parameters import parameters

_MOST = 16  # numbers of an array that are printed
_WIDTH = 100


def shown(module: Any) -> str:
    """A module of equinox in words, with six digits of its numbers. Of long arrays, and of those
    that are traced, the type and the shape stand there. An effect that holds limits by their
    inverses is told by the limits, as `Saturation.of(upper=4.0, lower=1.0)`."""
    limited = set[str]()

    def told(node: Any) -> Any:
        inverse = _inverse(node)
        if inverse and all(_known(getattr(node, name)) for name in inverse):
            limited.add(type(node).__name__)
            for name in inverse:
                with np.errstate(divide="ignore"):
                    limit = np.divide(1.0, getattr(node, name))
                node = eqx.tree_at(lambda own, name=name: getattr(own, name), node, limit)
        return jax.tree.map(_number, node)

    numbers = jax.tree.map(told, module, is_leaf=lambda node: bool(_inverse(node)))
    text = eqx.tree_pformat(numbers, width=_WIDTH)
    for name in limited:
        text = re.sub(rf"\b{name}\(", f"{name}.of(", text)
    return text


def _inverse(node: Any) -> list[str]:
    """The parameters of an effect that are inverse limits; none of anything else."""
    if not isinstance(node, eqx.Module):
        return []
    return [name for name, known in parameters(node).items() if known.shown == "inverse"]


def _known(leaf: Any) -> bool:
    known = isinstance(leaf, jax.Array | np.ndarray | np.floating) and not isinstance(leaf, Tracer)
    return known and leaf.size <= _MOST and leaf.dtype.kind in "fiu"


def _number(leaf: Any) -> Any:
    if not _known(leaf):
        return leaf
    return np.array([float(f"{x:.6g}") for x in np.ravel(leaf)]).reshape(leaf.shape).tolist()
