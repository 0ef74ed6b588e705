"""The triangular factor: as exact as Householder's method on the whole matrix."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from loopid import observation
from loopid.observation import add_rows, triangular_factor

EPS = np.finfo(float).eps
seeds = st.integers(0, 2**32 - 1)
shapes = st.sampled_from([(1, 1), (3, 7), (7, 3), (40, 12), (300, 30), (1200, 20), (2500, 9)])


def backward_error(matrix, factor):
    """Of RᵀR against WᵀW, relative to the sizes of the columns, in units of round-off."""
    size = np.linalg.norm(matrix, axis=0)
    size = np.where(size > 0, size, 1.0)
    return np.abs((factor.T @ factor - matrix.T @ matrix) / np.outer(size, size)).max() / EPS


@given(shape=shapes, seed=seeds, spread=st.floats(0, 12))
@settings(max_examples=60)
def test_it_has_the_scalar_products_of_the_columns(shape, seed, spread):
    generator = np.random.default_rng(seed)
    matrix = generator.standard_normal(shape) * 10 ** generator.uniform(-spread, 0, shape[1])
    factor = triangular_factor(matrix)
    assert factor.shape == (shape[1], shape[1])
    np.testing.assert_array_equal(factor, np.triu(factor))
    assert backward_error(matrix, factor) < 10 * np.sqrt(shape[0] * shape[1])


@given(seed=seeds, rank=st.integers(1, 11))
@settings(max_examples=30)
def test_small_singular_values_survive_that_normal_equations_lose(seed, rank):
    generator = np.random.default_rng(seed)
    left, right = (np.linalg.qr(generator.standard_normal(s))[0] for s in ((2300, 12), (12, 12)))
    values = np.r_[np.ones(rank), np.full(12 - rank, 1e-12)]
    found = np.linalg.svd(triangular_factor(left * values @ right), compute_uv=False)
    np.testing.assert_allclose(found, values, rtol=1e-2, atol=0)


@given(seed=seeds)
@settings(max_examples=20)
def test_columns_of_zeros_are_zero_and_change_nothing(seed):
    generator = np.random.default_rng(seed)
    matrix = generator.standard_normal((1100, 14))
    zero = generator.permutation(14)[:5]
    matrix[:, zero] = 0.0
    factor, kept = triangular_factor(matrix), np.setdiff1d(np.arange(14), zero)
    assert not factor[:, zero].any()
    assert not factor[zero].any()
    np.testing.assert_array_equal(factor[np.ix_(kept, kept)], triangular_factor(matrix[:, kept]))


def test_rows_taken_at_a_time_do_not_matter(monkeypatch):
    matrix = np.random.default_rng(3).standard_normal((500, 20))
    whole = np.abs(triangular_factor(matrix))
    for rows in (20, 33, 499):
        monkeypatch.setattr(observation, "ROWS", rows)
        np.testing.assert_allclose(np.abs(triangular_factor(matrix)), whole, rtol=1e-11, atol=1e-12)


def test_each_matrix_of_a_stack_has_its_own():
    stack = np.random.default_rng(4).standard_normal((2, 3, 50, 6))
    factors = triangular_factor(stack)
    for k in np.ndindex(2, 3):
        np.testing.assert_array_equal(factors[k], triangular_factor(stack[k]))


@pytest.mark.parametrize("shape", [(0, 4), (4, 0), (0, 5, 3), (5, 4)])
def test_nothing_gives_zeros(shape):
    factor = triangular_factor(np.zeros(shape))
    assert factor.shape == (*shape[:-2], shape[-1], shape[-1])
    assert not factor.any()


def test_the_matrix_is_left_as_it_was():
    matrix = np.asfortranarray(np.random.default_rng(5).standard_normal((60, 8)))
    before = matrix.copy()
    triangular_factor(matrix)
    np.testing.assert_array_equal(matrix, before)


@pytest.mark.parametrize("row", [0, 30, 899])
def test_a_column_counts_wherever_it_is_not_zero(row):
    W = np.random.default_rng(0).standard_normal((900, 7))
    W[:, 3] = 0.0
    W[row, 3] = 2.0
    R = triangular_factor(W)
    np.testing.assert_allclose(R.T @ R, W.T @ W, atol=1e-12 * np.abs(W.T @ W).max())


@given(st.lists(st.integers(0, 9), min_size=1, max_size=6), st.integers(1, 3), seeds)
def test_rows_come_in_parts_and_columns_turn_up_later(lengths, dof, seed):
    generator, width = np.random.default_rng(seed), 6
    present = generator.random((len(lengths), dof, 1, width)) < 0.5
    pairs = zip(lengths, present, strict=True)
    parts = [generator.normal(size=(dof, n, width)) * some for n, some in pairs]
    factors = np.zeros((dof, width, width))
    for part in parts:
        add_rows(factors, part)
    whole = np.concatenate(parts, axis=1)
    expected = whole.swapaxes(1, 2) @ whole
    np.testing.assert_allclose(factors.swapaxes(1, 2) @ factors, expected, atol=1e-11)
    np.testing.assert_array_equal(factors, np.triu(factors))
