"""The same results from one process and from several."""

import numpy as np
import pytest
from threadpoolctl import threadpool_info

from loopid.errors import OptionError
from loopid.workers import ordered_map


def product(seed):
    A = np.random.default_rng(seed).normal(size=(80, 60))
    return A.T @ A


def threads_of(_):
    np.ones((50, 50)) @ np.ones((50, 50))
    return [pool["num_threads"] for pool in threadpool_info() if pool["user_api"] == "blas"]


def refuse_three(number):
    if number == 3:
        raise OptionError("no threes")
    return number


def test_results_come_in_order_and_are_the_same_to_the_bit():
    alone, shared = (list(ordered_map(product, range(12), n_jobs)) for n_jobs in (1, 2))
    assert len(alone) == 12
    for k, (one, other) in enumerate(zip(alone, shared, strict=True)):
        np.testing.assert_array_equal(one, other)
        np.testing.assert_allclose(one, product(k), rtol=1e-12)


@pytest.mark.parametrize("n_jobs", [1, 2])
def test_each_process_has_one_blas_thread(n_jobs):
    for counts in ordered_map(threads_of, range(3), n_jobs):
        assert counts
        assert set(counts) == {1}


@pytest.mark.parametrize("n_jobs", [1, 2])
def test_items_are_taken_only_as_they_are_needed(n_jobs):
    taken = []

    def items():
        for k in range(100):
            taken.append(k)
            yield k

    results = ordered_map(refuse_three, items(), n_jobs)
    assert next(results) == 0
    assert len(taken) <= 2 * n_jobs + 1
    results.close()


@pytest.mark.parametrize("n_jobs", [1, 2])
def test_errors_of_the_function_are_raised_here(n_jobs):
    results = ordered_map(refuse_three, range(5), n_jobs)
    with pytest.raises(OptionError, match="no threes"):
        list(results)


@pytest.mark.parametrize("n_jobs", [0, -1, 1.5, True, "two"])
def test_other_numbers_of_processes_are_refused(n_jobs):
    with pytest.raises(OptionError, match="n_jobs must be a whole number of processes"):
        ordered_map(product, range(2), n_jobs)
