"""The subgroup search of the knee-rehabilitation paper, as its pseudocode has it.

It looks at n* = (1 + α) r rows of V2 at a time, tries all C(n*, d) choices among them, then drops
the row that occurs most often in the worse half of the invalid choices and takes in the next one.
What the paper leaves open is decided here and explained in docs/paper.md: n* is rounded up and at
most n, ties for the most frequent row go to the first, and without invalid choices the first row
of the group makes room.
"""

from __future__ import annotations

from itertools import combinations
from math import ceil, comb

import numpy as np

from loopid.arguments import checked
from loopid.arrays import FloatArray, IntArray
from loopid.base_parameters.search.problem import ChoiceProblem, condition_numbers
from loopid.base_parameters.search.strategy import SearchResult, SearchStrategy
from loopid.errors import OptionError, SearchError

VARIANTS = ("pseudocode", "text")
MEMORY_BOUND = 2**30  # bytes that the combinations and matrices of one group may take


class SubgroupSearch(SearchStrategy):
    """Search subgroups of rows [the paper's section II.C].

    Parameters
    ----------
    condition_limit : float
        A choice is valid when V22 has full rank and a condition number below this.
    alpha : float
        Group rising factor, 0 < alpha <= 0.5.
    variant : str
        What becomes of full-rank choices at or above the limit: ``"pseudocode"`` drops them,
        ``"text"`` counts them as invalid ones (M_nc).
    """

    name = "subgroup"

    @checked
    def __init__(
        self, condition_limit: float = 2000.0, alpha: float = 0.25, variant: str = "pseudocode"
    ) -> None:
        if not 0 < alpha <= 0.5:
            raise OptionError(f"alpha must be in (0, 0.5], not {alpha}")
        if not condition_limit > 1:
            raise OptionError(f"condition_limit must exceed 1, not {condition_limit}")
        if variant not in VARIANTS:
            raise OptionError.unknown("variant", variant, VARIANTS)
        self.condition_limit = condition_limit
        self.alpha = alpha
        self.variant = variant

    def group_size(self, problem: ChoiceProblem) -> int:
        """Rows n* of one group.

        Raises
        ------
        SearchError
            Where a group holds no combination at all, or too many for the memory bound.
        """
        d, r = problem.dependent_count, problem.structure.rank
        # Rounded first: 1.1 * 50 is a little more than 55 in binary.
        size = min(ceil(round((1 + self.alpha) * r, 9)), problem.size)
        if d > size:
            raise SearchError(
                f"subgroup search has no combinations: it would choose n - r = {d} of the "
                f"n* = {size} rows of a group (n = {problem.size}, r = {r}, alpha = {self.alpha})"
            )
        needed = comb(size, d) * d * (d + 2) * 8
        if needed > MEMORY_BOUND:
            raise SearchError(
                f"a group of subgroup search has C({size}, {d}) = {comb(size, d):,} combinations, "
                f"which take {needed / 2**30:,.1f} GiB (bound {MEMORY_BOUND / 2**30:g} GiB)"
            )
        return size

    def _search(self, problem: ChoiceProblem) -> SearchResult:
        size, d = self.group_size(problem), problem.dependent_count
        places = np.array(list(combinations(range(size), d)), dtype=np.int64)
        group = np.arange(size)
        best: IntArray | None = None
        least, evaluated = np.inf, 0
        for last in range(size, problem.size + 1):
            choices = np.sort(group[places], axis=1)
            valid, invalid, conditions = self._judge(problem, choices)
            evaluated += len(choices)
            value, choice = _best_valid(problem, choices[valid])
            if value < least:
                least, best = value, choice
            if last < problem.size:
                worst = _most_frequent(choices[invalid], conditions[invalid], group)
                group = np.append(group[group != worst], last)
        return SearchResult(
            name=self.name,
            criterion=problem.criterion,
            dependent=None if best is None else tuple(int(j) for j in best),
            condition_number=float(least),
            certified=False,
            candidates=problem.candidates,
            evaluated=evaluated,
        )

    def _judge(
        self, problem: ChoiceProblem, choices: IntArray
    ) -> tuple[IntArray, IntArray, FloatArray]:
        """Valid and invalid choices, and the condition numbers of all."""
        V22 = problem.structure.null_basis[choices]
        values = np.linalg.svd(V22, compute_uv=False)
        largest, smallest = values[:, 0], values[:, -1]
        with np.errstate(divide="ignore", invalid="ignore"):
            conditions = np.where(smallest > 0, largest / smallest, np.inf)
        # The numerical rank of MATLAB and NumPy.
        full_rank = smallest > V22.shape[1] * np.finfo(float).eps * largest
        valid = full_rank & (conditions < self.condition_limit)
        invalid = ~full_rank if self.variant == "pseudocode" else ~valid
        return np.flatnonzero(valid), np.flatnonzero(invalid), conditions


def _best_valid(problem: ChoiceProblem, choices: IntArray) -> tuple[float, IntArray | None]:
    """The first of the valid choices with the least value of the criterion."""
    if len(choices) == 0:
        return np.inf, None
    if problem.criterion == "nullspace":
        selections = choices
    else:
        is_base = np.ones((len(choices), problem.size), dtype=bool)
        np.put_along_axis(is_base, choices, False, axis=1)
        selections = np.nonzero(is_base)[1].reshape(len(choices), -1)
    values = condition_numbers(problem.vectors[selections])
    first = int(values.argmin())
    return float(values[first]), choices[first]


def _most_frequent(choices: IntArray, conditions: FloatArray, group: IntArray) -> int:
    """The row of the group that occurs most often in the worse half of the invalid choices."""
    if len(choices) == 0:
        return int(group[0])
    worse = choices[np.argsort(conditions, kind="stable")[len(choices) // 2 :]]
    counts = (worse[:, :, None] == group).sum(axis=(0, 1))
    return int(group[counts.argmax()])
