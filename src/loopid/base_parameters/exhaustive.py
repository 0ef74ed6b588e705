"""Gautier's search: every one of the C(n, d) combinations [Gautier1991].

Each combination is judged by a determinant, which costs a fifth of its singular values. With all
singular values between σ_max / κ and σ_max, |det| >= σ_max^k / κ^(k-1), and σ_max is at least the
root mean square of the singular values, ‖X_S‖_F / sqrt(k). A combination whose determinant is
smaller cannot have a condition number κ; only the others get their singular values computed.
"""

from __future__ import annotations

from itertools import chain, combinations, islice

import numpy as np

from loopid.arguments import checked
from loopid.arrays import FloatArray, IntArray
from loopid.base_parameters.choice import (
    TIE_TOLERANCE,
    ChoiceProblem,
    SearchResult,
    SearchStrategy,
    condition_numbers,
    most_readable,
    readabilities,
)
from loopid.errors import SearchError
from loopid.workers import Progress

MOST_CANDIDATES = 2_000_000_000
CHUNK = 1 << 14  # combinations whose matrices are in memory together
# Round-off of a determinant, relative, for matrices that could be the best.
DETERMINANT_SLACK = 1e-6
MOST_TIES = 20_000  # selections among which the most readable is chosen; the others are counted


class ExhaustiveSearch(SearchStrategy):
    """Evaluate all combinations, in bounded memory.

    Parameters
    ----------
    progress : callable, optional
        Called with the numbers of combinations done and in all.
    """

    name = "exhaustive"

    @checked
    def __init__(self, progress: Progress | None = None) -> None:
        self.progress = progress

    def _search(self, problem: ChoiceProblem) -> SearchResult:
        total, vectors = problem.candidates, problem.vectors
        if total > MOST_CANDIDATES:
            raise SearchError(
                f"exhaustive search would evaluate C({problem.size}, {problem.dependent_count}) = "
                f"{total:,} combinations (bound {MOST_CANDIDATES:,}): use search='exact'"
            )
        size, count = vectors.shape
        best, least, ties = np.empty((0, count), dtype=np.int64), np.inf, 0
        every = combinations(range(size), count)
        for done in range(0, total, CHUNK):
            numbers = chain.from_iterable(islice(every, CHUNK))
            selections = np.fromiter(numbers, np.int64).reshape(-1, count)
            kept, found = promising(vectors, selections, least)
            lowest = float(found.min(initial=np.inf))
            if least > lowest * (1 + TIE_TOLERANCE):
                best, ties = best[:0], 0
            least = min(least, lowest)
            tied = kept[(found <= least * (1 + TIE_TOLERANCE)) & (found < np.inf)]
            best, ties = np.concatenate([best, selections[tied]])[:MOST_TIES], ties + len(tied)
            if self.progress is not None:
                self.progress(min(done + CHUNK, total), total)
        chosen = most_readable(readabilities(problem.structure.null_basis, problem.dependent(best)))
        return SearchResult(
            name=self.name,
            criterion=problem.criterion,
            dependent=chosen.dependent,
            condition_number=problem.condition_number(np.array(chosen.dependent)),
            certified=True,
            gap=1.0,
            candidates=total,
            evaluated=total,
            ties=ties,
        )


def promising(
    vectors: FloatArray, selections: IntArray, least: float
) -> tuple[IntArray, FloatArray]:
    """Which of some selections (c, k) may reach a condition number, and theirs."""
    matrices, count = vectors[selections], selections.shape[1]
    mean = np.sqrt((vectors**2).sum(axis=1)[selections].sum(axis=1) / count)
    # One power of a quotient: a power of the condition number alone could overflow.
    quotient = mean / (least * (1 + TIE_TOLERANCE))
    enough = mean * quotient ** (count - 1) * (1 - DETERMINANT_SLACK)
    kept = np.flatnonzero(np.abs(np.linalg.det(matrices)) >= enough)
    return kept, condition_numbers(matrices[kept])
