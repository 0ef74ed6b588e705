"""The bound on the smallest eigenvalue holds at any time, and is met when there is enough."""

from itertools import combinations
from math import inf
from time import perf_counter

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from loopid.base_parameters.search.block import make_block
from loopid.base_parameters.search.gap import highest_smallest_bound, lowest_ratio_bound
from loopid.base_parameters.search.threshold import Budget

PLENTY = 1e9


@st.composite
def blocks(draw, decades):
    n = draw(st.integers(2, 9))
    k = draw(st.integers(1, n))
    rng = np.random.default_rng(draw(st.integers(0, 10**6)))
    X = rng.normal(size=(n, k)) * 10 ** np.linspace(0, -decades, k)
    X = X @ np.linalg.qr(rng.normal(size=(k, k)))[0]
    return make_block(X / np.linalg.norm(X, 2), np.arange(n))


def levels_of_all(block):
    return [block.levels(np.array(s)) for s in combinations(range(block.size), block.count)]


def budget(nodes=inf):
    return Budget(perf_counter() + PLENTY, most_nodes=nodes)


@pytest.mark.parametrize("decades", [0.0, 3.0])
@given(data=st.data())
def test_with_enough_time_the_bound_is_the_highest_smallest_eigenvalue(decades, data):
    block = data.draw(blocks(decades))
    levels = levels_of_all(block)
    below = data.draw(st.sampled_from([None, *sorted({x.largest for x in levels})[:20]]))
    highest = max((x.smallest for x in levels if below is None or x.largest < below), default=0.0)
    low = data.draw(st.floats(0.1, 2.0)) * max(x.smallest for x in levels)
    bound = highest_smallest_bound(block, low, budget(), below)
    assert bound == pytest.approx(max(low, highest), rel=1e-8)


@pytest.mark.parametrize("decades", [0.0, 3.0])
@given(data=st.data(), nodes=st.integers(0, 30))
def test_the_bound_holds_however_little_was_searched(decades, data, nodes):
    block = data.draw(blocks(decades))
    highest = max(x.smallest for x in levels_of_all(block))
    spent = budget(nodes)
    bound = highest_smallest_bound(block, highest * 0.5, spent)
    assert bound >= highest * (1 - 1e-9)
    assert spent.nodes <= nodes + 1
    F = block.vectors.T @ block.vectors
    assert bound <= max(np.linalg.eigvalsh(F)[0] * (1 + 1e-8), highest * 0.5)


@pytest.mark.parametrize("decades", [0.0, 2.0])
@given(data=st.data())
def test_with_enough_time_the_ratio_bound_is_the_lowest_ratio(decades, data):
    block = data.draw(blocks(decades))
    levels = levels_of_all(block)
    highest = max(x.smallest for x in levels) * data.draw(st.floats(1.0, 2.0))
    lowest = min(x.ratio for x in levels)
    ratio = data.draw(st.floats(0.7, 3.0)) * lowest
    bound = lowest_ratio_bound(block, ratio, highest, budget())
    assert bound == pytest.approx(min(lowest, ratio), rel=1e-8)


@pytest.mark.parametrize("decades", [0.0, 2.0])
@given(data=st.data(), nodes=st.integers(0, 60))
def test_the_ratio_bound_holds_however_little_was_searched(decades, data, nodes):
    block = data.draw(blocks(decades))
    levels = levels_of_all(block)
    highest, lowest = max(x.smallest for x in levels), min(x.ratio for x in levels)
    bound = lowest_ratio_bound(block, 2 * lowest, highest, budget(nodes))
    assert bound <= lowest * (1 + 1e-9)
    assert bound >= min(block.least_largest() / highest * (1 - 1e-8), 2 * lowest)


def test_more_nodes_bring_the_bound_closer():
    block = make_block(
        np.linalg.qr(np.random.default_rng(0).normal(size=(24, 10)))[0], np.arange(24)
    )
    bounds = [highest_smallest_bound(block, 0.05, budget(nodes)) for nodes in (1, 300, 3000)]
    assert bounds[0] > bounds[1] > bounds[2]


def test_without_time_the_bound_is_that_of_all_rows_together():
    X = np.linalg.qr(np.random.default_rng(0).normal(size=(9, 4)))[0]
    bound = highest_smallest_bound(make_block(X, np.arange(9)), 0.1, Budget(0.0))
    assert bound == pytest.approx(1.0)
