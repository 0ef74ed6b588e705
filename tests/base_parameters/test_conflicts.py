"""What is ruled out for free rows is in no set that the rules allow."""

from itertools import combinations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from loopid.base_parameters.search.conflicts import conflicts, consistent, eliminated, options


def symmetric(rng, size):
    """Indefinite matrices, as they are between levels, with some positive diagonal."""
    A = rng.normal(size=(size, size))
    return A + A.T + np.diag(rng.uniform(0, 4, size))


def positive(matrix, rows):
    return len(rows) == 0 or np.linalg.eigvalsh(matrix[np.ix_(rows, rows)])[0] > 0


def allowed(take, leave, count):
    """All ways to take ``count`` rows and to leave the others, by definition."""
    everything = range(len(take))
    for taken in combinations(everything, count):
        left = [row for row in everything if row not in taken]
        if positive(take, list(taken)) and positive(leave, left):
            yield set(taken)


@st.composite
def rules(draw):
    size = draw(st.integers(1, 7))
    count = draw(st.integers(0, size))
    rng = np.random.default_rng(draw(st.integers(0, 10**6)))
    return symmetric(rng, size), symmetric(rng, size), count


@given(rules())
def test_what_is_ruled_out_occurs_in_nothing_allowed(case):
    take, leave, count = case
    size = len(take)
    takeable, leavable = options([take], leave, (count, size - count))
    for taken in allowed(take, leave, count):
        assert takeable[list(taken)].all()
        assert leavable[list(set(range(size)) - taken)].all()


@given(st.integers(0, 10**6), st.integers(2, 6))
def test_conflicts_are_pairs_that_are_not_positive_together(seed, size):
    matrix = symmetric(np.random.default_rng(seed), size)
    matrix = matrix + np.diag(1e-3 - np.minimum(np.diag(matrix), 0))
    found = conflicts(matrix)
    for i, j in combinations(range(size), 2):
        assert found[i, j] == found[j, i] == (not positive(matrix, [i, j]))
    assert not found.diagonal().any()


@st.composite
def graphs(draw):
    size = draw(st.integers(2, 6))
    pairs = list(combinations(range(size), 2))
    two = []
    for _ in range(2):
        graph = np.zeros((size, size), dtype=bool)
        for i, j in draw(st.lists(st.sampled_from(pairs), max_size=5)):
            graph[i, j] = graph[j, i] = True
        two.append(graph)
    return two


@given(graphs(), st.data())
def test_consistent_keeps_whatever_respects_the_conflicts(two, data):
    apart, together = two
    size = len(apart)
    count = data.draw(st.integers(0, size))
    takeable, leavable = consistent(apart, together, (count, size - count))
    for taken in map(list, combinations(range(size), count)):
        left = np.setdiff1d(np.arange(size), taken)
        if apart[np.ix_(taken, taken)].any() or together[np.ix_(left, left)].any():
            continue
        assert takeable[taken].all()
        assert leavable[left].all()


def test_two_neighbours_in_conflict_rule_a_row_out():
    apart, together = np.zeros((2, 4, 4), dtype=bool)
    apart[0, [1, 2]] = apart[[1, 2], 0] = True
    together[1, 2] = together[2, 1] = True
    takeable, leavable = consistent(apart, together, (2, 2))
    np.testing.assert_array_equal(takeable, [False, True, True, True])
    assert leavable.all()
    takeable, leavable = consistent(together, apart, (2, 2))
    assert takeable.all()
    np.testing.assert_array_equal(leavable, [False, True, True, True])


@given(st.integers(0, 10**6), st.integers(2, 7), st.data())
def test_elimination_of_rows_together_is_that_of_one_after_another(seed, size, data):
    rng = np.random.default_rng(seed)
    A = rng.normal(size=(size, size))
    matrix = A @ A.T - 0.3 * np.eye(size)
    rows = np.array(data.draw(st.permutations(range(size)))[: data.draw(st.integers(1, size))])
    kept = np.setdiff1d(np.arange(size), rows)
    together = eliminated(matrix, rows, kept)
    assert (together is not None) == positive(matrix, rows)
    if together is not None:
        block, across = matrix[np.ix_(rows, rows)], matrix[np.ix_(rows, kept)]
        expected = matrix[np.ix_(kept, kept)] - across.T @ np.linalg.solve(block, across)
        scale = max(1.0, 1 / np.linalg.eigvalsh(block)[0])
        np.testing.assert_allclose(together, expected, rtol=0, atol=1e-9 * scale)
