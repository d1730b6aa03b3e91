"""Threads: who may use the processors while this package computes."""

import os
from contextlib import AbstractContextManager

from threadpoolctl import threadpool_limits

AT_ONCE = min(os.cpu_count() or 1, 4)
"""Pieces of work that are done side by side. NumPy and compiled programs let other threads run."""


def one_for_blas() -> AbstractContextManager[object]:
    """Let NumPy's linear algebra work in the thread that calls it, while this lasts.

    The matrices here are small, and what waits for them works side by side already: with threads of
    its own, OpenBLAS took a third of the processor time of a diagnosis to wait for itself.
    """
    return threadpool_limits(1, user_api="blas")
