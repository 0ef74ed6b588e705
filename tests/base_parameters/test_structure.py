"""Rank, null space and columns without effect, on matrices whose rank is known."""

import numpy as np
import pytest
from choice_problems import parameters
from hypothesis import given, strategies as st

from loopid.base_parameters import SEARCHES, find_base
from loopid.base_parameters.structure import analyse
from loopid.observation import Observation
from loopid.parameters import GRAVITY_KINDS, KINDS, ParameterSet

SEEDS = st.integers(0, 10**6)


def observe(W, **options):
    return Observation.from_matrix(W, parameters(W.shape[1]), **options)


@st.composite
def matrices_of_rank(draw, largest=10):
    """W (rows, n) of a known rank r <= n, none of its columns zero, and that rank."""
    n = draw(st.integers(1, largest))
    r = draw(st.integers(1, n))
    rng = np.random.default_rng(draw(SEEDS))
    return rng.normal(size=(r + 12, r)) @ rng.normal(size=(r, n)), r


@given(matrices_of_rank())
def test_rank_and_null_space(matrix_and_rank):
    W, r = matrix_and_rank
    n = W.shape[1]
    found = analyse(observe(W))
    V2, F = found.null_basis, found.row_factor
    assert found.rank == r
    assert V2.shape == (n, n - r)
    assert F.shape == (r, n)
    np.testing.assert_allclose(V2.T @ V2, np.eye(n - r), atol=1e-12)
    np.testing.assert_allclose(W @ V2, 0, atol=1e-9 * np.linalg.norm(W))
    np.testing.assert_allclose(F.T @ F, W.T @ W, atol=1e-12 * np.linalg.norm(W) ** 2)
    assert found.columns.tolist() == list(range(n))
    assert found.parameters == parameters(n)


@given(matrices_of_rank(), st.sets(st.integers(0, 9), min_size=1, max_size=5))
def test_columns_without_effect_are_left_out(matrix_and_rank, places):
    W, r = matrix_and_rank
    padded = W
    zero = sorted(place for place in places if place <= W.shape[1])
    for place in zero:
        padded = np.insert(padded, place, 1e-16 * W[:, 0], axis=1)
    found = analyse(observe(padded))
    kept = [j for j in range(padded.shape[1]) if np.linalg.norm(padded[:, j]) > 1e-10]
    assert found.columns.tolist() == kept
    assert found.parameters.labels == parameters(padded.shape[1]).select(kept).labels
    assert found.rank == r


@pytest.mark.parametrize("unit", [1e-3, 1e3, 1e6])
def test_a_robot_in_other_units_of_length_has_the_same_structure(unit):
    """Lengths in mm: a column per kg mm² is 1e-6 of the one per kg m², the same in effect."""
    rng = np.random.default_rng(0)
    labels = ParameterSet.of_links(["arm", "hand"], KINDS)
    W = rng.normal(size=(60, 12)) @ rng.normal(size=(12, 20))
    W[:, [4, 13]] *= 1e-4  # inertias and moments that hardly matter
    W[:, [0, 17]] = 1e-14 * rng.normal(size=(60, 2))  # and some that do not at all
    metres = analyse(Observation.from_matrix(W, labels, length=0.7))
    rescaled = W / unit ** labels.length_powers.astype(float)
    others = analyse(Observation.from_matrix(rescaled, labels, length=0.7 * unit))
    assert metres.columns.tolist() == [j for j in range(20) if j not in (0, 17)]
    assert others.columns.tolist() == metres.columns.tolist()
    assert others.rank == metres.rank == 12


@given(matrices_of_rank())
def test_rank_gap_is_the_ratio_of_neighbouring_singular_values(matrix_and_rank):
    W, r = matrix_and_rank
    values = np.linalg.svd(W, compute_uv=False)
    found = analyse(observe(W))
    own = found.singular_values
    np.testing.assert_allclose(own, values / values[0], atol=1e-12)
    below = own[r] if r < len(own) else 0.0
    assert found.rank_gap == pytest.approx(own[r - 1] / max(below, np.finfo(float).eps))


@pytest.mark.parametrize("search", SEARCHES)
def test_full_rank_leaves_nothing_to_choose(search):
    W = np.random.default_rng(3).normal(size=(30, 6))
    found = find_base(observe(W), search)
    assert found.structure.rank == len(found) == 6
    assert found.dependent.size == 0
    assert found.search.dependent == ()
    assert found.search.certified
    assert found.search.condition_number == found.nullspace_condition_number == 1.0
    np.testing.assert_array_equal(found.matrix, np.eye(6))


@pytest.mark.parametrize("search", ["exact", "qr"])
@pytest.mark.parametrize("criterion", ["nullspace", "regressor"])
def test_rank_one_keeps_one_parameter(search, criterion):
    column, row = np.random.default_rng(4).normal(size=(2, 7))
    found = find_base(observe(np.outer(column, row)), search, criterion=criterion)
    assert len(found) == 1
    assert found.condition_number == pytest.approx(1.0)
    np.testing.assert_allclose(found.matrix, [row / row[found.base[0]]], rtol=1e-12)


def test_a_single_column():
    links = ParameterSet.of_links(["bob"], GRAVITY_KINDS).select([1])
    found = find_base(Observation.from_matrix(np.ones((3, 1)), links))
    assert found.expressions == ("bob.mx",)


@pytest.mark.parametrize("small", [1e-3, 1e-6])
def test_round_off_of_a_small_column_is_no_evidence_of_rank(small):
    """It depends on the others, but for round-off as large as theirs."""
    rng = np.random.default_rng(0)
    W = rng.normal(size=(60, 4)) @ rng.normal(size=(4, 9))
    W[:, 3] *= small
    W[:, 3] += 1e-16 * rng.normal(size=60)
    assert analyse(observe(W)).rank == 4


def test_a_decomposition_that_does_not_converge_is_done_in_another_way(monkeypatch):
    # Which matrices LAPACK's divide and conquer fails for depends on the processor.
    W = np.random.default_rng(0).normal(size=(30, 4)) @ np.random.default_rng(1).normal(size=(4, 9))
    expected = analyse(observe(W))

    def fails(matrix, **options):
        raise np.linalg.LinAlgError("SVD did not converge")

    monkeypatch.setattr(np.linalg, "svd", fails)
    found = analyse(observe(W))
    assert found.rank == expected.rank == 4
    np.testing.assert_allclose(W @ found.null_basis, 0, atol=1e-12 * np.linalg.norm(W))
    np.testing.assert_allclose(found.singular_values, expected.singular_values, atol=1e-12)
