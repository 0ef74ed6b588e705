"""Pivoted QR: the common practice, good but with no word on how good."""

from __future__ import annotations

import numpy as np
from scipy.linalg import qr

from loopid.arrays import IntArray
from loopid.base_parameters.search.problem import ChoiceProblem
from loopid.base_parameters.search.strategy import SearchResult, SearchStrategy


class PivotedQR(SearchStrategy):
    """Take the columns of W greedily, each the one farthest from those taken."""

    name = "qr"

    def _search(self, problem: ChoiceProblem) -> SearchResult:
        dependent = pivoted_dependent(problem)
        return SearchResult(
            name=self.name,
            criterion=problem.criterion,
            dependent=tuple(int(j) for j in dependent),
            condition_number=problem.condition_number(dependent),
            certified=False,
            candidates=problem.candidates,
            evaluated=1,
        )


def pivoted_dependent(problem: ChoiceProblem) -> IntArray:
    """Columns that pivoted QR of the regressor leaves for last, ascending; shape (d,)."""
    _, _, order = qr(problem.structure.row_factor, mode="economic", pivoting=True)
    return np.sort(order[problem.structure.rank :]).astype(np.int64)
