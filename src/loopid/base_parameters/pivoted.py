"""Pivoted QR: the choice that is made in one pass, without a search."""

from __future__ import annotations

from typing import ClassVar

from loopid.base_parameters.choice import ChoiceProblem, SearchResult, SearchStrategy
from loopid.base_parameters.rank import pivots
from loopid.base_parameters.structure import base_columns
from loopid.records import record


@record
class PivotedQR(SearchStrategy):
    """Take the columns of W greedily, each the one farthest from the span of those taken."""

    name: ClassVar[str] = "qr"

    def _search(self, problem: ChoiceProblem) -> SearchResult:
        base = pivots(problem.structure.row_factor.T, problem.structure.rank)
        dependent = base_columns(problem.size, base)
        return self._result(problem, dependent, certified=False, evaluated=1)
