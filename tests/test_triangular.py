"""Triangular factors keep all inner products, whatever columns rows have and how they come."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from loopid.triangular import RowFactors, triangular_factor

seeds = st.integers(0, 2**32 - 1)


def tree_like(seed, count, dof, width):
    """Samples (N, dof, n) whose rows have some of the columns each, with zeros here and there."""
    generator = np.random.default_rng(seed)
    present = generator.random((dof, width)) < 0.5
    values = generator.normal(size=(count, dof, width))
    return values * present * (generator.random(values.shape) < 0.7)


@given(st.integers(0, 40), st.integers(1, 4), st.integers(1, 7), seeds)
def test_rows_on_their_own_columns_make_the_factor_of_all(count, dof, width, seed):
    W = tree_like(seed, count, dof, width)
    reduced = RowFactors(width)
    reduced.add(W)
    R = reduced.factor()
    assert reduced.rows == count * dof
    assert R.shape == (width, width)
    np.testing.assert_array_equal(R, np.triu(R))
    np.testing.assert_allclose(R.T @ R, np.einsum("ndi,ndj->ij", W, W), atol=1e-11)


@given(st.lists(st.integers(0, 9), min_size=1, max_size=6), st.integers(1, 3), seeds)
def test_columns_may_turn_up_in_a_later_part(lengths, dof, seed):
    width = 6
    parts = [tree_like([seed, k], length, dof, width) for k, length in enumerate(lengths)]
    reduced = RowFactors(width)
    for part in parts:
        reduced.add(part)
    whole = np.concatenate(parts).reshape(-1, width)
    np.testing.assert_allclose(reduced.factor().T @ reduced.factor(), whole.T @ whole, atol=1e-11)


@given(st.integers(1, 3), st.integers(1, 30), st.integers(1, 5), seeds)
def test_stacked_matrices_are_factored_each(stack, rows, width, seed):
    W = np.random.default_rng(seed).normal(size=(stack, rows, width))
    for R, matrix in zip(triangular_factor(W), W, strict=True):
        np.testing.assert_allclose(R.T @ R, matrix.T @ matrix, atol=1e-11)


def test_blocks_longer_than_the_cache_are_joined():
    W = tree_like(0, 2500, 2, 5)
    reduced = RowFactors(5)
    reduced.add(W)
    expected = np.einsum("ndi,ndj->ij", W, W)
    np.testing.assert_allclose(
        reduced.factor().T @ reduced.factor(), expected, rtol=1e-10, atol=1e-9
    )


@pytest.mark.parametrize("row", [0, 30, 899])
def test_a_column_counts_wherever_it_is_not_zero(row):
    W = np.random.default_rng(0).standard_normal((900, 7))
    W[:, 3] = 0.0
    W[row, 3] = 2.0
    R = triangular_factor(W)
    np.testing.assert_allclose(R.T @ R, W.T @ W, atol=1e-12 * np.abs(W.T @ W).max())
