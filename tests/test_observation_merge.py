"""Observations in parts: merged, they are the observation of all rows."""

import numpy as np
import pytest

from loopid import Observation, ParameterSet
from loopid.errors import DataError

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
