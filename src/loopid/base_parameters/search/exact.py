"""Exact search: the least condition number of all choices, with a certificate.

The null-space criterion falls apart into independent blocks, which are solved by branch and
bound and combined along a staircase. The regressor criterion is one block of its own. Ties are
counted and broken towards readable parameters.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import islice
from math import prod, sqrt
from time import perf_counter

import numpy as np

from loopid.arguments import checked
from loopid.arrays import IntArray
from loopid.base_parameters.search.block import Levels
from loopid.base_parameters.search.engines import BranchEngine
from loopid.base_parameters.search.parts import Part, separate
from loopid.base_parameters.search.problem import ChoiceProblem
from loopid.base_parameters.search.staircase import Optimum, least_ratio
from loopid.base_parameters.search.strategy import TIE_TOLERANCE, SearchResult, SearchStrategy
from loopid.base_parameters.search.threshold import Budget, OutOfBudgetError
from loopid.base_parameters.search.ties import MOST_TIES, NOTHING, Readability, most_readable
from loopid.errors import OptionError

TIME_LIMIT = 10.0  # s
# Nodes spent on listing the ties of a large block, of which there may be any number.
MOST_TIE_NODES = 1000


class ExactSearch(SearchStrategy):
    """Find the global optimum and prove it.

    Parameters
    ----------
    time_limit : float
        Seconds after which the best choice so far is returned, not certified.
    """

    name = "exact"

    @checked
    def __init__(self, time_limit: float = TIME_LIMIT) -> None:
        if not time_limit > 0:
            raise OptionError(f"time_limit must be positive, not {time_limit} s")
        self.time_limit = time_limit

    def _search(self, problem: ChoiceProblem) -> SearchResult:
        parts = separate(problem)
        budget = Budget(perf_counter() + self.time_limit)
        optimum = least_ratio([part.engine for part in parts], budget)
        if optimum.certified:
            choice, ties = _break_ties(parts, optimum, budget)
        else:
            choice, ties = _unlisted(parts, optimum), None
        dependent = np.array(choice.dependent, dtype=np.int64)
        return SearchResult(
            name=self.name,
            criterion=problem.criterion,
            dependent=choice.dependent,
            condition_number=problem.condition_number(dependent),
            certified=optimum.certified,
            gap=sqrt(optimum.levels.ratio / optimum.least),
            candidates=problem.candidates,
            evaluated=budget.leaves,
            nodes=budget.nodes,
            ties=ties,
        )


def _break_ties(
    parts: Sequence[Part], optimum: Optimum, budget: Budget
) -> tuple[Readability, int | None]:
    """The most readable of the best choices, and how many there are."""
    best, ties = [], 0
    for levels in optimum.tied or [optimum.levels]:
        tied = [_tied_selections(part, levels, budget) for part in parts]
        if not all(tied):
            return _unlisted(parts, optimum), None
        ties += prod(
            sum(part.ways(selection) for selection in selections)
            for part, selections in zip(parts, tied, strict=True)
        )
        best.append(_readable(parts, tied))
    return min(best), ties


def _tied_selections(part: Part, levels: Levels, budget: Budget) -> list[IntArray]:
    """All selections of a part that keep to the levels; none where they are too many to list."""
    above, below = levels.smallest * (1 - TIE_TOLERANCE), levels.largest * (1 + TIE_TOLERANCE)
    large = isinstance(part.engine, BranchEngine)
    own = Budget(budget.deadline, most_nodes=MOST_TIE_NODES if large else np.inf)
    selections = part.engine.between(above, below, own)
    try:
        listed = list(islice(selections, MOST_TIES + 1))
    except OutOfBudgetError:
        return []
    finally:
        budget.nodes += own.nodes
        budget.leaves += own.leaves
    return listed if len(listed) <= MOST_TIES else []


def _unlisted(parts: Sequence[Part], optimum: Optimum) -> Readability:
    return _readable(parts, [[selection] for selection in optimum.selections])


def _readable(parts: Sequence[Part], selections: Sequence[list[IntArray]]) -> Readability:
    keys = (
        most_readable(part.null_basis, part.dependent(chosen), part.columns)
        for part, chosen in zip(parts, selections, strict=True)
    )
    return sum(keys, start=NOTHING)
