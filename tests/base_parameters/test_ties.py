"""Ties are counted, and the most readable of the best choices is taken."""

import numpy as np
import pytest
from choice_problems import brute_force, integer_bases, problems, structure
from hypothesis import assume, given, settings, strategies as st

from loopid.base_parameters import ChoiceProblem, ExactSearch, SearchOptions
from loopid.base_parameters.blocks import Levels, _representatives
from loopid.base_parameters.choice import CRITERIA
from loopid.base_parameters.exact import overlap


def coefficients(problem, dependent):
    """β of W_D = W_B β, by least squares on W."""
    W = problem.structure.row_factor
    rest = np.setdiff1d(np.arange(problem.size), dependent)
    return np.linalg.lstsq(W[:, rest], W[:, dependent], rcond=None)[0]


def readability(problem, dependent):
    """Fewest terms, then smallest coefficients, then first columns; less is better."""
    sizes = np.abs(coefficients(problem, dependent))
    return (sizes > 1e-7).sum(), round(sizes.sum(), 5), tuple(dependent)


@pytest.mark.parametrize("criterion", CRITERIA)
@given(data=st.data())
@settings(max_examples=10)
def test_the_most_readable_of_the_best_is_taken(criterion, data):
    problem = data.draw(problems(integer_bases(7), criterion))
    brute = brute_force(problem)
    assume(brute.clear)
    best = min(readability(problem, choice) for choice in brute.tied.tolist())
    assert readability(problem, list(ExactSearch().search(problem).dependent)) == best


@pytest.mark.parametrize("criterion", CRITERIA)
@pytest.mark.parametrize("twins", [2, 3])
def test_parameters_that_act_alike_stand_for_each_other(criterion, twins):
    """Every column of W comes ``twins`` times, with either sign: any one of them may stay."""
    rng = np.random.default_rng(twins)
    columns = rng.normal(size=(3, 3))
    W = np.hstack([sign * columns for sign in (1, -1, 1)[:twins]])
    null_basis = np.linalg.svd(W)[2][3:].T
    mixing = W @ structure(null_basis).row_factor.T
    problem = ChoiceProblem(structure(null_basis, mixing), criterion)
    np.testing.assert_allclose(np.abs(problem.structure.row_factor), np.abs(W), atol=1e-12)
    found = ExactSearch().search(problem)
    assert found.ties == twins**3 == len(brute_force(problem).tied)
    assert found.dependent == tuple(range(3 * twins - 3))


@pytest.mark.parametrize("off", [0.0, 1e-10, 2e-10, 4e-10])
def test_ties_at_the_least_level_there_is_are_counted(off):
    """Two pairs of orthogonal columns, one of them hardly so, and shorter than the other."""
    W = np.array([[1.0, off, 2.0, -1.0], [0.0, 1.0, 1.0, 2.0]])
    null_basis = np.linalg.svd(W)[2][2:].T
    problem = ChoiceProblem(
        structure(null_basis, W @ structure(null_basis).row_factor.T), "regressor"
    )
    assert ExactSearch().search(problem).ties == len(brute_force(problem).tied) == 2


@pytest.mark.parametrize("angle", [1e-5, 1e-6, 1e-7, 1e-8])
def test_nearly_parallel_columns_are_told_apart(angle):
    """Columns of equal norm at a small angle: which of them stays matters at first order."""
    missed = 0
    for seed in range(20):
        rng = np.random.default_rng(seed)
        W = rng.normal(size=(2, 6))
        turn = [[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]]
        W[:, 1] = turn @ W[:, 0]
        null_basis = np.linalg.svd(W)[2][2:].T
        mixing = W @ structure(null_basis).row_factor.T
        problem = ChoiceProblem(structure(null_basis, mixing), "regressor")
        brute, found = brute_force(problem), ExactSearch().search(problem)
        assert found.condition_number == pytest.approx(brute.least, rel=1e-9, abs=0)
        if brute.clear:
            assert found.ties == len(brute.tied)
        conditions = dict(zip(map(tuple, brute.choices.tolist()), brute.conditions, strict=True))
        chosen = set(range(6)) - set(found.dependent)
        if len(chosen & {0, 1}) == 1:
            other = tuple(sorted(set(range(6)) - (chosen ^ {0, 1})))
            missed += conditions[other] > found.condition_number * (1 + 1e-9)
    assert missed > 3  # the angle did decide


def test_vectors_equal_to_round_off_share_a_representative():
    rng = np.random.default_rng(0)
    X = rng.normal(size=(3, 4))
    doubled = np.vstack([X, -X * (1 + 1e-14), X + 1e-15])
    _, groups, error = _representatives(doubled)
    assert [group.tolist() for group in groups] == [[0, 3, 6], [1, 4, 7], [2, 5, 8]]
    assert 0 < error < 1e-13
    apart = np.vstack([X, X * (1 + 1e-9), -X + 1e-8])
    assert len(_representatives(apart)[0]) == 9
    assert len(_representatives(np.vstack([X, 2 * X]))[0]) == 6


def test_too_many_ties_are_neither_listed_nor_counted():
    """All rows of the null vector are alike in size but belong to different lines."""
    angles = np.arange(12) * np.pi / 12
    problem = ChoiceProblem(structure(np.stack([np.cos(angles), np.sin(angles)], axis=1)))
    full = ExactSearch().search(problem)
    assert full.ties == len(brute_force(problem).tied) == 6
    limited = ExactSearch(SearchOptions(ties=5)).search(problem)
    assert limited.ties is None
    assert limited.certified
    # The first columns are then made dependent.
    assert list(limited.dependent) == min(brute_force(problem).tied.tolist())
    assert limited.condition_number == pytest.approx(full.condition_number, rel=1e-9)


@pytest.mark.parametrize(
    ("smallest", "largest", "expected"),
    [
        (1 + 1e-6, 1 + 1e-6, False),  # a better choice would be in both
        (1 - 1e-6, 1 - 1e-6, False),
        (1.0, 1 + 3e-9, True),
        (1 - 3e-9, 1.0, True),
        (1 + 3e-10, 1 + 3e-10, True),
    ],
)
def test_ties_that_could_be_counted_twice_are_near_ties(smallest, largest, expected):
    levels = Levels(0.5, 0.9), Levels(0.5 * smallest, 0.9 * largest)
    assert overlap(levels, 1e-9) == expected
    assert overlap(levels[::-1], 1e-9) == expected
