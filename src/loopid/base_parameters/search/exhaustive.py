"""Gautier's search: every one of the C(n, d) combinations [Gautier1991].

Each combination is judged by a determinant, which costs a fifth of its singular values. With all
singular values between σ_max / κ and σ_max, |det| >= σ_max^k / κ^(k-1), and σ_max is at least the
root mean square of the singular values, ‖X_S‖_F / sqrt(k). A combination whose determinant is
smaller cannot have a condition number κ; only the others get their singular values computed.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import ProcessPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from itertools import islice
from math import comb
from multiprocessing import get_context
from os import cpu_count

import numpy as np

from loopid.arguments import checked
from loopid.arrays import FloatArray, IntArray
from loopid.base_parameters.search.problem import (
    TIE_TOLERANCE,
    ChoiceProblem,
    SearchResult,
    SearchStrategy,
    condition_numbers,
    most_readable,
    readabilities,
)
from loopid.errors import SearchError
from loopid.workers import Progress, one_blas_thread, require_processes

MOST_CANDIDATES = 2_000_000_000
CHUNK = 1 << 14  # combinations whose matrices are in memory together
TASK = 1 << 18  # combinations that one worker takes at a time
TASKS_PER_WAVE = 4
# Round-off of a determinant, relative, for matrices that could be the best.
DETERMINANT_SLACK = 1e-6
MOST_TIES = 20_000  # selections listed to choose the most readable among; the others are counted


@dataclass(frozen=True)
class Best:
    """The least condition number in a range, and the selections (c, k) that reach it."""

    value: float
    selections: IntArray
    ties: int

    @classmethod
    def of(cls, values: FloatArray, selections: IntArray) -> Best:
        """The best of selections (c, k) with condition numbers (c,)."""
        least = float(values.min(initial=np.inf))
        tied = np.flatnonzero((values <= least * (1 + TIE_TOLERANCE)) & (least < np.inf))
        return cls(least, selections[tied[:MOST_TIES]], len(tied))

    def merge(self, other: Best) -> Best:
        """The better of two, or both where they tie."""
        low, high = sorted((self, other), key=lambda best: best.value)
        if high.ties == 0 or high.value > low.value * (1 + TIE_TOLERANCE):
            return low
        together = np.concatenate([self.selections, other.selections])[:MOST_TIES]
        return Best(low.value, together, self.ties + other.ties)


class ExhaustiveSearch(SearchStrategy):
    """Evaluate all combinations, in bounded memory, on all cores.

    Parameters
    ----------
    workers : int, optional
        Processes; by default one a core, and none for small problems.
    progress : callable, optional
        Called with the numbers of combinations done and in all.
    """

    name = "exhaustive"

    @checked
    def __init__(self, workers: int | None = None, progress: Progress | None = None) -> None:
        if workers is not None:
            require_processes(workers, "workers")
        self.workers = workers
        self.progress = progress

    def _search(self, problem: ChoiceProblem) -> SearchResult:
        total = problem.candidates
        if total > MOST_CANDIDATES:
            raise SearchError(
                f"exhaustive search would evaluate C({problem.size}, {problem.dependent_count}) = "
                f"{total:,} combinations (bound {MOST_CANDIDATES:,}): use search='exact'"
            )
        best = self._evaluate_all(problem.vectors, total)
        choices = problem.dependent(best.selections)
        chosen = most_readable(readabilities(problem.structure.null_basis, choices))
        return SearchResult(
            name=self.name,
            criterion=problem.criterion,
            dependent=chosen.dependent,
            condition_number=problem.condition_number(np.array(chosen.dependent)),
            certified=True,
            gap=1.0,
            candidates=total,
            evaluated=total,
            ties=best.ties,
        )

    def _evaluate_all(self, vectors: FloatArray, total: int) -> Best:
        tasks = ((first, min(first + TASK, total)) for first in range(0, total, TASK))
        workers = min(self.workers or cpu_count() or 1, -(-total // TASK))
        best, done = nothing_yet(vectors.shape[1]), 0
        with _pool(workers) as run_all:
            # A wave of tasks knows the best of the waves before it, which spares it most work.
            while wave := list(islice(tasks, TASKS_PER_WAVE * workers)):
                for part in run_all(partial(best_in_range, vectors, best.value), wave):
                    best = best.merge(part)
                done = wave[-1][1]
                if self.progress is not None:
                    self.progress(done, total)
        return best


def nothing_yet(count: int) -> Best:
    """The best of no selections."""
    return Best(np.inf, np.empty((0, count), dtype=np.int64), 0)


def best_in_range(vectors: FloatArray, incumbent: float, ranks: tuple[int, int]) -> Best:
    """The best selections among those with lexicographic ranks in a range.

    Selections that cannot reach the incumbent's condition number may be left out.
    """
    size, count = vectors.shape
    squares = (vectors**2).sum(axis=1)
    best = nothing_yet(count)
    with one_blas_thread():
        for first in range(*ranks, CHUNK):
            selections = unrank(np.arange(first, min(first + CHUNK, ranks[1])), size, count)
            matrices = vectors[selections]
            mean_square = squares[selections].sum(axis=1) / count
            reach = min(incumbent, best.value) * (1 + TIE_TOLERANCE)
            # One power of a quotient: a power of the reach alone could overflow.
            quotient = np.sqrt(mean_square) / reach
            least = np.sqrt(mean_square) * quotient ** (count - 1) * (1 - DETERMINANT_SLACK)
            kept = np.flatnonzero(np.abs(np.linalg.det(matrices)) >= least)
            if len(kept):
                best = best.merge(Best.of(condition_numbers(matrices[kept]), selections[kept]))
    return best


def unrank(ranks: IntArray, size: int, count: int) -> IntArray:
    """Combinations with the given lexicographic ranks.

    Parameters
    ----------
    ranks : IntArray
        (c,), in 0 ... C(size, count) - 1, which must fit in 64 bits.
    size, count : int
        Choose ``count`` of ``range(size)``.

    Returns
    -------
    IntArray
        (c, count), ascending in each row.
    """
    # The combinatorial number system counts backwards: C(n, k) - 1 - rank = Σ C(c_j, k - j),
    # and the element chosen at place j is n - 1 - c_j.
    left = comb(size, count) - 1 - np.asarray(ranks, dtype=np.int64)
    chosen = np.empty((len(left), count), dtype=np.int64)
    largest = np.iinfo(np.int64).max
    for place in range(count):
        # Entries beyond every rank only have to stay beyond them.
        entries = [min(comb(c, count - place), largest) for c in range(size)]
        table = np.array(entries, dtype=np.int64)
        digit = np.searchsorted(table, left, side="right") - 1
        left = left - table[digit]
        chosen[:, place] = size - 1 - digit
    return chosen


@contextmanager
def _pool(workers: int) -> Iterator[Callable[..., Iterable[Best]]]:
    if workers == 1:
        yield map
        return
    with ProcessPoolExecutor(workers, mp_context=get_context("spawn")) as executor:
        yield executor.map
