"""The interface of all searches, and what they answer."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass, replace
from math import inf
from time import perf_counter
from typing import ClassVar

import numpy as np

from loopid.base_parameters.search.problem import ChoiceProblem
from loopid.threads import one_blas_thread

# Choices whose condition numbers differ by less than this fraction are ties.
TIE_TOLERANCE = 1e-9


@dataclass(frozen=True)
class SearchResult:
    """What a search found.

    Attributes
    ----------
    name, criterion : str
    dependent : tuple of int or None
        Dependent columns, ascending, among those with an effect; None where nothing was found.
    condition_number : float
        The criterion's value; infinite where nothing was found.
    certified : bool
        Whether no choice is better by more than ``tolerance`` times the value.
    gap : float
        No choice has a condition number of less than the value over this, up to ``tolerance``: 1
        where it is certified, infinite where nothing was proven.
    candidates : int
        Number of combinations there are.
    evaluated : int
        Number of combinations that were looked at one by one.
    nodes : int
        Nodes of the search tree, 0 for strategies without one.
    ties : int or None
        Number of best choices; None where they were not counted.
    tolerance : float
        Relative; see ``certified``.
    seconds : float
    """

    name: str
    criterion: str
    dependent: tuple[int, ...] | None
    condition_number: float
    certified: bool
    candidates: int
    evaluated: int
    nodes: int = 0
    ties: int | None = None
    gap: float = inf
    tolerance: float = TIE_TOLERANCE
    seconds: float = 0.0

    @property
    def found(self) -> bool:
        """Whether there is an answer at all."""
        return self.dependent is not None


class SearchStrategy(ABC):
    """A way of choosing the dependent parameters."""

    name: ClassVar[str]

    def search(self, problem: ChoiceProblem) -> SearchResult:
        """Solve a choice problem, on one BLAS thread: the matrices are small.

        Raises
        ------
        SearchError
            Where the strategy cannot be applied.
        """
        start = perf_counter()
        with one_blas_thread():
            result = self._search(problem) if problem.dependent_count else _no_choice(self, problem)
        return replace(result, seconds=perf_counter() - start)

    @abstractmethod
    def _search(self, problem: ChoiceProblem) -> SearchResult: ...


def _no_choice(strategy: SearchStrategy, problem: ChoiceProblem) -> SearchResult:
    """The only answer where every parameter is a base parameter."""
    return SearchResult(
        name=strategy.name,
        criterion=problem.criterion,
        dependent=(),
        condition_number=problem.condition_number(np.empty(0, dtype=np.int64)),
        certified=True,
        candidates=1,
        evaluated=1,
        ties=1,
        gap=1.0,
    )
