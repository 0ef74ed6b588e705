"""The trade between largest and smallest singular values, over blocks and inside one.

cond(V22) is the largest of all blocks' singular values over the smallest of all. Neither the
choice that is best for each block alone, nor the one with the largest smallest singular value,
makes the best whole.
"""

from itertools import combinations

import numpy as np
import pytest
from choice_problems import brute_force, structure
from hypothesis import given
from hypothesis import strategies as st
from scipy.linalg import block_diag

from loopid.base_parameters import ChoiceProblem, ExactSearch, independent_blocks

# Two null vectors of unit length; one row of each becomes dependent.
SHARED = np.array([[0.6, 0], [0.8, 0], [0, 0.6], [0, 0.8 / np.sqrt(2)], [0, 0.8 / np.sqrt(2)]])


def each_block_alone(V2, merit):
    """Condition number when every block makes the choice of most merit for itself."""
    chosen = []
    for columns in independent_blocks(V2):
        count = np.linalg.matrix_rank(V2[columns])
        choices = [list(columns[list(rows)]) for rows in combinations(range(len(columns)), count)]
        values = [np.linalg.svd(V2[rows], compute_uv=False)[:count] for rows in choices]
        chosen += choices[int(np.argmax([merit(own) for own in values]))]
    return np.linalg.cond(V2[sorted(chosen)])


def strength(values):
    return values[-1]


def evenness(values):
    return values[-1] / values[0]


def test_the_strongest_of_each_block_is_not_the_best_of_all():
    """Taking 0.8 from the first block is best there; 0.6 goes with the 0.6 of the second."""
    problem = ChoiceProblem(structure(SHARED))
    assert each_block_alone(problem.structure.null_basis, strength) == pytest.approx(4 / 3)
    found = ExactSearch().search(problem)
    assert found.condition_number == pytest.approx(1.0, rel=1e-12)
    assert found.dependent == (0, 2)
    assert found.ties == 1
    assert found.certified


@pytest.mark.parametrize("merit", [strength, evenness])
def test_blocks_are_weighed_against_each_other(merit):
    rng = np.random.default_rng(0)
    missed = 0
    for _ in range(40):
        problem = ChoiceProblem(structure(block_diag(*rng.normal(size=(2, 7, 2)))))
        least = ExactSearch().search(problem).condition_number
        assert least == pytest.approx(brute_force(problem).least, rel=1e-9)
        missed += each_block_alone(problem.structure.null_basis, merit) > least * 1.001
    assert missed > 5  # the premise: the short cut does not do


@pytest.mark.parametrize("d", [2, 3, 4])
def test_inside_one_block_both_ends_of_the_spectrum_count(d):
    rng = np.random.default_rng(d)
    missed = 0
    for _ in range(40):
        problem = ChoiceProblem(structure(rng.normal(size=(9, d))))
        least = ExactSearch().search(problem).condition_number
        assert least == pytest.approx(brute_force(problem).least, rel=1e-9)
        missed += each_block_alone(problem.structure.null_basis, strength) > least * 1.001
    assert missed > 5


@given(st.integers(1, 12), st.integers(1, 6))
def test_equal_optima_at_several_levels_are_all_counted(first, second):
    """Two like null vectors of two different entries: cond = 1 with either entry of both."""
    vector = np.r_[np.full(first, 1.0), np.full(second, 2.0)][:, None]
    found = ExactSearch().search(ChoiceProblem(structure(block_diag(vector, vector))))
    assert found.condition_number == pytest.approx(1.0, rel=1e-12)
    assert found.ties == first**2 + second**2
