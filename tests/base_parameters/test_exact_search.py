"""What exact search promises beside the optimum: a certificate, and the same answer always."""

from dataclasses import replace

import numpy as np
import pytest
from choice_problems import BASES, brute_force, problems, random_structure, structure
from hypothesis import assume, given, settings, strategies as st

from loopid.base_parameters import (
    SEARCHES,
    ChoiceProblem,
    ExactSearch,
    PivotedQR,
    SearchOptions,
    SubgroupSearch,
)
from loopid.base_parameters.choice import CRITERIA
from loopid.errors import OptionError

OTHERS = [PivotedQR(), SubgroupSearch(), SubgroupSearch(alpha=0.5)]


@pytest.mark.parametrize("criterion", CRITERIA)
@given(data=st.data())
@settings(max_examples=10)
def test_no_other_strategy_does_better(criterion, data):
    problem = data.draw(problems(st.one_of(*BASES.values()), criterion))
    exact = ExactSearch().search(problem)
    for strategy in OTHERS:
        try:
            other = strategy.search(problem)
        except OptionError:
            continue
        assert exact.condition_number <= other.condition_number * (1 + 1e-9)
        assert not other.certified or not problem.dependent_count
        if other.found:
            value = problem.condition_number(np.array(other.dependent))
            assert other.condition_number == pytest.approx(value, rel=1e-6)


@pytest.mark.parametrize("criterion", CRITERIA)
@given(data=st.data())
def test_order_and_signs_of_the_columns_do_not_matter(criterion, data):
    problem = data.draw(problems(st.one_of(*BASES.values()), criterion))
    assume(brute_force(problem).clear)
    n = problem.size
    order = np.array(data.draw(st.permutations(range(n))))
    signs = np.array(data.draw(st.lists(st.sampled_from([-1.0, 1.0]), min_size=n, max_size=n)))
    S = problem.structure
    null_basis, factor = signs[:, None] * S.null_basis[order], signs * S.row_factor[:, order]
    turned = replace(S, null_basis=null_basis, row_factor=factor)
    expected = ExactSearch().search(problem)
    found = ExactSearch().search(ChoiceProblem(turned, criterion))
    assert found.condition_number == pytest.approx(expected.condition_number, rel=1e-9)
    assert found.ties == expected.ties


@pytest.mark.parametrize("criterion", CRITERIA)
def test_the_same_question_has_the_same_answer(criterion):
    problem = ChoiceProblem(random_structure(18, 7), criterion)
    first, second = (replace(ExactSearch().search(problem), seconds=0.0) for _ in range(2))
    assert first == second


@pytest.mark.parametrize("criterion", CRITERIA)
@pytest.mark.parametrize(("n", "d"), [(60, 30), (70, 20)])
def test_out_of_time_means_a_valid_choice_without_certificate(n, d, criterion):
    problem = ChoiceProblem(random_structure(n, d), criterion)
    found = ExactSearch(SearchOptions(time_limit=1e-6)).search(problem)
    assert not found.certified
    assert found.ties is None
    assert len(set(found.dependent)) == d
    assert set(found.dependent) <= set(range(n))
    V22 = problem.structure.null_basis[list(found.dependent)]
    assert np.linalg.matrix_rank(V22) == d
    assert found.condition_number == problem.condition_number(np.array(found.dependent))
    assert found.condition_number < 100 * PivotedQR().search(problem).condition_number


def test_time_limit_is_kept():
    problem = ChoiceProblem(random_structure(80, 40))
    found = ExactSearch(SearchOptions(time_limit=0.2)).search(problem)
    assert not found.certified
    assert found.gap > 1
    assert found.seconds < 5.0


@pytest.mark.parametrize("limit", [0.0, -1.0, float("nan")])
def test_a_time_limit_must_be_positive(limit):
    with pytest.raises(OptionError, match=r"time_limit must be (above 0|a finite number)"):
        ExactSearch(SearchOptions(time_limit=limit))


@pytest.mark.parametrize("search", SEARCHES)
def test_results_say_who_found_them_and_for_what(search):
    problem = ChoiceProblem(random_structure(8, 3), "regressor")
    found = SEARCHES[search]().search(problem)
    assert (found.name, found.criterion) == (search, "regressor")
    assert found.candidates == 56
    assert found.seconds > 0
    assert found.found
    assert list(found.dependent) == sorted(found.dependent)


def test_columns_that_no_null_vector_touches_stay_base_parameters():
    Z = np.array([[1.0, 0], [2, 0], [0, 0], [0, 3], [0, 1], [0, 0]])
    for criterion in CRITERIA:
        problem = ChoiceProblem(structure(Z), criterion)
        found = ExactSearch().search(problem)
        assert not {2, 5} & set(found.dependent)
        assert found.condition_number == pytest.approx(brute_force(problem).least)


@pytest.mark.parametrize("criterion", ["nullspace", "regressor"])
@pytest.mark.parametrize("others", [0, 1])
def test_columns_that_are_null_vectors_alone_become_dependent(criterion, others):
    rng = np.random.default_rng(others)
    Z = np.zeros((6, 1 + others))
    Z[2, 0] = 1.0
    Z[3:, 1:] = rng.normal(size=(3, others))
    result = ExactSearch().search(ChoiceProblem(structure(Z), criterion))
    assert result.certified
    assert 2 in result.dependent
    assert len(result.dependent) == 1 + others
