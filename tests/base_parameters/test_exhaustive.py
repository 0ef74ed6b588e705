"""Exhaustive search in chunks: nothing is lost on the way."""

from itertools import combinations
from math import comb

import numpy as np
import pytest
from choice_problems import BASES, brute_force, problems, random_bases, random_structure, structure
from hypothesis import assume, given, settings, strategies as st

from loopid.base_parameters import ChoiceProblem, ExactSearch, ExhaustiveSearch, SearchOptions
from loopid.base_parameters.choice import CRITERIA
from loopid.base_parameters.enumerated import promising
from loopid.errors import OptionError

ONE = ExhaustiveSearch()


def agree(problem, chunk):
    """Small chunks, so that the determinant screens against an incumbent from the start."""
    brute = brute_force(problem)
    assume(brute.clear)
    found = ExhaustiveSearch(chunk=chunk).search(problem)
    assert found.condition_number == pytest.approx(brute.least, rel=1e-9)
    assert found.ties == len(brute.tied)
    assert list(found.dependent) in brute.tied.tolist()


@pytest.mark.parametrize("criterion", CRITERIA)
@given(data=st.data())
@settings(max_examples=15)
def test_the_determinant_screen_never_loses_the_optimum(criterion, data):
    problem = data.draw(problems(st.one_of(*BASES.values()), criterion))
    agree(problem, data.draw(st.integers(1, 9)))


@given(problems(random_bases(9), "regressor", decades=6.0), st.integers(1, 5))
@settings(max_examples=15)
def test_nor_where_the_optimum_itself_is_badly_conditioned(problem, chunk):
    agree(problem, chunk)


def test_the_screen_spares_most_singular_values():
    """Five null vectors of three entries each: all but 3**5 of C(15, 5) choices are singular."""
    problem = ChoiceProblem(structure(np.kron(np.eye(5), np.ones((3, 1)))))
    assert ExhaustiveSearch(chunk=64).search(problem).ties == 3**5
    every = np.array(list(combinations(range(15), 5)))
    kept, conditions = promising(problem.vectors, every, 1 + 1e-9)
    assert (conditions < 1 + 1e-9).sum() == 3**5
    assert len(kept) < problem.candidates / 3


def test_huge_condition_numbers_do_not_overflow():
    """Columns 0 and 1 act alike, so whole chunks of 24 rows are singular but for round-off."""
    rng = np.random.default_rng(0)
    Z = rng.normal(size=(26, 24))
    Z[1] = Z[0] * (1 + 1e-13)
    problem = ChoiceProblem(structure(Z))
    brute = brute_force(problem)
    assert 23 * np.log10(brute.conditions[:50].min()) > 308
    found = ExhaustiveSearch(chunk=50).search(problem)
    assert found.condition_number == pytest.approx(brute.least, rel=1e-9)


def test_ties_beyond_those_listed_are_still_counted():
    problem = ChoiceProblem(structure(np.ones((12, 1))))
    assert ExhaustiveSearch(options=SearchOptions(ties=3), chunk=2).search(problem).ties == 12


def test_absurd_sizes_are_refused_with_their_number():
    problem = ChoiceProblem(random_structure(60, 30))
    with pytest.raises(OptionError) as refused:
        ONE.search(problem)
    assert refused.value.facts["candidates"] == comb(60, 30) > refused.value.facts["bound"]
    few = ExhaustiveSearch(options=SearchOptions(candidates=10))
    with pytest.raises(OptionError):
        few.search(ChoiceProblem(random_structure(6, 3)))


def test_few_of_many_parameters_are_no_problem():
    """C(70, 68) is small, although binomial coefficients on the way to it are not."""
    problem = ChoiceProblem(random_structure(70, 2), "regressor")
    found = ONE.search(problem)
    assert found.evaluated == found.candidates == comb(70, 2)
    least = ExactSearch().search(problem).condition_number
    assert found.condition_number == pytest.approx(least, rel=1e-9)


def test_progress_counts_up_to_the_total():
    calls = []
    search = ExhaustiveSearch(chunk=40, progress=lambda *counts: calls.append(counts))
    problem = ChoiceProblem(random_structure(12, 4))
    search.search(problem)
    done, totals = zip(*calls, strict=True)
    assert set(totals) == {comb(12, 4)}
    assert len(done) > 2
    assert list(done) == sorted(set(done))
    assert done[-1] == comb(12, 4)
