"""Certificates are true: brute force finds nothing better, ball arithmetic confirms the proofs."""

import warnings
from dataclasses import replace
from itertools import combinations, product

import numpy as np
import pytest
from choice_problems import parameters, structure
from hard_problems import KINDS, SHAPES, least, small_problem, weakly_coupled
from proof_recorder import proven

import loopid
from loopid import bundled_robots
from loopid.base_parameters import ChoiceProblem, ExactSearch, SearchOptions, find_base
from loopid.base_parameters.blocks import Budget, split
from loopid.base_parameters.branch_and_bound import RULES, margin, selections_between
from loopid.base_parameters.choice import CRITERIA
from loopid.base_parameters.structure import analyse
from loopid.errors import AccuracyWarning
from loopid.observation import Observation
from loopid.regressors import structural_observation
from smooth_data import runs

SMALL_SEEDS = 5
COUPLED_SEEDS = (0, 4, 8)  # five to fifteen blocks of a path, a star and a tree


def assert_true(problem):
    """Whatever is claimed holds; nothing is warned of."""
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        found = ExactSearch(SearchOptions(time_limit=5.0)).search(problem)
    reached = least(problem)
    assert found.certified == (found.reason == "")
    if found.certified:
        assert found.condition_number <= reached * (1 + found.tolerance)
    assert found.condition_number / found.gap <= reached * (1 + 2e-6)
    return found


@pytest.mark.parametrize("criterion", CRITERIA)
@pytest.mark.parametrize("kind", KINDS)
def test_brute_force_finds_nothing_better(kind, criterion):
    found = [assert_true(small_problem(kind, seed, criterion)) for seed in range(SMALL_SEEDS)]
    assert sum(one.certified for one in found) > 0.7 * SMALL_SEEDS


def test_a_walk_that_round_off_would_lead_astray_ends():
    assert_true(small_problem("graded", 502, "regressor"))


@pytest.mark.validate
@pytest.mark.parametrize("criterion", CRITERIA)
@pytest.mark.parametrize("kind", KINDS)
def test_brute_force_finds_nothing_better_in_ten_thousand(kind, criterion):
    for seed in range(SMALL_SEEDS, SMALL_SEEDS + 500):
        assert_true(small_problem(kind, seed, criterion))


def assert_coupled(seed):
    shape, count = SHAPES[seed % 3], (5, 10, 15)[seed // 3 % 3]
    problem, reached = weakly_coupled(np.random.default_rng([seed, 77]), shape, count)
    found = ExactSearch(SearchOptions(time_limit=5.0)).search(problem)
    assert found.condition_number / found.gap <= reached * (1 + found.tolerance)


@pytest.mark.parametrize("seed", COUPLED_SEEDS)
def test_weakly_coupled_blocks_have_no_better_choice_than_certified(seed):
    """Paths, stars and trees of up to fifteen blocks, n up to 100."""
    assert_coupled(seed)


@pytest.mark.validate
def test_many_weakly_coupled_blocks_have_no_better_choice_than_certified():
    for seed in range(200):
        assert_coupled(seed)


@pytest.mark.parametrize("rule", RULES)
@pytest.mark.parametrize("kind", KINDS)
def test_the_tree_finds_all_that_brute_force_does(kind, rule, monkeypatch):
    monkeypatch.setattr(
        "loopid.base_parameters.branch_and_bound.LOOKED_AT", 0
    )  # down to single selections
    for seed, criterion in product(range(2), CRITERIA):
        for block in split(small_problem(kind, seed, criterion))[0]:
            every = np.array(list(combinations(range(block.size), block.count)))
            values = np.linalg.svd(block.vectors[every], compute_uv=False) ** 2
            above, below = values[:, -1].max() / 2, 1.1 * values[values[:, -1].argmax(), 0]
            if above < 1e-10:  # round-off decides
                continue
            inside = (values[:, -1] > above) & (values[:, 0] < below)
            found = selections_between(block, above, below, Budget(np.inf), rule=rule)
            assert sorted(map(tuple, found)) == sorted(map(tuple, every[inside]))


def test_proofs_by_either_rule_hold_in_ball_arithmetic(monkeypatch):
    """A box that the first rule leaves undecided is closed by the other, from its root on."""
    monkeypatch.setattr("loopid.base_parameters.branch_and_bound.LOOKED_AT", 0)
    for seed in range(4):
        assert_proven(small_problem("generic", seed, "nullspace"), nodes=2)


def assert_proven(problem, certified=True, **options):
    """The recorded proof passes the independent check."""
    check = pytest.importorskip("proof_checker", reason="needs python-flint").check
    found, proof = proven(problem, time_limit=60.0, **options)
    assert found.certified or not certified
    if found.certified:
        blocks, _ = split(problem)
        check([block.vectors for block in blocks], found, proof)


@runs(2, 10)
@pytest.mark.parametrize("kind", KINDS)
def test_proofs_of_random_problems_hold_in_ball_arithmetic(kind, runs):
    for seed in range(runs):
        for criterion in CRITERIA:
            assert_proven(small_problem(kind, seed, criterion), certified=False)


QUICK = "five_bar"
PROVEN = [
    pytest.param(
        *case,
        id="-".join(case),
        marks=[] if case[0] == QUICK else [pytest.mark.validate],
    )
    for case in product(bundled_robots(), ("gravity", "full"), CRITERIA)
]


@pytest.mark.parametrize(("robot", "model", "criterion"), PROVEN)
def test_proofs_of_the_bundled_robots_hold_in_ball_arithmetic(robot, model, criterion):
    structure = analyse(structural_observation(loopid.load(robot), model))
    assert_proven(ChoiceProblem(structure, criterion))


@pytest.mark.parametrize("size", [5, 40, 120])
def test_the_margin_exceeds_the_round_off_of_elimination(size):
    """Pivots of a matrix as the tree has them, against the same elimination in many digits."""
    flint = pytest.importorskip("flint", reason="needs pip install 'loopid[test]'")
    X = np.linalg.qr(np.random.default_rng(size).normal(size=(2 * size, size)))[0][:size]
    norms = np.linalg.norm(X, axis=1)
    matrix = X @ X.T / norms / norms[:, None]
    with flint.ctx.workprec(300):
        exact = flint.arb_mat(X.tolist())
        inverse = (exact * exact.transpose()).inv()[size - 1, size - 1]
        exact_pivot = float((1 / inverse).mid()) / norms[-1] ** 2
    computed = np.linalg.cholesky(matrix)[-1, -1] ** 2
    assert abs(computed - exact_pivot) < margin(size, size)


def test_a_proof_with_a_leaf_missing_or_a_box_too_large_is_rejected():
    checker = pytest.importorskip("proof_checker", reason="needs python-flint")
    problem = small_problem("generic", 0, "nullspace")
    _, proof = proven(problem)
    entry = max(proof, key=lambda one: len(one.leaves))
    without = replace(entry, leaves=entry.leaves[1:])
    with pytest.raises(AssertionError):
        checker.assert_partition(without)
    wider = replace(entry, above=1e-9, below=np.inf)
    with pytest.raises(AssertionError, match="is open"):
        checker.assert_excluded(wider)


def test_what_round_off_could_decide_is_not_certified_and_the_reason_is_named():
    near = np.diag([1.0, 1.0, 0.0])
    near[2] = [0.0, 1.0 - 5e-10, 0.0]
    tied = ExactSearch().search(ChoiceProblem(structure(near[:, :2])))
    assert (tied.certified, tied.reason, tied.ties) == (False, "near ties", None)
    rng = np.random.default_rng(0)
    turns = [np.linalg.qr(rng.normal(size=(4, 4)))[0] for _ in range(2)]
    mixing = turns[0] * 10.0 ** np.linspace(0, -11, 4) @ turns[1]
    singular = structure(rng.normal(size=(6, 2)), mixing)
    found = ExactSearch().search(ChoiceProblem(singular, "regressor"))
    assert (found.certified, found.reason, found.gap) == (False, "round-off", np.inf)


def test_each_further_attempt_has_four_times_the_nodes(monkeypatch):
    """So what fails costs at most a few times as much as what decides."""
    asked, part = [], Budget.part

    def spied(budget, nodes):
        asked.append(nodes)
        return part(budget, nodes)

    monkeypatch.setattr(Budget, "part", spied)
    vectors = np.random.default_rng(0).standard_normal((20, 8))
    found = ExactSearch(SearchOptions(nodes=1)).search(ChoiceProblem(structure(vectors)))
    assert found.certified
    attempts = sorted({*asked})
    assert attempts == [4**k for k in range(len(attempts))]
    assert len(attempts) > 2


def test_the_answer_does_not_depend_on_where_the_search_starts():
    """A certified choice is a property of the problem: other guesses and efforts end there too.

    Columns in another order have other guesses; ties are then broken by other columns.
    """
    for robot, model in (("five_bar", "full"), ("3ups_rpu", "gravity")):
        structure = analyse(structural_observation(loopid.load(robot), model))
        order = np.random.default_rng(0).permutation(len(structure.columns))
        for criterion in CRITERIA:
            first = ExactSearch().search(ChoiceProblem(structure, criterion))
            hurried = ExactSearch(SearchOptions(nodes=40))
            again = hurried.search(ChoiceProblem(structure, criterion))
            assert again.certified
            assert (again.dependent, again.ties) == (first.dependent, first.ties)
            turned = hurried.search(ChoiceProblem(structure.permuted(order), criterion))
            assert turned.certified
            assert turned.ties == first.ties
            assert turned.condition_number == pytest.approx(first.condition_number, rel=1e-9)


def assert_no_attack_succeeds(seeds):
    """What is certified of regressors of exact numbers is so; the part that is certified."""
    attacks = pytest.importorskip("attacks", reason="needs python-flint")
    claimed = total = 0
    for seed in seeds:
        W, rank = attacks.attack(seed)
        truth = attacks.conditions(W, rank)
        for which, criterion in enumerate(CRITERIA):
            with warnings.catch_warnings():
                warnings.simplefilter("ignore", AccuracyWarning)
                observation = Observation.from_matrix(W, parameters(W.shape[1]))
                base = find_base(observation, criterion=criterion)
            if base.structure.rank != rank or base.doubtful:
                continue
            total, claimed = total + 1, claimed + base.search.certified
            if base.search.certified:
                tolerance = base.search.tolerance
                own = truth[tuple(base.dependent.tolist())][which]
                assert own <= (1 + tolerance) * min(one[which] for one in truth.values())
                assert base.search.condition_number == pytest.approx(own, rel=tolerance)
    return claimed / total


def test_columns_of_any_size_make_no_certificate_false():
    assert assert_no_attack_succeeds(range(15)) > 0.9


def test_what_a_zero_in_a_null_vector_moves_is_in_the_tolerance():
    """A part of 2e-9 of the null vector is taken for none: a condition of 2e6 is off by 1e-5."""
    assert_no_attack_succeeds([2974])


@pytest.mark.validate
def test_columns_of_any_size_make_none_of_ten_thousand_certificates_false():
    assert assert_no_attack_succeeds(range(30, 3200)) > 0.98


@pytest.mark.parametrize("decades", [9, 10, 12])
def test_short_columns_in_the_span_of_long_ones_are_seen(decades):
    """The two short ones are nearly orthogonal, the long ones nearly parallel."""
    A = np.array([[1, 0], [0, 1], [1, 1], [1, -1], [2, 1]])
    W = A @ np.array([[1, 0, 1, 1], [0, 1, 1, 1.25]]) * [1, 1, 10.0**decades, 10.0**decades]
    base = find_base(Observation.from_matrix(W, parameters(4)), criterion="regressor")
    assert (base.base.tolist(), base.search.certified) == ([0, 1], True)
    assert base.search.condition_number == pytest.approx(np.linalg.cond(A), rel=1e-9)
