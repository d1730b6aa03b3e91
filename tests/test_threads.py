"""Linear algebra works in one thread while the package computes, and as before afterwards."""

import threading

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from threadpoolctl import threadpool_info, threadpool_limits

from vdmsi_jax.threads import AT_ONCE, each, one_for_blas


def blas_threads() -> list[int]:
    return [pool["num_threads"] for pool in threadpool_info() if pool["user_api"] == "blas"]


def test_blas_gets_one_thread_and_its_own_again():
    with threadpool_limits(2, user_api="blas"):
        before = blas_threads()
        if not before or max(before) == 1:
            pytest.skip("NumPy's linear algebra has no threads here")
        with one_for_blas():
            assert set(blas_threads()) == {1}
        assert blas_threads() == before


@pytest.mark.parametrize("double", [True, False])
def test_each_answers_in_order_and_in_the_precision_of_who_asks(double):
    with jax.enable_x64(double):
        found = each(lambda k: (k, jnp.ones(()).dtype.itemsize), range(9))
    assert found == [(k, 8 if double else 4) for k in range(9)]


@pytest.mark.parametrize("care", ["ignore", "raise"])
def test_each_cares_for_overflows_as_who_asks(care):
    with np.errstate(over=care):
        assert each(lambda _: np.geterr()["over"], range(4)) == [care] * 4


@pytest.mark.parametrize("items", [[1, 0], [0, 1], [0, 0, 0, 0], [0]])
def test_what_fails_in_a_thread_fails_where_it_was_asked(items):
    with pytest.raises(ZeroDivisionError):
        each(lambda k: 1 / k, items)
    with pytest.raises(IndexError):
        each(lambda k: [7][1 - k], items)


def test_each_may_be_asked_for_within_each():
    found = each(lambda k: sum(each(lambda j: j * k, range(5))), range(20))
    assert found == [10 * k for k in range(20)]
    assert each(abs, []) == []


@pytest.mark.skipif(AT_ONCE < 2, reason="one processor does one thing at a time")
def test_each_works_side_by_side():
    meet = threading.Barrier(2, timeout=30.0)  # breaks where one waits for the other to end
    assert len(each(lambda _: meet.wait(), range(2))) == 2
