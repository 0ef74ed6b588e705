"""Exact search finds what brute force finds: optimum, ties, and one choice."""

import pytest
from choice_problems import BASES, brute_force, problems, random_bases, random_structure
from hypothesis import assume, given, settings, strategies as st

from loopid.base_parameters import ChoiceProblem, ExactSearch
from loopid.base_parameters.choice import CRITERIA


def assert_agreement(problem, brute):
    exact = ExactSearch().search(problem)
    assert exact.certified
    assert exact.condition_number == pytest.approx(brute.least, rel=1e-9)
    assert exact.ties == len(brute.tied)
    assert exact.candidates == len(brute.choices)
    assert list(exact.dependent) in brute.tied.tolist()


@pytest.mark.parametrize("criterion", CRITERIA)
@pytest.mark.parametrize("bases", BASES.values(), ids=BASES)
@given(data=st.data())
@settings(max_examples=6)
def test_both_agree(bases, criterion, data):
    problem = data.draw(problems(bases, criterion))
    brute = brute_force(problem)
    assume(brute.clear)
    assert_agreement(problem, brute)


@given(problems(random_bases(9), "regressor", decades=6.0))
@settings(max_examples=12)
def test_badly_conditioned_regressors_are_no_exception(problem):
    """Squared condition numbers reach 1e12 here: Gram matrices alone could not tell."""
    brute = brute_force(problem)
    assume(brute.clear)
    assert_agreement(problem, brute)


@pytest.mark.parametrize("criterion", CRITERIA)
@pytest.mark.parametrize(("n", "d"), [(12, 3), (12, 9), (11, 5)])
@pytest.mark.parametrize("seed", range(3))
def test_larger_problems_agree_too(n, d, criterion, seed):
    problem = ChoiceProblem(random_structure(n, d, seed), criterion)
    brute = brute_force(problem)
    assert brute.clear
    assert_agreement(problem, brute)
