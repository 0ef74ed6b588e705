"""States of a front are what their definition says, and passes lose no selection."""

from itertools import product
from time import perf_counter

import numpy as np
import pytest
from chains import chain_block, chains, levels_of_all
from hypothesis import given, settings
from hypothesis import strategies as st

from loopid.base_parameters.search import fronts as fronts_module
from loopid.base_parameters.search import passes as passes_module
from loopid.base_parameters.search.branches import branch_decomposition
from loopid.base_parameters.search.fronts import Front, Range, merged, single, supported
from loopid.base_parameters.search.narrow import NarrowSearch
from loopid.base_parameters.search.passes import downwards, relaxed, restricted, upwards
from loopid.base_parameters.search.threshold import Budget, OutOfBudgetError

FINE = 8  # efforts after which the fronts of small blocks are whole


def budget():
    return Budget(perf_counter() + 1e9)


def unchanged(front):
    return front


def form(vectors, branch, weights):
    """The form of a set by definition: minimised over the null vectors inside."""
    rows = vectors[list(branch.rows)]
    M = rows.T @ (weights[:, None] * rows)
    values, turns = np.linalg.eigh(rows.T @ rows)
    inside = turns[:, values >= 1 - 1e-9]
    inner = inside.T @ M @ inside
    if branch.inside and np.linalg.eigvalsh(inner)[0] <= 1e-9:
        return None
    cross = branch.boundary.T @ M @ inside
    own = branch.boundary.T @ M @ branch.boundary
    return own - cross @ np.linalg.solve(inner, cross.T) if branch.inside else own


@given(
    vectors=chains(largest=8), above=st.floats(0.01, 0.3), below=st.none() | st.floats(0.5, 0.99)
)
@settings(max_examples=30)
def test_states_are_forms_minimised_over_what_is_inside(vectors, above, below):
    """Every state of every set, before worse ones are dropped, traced back to its vectors."""
    wanted = Range(above, below)
    members = {}
    fronts = {}
    for branch in branch_decomposition(vectors).walk():
        if not branch.children:
            fronts[branch], members[branch] = single(branch, wanted), [(0,), (1,)]
        else:
            pair = tuple(fronts[child] for child in branch.children)
            fronts[branch] = merged(branch, pair, wanted, (unchanged, unchanged), budget())
            both = [members[child] for child in branch.children]
            members[branch] = [both[0][i] + both[1][j] for i, j in fronts[branch].origins]
        for state, taken in enumerate(members[branch]):
            taken = np.array(taken)
            assert taken.sum() - branch.inside == fronts[branch].excess[state]
            for kind, (yes, no) in enumerate(zip(wanted.selected, wanted.left, strict=True)):
                expected = form(vectors, branch, np.where(taken == 1, yes, no))
                np.testing.assert_allclose(fronts[branch].forms[state, kind], expected, atol=1e-7)


@given(vectors=chains(largest=8), above=st.floats(0.01, 0.3))
@settings(max_examples=30)
def test_only_what_cannot_be_completed_is_dropped(vectors, above):
    """Parts of a selection in the range are states of every set, in merges of everything."""
    wanted = Range(above)
    fronts, members = {}, {}
    for branch in branch_decomposition(vectors).walk():
        if not branch.children:
            fronts[branch], members[branch] = single(branch, wanted), [(0,), (1,)]
            continue
        pair = tuple(fronts[child] for child in branch.children)
        fronts[branch] = merged(branch, pair, wanted, (unchanged, unchanged), budget())
        both = [members[child] for child in branch.children]
        members[branch] = [both[0][i] + both[1][j] for i, j in fronts[branch].origins]
    n, k = vectors.shape
    for choice in product((0, 1), repeat=n):
        chosen = np.flatnonzero(choice)
        if len(chosen) != k:
            continue
        if np.linalg.svd(vectors[chosen], compute_uv=False)[-1] ** 2 <= above * (1 + 1e-9):
            continue
        for branch, states in members.items():
            assert tuple(choice[row] for row in branch.rows) in states


@pytest.fixture(params=["at once", "in pieces"], autouse=True, scope="module")
def crowd(request):
    """Fronts that are thinned as they grow, and so large that none are compared."""
    with pytest.MonkeyPatch.context() as patch:
        if request.param == "in pieces":
            patch.setattr(fronts_module, "MOST_PAIRS", 5)
            patch.setattr(fronts_module, "MOST_WAITING", 3)
            patch.setattr(passes_module, "COMPARED", 1)
        yield


@given(vectors=chains(), effort=st.integers(0, 3), data=st.data())
def test_a_search_finds_a_selection_exactly_where_there_is_one(vectors, effort, data):
    block = chain_block(vectors)
    smallest, largest = levels_of_all(block)
    below = data.draw(
        st.none() | st.sampled_from(sorted({*largest.round(9)})).map(lambda u: u + 1e-6)
    )
    above = data.draw(
        st.sampled_from(sorted({*smallest.round(9)})).map(lambda t: max(t - 1e-6, 1e-6))
    )
    above += data.draw(st.sampled_from([0.0, 2e-6]))
    exists = ((smallest > above) & ((below is None) | (largest < (below or 0)))).any()
    search = NarrowSearch(block)
    try:
        found = search.first(above, below, effort, budget())
    except OutOfBudgetError:
        found = search.first(above, below, FINE, budget())
    assert (found is not None) == exists
    if found is not None:
        levels = block.levels(found)
        assert levels.smallest > above * (1 - 1e-9)
        assert below is None or levels.largest < below * (1 + 1e-9)


@given(vectors=chains(), thresholds=st.lists(st.floats(0.001, 0.4), min_size=2, max_size=4))
def test_what_was_learnt_at_one_threshold_does_no_harm_at_another(vectors, thresholds):
    block = chain_block(vectors)
    used = NarrowSearch(block)
    for above in thresholds:
        for effort in (0, 1):
            answers = []
            for search in (used, NarrowSearch(block)):
                try:
                    answers.append(search.first(above, None, effort, budget()) is not None)
                except OutOfBudgetError:
                    answers.append(None)
            assert answers[0] == answers[1] or None in answers


@given(vectors=chains())
def test_a_crowded_block_reaches_one(vectors):
    block = chain_block(vectors)
    if NarrowSearch(block).crowded:
        smallest, largest = levels_of_all(block)
        assert largest[smallest > 1e-9].min(initial=1.0) == pytest.approx(1.0, abs=1e-9)


@given(vectors=chains(), limit=st.integers(1, 3), above=st.floats(0.01, 0.2))
@settings(max_examples=50)
def test_relaxed_fronts_exceed_and_restricted_ones_are_part_of_the_whole(vectors, limit, above):
    branches = tuple(branch_decomposition(vectors).walk())
    wanted = Range(above)
    whole = upwards(branches, wanted, {}, lambda branch, front: front, budget())
    if whole is None:
        return
    outside = downwards(branches, whole, limit, budget())
    for branch, front in whole.items():
        if not branch.width or branch not in outside:
            continue
        loose = relaxed(front, limit)
        assert max(np.bincount(loose.excess)) <= max(limit, 1)
        for state in range(len(front)):
            same = loose.forms[loose.excess == front.excess[state]]
            gaps = np.linalg.eigvalsh(same - front.forms[state])
            assert (gaps.reshape(len(same), -1).min(axis=1) >= -1e-9).any()
        front = front.only(supported(front, outside[branch], branch.width, budget()))
        some = restricted(front, outside[branch], limit, branch.width)
        whole_forms = [state.tobytes() for state in front.forms]
        assert all(state.tobytes() in whole_forms for state in some.forms)
        assert set(some.excess) == set(front.excess)


def test_states_of_bounds_are_not_taken_for_selections():
    forms = np.array([np.diag([k, -k]) for k in range(5)])[:, None].astype(float)
    front = Front(forms, np.zeros(5, np.int64), np.zeros((5, 2), np.int64))
    assert front.exact
    assert not relaxed(front, 2).exact
