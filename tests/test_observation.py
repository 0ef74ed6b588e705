"""An observation is the triangular factor of its stacked rows, however they come."""

from dataclasses import FrozenInstanceError

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from loopid import Observation, ParameterSet
from loopid.errors import DataError

seeds = st.integers(0, 2**32 - 1)


def named(width):
    return ParameterSet.from_labels(f"link{j}.m" for j in range(width))


def random_matrix(seed, *shape):
    return np.random.default_rng(seed).normal(size=shape)


@given(st.integers(1, 30), st.integers(1, 8), seeds)
def test_the_factor_keeps_all_inner_products(rows, width, seed):
    W = random_matrix(seed, rows, width)
    observation = Observation.from_matrix(W, named(width))
    R = observation.factor
    assert R.shape == (width, width)
    assert observation.rows == rows
    np.testing.assert_array_equal(R, np.triu(R))
    np.testing.assert_allclose(R.T @ R, W.T @ W, atol=1e-12)


@given(st.integers(1, 6), st.integers(1, 4), st.integers(1, 5), seeds)
def test_samples_of_several_rows_are_stacked(count, dof, width, seed):
    W = random_matrix(seed, count, dof, width)
    whole = Observation.from_matrix(W, named(width), keep_matrix=True)
    assert whole.rows == count * dof
    np.testing.assert_array_equal(whole.matrix, W.reshape(-1, width))
    np.testing.assert_allclose(
        whole.factor.T @ whole.factor, np.einsum("ndi,ndj->ij", W, W), atol=1e-12
    )


@given(st.lists(st.integers(0, 7), min_size=1, max_size=5).filter(any), st.integers(1, 4), seeds)
def test_parts_make_the_same_observation_as_the_whole(lengths, width, seed):
    W = random_matrix(seed, sum(lengths), width)
    parts = np.split(W, np.cumsum(lengths)[:-1])
    whole = Observation.from_matrix(W, named(width), 2.0, keep_matrix=True)
    joined = Observation.from_parts(iter(parts), named(width), 2.0, keep_matrix=True)
    assert (joined.rows, joined.length) == (whole.rows, whole.length) == (len(W), 2.0)
    np.testing.assert_array_equal(joined.matrix, W)
    np.testing.assert_allclose(joined.factor.T @ joined.factor, W.T @ W, atol=1e-12)


def test_the_matrix_is_kept_only_on_request():
    W = random_matrix(0, 5, 2)
    assert Observation.from_matrix(W, named(2)).matrix is None
    assert Observation.from_matrix(W, named(2)).parameters == named(2)


def test_an_observation_cannot_be_changed():
    W = random_matrix(0, 5, 2)
    observation = Observation.from_matrix(W, named(2), keep_matrix=True)
    for array in (observation.factor, observation.matrix):
        with pytest.raises(ValueError, match="read-only"):
            array[0, 0] = 1.0
    with pytest.raises(FrozenInstanceError):
        observation.rows = 3
    kept = W.copy()
    W[:] = 0.0
    np.testing.assert_array_equal(observation.matrix, kept)


@pytest.mark.parametrize(
    ("matrix", "problem"),
    [
        (np.zeros((3, 4)), r"2 columns, not shape \(3, 4\)"),
        (np.zeros(2), r"2 columns, not shape \(2,\)"),
        (np.zeros((1, 1, 1, 2)), r"2 columns, not shape \(1, 1, 1, 2\)"),
        (np.zeros((0, 2)), "no rows"),
        (np.array([[0.0, 1.0], [np.nan, 0.0]]), r"finite, but entry \(1, 0\) is nan"),
        (np.array([[0.0, -np.inf]]), r"finite, but entry \(0, 1\) is -inf"),
        ([["a", "b"]], "must be numbers"),
    ],
)
def test_bad_matrices_are_refused(matrix, problem):
    with pytest.raises(DataError, match=f"observation matrix.*{problem}"):
        Observation.from_matrix(matrix, named(2))


def test_an_observation_without_parts_is_refused():
    with pytest.raises(DataError, match="no rows"):
        Observation.from_parts(iter([]), named(2))


NAMES = ParameterSet.from_labels([f"link{j}.m" for j in range(5)])


def part(seed, rows, keep=False, **options):
    W = np.random.default_rng(seed).normal(size=(rows, 5)) * [1, 10, 1e-3, 1, 1]
    W[:, 4] = W[:, 0] - 2 * W[:, 1]
    return W, Observation.from_matrix(W, NAMES, keep_matrix=keep, **options)


def assert_observes(observation, W):
    scale = np.linalg.norm(W, axis=0)
    squares = observation.factor.T @ observation.factor / np.outer(scale, scale)
    np.testing.assert_allclose(squares, W.T @ W / np.outer(scale, scale), atol=1e-13)
    np.testing.assert_array_equal(np.tril(observation.factor, -1), 0.0)
    assert observation.rows == len(W)


def test_merging_is_stacking_whatever_the_order():
    (A, a), (B, b), (C, c) = part(0, 40), part(1, 3), part(2, 200)
    W = np.concatenate([A, B, C])
    for merged in (a.merge(b).merge(c), a.merge(b.merge(c)), c.merge(a).merge(b)):
        assert_observes(merged, W)
        assert merged.parameters == NAMES


def test_the_matrix_is_kept_where_both_keep_it():
    (A, a), (B, b) = part(0, 40, True), part(1, 30, True)
    np.testing.assert_array_equal(a.merge(b).matrix, np.concatenate([A, B]))
    assert a.merge(part(1, 30)[1]).matrix is None


@pytest.mark.parametrize("size", [1, 7, 64])
def test_blocks_of_a_matrix_make_its_factor(monkeypatch, size):
    monkeypatch.setattr("loopid.scratch.BLOCK_ROWS", size)
    W, observation = part(0, 150)
    assert_observes(observation, W)


@pytest.mark.parametrize("option", [{"length": 2.0}, {"natural_size": 3.0}])
def test_observations_of_other_robots_are_not_merged(option):
    _, one = part(0, 10)
    _, other = part(1, 10, **option)
    with pytest.raises(DataError, match=f"must have the same {next(iter(option))}"):
        one.merge(other)
