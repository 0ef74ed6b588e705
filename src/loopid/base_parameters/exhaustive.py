"""Exhaustive search: every combination is looked at [Gautier1991]."""

from __future__ import annotations

from dataclasses import field
from itertools import chain, combinations, islice
from typing import ClassVar

import numpy as np

from loopid.arguments import FloatArray, IntArray
from loopid.base_parameters.choice import (
    ChoiceProblem,
    SearchEffort,
    SearchResult,
    SearchStrategy,
    condition_numbers,
)
from loopid.base_parameters.ties import most_readable, readabilities
from loopid.errors import OptionError
from loopid.records import record
from loopid.workers import Progress

DETERMINANT_SLACK = 1e-6  # round-off of a determinant, relative, for matrices that may be the best


@record(kw_only=True, checked=True)
class ExhaustiveSearch(SearchStrategy):
    """Gautier's search: evaluate every one of the C(n, d) combinations [Gautier1991].

    Each is judged by a determinant, which costs a fifth of its singular values. With all singular
    values between σ_max / κ and σ_max, |det| >= σ_max^k / κ^(k-1), and σ_max is at least the root
    mean square of the singular values, ‖X_S‖_F / sqrt(k). A combination whose determinant is
    smaller cannot have a condition number κ; only the others get their singular values computed.

    Parameters
    ----------
    effort : SearchEffort
        Its number of combinations is the most that are tried.
    chunk : int
        Combinations whose matrices are in memory together.
    progress : callable, optional
        Called with the numbers of combinations done and in all.
    """

    name: ClassVar[str] = "exhaustive"

    effort: SearchEffort = SearchEffort()
    chunk: int = 1 << 14
    progress: Progress | None = field(default=None, compare=False, repr=False)

    def _search(self, problem: ChoiceProblem) -> SearchResult:
        total, vectors, tolerance = problem.candidates, problem.vectors, self.effort.tolerance
        if total > self.effort.candidates:
            raise OptionError(
                f"exhaustive search would evaluate C({problem.size}, {problem.dependent_count}) = "
                f"{total:,} combinations (bound {self.effort.candidates:,}): use search='exact'",
                candidates=total,
                bound=self.effort.candidates,
            )
        size, count = vectors.shape
        best, least, ties = np.empty((0, count), dtype=np.int64), np.inf, 0
        every = combinations(range(size), count)
        for done in range(0, total, self.chunk):
            numbers = chain.from_iterable(islice(every, self.chunk))
            selections = np.fromiter(numbers, np.int64).reshape(-1, count)
            kept, found = promising(vectors, selections, least * (1 + tolerance))
            lowest = float(found.min(initial=np.inf))
            if least > lowest * (1 + tolerance):
                best, ties = best[:0], 0
            least = min(least, lowest)
            tied = kept[(found <= least * (1 + tolerance)) & (found < np.inf)]
            best = np.concatenate([best, selections[tied]])[: self.effort.ties]
            ties += len(tied)
            if self.progress is not None:
                self.progress(min(done + self.chunk, total), total)
        chosen = most_readable(readabilities(problem.structure.null_basis, problem.dependent(best)))
        return self._result(
            problem, chosen.dependent, certified=True, gap=1.0, evaluated=total, ties=ties
        )


def promising(
    vectors: FloatArray, selections: IntArray, most: float
) -> tuple[IntArray, FloatArray]:
    """Which of some selections (c, k) may reach a condition number, and theirs."""
    matrices, count = vectors[selections], selections.shape[1]
    mean = np.sqrt((vectors**2).sum(axis=1)[selections].sum(axis=1) / count)
    # One power of a quotient: a power of the condition number alone could overflow.
    enough = mean * (mean / most) ** (count - 1) * (1 - DETERMINANT_SLACK)
    kept = np.flatnonzero(np.abs(np.linalg.det(matrices)) >= enough)
    return kept, condition_numbers(matrices[kept])
