"""Strategies and criteria by name or as objects."""

import pickle
from dataclasses import fields, replace

import numpy as np
import pytest
from choice_problems import parameters, random_structure
from scipy.linalg import qr

from loopid.base_parameters import (
    SEARCHES,
    ChoiceProblem,
    ExactSearch,
    PivotedQR,
    SearchOptions,
    SearchStrategy,
    SubgroupSearch,
    find_base,
)
from loopid.base_parameters.base import find_base_and_motors_alone
from loopid.base_parameters.choice import CRITERIA
from loopid.errors import LoopidError, OptionError
from loopid.observation import Observation, StackedRows


@pytest.fixture(scope="module")
def observation():
    rng = np.random.default_rng(0)
    W = rng.normal(size=(40, 6)) @ rng.normal(size=(6, 10))
    return Observation.from_matrix(W, parameters(10))


def test_every_search_has_a_name_and_goes_by_it(observation):
    assert list(SEARCHES) == ["exact", "subgroup", "qr"]
    for name, kind in SEARCHES.items():
        assert kind.name == name
        assert find_base(observation, name) == find_base(observation, kind())


def test_a_search_with_options_is_used_as_it_is(observation):
    assert find_base(observation, SubgroupSearch(alpha=0.5)).search.subgroups.alpha == 0.5
    with pytest.raises(OptionError):  # of these choices none is valid
        find_base(observation, SubgroupSearch(condition_limit=1.0001))


@pytest.mark.parametrize("search", ["exact", ExactSearch(), ExactSearch(SearchOptions(ties=3))])
def test_an_effort_is_that_of_the_search_and_comes_back(observation, search):
    options = SearchOptions(time_limit=5.0, tolerance=1e-8)
    found = find_base(observation, search, options=options).search
    assert found.options == options
    assert found.tolerance == 1e-8


def test_a_search_of_ones_own(observation, monkeypatch):
    class First(SearchStrategy):
        """The pivoted choice under another name."""

        name = "first"

        def _search(self, problem):
            return PivotedQR()._search(problem)

    expected = find_base(observation, "qr").dependent.tolist()
    found = find_base(observation, First(), criterion="regressor")
    assert found.dependent.tolist() == expected
    monkeypatch.setattr(SEARCHES, "_entries", dict(SEARCHES._entries))
    SEARCHES.register("first", First)
    assert find_base(observation, "first").dependent.tolist() == expected


@pytest.mark.parametrize("search", ["fast", "", "Exact"])
def test_an_unknown_search_is_refused_with_the_choices(observation, search):
    with pytest.raises(OptionError) as refused:
        find_base(observation, search)
    assert refused.value.facts == {"given": search, "valid": tuple(SEARCHES)}


@pytest.mark.parametrize("search", [None, 3, [], {}, ExactSearch])
def test_what_is_no_search_is_refused(observation, search):
    with pytest.raises(OptionError, match="search must be"):
        find_base(observation, search)
    with pytest.raises(OptionError, match="observation must be"):
        find_base(search)


@pytest.mark.parametrize("field", fields(SearchOptions), ids=lambda field: field.name)
@pytest.mark.parametrize("wrong", [0, -1, float("nan"), "many"])
def test_an_effort_is_of_positive_numbers(field, wrong):
    with pytest.raises(OptionError, match=field.name):
        SearchOptions(**{field.name: wrong})


def test_searches_and_results_are_records(observation):
    for search in (ExactSearch(), SubgroupSearch(alpha=0.5), PivotedQR()):
        problem = ChoiceProblem(random_structure(8, 3))
        found, again = search.search(problem), search.search(problem)
        for one, other in ((search, replace(search)), (problem, replace(problem)), (found, again)):
            assert one == other == pickle.loads(pickle.dumps(one))
            assert hash(one) == hash(other)
            assert len(repr(one).splitlines()) <= 10


def test_an_unknown_criterion_is_refused_with_the_choices(observation):
    expected = "unknown criterion 'cond': choose among nullspace, regressor"
    for refused in (
        lambda: find_base(observation, criterion="cond"),
        lambda: ChoiceProblem(random_structure(5, 2), "cond"),
    ):
        with pytest.raises(OptionError, match=expected) as caught:
            refused()
        assert isinstance(caught.value, LoopidError)
        assert isinstance(caught.value, ValueError)


@pytest.mark.parametrize("search", SEARCHES)
@pytest.mark.parametrize("criterion", CRITERIA)
def test_each_strategy_reports_the_criterion_it_was_asked_for(observation, search, criterion):
    found = find_base(observation, search, criterion=criterion)
    values = {
        "nullspace": found.nullspace_condition_number,
        "regressor": found.condition_number,
    }
    assert found.search.condition_number == pytest.approx(values[criterion], rel=1e-9)
    assert found.search.criterion == criterion


def test_pivoted_qr_leaves_the_last_pivots_dependent():
    problem = ChoiceProblem(random_structure(9, 4))
    order = qr(problem.structure.row_factor, pivoting=True, mode="r")[1]
    assert PivotedQR().search(problem).dependent == tuple(sorted(order[5:].tolist()))


def observed(W, driven):
    rows = StackedRows(parameters(W.shape[-1]), driven)
    rows.add(W)
    return rows.observation()


def test_what_the_motors_alone_feel_is_found_in_the_time_that_is_left():
    rng = np.random.default_rng(0)
    W = rng.normal(size=(40, 3, 5)) @ rng.normal(size=(5, 9))
    observation = observed(W, driven=2)
    options = SearchOptions(time_limit=50.0)
    base, felt = find_base_and_motors_alone(observation, options=options)
    assert base == find_base(observation, options=options)
    alone = find_base(observation.motors_alone)
    assert felt.dependent.tolist() == alone.dependent.tolist()
    left = 50.0 - base.search.seconds
    assert felt.search.options.time_limit == pytest.approx(left)
    W[:, :2] = 0.0  # only rows of free coordinates have an effect
    free = observed(W, driven=2)
    assert find_base_and_motors_alone(free)[1] is None
    assert find_base_and_motors_alone(Observation.from_matrix(W, parameters(9)))[1] is None
