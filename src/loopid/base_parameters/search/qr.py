"""Pivoted QR: the common practice, good but with no word on how good."""

from __future__ import annotations

import numpy as np

from loopid.arrays import FloatArray, IntArray
from loopid.base_parameters.search.problem import ChoiceProblem, SearchResult, SearchStrategy
from loopid.base_parameters.structure import base_columns

# Remaining norms that differ by less than this fraction are equal: the first vector is taken.
EQUAL_NORMS = 1e-6
LEFT = 1e-6  # of a squared norm, from which on subtracting leaves it inexact


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
    basis, along = np.empty((count, vectors.shape[1])), np.empty((len(vectors), count))
    squares = np.einsum("ij,ij->i", vectors, vectors)  # of what is left of each vector
    exact, chosen = squares.copy(), np.empty(count, dtype=np.int64)
    for k in range(count):
        norms = np.sqrt(np.maximum(squares, 0.0))
        norms[chosen[:k]] = -1.0
        chosen[k] = pivot = int(np.argmax(norms >= norms.max() * (1 - EQUAL_NORMS)))
        rest = vectors[pivot].copy()
        for _ in range(2):  # once more for what round-off left
            rest -= (basis[:k] @ rest) @ basis[:k]
        basis[k] = rest / (np.linalg.norm(rest) or 1.0)
        along[:, k] = vectors @ basis[k]
        squares -= along[:, k] ** 2
        # What is left of a vector after much was taken away is round-off: it is found anew.
        if len(lost := np.flatnonzero(squares < LEFT * exact)):
            left = vectors[lost] - along[lost, : k + 1] @ basis[: k + 1]
            squares[lost] = exact[lost] = np.einsum("ij,ij->i", left, left)
    return chosen
