"""An observation is the triangular factor of its rows, however they come, to round-off."""

import pickle
from dataclasses import FrozenInstanceError

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

import loopid
from loopid.base_parameters.structure import analyse
from loopid.errors import DataError
from loopid.observation import Observation, StackedRows, add_rows, triangular_factor
from loopid.parameters import ParameterSet
from loopid.regressors import structural_observation

EPS = np.finfo(float).eps
seeds = st.integers(0, 2**32 - 1)
shapes = st.sampled_from([(1, 1), (3, 7), (7, 3), (40, 12), (300, 30), (1200, 20), (2500, 9)])


def backward_error(matrix, factor):
    """Of RᵀR against WᵀW, relative to the sizes of the columns, in units of round-off."""
    size = np.linalg.norm(matrix, axis=0)
    size = np.where(size > 0, size, 1.0)
    return np.abs((factor.T @ factor - matrix.T @ matrix) / np.outer(size, size)).max() / EPS


@given(shape=shapes, seed=seeds, spread=st.floats(0, 12))
@settings(max_examples=10)
def test_it_has_the_scalar_products_of_the_columns(shape, seed, spread):
    generator = np.random.default_rng(seed)
    matrix = generator.standard_normal(shape) * 10 ** generator.uniform(-spread, 0, shape[1])
    factor = triangular_factor(matrix)
    assert factor.shape == (shape[1], shape[1])
    np.testing.assert_array_equal(factor, np.triu(factor))
    assert backward_error(matrix, factor) < 10 * np.sqrt(shape[0] * shape[1])


@given(seed=seeds, rank=st.integers(1, 11))
@settings(max_examples=10)
def test_small_singular_values_survive_that_normal_equations_lose(seed, rank):
    generator = np.random.default_rng(seed)
    left, right = (np.linalg.qr(generator.standard_normal(s))[0] for s in ((2300, 12), (12, 12)))
    values = np.r_[np.ones(rank), np.full(12 - rank, 1e-12)]
    found = np.linalg.svd(triangular_factor(left * values @ right), compute_uv=False)
    np.testing.assert_allclose(found, values, rtol=1e-2, atol=0)


@given(seed=seeds)
@settings(max_examples=10)
def test_columns_of_zeros_are_zero_and_change_nothing(seed):
    generator = np.random.default_rng(seed)
    matrix = generator.standard_normal((1100, 14))
    zero = generator.permutation(14)[:5]
    matrix[:, zero] = 0.0
    factor, kept = triangular_factor(matrix), np.setdiff1d(np.arange(14), zero)
    assert not factor[:, zero].any()
    assert not factor[zero].any()
    np.testing.assert_array_equal(factor[np.ix_(kept, kept)], triangular_factor(matrix[:, kept]))


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


def named(width):
    return ParameterSet.from_labels(f"link{j}.m" for j in range(width))


def of_parts(parts, width, driven=None, **units):
    rows = StackedRows(named(width), driven)
    for part in parts:
        rows.add(part)
    return rows.observation(**units)


def random_matrix(seed, *shape):
    return np.random.default_rng(seed).normal(size=shape)


@given(st.lists(st.integers(0, 7), min_size=1, max_size=5).filter(any), st.integers(1, 4), seeds)
def test_parts_make_the_same_observation_as_the_whole(lengths, width, seed):
    W = random_matrix(seed, sum(lengths), width)
    parts = np.split(W, np.cumsum(lengths)[:-1])
    whole = Observation.from_matrix(W, named(width), length=2.0)
    joined = of_parts(parts, width, length=2.0)
    assert (joined.rows, joined.length) == (whole.rows, whole.length) == (len(W), 2.0)
    np.testing.assert_allclose(joined.factor.T @ joined.factor, W.T @ W, atol=1e-12)


def test_an_observation_cannot_be_changed():
    W = random_matrix(0, 5, 2)
    observation = Observation.from_matrix(W, named(2))
    with pytest.raises(ValueError, match="read-only"):
        observation.factor[0, 0] = 1.0
    with pytest.raises(FrozenInstanceError):
        observation.rows = 3


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
    with pytest.raises(DataError, match=f"matrix.*{problem}"):
        Observation.from_matrix(matrix, named(2))


def test_an_observation_without_parts_is_refused():
    with pytest.raises(DataError, match="no rows"):
        of_parts([], 2)


def test_samples_of_several_rows_are_stacked():
    W = random_matrix(0, 6, 4, 5)
    whole = Observation.from_matrix(W, named(5))
    assert whole.rows == 24
    rows = W.reshape(-1, 5)
    np.testing.assert_allclose(whole.factor.T @ whole.factor, rows.T @ rows, atol=1e-12)


def test_what_the_motors_alone_feel_are_the_first_rows_of_each_sample():
    W = random_matrix(0, 40, 3, 5)
    alone = of_parts([W[:7], W[7:]], 5, driven=2).motors_alone
    rows = W[:, :2].reshape(-1, 5)
    assert alone.rows == 80
    np.testing.assert_allclose(alone.factor.T @ alone.factor, rows.T @ rows, atol=1e-12)


def test_an_unclear_rank_is_decided_by_four_times_as_many_samples():
    """Those that there were, and others."""
    observation = structural_observation(loopid.load("four_bar"), samples=20, seed=3)
    before = observation.unit_motions
    found = before.draws.more()
    assert found == pickle.loads(pickle.dumps(before.draws)).more()
    after = found.unit_motions or found
    assert after.rows == 4 * before.rows
    one, all_four = (each.factor.T @ each.factor for each in (before, after))
    least, *_, most = np.linalg.eigvalsh(all_four - one)
    assert least > -1e-9 * most
    assert np.abs(all_four - 4 * one).max() > 0.01 * np.abs(one).max()


def test_observations_are_records():
    """Of the same robot they are equal, also after a pickle, and then have the same rank."""
    robot = loopid.load("four_bar")
    one, other = (structural_observation(robot, "full", samples=60, seed=3) for _ in range(2))
    copy = pickle.loads(pickle.dumps(one))
    assert one == other == copy
    assert hash(one) == hash(copy)
    assert one != structural_observation(robot, "full", samples=60, seed=4)
    assert analyse(copy) == analyse(one)
    assert len(repr(one).splitlines()) <= 10
    again, drawn = (each.unit_motions.draws for each in (copy, one))
    np.testing.assert_array_equal(again.rounded(2), drawn.rounded(2))
    names = one.parameters
    assert names == pickle.loads(pickle.dumps(names))
    assert hash(names) == hash(ParameterSet.from_labels(names.labels))
