"""The subgroup search of the knee-rehabilitation paper [its section II.C].

It looks at n* = (1 + α) r rows of V2 at a time, and tries all C(n*, d) choices among them. Then the
row that occurs most often in the worse half of the invalid choices makes room for the next one. The
outcome of the pseudocode depends on round-off, that of the default variant does not: docs/paper.md.
"""

from __future__ import annotations

from itertools import combinations
from math import ceil, comb
from typing import Annotated, ClassVar

import numpy as np
from pydantic import Field

from loopid.arguments import BoolArray, FloatArray, IntArray
from loopid.base_parameters.account import SubgroupAccount, TriedGroup
from loopid.base_parameters.choice import (
    ChoiceProblem,
    SearchOptions,
    SearchResult,
    SearchStrategy,
    largest_over_least,
)
from loopid.base_parameters.rank import pivots
from loopid.errors import OptionError
from loopid.records import record

# Singular values below this fraction of the largest are zero to the variant "gap": null vectors are
# known to some 1e-12, and regular choices of robots stay above 1e-4.
RANK_TOLERANCE = 1e-8
VARIANTS = ("gap", "pseudocode")
PAPER_LIMIT, PAPER_ALPHA = 2000.0, 0.25  # cond_limit and α of the paper
DIGITS = 6  # that condition numbers are compared with


@record(kw_only=True, checked=True)
class SubgroupSearch(SearchStrategy):
    """Search subgroups of rows [the paper's section II.C].

    Parameters
    ----------
    options : SearchOptions
        Its memory bounds a group.
    condition_limit : float
        A choice is valid when V22 has full rank and a condition number below this.
    alpha : float
        Group rising factor, 0 < alpha <= 0.5.
    variant : str
        ``"gap"``: rank by a gap, invalid choices in the order of their rank and of the condition
        number of what is not zero, rows in the order of pivoted QR. ``"pseudocode"``: as printed
        in the paper.

    Examples
    --------
    >>> import loopid
    >>> observation = loopid.regressors.structural_observation(loopid.load("four_bar"))
    >>> search = loopid.base_parameters.SubgroupSearch(alpha=0.5)
    >>> base = loopid.base_parameters.find_base(observation, search)
    >>> base.search.found, base.search.certified
    (True, False)
    """

    name: ClassVar[str] = "subgroup"

    options: SearchOptions = SearchOptions()
    condition_limit: Annotated[float, Field(gt=1)] = PAPER_LIMIT
    alpha: Annotated[float, Field(gt=0, le=0.5)] = PAPER_ALPHA
    variant: str = "gap"

    def __post_init__(self) -> None:
        OptionError.require("variant", self.variant, VARIANTS)

    def group_size(self, problem: ChoiceProblem) -> int:
        """Rows n* of a group; OptionError if that makes no combination, or too many."""
        d, r = problem.dependent_count, problem.structure.rank
        # Rounded first: 1.1 * 50 is a little more than 55 in binary.
        size = min(ceil(round((1 + self.alpha) * r, 9)), problem.size)
        if d > size:
            raise OptionError(
                f"subgroup search has no combinations: it would choose n - r = {d} of the "
                f"n* = {size} rows of a group (n = {problem.size}, r = {r}, alpha = {self.alpha}): "
                "use search='exact'",
                dependent=d,
                group=size,
            )
        needed, bound = comb(size, d) * d * (d + 2) * 8, self.options.memory
        if needed > bound:
            raise OptionError(
                f"a group of subgroup search has C({size}, {d}) = {comb(size, d):,} combinations, "
                f"which take {needed / 2**30:,.1f} GiB (bound {bound / 2**30:g} GiB): use "
                "search='exact'",
                needed=needed,
                bound=bound,
            )
        return size

    def _search(self, problem: ChoiceProblem) -> SearchResult:
        size, d = self.group_size(problem), problem.dependent_count
        places = np.array(list(combinations(range(size), d)), dtype=np.int64)
        order = self._order(problem)
        rows = order[:size]
        best, groups = None, list[TriedGroup]()
        for added in [*order[size:].tolist(), None]:
            group, choice = self._tried(problem, rows, places, added)
            if group.least < min((other.least for other in groups), default=np.inf):
                best = choice
            groups.append(group)
            rows = np.append(rows[rows != group.removed], added)
        account = SubgroupAccount(self.variant, self.alpha, self.condition_limit, d, tuple(groups))
        return self._result(
            problem, best, certified=False, evaluated=account.tried, subgroups=account
        )

    def _tried(
        self, problem: ChoiceProblem, rows: IntArray, places: IntArray, added: int | None
    ) -> tuple[TriedGroup, IntArray | None]:
        """A group after all its choices were tried, and the best of them."""
        choices = np.sort(rows[places], axis=1)
        conditions, full_rank, order = self._judge(problem.structure.null_basis[choices])
        valid = full_rank & (conditions < self.condition_limit)
        invalid = order[~(full_rank if self.variant == "pseudocode" else valid)[order]]
        worse = choices[invalid[len(invalid) // 2 :]]
        least, best = self._best_valid(problem, choices, np.flatnonzero(valid))
        # Without invalid choices the first row makes room.
        counts = (worse[:, :, None] == rows).sum(axis=(0, 1))
        leaves = int(counts.argmax())
        group = TriedGroup(
            rows=tuple(rows.tolist()),
            condition_numbers=conditions,
            full_rank=full_rank,
            valid=int(valid.sum()),
            least=least,
            best=best,
            removed=None if added is None else int(rows[leaves]),
            added=added,
            share=0.0 if added is None else float(counts[leaves]) / max(len(worse), 1),
        )
        return group, None if best is None else choices[best]

    def _order(self, problem: ChoiceProblem) -> IntArray:
        """The order in which rows come into the group."""
        if self.variant != "gap":
            return np.arange(problem.size)
        V2 = problem.structure.null_basis
        first = pivots(V2, problem.dependent_count)
        return np.concatenate([first, np.setdiff1d(np.arange(problem.size), first)])

    def _judge(self, V22: FloatArray) -> tuple[FloatArray, BoolArray, IntArray]:
        """Condition numbers of choices (c, d, d), who has full rank, and the order, worst last."""
        values = np.linalg.svd(V22, compute_uv=False)
        conditions = largest_over_least(np.asarray(values))
        if self.variant == "pseudocode":
            # The numerical rank of MATLAB and NumPy.
            full_rank = values[:, -1] > V22.shape[1] * np.finfo(float).eps * values[:, 0]
            return conditions, full_rank, np.argsort(conditions, kind="stable")
        ranks = (values > RANK_TOLERANCE * values[:, :1]).sum(axis=1)
        last = values[np.arange(len(values)), np.maximum(ranks, 1) - 1]
        kept = np.where(last > 0, values[:, 0], 1.0) / np.where(last > 0, last, 1.0)
        # Choices of lower rank are worse; rounded, so that equal ones stay in their order.
        order = np.lexsort((np.log(kept).round(DIGITS), -ranks))
        return conditions, ranks == V22.shape[1], order

    def _best_valid(
        self, problem: ChoiceProblem, choices: IntArray, valid: IntArray
    ) -> tuple[float, int | None]:
        """The least value of the criterion, and which valid choice has it first."""
        if len(valid) == 0:
            return np.inf, None
        values = problem.condition_numbers(choices[valid])
        if self.variant == "gap":
            values = 10.0 ** np.log10(values).round(DIGITS)
        first = int(values.argmin())
        return float(values[first]), int(valid[first])
