"""Threads: who may use the processors while this package computes."""

import os
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import AbstractContextManager
from functools import cache
from typing import Any, TypeVar

import jax
import numpy as np
from threadpoolctl import threadpool_limits

T = TypeVar("T")
R = TypeVar("R")

_SETTINGS: Any = jax.config  # whose attributes no type checker knows

AT_ONCE = min(os.cpu_count() or 1, 4)
"""Pieces of work that are done side by side. NumPy and compiled programs let other threads run."""


def one_for_blas() -> AbstractContextManager[object]:
    """Let NumPy's linear algebra work in the thread that calls it, while this lasts.

    The matrices here are small, and what waits for them works side by side already: with threads of
    its own, OpenBLAS took a third of the processor time of a diagnosis to wait for itself.
    """
    return threadpool_limits(1, user_api="blas")


def each(function: Callable[[T], R], items: Sequence[T]) -> list[R]:
    """What a function makes of every item, side by side, in the precision of the thread that asks,
    and with its care for overflows and the like.

    All who ask share the same threads, so the function must not ask again.
    """
    if len(items) < 2:
        return [function(item) for item in items]
    double, care = bool(_SETTINGS.jax_enable_x64), np.geterr()

    def run(item: T) -> R:
        with jax.enable_x64(double), np.errstate(**care):  # both are a thread's own
            return function(item)

    return list(_pool().map(run, items))


@cache
def _pool() -> ThreadPoolExecutor:
    return ThreadPoolExecutor(AT_ONCE)
