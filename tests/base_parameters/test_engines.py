"""All engines give the same answers, and a bracket or a whole search never claims too much."""

from time import perf_counter

import numpy as np
import pytest
from chains import chain_block, chains, levels_of_all
from choice_problems import BASES, brute_force, problems, structure
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from loopid.base_parameters import ChoiceProblem, ExactSearch
from loopid.base_parameters.search import engines
from loopid.base_parameters.search.bracket import Bracket
from loopid.base_parameters.search.engines import BranchEngine, TableEngine, TreeEngine
from loopid.base_parameters.search.narrow import NarrowSearch
from loopid.base_parameters.search.staircase import least_ratio
from loopid.base_parameters.search.threshold import Budget

ENGINES = {
    "table": TableEngine,
    "tree": TreeEngine,
    "branches": lambda block: BranchEngine(block, NarrowSearch(block)),
}


def budget(nodes=np.inf):
    return Budget(perf_counter() + 1e9, most_nodes=nodes)


@pytest.fixture
def always_branches(monkeypatch):
    """Let every block be searched along a branch decomposition."""
    monkeypatch.setattr(engines, "LARGEST_TABLE", 0)
    monkeypatch.setattr(engines, "LARGEST_TREE", 1)


@pytest.mark.parametrize("name", ENGINES)
@given(vectors=chains())
def test_bounds_of_an_engine_hold_and_its_start_is_a_selection(name, vectors):
    block = chain_block(vectors)
    engine = ENGINES[name](block)
    smallest, largest = levels_of_all(block)
    regular = smallest > 1e-9
    assert engine.most_smallest >= smallest.max() * (1 - 1e-12)
    assert engine.least_largest <= largest[regular].min() * (1 + 1e-9)
    start = engine.start(engine.least_largest)
    assert len(np.unique(start)) == block.count
    assert block.levels(start).smallest > 1e-9


@pytest.mark.parametrize("name", ENGINES)
@given(vectors=chains(), seed=st.integers(0, 1000))
def test_a_bracket_closes_on_the_highest_smallest_eigenvalue(name, vectors, seed):
    block = chain_block(vectors)
    smallest, _ = levels_of_all(block)
    engine = ENGINES[name](block)
    bracket = Bracket(engine, engine.start(0.0), engine.most_smallest)
    bracket.raise_to(np.inf, budget())
    assert bracket.closed
    assert bracket.low == pytest.approx(smallest.max(), rel=1e-8)
    assert bracket.low == block.levels(bracket.selection).smallest


@pytest.mark.parametrize("name", ENGINES)
@given(vectors=chains(), nodes=st.integers(0, 60))
def test_the_gap_holds_however_little_was_searched(name, vectors, nodes):
    block = chain_block(vectors)
    smallest, largest = levels_of_all(block)
    regular = smallest > 1e-9
    least = (largest[regular] / smallest[regular]).min()
    optimum = least_ratio([ENGINES[name](block)], budget(nodes))
    assert optimum.least <= least * (1 + 1e-8)
    assert optimum.levels.ratio >= least * (1 - 1e-8)
    if optimum.certified:
        assert optimum.levels.ratio == pytest.approx(least, rel=1e-8)


@pytest.mark.usefixtures("always_branches")
@given(data=st.data())
@settings(max_examples=60)
def test_search_along_branches_is_exhaustive_search(data):
    problem = data.draw(problems(st.one_of(*BASES.values()), "nullspace"))
    assume(problem.dependent_count)
    found, brute = ExactSearch().search(problem), brute_force(problem)
    assert found.certified
    assert found.gap == 1.0
    assert found.condition_number == pytest.approx(brute.least, rel=1e-9)


@pytest.mark.usefixtures("always_branches")
@given(vectors=chains(), other=chains(largest=6))
@settings(max_examples=40)
def test_blocks_of_chains_are_chosen_together(vectors, other):
    n, d = vectors.shape
    both = np.zeros((n + len(other), d + other.shape[1]))
    both[:n, :d], both[n:, d:] = vectors, other
    problem = ChoiceProblem(structure(both))
    assume(problem.candidates < 50_000)
    found = ExactSearch().search(problem)
    assert found.certified
    assert found.condition_number == pytest.approx(brute_force(problem).least, rel=1e-9)


@given(vectors=chains())
def test_a_gap_of_one_is_a_certificate(vectors):
    found = ExactSearch().search(ChoiceProblem(structure(vectors)))
    assert (found.gap == 1.0) == found.certified
