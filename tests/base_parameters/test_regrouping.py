"""Regrouping loses no force, whichever valid parameters are made dependent."""

import warnings

import numpy as np
import pytest
from choice_problems import BASES, brute_force, parameters, structures
from hypothesis import given, settings, strategies as st

import loopid
from bank_robots import few_of
from loopid.base_parameters import ChoiceProblem, find_base
from loopid.base_parameters.choice import condition_numbers
from loopid.base_parameters.structure import base_columns, regrouping_matrix
from loopid.errors import AccuracyWarning
from loopid.observation import Observation

SEEDS = st.integers(0, 10**6)


@pytest.mark.parametrize("bases", BASES.values(), ids=BASES)
@given(data=st.data())
@settings(max_examples=10)
def test_forces_stay_the_same_for_every_valid_choice(bases, data):
    found = data.draw(structures(bases))
    brute = brute_force(ChoiceProblem(found))
    valid = brute.choices[brute.conditions < 1e5]
    D = valid[data.draw(st.integers(0, len(valid) - 1))] if len(valid) else brute.tied[0]
    B = base_columns(len(found.null_basis), D)
    assert sorted([*B, *D]) == list(range(len(found.null_basis)))
    W = found.row_factor
    phi = np.random.default_rng(data.draw(SEEDS)).normal(size=W.shape[1])
    beta = regrouping_matrix(found.null_basis, D)
    scale = np.linalg.norm(W) * (1 + np.linalg.norm(beta)) * np.linalg.norm(phi)
    forces = W[:, B] @ (phi[B] + beta @ phi[D])
    np.testing.assert_allclose(forces, W @ phi, atol=1e-8 * scale)


def test_coefficients_that_are_round_off_are_zero():
    """Rows 2 and 3 are -1/3 of row 0, and have nothing to do with row 1."""
    null_basis = np.linalg.qr(np.array([[3.0, 0], [0, 3], [1, 0], [1, 1e-12]]))[0]
    beta = regrouping_matrix(null_basis, np.array([0, 1]))
    np.testing.assert_allclose(beta, [[-1 / 3, 0], [-1 / 3, 0]], rtol=1e-12)
    assert beta[0, 1] == beta[1, 1] == 0.0


@st.composite
def observed(draw):
    """A regressor W of deficient rank and its base parameters."""
    n = draw(st.integers(2, 10))
    r = draw(st.integers(1, n - 1))
    rng = np.random.default_rng(draw(SEEDS))
    rows = rng.normal(size=(r, n))
    W = rng.normal(size=(r + 8, r)) @ rows
    return rows, find_base(Observation.from_matrix(W, parameters(n)))


@given(observed(), SEEDS)
def test_fresh_rows_of_the_same_robot_are_rebuilt_and_others_are_not(case, seed):
    rows, found = case
    rng = np.random.default_rng(seed)
    fresh = rng.normal(size=(6, len(rows))) @ rows
    assert found.reconstruction_error(fresh) < 1e-10
    foreign = rng.normal(size=(6, rows.shape[1]))
    # Exactly the part of the rows that lies along null vectors is lost.
    V2 = found.structure.null_basis
    lost = np.linalg.norm(foreign @ V2) / np.linalg.norm(foreign)
    assert found.reconstruction_error(foreign) >= lost * (1 - 1e-9)
    assert lost > 1e-3
    assert found.reconstruction_error(np.zeros_like(fresh)) == 0.0


@given(observed(), SEEDS)
def test_regressor_times_values_are_the_forces(case, seed):
    rows, found = case
    rng = np.random.default_rng(seed)
    W = rng.normal(size=(3, 4, len(rows))) @ rows
    phi = rng.normal(size=rows.shape[1])
    forces = found.regressor(W) @ found.values(phi)
    assert forces.shape == (3, 4)
    scale = np.linalg.norm(W) * np.linalg.norm(phi)
    np.testing.assert_allclose(forces, W @ phi, atol=1e-9 * scale)


@given(observed())
def test_condition_numbers_are_those_of_the_matrices(case):
    _, found = case
    V22 = found.structure.null_basis[found.dependent]
    assert found.nullspace_condition_number == pytest.approx(np.linalg.cond(V22), rel=1e-9)
    W_B = found.structure.row_factor[:, found.base]
    assert found.condition_number == pytest.approx(np.linalg.cond(W_B), rel=1e-9)


def test_a_singular_matrix_has_no_condition_number():
    assert condition_numbers(np.zeros((2, 2))[None])[0] == np.inf
    assert condition_numbers(np.diag([4.0, 0.0])[None])[0] == np.inf
    assert condition_numbers(np.diag([4.0, 0.5])[None])[0] == 8.0
    assert condition_numbers(np.empty((0, 3))[None])[0] == 1.0


def test_coefficients_between_columns_of_any_size_rebuild_each_column():
    """Small coefficients of large columns are no zeros: columns are up to 2^40 apart."""
    attacks = pytest.importorskip("attacks", reason="needs python-flint")
    for seed in range(20):
        W, rank = attacks.attack(seed)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", AccuracyWarning)
            base = find_base(
                Observation.from_matrix(W, parameters(W.shape[1])), "qr", criterion="regressor"
            )
        if len(base) == rank and not base.doubtful:
            errors = np.linalg.norm(base.regressor(W) @ base.matrix - W, axis=0)
            assert (errors < 1e-8 * np.linalg.norm(W, axis=0)).all()


@pytest.mark.parametrize(
    "name", few_of(["five_bar", "3ups_rpu", "delta", "6ups"], "five_bar", "3ups_rpu")
)
@pytest.mark.parametrize("model", ["gravity", "full"])
def test_no_coefficient_is_round_off(name, model):
    """Those of exact files are products of lengths: none is small."""
    matrix = np.abs(loopid.force_model(loopid.load(name), model).base.matrix)
    assert matrix[matrix > 0].min() > 1e-4
