"""Linear algebra works in one thread while the package computes, and as before afterwards."""

import pytest
from threadpoolctl import threadpool_info, threadpool_limits

from vdmsi_jax.threads import one_for_blas


def blas_threads() -> list[int]:
    return [each["num_threads"] for each in threadpool_info() if each["user_api"] == "blas"]


def test_blas_gets_one_thread_and_its_own_again():
    with threadpool_limits(2, user_api="blas"):
        before = blas_threads()
        if not before or max(before) == 1:
            pytest.skip("NumPy's linear algebra has no threads here")
        with one_for_blas():
            assert set(blas_threads()) == {1}
        assert blas_threads() == before
