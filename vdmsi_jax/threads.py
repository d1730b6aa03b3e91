"""Threads: who may use the processors while this package computes."""

import os
from collections import deque
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor, wait
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

    The thread that asks works as well, and all who ask share the threads that help.
    """
    double, care = bool(_SETTINGS.jax_enable_x64), np.geterr()
    left, found = deque(range(len(items))), dict[int, R]()

    def work() -> None:
        with jax.enable_x64(double), np.errstate(**care):  # both are a thread's own
            while True:
                try:
                    number = left.popleft()
                except IndexError:  # all are taken
                    return
                found[number] = function(items[number])

    helpers = [_pool().submit(work) for _ in range(min(AT_ONCE, len(items)) - 1)]
    try:
        work()
    finally:
        left.clear()
        helping = [helper for helper in helpers if not helper.cancel()]
        wait(helping)
    for helper in helping:
        helper.result()
    return [found[number] for number in range(len(items))]


@cache
def _pool() -> ThreadPoolExecutor:
    return ThreadPoolExecutor(AT_ONCE)
