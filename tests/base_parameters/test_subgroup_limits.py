"""Where subgroup search does not apply, finds nothing, or depends on the order of the columns."""

from math import comb

import numpy as np
import pytest
from choice_problems import parameters, random_structure, structure
from scipy.linalg import block_diag

from loopid.base_parameters import (
    ChoiceProblem,
    ExactSearch,
    SearchOptions,
    SubgroupSearch,
    find_base,
)
from loopid.errors import OptionError
from loopid.observation import Observation


@pytest.mark.parametrize(
    ("r", "alpha", "n_star"),
    [
        (15, 0.25, 19),  # the paper's: 18.75 is rounded up
        (12, 0.25, 15),
        (25, 0.12, 28),  # 1.12 * 25 exceeds 28 in binary
    ],
)
def test_groups_have_n_star_rows_rounded_up(r, alpha, n_star):
    problem = ChoiceProblem(random_structure(r + 5, 5))
    assert SubgroupSearch(alpha=alpha).group_size(problem) == n_star


def test_a_group_never_has_more_rows_than_there_are():
    assert SubgroupSearch().group_size(ChoiceProblem(random_structure(10, 1))) == 10


def test_more_dependent_parameters_than_a_group_holds_are_refused():
    problem = ChoiceProblem(random_structure(10, 8))
    with pytest.raises(OptionError) as refused:
        SubgroupSearch().search(problem)
    assert refused.value.facts == {"dependent": 8, "group": 3}


def test_more_combinations_than_fit_in_memory_are_refused_with_their_number():
    problem = ChoiceProblem(random_structure(60, 30))
    with pytest.raises(OptionError) as refused:
        SubgroupSearch().search(problem)
    assert refused.value.facts == {"needed": comb(38, 30) * 30 * 32 * 8, "bound": 2**30}
    small = ChoiceProblem(random_structure(9, 4))
    assert SubgroupSearch().search(small).found
    with pytest.raises(OptionError):
        SubgroupSearch(options=SearchOptions(memory=1000)).search(small)


@pytest.mark.parametrize("alpha", [0.0, -0.1, 0.51, float("nan")])
def test_alpha_must_be_the_papers(alpha):
    with pytest.raises(
        OptionError,
        match=r"alpha must be (above 0|0.5 or less|a finite number)",
    ):
        SubgroupSearch(alpha=alpha)


@pytest.mark.parametrize("limit", [1.0, 0.0, -5.0, float("nan")])
def test_the_condition_limit_must_exceed_one(limit):
    with pytest.raises(OptionError, match=r"condition_limit must be (above 1|a finite number)"):
        SubgroupSearch(condition_limit=limit)


def test_an_unknown_variant_is_refused_with_the_choices():
    with pytest.raises(OptionError, match="unknown variant 'figure': choose among gap, pseudocode"):
        SubgroupSearch(variant="figure")


def test_nothing_found_is_said_and_raised():
    observation = Observation.from_matrix(
        np.random.default_rng(0).normal(size=(30, 6)) @ random_structure(10, 4).row_factor,
        parameters(10),
    )
    least = find_base(observation).search.condition_number
    strict = SubgroupSearch(condition_limit=1 + (least - 1) / 2)
    result = strict.search(ChoiceProblem(find_base(observation).structure))
    assert not result.found
    assert result.dependent is None
    assert result.condition_number == np.inf
    assert not result.certified
    with pytest.raises(OptionError, match="subgroup search found no valid choice among") as caught:
        find_base(observation, strict)
    assert f"{result.evaluated:,} of {result.candidates:,}" in str(caught.value)
    assert "search='exact'" in str(caught.value)


def outcomes(variant):
    """Of one problem like a robot's, with its columns in seeded orders."""
    rng = np.random.default_rng(3)
    pairs, sums = np.kron(np.eye(4), [[1.0], [-1.0]]), rng.integers(-1, 2, size=(6, 3))
    Z = block_diag(pairs, sums)
    for _ in range(60):
        problem = ChoiceProblem(structure(Z[rng.permutation(14)]))
        least = ExactSearch().search(problem).condition_number
        found = SubgroupSearch(variant=variant).search(problem).condition_number
        assert found >= least * (1 - 1e-9)
        yield "best" if found <= least * (1 + 1e-9) else "worse" if found < np.inf else "none"


def test_the_pseudocode_depends_on_the_order_of_the_columns():
    found = set(outcomes("pseudocode"))
    # Round-off decides whether it finds a worse choice or none.
    assert "best" in found
    assert found & {"worse", "none"}


def test_with_the_rank_told_by_a_gap_there_is_always_a_choice():
    assert "none" not in set(outcomes("gap"))
