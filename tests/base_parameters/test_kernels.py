"""Compiled kernels say what arrays of all pairs at a time say, and are not needed."""

import sys
from unittest.mock import patch

import numpy as np
import pytest
from chains import chain_block, chains, levels_of_all
from hypothesis import given, settings
from hypothesis import strategies as st
from test_engines import budget

from loopid.base_parameters.search import acceleration, loewner
from loopid.base_parameters.search.conflicts import ZERO_PIVOT
from loopid.base_parameters.search.loewner import groups, maximal, positive_definite, room, sums
from loopid.base_parameters.search.narrow import NarrowSearch
from loopid.base_parameters.search.threshold import OutOfBudgetError

pytest.importorskip("numba", reason="the kernels need numba")
kernels = pytest.importorskip(acceleration.KERNELS)


both_ways = pytest.mark.parametrize("way", ["compiled", "arrays"])


def by(way):
    """Take the kernels always, or never."""
    found = kernels if way == "compiled" else None
    return patch.object(loewner, "kernels", lambda pairs: found)


@st.composite
def two_stacks(draw):
    """Two stacks (N, kinds, w, w) of whole numbers: equal forms and zero pivots occur."""
    kinds, width = draw(st.integers(1, 2)), draw(st.integers(1, 4))
    rng = np.random.default_rng(draw(st.integers(0, 10**6)))
    shift = draw(st.sampled_from([0, 1, 3])) * np.eye(width)
    return [half_sum(rng, draw(st.integers(1, 9)), kinds, width) + shift for _ in range(2)]


def half_sum(rng, count, kinds, width):
    forms = rng.integers(-2, 3, size=(count, kinds, width, width)).astype(float)
    return (forms + forms.swapaxes(2, 3)) / 2


@both_ways
@given(stacks=two_stacks(), data=st.data())
def test_sums_are_schur_complements_of_all_pairs(way, stacks, data):
    first, second = stacks
    width = data.draw(st.integers(0, first.shape[-1]))
    rng = np.random.default_rng(data.draw(st.integers(0, 99)))
    excess = rng.integers(-1, width + 2, size=(len(first), len(second)))
    with by(way):
        forms, pairs = sums(first, second, excess, width)
    rest = (first[:, None] + second)[..., width:, width:]
    flat = rest.reshape(excess.size, *rest.shape[2:])
    possible = positive_definite(flat).reshape(excess.shape) & (excess >= 0) & (excess <= width)
    np.testing.assert_array_equal(pairs, np.argwhere(possible))
    for form, (i, j) in zip(forms, pairs, strict=True):
        whole = first[i] + second[j]
        coupling = whole[:, :width, width:]
        inner = np.linalg.solve(whole[:, width:, width:], np.swapaxes(coupling, 1, 2))
        np.testing.assert_allclose(form, whole[:, :width, :width] - coupling @ inner, atol=1e-9)


@both_ways
@given(stacks=two_stacks())
def test_room_is_the_least_pivot_beside_the_best_partner(way, stacks):
    forms, partners = stacks
    expected = [max(least_pivot(form + other) for other in partners) for form in forms]
    with by(way):
        found, enough = room(forms, partners), room(forms, partners, enough=ZERO_PIVOT)
    np.testing.assert_allclose(found, np.maximum(expected, ZERO_PIVOT), atol=1e-9)
    np.testing.assert_array_equal(enough > ZERO_PIVOT, np.array(expected) > 0)


def least_pivot(form):
    """Least square of a Cholesky diagonal, taken from the last coordinate on; 0 where none."""
    turned = form[:, ::-1, ::-1]
    if not positive_definite(turned[None])[0]:
        return 0.0
    return (np.diagonal(np.linalg.cholesky(turned), axis1=1, axis2=2) ** 2).min()


@both_ways
@given(stacks=two_stacks())
def test_what_is_left_exceeds_all_that_went(way, stacks):
    forms = np.concatenate(stacks)
    with by(way):
        kept = maximal(forms)
    for index, form in enumerate(forms):
        above = [np.linalg.eigvalsh(forms[other] - form).min() >= -1e-9 for other in kept]
        assert any(above)
        if index in kept:
            assert sum(above) == 1


@both_ways
@given(stacks=two_stacks(), count=st.integers(1, 6))
def test_groups_are_of_the_nearest_of_centres_that_lie_far_apart(way, stacks, count):
    forms = stacks[0]
    with by(way):
        labels = groups(forms, count)
    points = forms.reshape(len(forms), -1)
    centres = [0]
    while len(centres) < min(count, len(points)):
        distance = np.linalg.norm(points[:, None] - points[centres], axis=2).min(axis=1)
        centres.append(int(distance.argmax()))
    distance = np.linalg.norm(points[:, None] - points[centres], axis=2)
    own = distance[np.arange(len(points)), labels]
    np.testing.assert_allclose(own, distance.min(axis=1), atol=1e-12)


@both_ways
@settings(deadline=None, max_examples=20)
@given(vectors=chains(), above=st.floats(0.0, 0.5))
def test_a_search_says_the_same_with_kernels_and_without(way, vectors, above):
    block = chain_block(vectors)
    smallest = levels_of_all(block)[0]
    for effort in range(8):
        try:
            with by(way):
                found = NarrowSearch(block).first(above, None, effort, budget())
        except OutOfBudgetError:
            continue
        assert (found is not None) == bool((smallest > above).any())
        break
    else:
        pytest.fail("undecided at every effort")


def test_no_kernels_where_numba_is_missing(monkeypatch):
    monkeypatch.delitem(sys.modules, acceleration.KERNELS)
    monkeypatch.setitem(sys.modules, "numba", None)
    acceleration._kernels.cache_clear()
    assert acceleration.kernels(acceleration.LEAST_PAIRS) is None
    acceleration._kernels.cache_clear()


def test_little_work_does_not_load_the_kernels(monkeypatch):
    monkeypatch.delitem(sys.modules, acceleration.KERNELS)
    assert acceleration.kernels(acceleration.LEAST_PAIRS - 1) is None
    assert acceleration.kernels(acceleration.LEAST_PAIRS) is not None
