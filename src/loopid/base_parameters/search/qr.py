"""Pivoted QR: the common practice, good but with no word on how good."""

from __future__ import annotations

import numpy as np

from loopid.arrays import FloatArray, IntArray
from loopid.base_parameters.search.problem import ChoiceProblem, SearchResult, SearchStrategy
from loopid.base_parameters.structure import base_columns

# Remaining norms that differ by less than this fraction are equal: the first vector is taken.
EQUAL_NORMS = 1e-6


class PivotedQR(SearchStrategy):
    """Take the columns of W greedily, each the one farthest from the span of those taken."""

    name = "qr"

    def _search(self, problem: ChoiceProblem) -> SearchResult:
        structure = problem.structure
        base = pivots(structure.row_factor.T, structure.rank)
        dependent = base_columns(problem.size, base)
        return SearchResult(
            name=self.name,
            criterion=problem.criterion,
            dependent=tuple(dependent.tolist()),
            condition_number=problem.condition_number(dependent),
            certified=False,
            candidates=problem.candidates,
            evaluated=1,
        )


def pivots(vectors: FloatArray, count: int) -> IntArray:
    """Rows (count,) of vectors (n, m) in the order of pivoted QR; round-off decides no pivot."""
    rest, chosen = np.array(vectors), np.empty(0, dtype=np.int64)
    for _ in range(count):
        norms = np.linalg.norm(rest, axis=1)
        norms[chosen] = -1.0
        pivot = int(np.argmax(norms >= norms.max() * (1 - EQUAL_NORMS)))
        chosen = np.append(chosen, pivot)
        direction = rest[pivot] / (norms[pivot] or 1.0)
        for _ in range(2):  # once more for what round-off left
            rest -= np.outer(rest @ direction, direction)
    return chosen
