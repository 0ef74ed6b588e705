"""Batched solves: least squares of minimum norm, with the rank told first."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from loopid.kinematics import Factorisation
from loopid.kinematics.projection import Solver, null_space

sizes = st.integers(1, 6)
seeds = st.integers(0, 2**32 - 1)


def low_rank(generator, count, rows, columns, rank):
    """Random matrices of a rank, with singular values between 0.1 and 10."""
    left = np.linalg.qr(generator.normal(size=(count, rows, rank)))[0]
    right = np.linalg.qr(generator.normal(size=(count, columns, rank)))[0]
    values = 10 ** generator.uniform(-1, 1, size=(count, 1, rank))
    return (left * values) @ right.transpose(0, 2, 1)


@given(sizes, sizes, st.data(), seeds)
def test_solutions_are_those_of_the_pseudo_inverse(rows, columns, data, seed):
    rank = data.draw(st.integers(1, min(rows, columns)))
    generator = np.random.default_rng(seed)
    matrices = low_rank(generator, 3, rows, columns, rank)
    right_hand_sides = generator.normal(size=(3, rows, 2))
    factors = Factorisation.of(matrices)
    np.testing.assert_array_equal(factors.rank, rank)
    expected = np.linalg.pinv(matrices, rcond=1e-8) @ right_hand_sides
    np.testing.assert_allclose(factors.solve(right_hand_sides), expected, atol=1e-10)


@given(sizes, seeds, st.floats(1e-12, 1e12))
def test_the_rank_does_not_depend_on_the_unit(size, seed, unit):
    matrices = low_rank(np.random.default_rng(seed), 2, size, size, max(1, size - 1))
    assert (Factorisation.of(unit * matrices).rank == Factorisation.of(matrices).rank).all()


def test_a_zero_matrix_has_rank_zero_and_solution_zero():
    factors = Factorisation.of(np.zeros((2, 3, 4)))
    np.testing.assert_array_equal(factors.rank, 0)
    np.testing.assert_array_equal(factors.solve(np.ones((2, 3, 1))), np.zeros((2, 4, 1)))


def test_systems_without_equations_or_unknowns_are_solved():
    for rows, columns in ((0, 4), (3, 0), (0, 0)):
        factors = Factorisation.of(np.empty((2, rows, columns)))
        np.testing.assert_array_equal(factors.rank, 0)
        solution = factors.solve(np.ones((2, rows, 1)))
        np.testing.assert_array_equal(solution, np.zeros((2, columns, 1)))


@given(sizes, st.integers(0, 2), seeds)
def test_regular_matrices_are_inverted_and_others_told(size, more, seed):
    generator = np.random.default_rng(seed)
    matrices = low_rank(generator, 6, size + more, size, size)
    matrices[4] = low_rank(generator, 1, size + more, size, max(size - 1, 1))[0]
    solver = Solver.of(matrices, 1e-3)
    values = np.linalg.svd(matrices, compute_uv=False)
    ill_conditioned = np.flatnonzero(values[:, -1] < 1e-3 * values[:, 0])
    assert set(ill_conditioned) <= set(solver.ill_conditioned)
    assert more or not len(Solver.of(matrices[:4], 1e-3).ill_conditioned)
    right = generator.normal(size=(6, size + more, 2))
    expected = np.linalg.pinv(matrices, rcond=1e-8) @ right
    np.testing.assert_allclose(solver.solve(right), expected, atol=1e-9)


def test_an_exactly_singular_matrix_spoils_no_other():
    matrices = np.stack([np.eye(2), np.zeros((2, 2)), 2 * np.eye(2)])
    found = Solver.of(matrices, 1e-3).solve(np.ones((3, 2, 1)))
    np.testing.assert_allclose(found[:, 0, 0], [1.0, 0.0, 0.5])


def test_blocks_are_solved_as_the_whole_matrix_is():
    generator = np.random.default_rng(4)
    matrices, rows, columns = np.zeros((3, 31, 23)), generator.permutation(31), np.arange(23)
    shapes = ((3, 2), (3, 2), (9, 6), (3, 2), (4, 5), (6, 5))
    r = c = 0
    for m, n in shapes:  # the last rows have no columns, the last column no rows
        matrices[:, rows[r : r + m, None], columns[c : c + n]] = generator.normal(size=(3, m, n))
        r, c = r + m, c + n
    matrices[:, rows[2]] = matrices[:, rows[1]]  # redundant
    b = generator.normal(size=(3, 31, 2))
    found = Factorisation.of(matrices)
    assert len(found.blocks) > 1
    np.testing.assert_allclose(found.solve(b), np.linalg.pinv(matrices) @ b, atol=1e-12)
    values = np.linalg.svd(matrices, compute_uv=False)
    np.testing.assert_allclose(found.values[:, :21], values[:, :21], rtol=1e-12)
    np.testing.assert_array_equal(found.rank, np.linalg.matrix_rank(matrices))
    space = null_space(matrices[0])
    np.testing.assert_allclose(space.T @ space, np.eye(23 - found.rank[0]), atol=1e-12)
    np.testing.assert_allclose(matrices[0] @ space, 0, atol=1e-12)
