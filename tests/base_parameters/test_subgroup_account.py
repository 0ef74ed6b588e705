"""What a subgroup search says that it tried is what it tried."""

from collections import Counter
from itertools import combinations

import numpy as np
import pytest
from choice_problems import random_structure, structure

import loopid
from loopid.base_parameters import ChoiceProblem, SubgroupSearch
from loopid.errors import OptionError
from loopid.plots import search_chart
from loopid.report import base_report


@pytest.fixture(scope="module")
def problem():
    """Of pairs and sums, as of robots: many choices are rank-deficient."""
    pairs = np.kron(np.eye(3), [[1.0], [-1.0]])
    sums = np.array([[1, 0, 0], [0, 1, 0], [1, 1, 0], [0, 0, 1], [1, 0, -1.0]])
    rows = np.random.default_rng(2).permutation(11)
    return ChoiceProblem(
        structure(np.block([[pairs, np.zeros((6, 3))], [np.zeros((5, 3)), sums]])[rows])
    )


@pytest.fixture(scope="module", params=["gap", "pseudocode"])
def account(request, problem):
    found = SubgroupSearch(variant=request.param, alpha=0.5).search(problem)
    return found, found.subgroups


def test_groups_hold_all_combinations_of_their_rows(account, problem):
    found, told = account
    assert told.tried == found.evaluated
    seen = set()
    for group in told.groups:
        assert len(group.rows) == told.group_size
        choices = list(combinations(group.rows, told.dependent))
        assert len(group) == len(choices)
        seen |= {frozenset(choice) for choice in choices}
        for choice, value, full in zip(
            choices, group.condition_numbers, group.full_rank, strict=True
        ):
            V22 = problem.structure.null_basis[np.sort(choice)]
            assert full == (np.linalg.matrix_rank(V22, tol=1e-9) == told.dependent)
            if full:
                assert value == pytest.approx(np.linalg.cond(V22), rel=1e-9)
            else:
                assert value > 1e12
        assert group.deficient == (~group.full_rank).sum()
        assert group.valid == (group.full_rank & (group.condition_numbers < 2000)).sum()
    assert told.different == len(seen)


def test_the_row_that_is_removed_is_the_most_frequent_of_the_worse_half(account):
    _, told = account
    for group, following in zip(told.groups, told.groups[1:], strict=False):
        assert group.removed in group.rows
        assert group.added not in group.rows
        assert set(following.rows) == set(group.rows) - {group.removed} | {group.added}
        assert 0.5 < group.share <= 1  # d of n* rows is more than half here
    assert (told.groups[-1].removed, told.groups[-1].added, told.groups[-1].share) == (
        None,
        None,
        0,
    )


def test_the_share_is_that_of_the_worse_half(problem):
    found = SubgroupSearch(variant="pseudocode", alpha=0.5).search(problem)
    for group in found.subgroups.groups[:-1]:
        choices = list(combinations(group.rows, found.subgroups.dependent))
        invalid = [k for k in np.argsort(group.condition_numbers, kind="stable")
                   if not group.full_rank[k]]  # fmt: skip
        worse = [choices[k] for k in invalid[len(invalid) // 2 :]]
        counts = Counter(row for choice in worse for row in choice)
        assert counts[group.removed] == max(counts.values())
        assert group.share == pytest.approx(counts[group.removed] / len(worse))


def test_the_best_is_where_it_is_said_to_be(account, problem):
    found, told = account
    group = told.groups[told.found_in]
    choice = list(combinations(group.rows, told.dependent))[group.best]
    assert tuple(sorted(choice)) == found.dependent
    assert group.least == pytest.approx(found.condition_number, rel=1e-5)
    assert all(other.least > group.least for other in told.groups[: told.found_in])


def test_rows_are_called_as_the_columns_of_the_result(load_once):
    """Whatever order the search took them in."""
    observation = loopid.regressors.structural_observation(load_once("four_bar"), "full")
    base = loopid.base_parameters.find_base(observation, "subgroup")
    group = base.search.subgroups.groups[base.search.subgroups.found_in]
    choice = list(combinations(group.rows, base.search.subgroups.dependent))[group.best]
    assert tuple(sorted(choice)) == base.search.dependent


def test_page_terminal_and_json_say_the_same(knee, papers_choice):
    base = papers_choice
    report = base_report(knee, "gravity", base)
    told, account = report.data["search"]["subgroups"], base.search.subgroups
    page = report.page().html()
    for text in (f"{account.tried:,} of 155,117,520", "12 of n* = 19 rows (alpha 0.25)"):
        assert text in page
        assert any(text in str(cell) for c in report.brief[1].columns for cell in c.cells)
    assert told["tried"] == sum(group["tried"] for group in told["groups"]) == 46_512
    assert sum(group["valid"] for group in told["groups"]) == account.valid
    labels = base.structure.parameters.labels
    assert told["groups"][0]["removed"] == labels[account.groups[0].removed]
    drawn = {mark.name: mark for mark in search_chart([base.search]).panels[0].marks}
    assert len(drawn["full rank"].x) + len(drawn["rank-deficient"].x) == account.tried
    assert drawn["best"].y == pytest.approx([base.nullspace_condition_number])


def test_other_searches_have_no_account():
    found = loopid.base_parameters.ExactSearch().search(ChoiceProblem(random_structure(8, 3)))
    assert found.subgroups is None
    with pytest.raises(OptionError, match="subgroup searches, not exact search"):
        search_chart([found])
