"""Combinations by number are those of itertools, and stay so where the numbers are huge."""

from itertools import combinations
from math import comb

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from loopid.base_parameters.search.combinations import unrank

LARGEST = 2**63 - 1


def rank(combination, size):
    """Combinations before this one: for each element, those with a smaller one in its place."""
    before, start = 0, 0
    for place, chosen in enumerate(combination):
        left = len(combination) - place - 1
        before += sum(comb(size - skipped - 1, left) for skipped in range(start, chosen))
        start = chosen + 1
    return before


@given(st.integers(0, 11).flatmap(lambda n: st.tuples(st.just(n), st.integers(0, n))))
def test_the_order_is_that_of_itertools(case):
    n, k = case
    expected = np.array(list(combinations(range(n), k)), dtype=int).reshape(comb(n, k), k)
    np.testing.assert_array_equal(unrank(np.arange(comb(n, k)), n, k), expected)


SIZES = [(62, 31), (66, 30), (70, 68), (200, 198), (300, 8), (1000, 3), (5000, 1), (40, 40)]


@pytest.mark.parametrize(("n", "k"), SIZES)
@given(data=st.data())
def test_numbers_lead_back(n, k, data):
    ranks = data.draw(st.lists(st.integers(0, comb(n, k) - 1), min_size=1, max_size=5))
    found = unrank(np.array(ranks), n, k)
    assert [rank(row.tolist(), n) for row in found] == ranks
    assert (np.diff(found, axis=1) > 0).all()


@pytest.mark.parametrize(("n", "k"), SIZES)
def test_the_ends_are_the_first_and_the_last(n, k):
    assert comb(n, k) <= LARGEST
    first, last = unrank(np.array([0, comb(n, k) - 1]), n, k)
    assert first.tolist() == list(range(k))
    assert last.tolist() == list(range(n - k, n))
