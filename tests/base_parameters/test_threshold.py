"""Branch and bound at a threshold yields exactly the selections in the open range, each once."""

from itertools import combinations
from time import perf_counter

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from loopid.base_parameters.search.block import make_block
from loopid.base_parameters.search.threshold import Budget, OutOfBudgetError, selections_between

PLENTY = 1e9


def budget():
    return Budget(perf_counter() + PLENTY)


@st.composite
def blocks(draw, decades=0.0):
    """Vectors in general position, of norms up to 1, perhaps spread over decades."""
    n = draw(st.integers(1, 9))
    k = draw(st.integers(1, n))
    rng = np.random.default_rng(draw(st.integers(0, 10**6)))
    X = rng.normal(size=(n, k)) * 10 ** rng.uniform(-decades, 0, size=(n, 1))
    X = X @ (np.linalg.qr(rng.normal(size=(k, k)))[0] * 10 ** np.linspace(0, -decades, k))
    return make_block(X / np.linalg.norm(X, 2), np.arange(n))


def all_selections(block):
    return [np.array(rows) for rows in combinations(range(block.size), block.count)]


def expected(block, above, below):
    kept = []
    for rows in all_selections(block):
        levels = block.levels(rows)
        if levels.smallest > above and (below is None or levels.largest < below):
            kept.append(tuple(rows.tolist()))
    return kept


def found(block, above, below):
    listed = [tuple(s.tolist()) for s in selections_between(block, above, below, budget())]
    assert len(listed) == len(set(listed))
    return sorted(listed)


@pytest.mark.parametrize("decades", [0.0, 4.0])
@given(data=st.data())
@settings(max_examples=60)
def test_exactly_the_selections_in_the_range(decades, data):
    block = data.draw(blocks(decades))
    levels = [block.levels(rows) for rows in all_selections(block)]
    places = st.floats(0.0, 1.0)
    above = np.quantile([x.smallest for x in levels], data.draw(places)) * 0.999
    below = np.quantile([x.largest for x in levels], data.draw(places)) * 1.001
    for ceiling in (None, below):
        assert found(block, above, ceiling) == expected(block, above, ceiling)


@pytest.mark.parametrize("decades", [0.0, 4.0])
@given(data=st.data())
@settings(max_examples=40)
def test_the_range_is_open_to_the_last_bit(decades, data):
    """Each end is an eigenvalue that occurs: outside at the value, inside one bit further."""
    block = data.draw(blocks(decades))
    rows = data.draw(st.sampled_from(all_selections(block)))
    levels, chosen = block.levels(rows), tuple(rows.tolist())
    inside = np.nextafter(levels.smallest, 0.0), np.nextafter(levels.largest, np.inf)
    assert chosen in found(block, inside[0], inside[1])
    assert chosen in found(block, inside[0], None)
    assert chosen not in found(block, levels.smallest, inside[1])
    assert chosen not in found(block, inside[0], levels.largest)


@given(blocks())
def test_a_range_that_holds_nothing_is_empty_and_one_that_holds_all_is_complete(block):
    total = np.linalg.norm(block.vectors, 2) ** 2
    assert found(block, total * 1.01, None) == []
    assert found(block, 0.0, block.least_largest() * 0.999) == []
    assert len(found(block, -1.0, total * 1.01)) == len(all_selections(block))


@given(blocks())
def test_least_largest_is_a_bound_for_every_selection(block):
    least = min(block.levels(rows).largest for rows in all_selections(block))
    assert block.least_largest() <= least * (1 + 1e-12)


@given(blocks())
def test_the_start_cannot_be_enlarged_by_a_swap(block):
    chosen = block.start()
    volume = np.prod(np.linalg.svd(block.vectors[chosen], compute_uv=False))
    assert len(set(chosen.tolist())) == block.count
    for row in set(range(block.size)) - set(chosen.tolist()):
        for place in range(block.count):
            swapped = chosen.copy()
            swapped[place] = row
            values = np.linalg.svd(block.vectors[swapped], compute_uv=False)
            assert np.prod(values) <= volume * 1.0101


def test_pruning_saves_most_of_the_tree():
    X = np.linalg.qr(np.random.default_rng(0).normal(size=(20, 8)))[0]
    block = make_block(X, np.arange(20))
    best = max(block.levels(rows).smallest for rows in all_selections(block)[::50])
    spent = budget()
    listed = list(selections_between(block, best, None, spent))
    assert spent.leaves >= len(listed) > 0
    assert spent.nodes < 125970 / 10


def test_a_deadline_in_the_past_stops_the_search():
    X = np.linalg.qr(np.random.default_rng(0).normal(size=(9, 4)))[0]
    with pytest.raises(OutOfBudgetError):
        list(selections_between(make_block(X, np.arange(9)), 0.0, None, Budget(0.0)))
