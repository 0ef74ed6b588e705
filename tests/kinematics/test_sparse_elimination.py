"""Inverses by one order of pivots for all samples, and how their error is told."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from loopid.kinematics.dependent import FEW, DependentColumns
from loopid.kinematics.elimination import Elimination, inversion_error

seeds = st.integers(0, 2**32 - 1)
LEGS, COUNT = 3, 40


def legs(generator, count=COUNT):
    """Matrices (9, 9, N): each three rows have two columns of their own, and three in common."""
    matrices = generator.standard_normal((9, 9, count))
    rows, columns = np.indices((9, 9))
    own = (columns // 2 == rows // 3) | (columns >= 2 * LEGS)
    return matrices * own[:, :, None]


def multiplied(one, two):
    return np.einsum("ijn,jkn->ikn", one, two)


@given(seed=seeds)
@settings(max_examples=30)
def test_inverses_are_inverses(seed):
    matrices = legs(np.random.default_rng(seed))
    inverses, signs = Elimination.of(matrices[:, :, :8]).inverses(matrices)
    expected = np.moveaxis(np.linalg.inv(np.moveaxis(matrices, 2, 0)), 0, 2)
    condition = np.linalg.cond(np.moveaxis(matrices, 2, 0))
    error = np.abs(inverses - expected).max(axis=(0, 1)) / np.abs(expected).max(axis=(0, 1))
    assert (error < 1e-10 * condition).all()
    determinants = np.linalg.det(np.moveaxis(matrices, 2, 0))
    np.testing.assert_array_equal(signs, np.sign(determinants))


@pytest.mark.parametrize("size", [1, 2, 5])
def test_full_matrices_of_any_size_are_inverted(size):
    matrices = np.random.default_rng(size).standard_normal((size, size, COUNT))
    inverses, signs = Elimination.of(matrices[:, :, :8]).inverses(matrices)
    one = np.broadcast_to(np.eye(size)[:, :, None], inverses.shape)
    np.testing.assert_allclose(multiplied(inverses, matrices), one, atol=1e-10)
    np.testing.assert_array_equal(signs, np.linalg.slogdet(np.moveaxis(matrices, 2, 0))[0])


def test_no_arithmetic_is_spent_on_zeros_that_stay():
    matrices = legs(np.random.default_rng(0))
    dense = Elimination.of(np.random.default_rng(0).standard_normal((9, 9, 8)))
    work = [
        sum(step.rest.size * len(step.pivots) + len(step.pivots) ** 3 for step in elimination.steps)
        for elimination in (Elimination.of(matrices[:, :, :8]), dense)
    ]
    assert work[0] < 0.5 * work[1]


@given(seed=seeds)
@settings(max_examples=30)
def test_the_error_of_an_inverse_is_seen(seed):
    generator = np.random.default_rng(seed)
    matrices = legs(generator)
    inverses = np.moveaxis(np.linalg.inv(np.moveaxis(matrices, 2, 0)), 0, 2)
    wrong = inverses + 1e-6 * generator.standard_normal(inverses.shape)
    true_error = np.linalg.norm(multiplied(wrong, matrices) - np.eye(9)[:, :, None], axis=(0, 1))
    told = inversion_error(matrices, wrong)
    assert (told > 1e-3 * true_error).all()


def solved_both_ways(matrices, right, typical):
    columns = DependentColumns.of(matrices, Elimination.of(typical), 1e-3)
    alone = DependentColumns.of(matrices, None, 1e-3)
    return columns, columns.solve(right), alone.solve(right)


@given(seed=seeds)
@settings(max_examples=20)
def test_solutions_are_those_by_singular_values(seed):
    generator = np.random.default_rng(seed)
    matrices, right = legs(generator), generator.standard_normal((9, 2, COUNT))
    columns, found, expected = solved_both_ways(matrices, right, matrices[:, :, :8])
    size = np.abs(expected).max(axis=(0, 1))
    values = np.linalg.svd(np.moveaxis(matrices, 2, 0), compute_uv=False)
    condition = values[:, 0] / values[:, -1]
    assert (
        np.abs(found - expected).max(axis=(0, 1)) < 1e-11 * size + 1e-13 * condition * size
    ).all()
    # What passes without doubt is clear of the bound.
    sure = np.setdiff1d(np.arange(COUNT), columns.doubtful)
    assert (condition[sure] < 1e3).all()
    assert len(sure) > COUNT / 2


@pytest.mark.parametrize("spoilt", ["singular", "unsuited"])
def test_samples_that_the_pivots_do_not_suit_are_solved_otherwise(spoilt):
    generator = np.random.default_rng(1)
    matrices, right = legs(generator), generator.standard_normal((9, 1, COUNT))
    typical = matrices[:, :, :8].copy()
    if spoilt == "singular":
        matrices[:, 0, 20] = 0.0
    else:
        matrices[:, :, 20] = np.eye(9)[::-1]  # regular, but zero at the pivots
    columns, found, expected = solved_both_ways(matrices, right, typical)
    assert 20 in columns.doubtful
    np.testing.assert_array_equal(found[:, :, 20], expected[:, :, 20])
    assert np.isfinite(found).all()


def test_few_samples_are_all_in_doubt():
    matrices = legs(np.random.default_rng(2), FEW - 1)
    columns = DependentColumns.of(matrices, Elimination.of(matrices), 1e-3)
    assert columns.inverses is None
    np.testing.assert_array_equal(columns.doubtful, np.arange(FEW - 1))
