"""Strategies and criteria by name or as objects."""

import re

import numpy as np
import pytest
from choice_problems import parameters, random_structure
from scipy.linalg import qr

from loopid.base_parameters import (
    CRITERIA,
    STRATEGIES,
    ChoiceProblem,
    ExactSearch,
    ExhaustiveSearch,
    PivotedQR,
    SearchStrategy,
    SubgroupSearch,
    find_base_parameters,
    make_strategy,
)
from loopid.errors import (
    LoopidError,
    OptionError,
)
from loopid.observation import Observation


@pytest.fixture(scope="module")
def observation():
    rng = np.random.default_rng(0)
    W = rng.normal(size=(40, 6)) @ rng.normal(size=(6, 10))
    return Observation.from_matrix(W, parameters(10))


def test_every_strategy_has_a_name_and_goes_by_it():
    assert list(STRATEGIES) == ["exact", "subgroup", "exhaustive", "qr"]
    for name, kind in STRATEGIES.items():
        assert isinstance(make_strategy(name), kind)
        assert kind.name == name


def test_a_strategy_with_options_is_used_as_it_is(observation):
    limited = SubgroupSearch(condition_limit=50.0, alpha=0.5, variant="pseudocode")
    assert make_strategy(limited) is limited
    asked = []
    search = ExhaustiveSearch(progress=lambda *counts: asked.append(counts))
    assert find_base_parameters(observation, search).search.name == "exhaustive"
    assert asked


def test_a_strategy_of_ones_own(observation):
    class First(SearchStrategy):
        """The pivoted choice under another name."""

        name = "first"

        def _search(self, problem):
            return PivotedQR()._search(problem)

    found = find_base_parameters(observation, First(), "regressor")
    assert found.dependent.tolist() == find_base_parameters(observation, "qr").dependent.tolist()


@pytest.mark.parametrize("search", ["fast", "", "Exact", None, 3, ExactSearch])
def test_an_unknown_search_is_refused_with_the_choices(observation, search):
    expected = f"unknown search {search!r}: choose one of exact, subgroup, exhaustive, qr"
    with pytest.raises(OptionError, match=re.escape(expected)):
        find_base_parameters(observation, search)


def test_an_unknown_criterion_is_refused_with_the_choices(observation):
    expected = "unknown criterion 'cond': choose one of nullspace, regressor"
    for refused in (
        lambda: find_base_parameters(observation, criterion="cond"),
        lambda: ChoiceProblem(random_structure(5, 2), "cond"),
    ):
        with pytest.raises(OptionError, match=expected) as caught:
            refused()
        assert isinstance(caught.value, LoopidError)
        assert isinstance(caught.value, ValueError)


@pytest.mark.parametrize("search", STRATEGIES)
@pytest.mark.parametrize("criterion", CRITERIA)
def test_each_strategy_reports_the_criterion_it_was_asked_for(observation, search, criterion):
    found = find_base_parameters(observation, search, criterion)
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
