"""Branch and bound at a threshold yields exactly the selections in the open range, each once."""

from time import perf_counter

import numpy as np
import pytest
from choice_problems import all_selections, block_of
from hypothesis import given, settings
from hypothesis import strategies as st

from loopid.base_parameters.search.tree import (
    Budget,
    OutOfBudgetError,
    margin,
    selections_between,
)

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
    return block_of(X / np.linalg.norm(X, 2))


def expected(block, above, below):
    kept = []
    for rows in all_selections(block):
        levels = block.levels(rows)
        if levels.smallest > above and levels.largest < below:
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
    for ceiling in (np.inf, below):
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
    assert chosen in found(block, inside[0], np.inf)
    assert chosen not in found(block, levels.smallest, inside[1])
    assert chosen not in found(block, inside[0], levels.largest)


@given(blocks())
def test_a_range_that_holds_nothing_is_empty_and_one_that_holds_all_is_complete(block):
    total = np.linalg.norm(block.vectors, 2) ** 2
    assert found(block, total * 1.01, np.inf) == []
    assert found(block, 1e-300, block.least_largest * 0.999) == []
    regular = expected(block, 1e-300, np.inf)
    assert found(block, 1e-300, total * 1.01) == regular


@given(blocks(), st.data())
def test_what_is_settled_beforehand_stays_so(block, data):
    taken = np.array(data.draw(st.permutations(range(block.size)))[: block.count // 2], dtype=int)
    rest = np.setdiff1d(np.arange(block.size), taken)
    left = np.array(data.draw(st.permutations(rest))[: (block.size - block.count) // 2], dtype=int)
    above = min(block.levels(rows).smallest for rows in all_selections(block)) * 1.1 + 1e-12
    listed = selections_between(block, above, np.inf, budget(), taken, left)
    wanted = [
        rows
        for rows in expected(block, above, np.inf)
        if set(taken.tolist()) <= set(rows) and not set(left.tolist()) & set(rows)
    ]
    assert sorted(tuple(rows.tolist()) for rows in listed) == wanted


@given(blocks())
def test_least_largest_is_a_bound_for_every_selection(block):
    least = min(block.levels(rows).largest for rows in all_selections(block))
    assert block.least_largest <= least * (1 + 1e-12)


@pytest.mark.parametrize("size", [5, 40, 120])
def test_the_margin_exceeds_the_round_off_of_elimination(size):
    """Pivots of a matrix as the tree has them, against the same elimination in many digits."""
    flint = pytest.importorskip("flint", reason="needs pip install 'loopid[test]'")
    X = np.linalg.qr(np.random.default_rng(size).normal(size=(2 * size, size)))[0][:size]
    norms = np.linalg.norm(X, axis=1)
    matrix = X @ X.T / norms / norms[:, None]
    with flint.ctx.workprec(300):
        exact = flint.arb_mat(X.tolist())
        inverse = (exact * exact.transpose()).inv()[size - 1, size - 1]
        exact_pivot = float((1 / inverse).mid()) / norms[-1] ** 2
    computed = np.linalg.cholesky(matrix)[-1, -1] ** 2
    assert abs(computed - exact_pivot) < margin(size, size)


def test_pruning_saves_most_of_the_tree():
    X = np.linalg.qr(np.random.default_rng(0).normal(size=(20, 8)))[0]
    block = block_of(X)
    best = max(block.levels(rows).smallest for rows in all_selections(block)[::50])
    spent = budget()
    listed = list(selections_between(block, best, np.inf, spent))
    assert spent.leaves >= len(listed) > 0
    assert spent.nodes < 125970 / 10


def test_a_deadline_in_the_past_stops_the_search():
    X = np.linalg.qr(np.random.default_rng(0).normal(size=(9, 4)))[0]
    with pytest.raises(OutOfBudgetError):
        list(selections_between(block_of(X), 1e-3, np.inf, Budget(0.0)))
