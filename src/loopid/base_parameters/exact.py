"""Exact search: the least condition number of all choices, with a certificate.

The null-space criterion falls apart into independent blocks; the regressor criterion is one block.
The squared condition number is l / s, the largest over the smallest eigenvalue of all blocks.
Better selections have l between ``floor`` and ``ceiling``, and s of at most ``highest``. Boxes that
branch and bound shows empty move these ends until nothing is left between them. Of ties the most
readable one is returned. Derivation in docs/derivations.md.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import combinations, count, islice
from math import sqrt
from time import thread_time
from typing import ClassVar

import numpy as np

from loopid.arguments import IntArray
from loopid.base_parameters.blocks import (
    Block,
    Budget,
    Levels,
    OutOfBudgetError,
    good_selection,
    split,
    walked,
)
from loopid.base_parameters.branch_and_bound import margin, one_between, selections_between
from loopid.base_parameters.choice import (
    MOST_TOLERANCE,
    NO_COLUMNS,
    ChoiceProblem,
    Readability,
    SearchOptions,
    SearchResult,
    SearchStrategy,
    most_readable,
    readabilities,
)
from loopid.numbers import UNIT_ROUND_OFF
from loopid.records import record

MORE_NODES = 4  # factor of the nodes of each rule at every further attempt
# Ends of the interval that are this close are worth no further question, or need no middle.
FINENESS, NEAR = 1e-2, 1.05

Selections = list[IntArray]


@record(checked=True)
class ExactSearch(SearchStrategy):
    """Find the global optimum and prove it.

    Parameters
    ----------
    options : SearchOptions

    Examples
    --------
    >>> import loopid
    >>> observation = loopid.regressors.structural_observation(loopid.load("four_bar"))
    >>> base = loopid.base_parameters.find_base(observation, loopid.base_parameters.ExactSearch())
    >>> base.search.certified, base.search.gap
    (True, 1.0)
    """

    name: ClassVar[str] = "exact"

    options: SearchOptions = SearchOptions()

    def _search(self, problem: ChoiceProblem) -> SearchResult:
        budget = Budget(thread_time() + self.options.time_limit)
        blocks, apart = split(problem)
        interval = _Interval(problem, blocks, apart, budget, self.options)
        ties, reason = None, "round-off"
        dependent = _joint_dependent(blocks, interval.best)
        if interval.tolerance <= MOST_TOLERANCE:
            try:
                interval.close()
                choice, ties, near = most_readable_tie(interval)
                dependent, reason = choice.dependent, "near ties" if near else ""
            except OutOfBudgetError:
                dependent, reason = _joint_dependent(blocks, interval.best), "time limit"
        return self._result(
            problem,
            dependent,
            certified=not reason,
            gap=interval.gap if reason != "round-off" else np.inf,
            evaluated=budget.leaves,
            nodes=budget.nodes,
            ties=ties,
            tolerance=interval.tolerance,
            reason=reason,
        )


class _Interval:
    """Better joint selections have floor <= largest < ceiling, smallest <= highest."""

    def __init__(
        self,
        problem: ChoiceProblem,
        blocks: Sequence[Block],
        apart: float,
        budget: Budget,
        options: SearchOptions,
    ) -> None:
        self.blocks, self.budget, self.options = blocks, budget, options
        least_largest = max(block.least_largest for block in blocks)
        self.best = [good_selection(block, budget) for block in blocks]
        self._known = [
            [(own, block.levels(own))] for block, own in zip(blocks, self.best, strict=True)
        ]
        self.levels = self._joint(self.best)
        self.tied = [self.levels]
        self.tolerance = self._tolerance(problem, apart)
        self._fine = self.tolerance / 16
        lowest = min(float(block.svd[1][-1]) + margin(block.count, block.size) for block in blocks)
        self.highest = lowest**2
        # Below what any selection has, so that one that ties there is met.
        self.floor = least_largest * (1 - 4 * self.tolerance)
        top = max(float(block.svd[1][0]) ** 2 for block in blocks)
        self.ceiling = min(top, self.levels.ratio * self.highest) * (1 + 4 * self._fine)

    def _tolerance(self, problem: ChoiceProblem, apart: float) -> float:
        """Relative tolerance of condition numbers that covers all round-off.

        Singular values of a selection are computed to a small multiple of the unit round-off times
        the largest one. Those of the blocks are within ``apart`` of the problem's. Its vectors have
        errors of their own.
        """
        largest = max(block.count for block in self.blocks)
        computed = 4 * largest * UNIT_ROUND_OFF * (sqrt(self.levels.ratio) + 1)
        if not self.levels.smallest > 0:
            return np.inf
        neglected = apart * (1 / sqrt(self.levels.smallest) + 1 / sqrt(self.levels.largest))
        given = problem.uncertainty(sqrt(self.levels.ratio))
        return self.options.covering(computed + neglected + given)

    @property
    def closed(self) -> bool:
        """Whether no better joint selection is left, up to the tolerance."""
        least = self.levels.ratio * (1 - 8 * self._fine)
        return self.ceiling <= self.floor or least * self.highest <= self.floor

    @property
    def gap(self) -> float:
        """Best condition number over a lower bound of all."""
        if self.closed:
            return 1.0
        return max(1.0, sqrt(self.levels.ratio * self.highest / self.floor))

    def close(self) -> None:
        """Shrink the interval until it is empty; OutOfBudgetError when time runs out before."""
        for attempt in count():
            self.budget.check()
            self._raise_floor(attempt)
            self._lower_ceiling(attempt)
            if self.closed:
                return

    def _raise_floor(self, attempt: int) -> None:
        """Rule out largest eigenvalues below u: better selections have s = l / ρ > floor / ρ.

        Boxes become smaller where one is undecided, and where one holds selections that are not
        better. If it is small already, its end goes beside such a selection.
        """
        undecided, step, barrier = np.inf, np.inf, np.inf
        while True:
            self.budget.check()
            goal = min(self.levels.largest * (1 - self._fine), self.ceiling)
            if self.floor >= goal or undecided <= self.floor * (1 + FINENESS):
                return
            tried = min(goal, self.floor * step, barrier, sqrt(self.floor * undecided))
            above = self.floor / self.levels.ratio * (1 + 2 * self._fine)
            try:
                found = self._ask(above, tried, attempt)
            except OutOfBudgetError:
                undecided = tried
                continue
            if found is None:
                self.floor, step, barrier = tried, step * step, np.inf
            elif self._offer(found):
                undecided, barrier = np.inf, np.inf
            elif tried <= self.floor * (1 + FINENESS):
                barrier = self._joint(found).largest * (1 - self._fine)
            else:
                step = sqrt(tried / self.floor)

    def _lower_ceiling(self, attempt: int) -> None:
        """Rule out smallest eigenvalues above t, so that better selections have l = ρ s <= ρ t."""
        # From the second attempt on the middle comes first, until the ends are near each other.
        wide = attempt > 0 and self.highest > NEAR * self.levels.smallest
        undecided, step, barrier = self.levels.smallest if wide else 0.0, np.inf, 0.0
        while not self.closed and self.levels.largest < self.ceiling:
            self.budget.check()
            if self.highest <= undecided * (1 + FINENESS):
                return
            least = self.levels.smallest * (1 + self._fine)
            tried = max(least, self.highest / step, barrier, sqrt(self.highest * undecided))
            try:
                found = self._ask(tried, self.ceiling, attempt)
            except OutOfBudgetError:
                undecided = tried
                continue
            if found is None:
                self.highest, step, barrier = tried, step * step, 0.0
                below = self.levels.ratio * self.highest * (1 - 4 * self._fine)
                self.ceiling = min(self.ceiling, below)
            elif self._offer(found):
                undecided, barrier = 0.0, 0.0
            elif self.highest <= tried * (1 + FINENESS):
                barrier = self._joint(found).smallest * (1 + self._fine)
            else:
                step = sqrt(self.highest / tried)

    def _ask(self, above: float, below: float, attempt: int) -> Selections | None:
        """Joint selections in a box, None if a block has none; OutOfBudgetError if undecided."""
        found: dict[int, IntArray] = {}
        # Blocks that keep the smallest eigenvalue low are the likeliest to have none.
        for b in sorted(range(len(self.blocks)), key=lambda b: self._known[b][-1][1].smallest):
            try:
                own = self._selection_in(b, above, below, attempt)
            except OutOfBudgetError:
                self.budget.check()
                continue
            if own is None:
                return None
            found[b] = own
        if len(found) < len(self.blocks):
            raise OutOfBudgetError
        return [found[b] for b in range(len(self.blocks))]

    def _selection_in(self, b: int, above: float, below: float, attempt: int) -> IntArray | None:
        """A selection of a block in a box, None if it has none; OutOfBudgetError if undecided."""
        known = [own for own, levels in self._known[b] if levels.inside(above, below)]
        if known:
            return known[-1]
        nodes = self.options.nodes * MORE_NODES**attempt
        own = one_between(self.blocks[b], (above, below), self.budget, [nodes])
        return None if own is None else self._polished(b, own, below)

    def _polished(self, b: int, selection: IntArray, below: float) -> IntArray:
        """The selection after swaps that raise its smallest eigenvalue, if it stays below."""
        block = self.blocks[b]
        better = walked(block, selection, self.budget)
        before, after = block.levels(selection), block.levels(better)
        if after.largest < below and after.smallest > before.smallest:
            selection, before = better, after
        self._known[b].append((selection, before))
        return selection

    def _offer(self, selections: Selections) -> bool:
        """Take note of a joint selection; whether it is the best so far."""
        levels, least = self._joint(selections), self.levels.ratio
        better = levels.ratio < least
        if better:
            self.best, self.levels = selections, levels
            below = levels.ratio * self.highest * (1 + 4 * self._fine)
            self.ceiling = min(self.ceiling, below)
        candidates = [*self.tied, levels]
        self.tied = []
        for one in candidates:
            ties = one.ratio <= self.levels.ratio * (1 + 2 * self.tolerance)
            if ties and not any(one.near(other, 2 * self.tolerance) for other in self.tied):
                self.tied.append(one)
        return better

    def _joint(self, selections: Selections) -> Levels:
        """Extreme eigenvalues over all blocks."""
        levels = [block.levels(own) for block, own in zip(self.blocks, selections, strict=True)]
        return Levels(min(x.smallest for x in levels), max(x.largest for x in levels))


def _joint_dependent(blocks: Sequence[Block], selections: Selections) -> tuple[int, ...]:
    parts = [
        block.columns[block.dependent(own[None])[0]]
        for block, own in zip(blocks, selections, strict=True)
    ]
    return tuple(np.sort(np.concatenate(parts)).tolist())


def overlap(tied: Sequence[Levels], tolerance: float) -> bool:
    """Whether a selection may keep to two of the best levels, and would be counted twice.

    Its value is at most the smaller largest over the larger smallest. That is below the least value
    unless the levels nearly agree.
    """
    least = min(one.ratio for one in tied) * (1 - 2 * tolerance)
    return any(
        min(one.largest, other.largest) > least * max(one.smallest, other.smallest)
        for one, other in combinations(tied, 2)
    )


def most_readable_tie(found: _Interval) -> tuple[Readability, int | None, bool]:
    """The most readable best choice, how many there are (or None), and if some nearly tie."""
    tied, tolerance, blocks = found.tied, found.tolerance, found.blocks
    options, budget = found.options, found.budget
    choices, ties, near = [], 0, overlap(tied, tolerance)
    for levels in tied:
        choice, ways = NO_COLUMNS, 1
        for block in blocks:
            selections, nearly = _listed(block, levels, tolerance, options, budget)
            near |= nearly
            if selections:
                ways *= sum(block.ways(own) for own in selections)
            else:
                ways, selections = 0, [_first(block, levels.box(tolerance), options, budget)]
            dependent = block.dependent(np.array(selections))
            if len(dependent) * len(tied) == 1:  # nothing to compare
                choice += Readability(0, 0.0, tuple(block.columns[dependent[0]].tolist()))
                continue
            batches = readabilities(block.null_basis, dependent, block.columns)
            choice += most_readable(budget.checking(batches))
        choices.append(choice)
        ties = ties + ways if ways and (ties or len(choices) == 1) else 0
    return most_readable(choices), None if near else ties or None, near


def _listed(
    block: Block, levels: Levels, tolerance: float, options: SearchOptions, budget: Budget
) -> tuple[list[IntArray], bool]:
    """All selections that keep to the levels, and whether some nearly do; none if too many.

    What is within half of the tolerance keeps to them, what is beyond twice of it does not.
    Selections between are near ties, which round-off would decide.
    """
    if block.size == block.count:
        return [np.arange(block.size)], False
    part = budget.part(options.nodes * MORE_NODES)
    found = selections_between(block, *levels.box(2 * tolerance), part)
    try:
        listed = list(islice(found, options.ties + 1))
    except OutOfBudgetError:
        budget.check()
        return [], False
    finally:
        budget.add(part)
    if len(listed) > options.ties:
        return [], False
    kept = [own for own in listed if block.levels(own).inside(*levels.box(tolerance / 2))]
    return kept, len(kept) < len(listed)


def _first(
    block: Block, box: tuple[float, float], options: SearchOptions, budget: Budget
) -> IntArray:
    """The selection in a box that makes the first columns dependent.

    Column after column is made dependent where some selection allows it. This answer does not
    depend on how selections are found.
    """
    settled: tuple[list[int], list[int]] = ([], [])
    dependent, base = settled if block.selects_dependent else settled[::-1]

    def some(row: list[int]) -> IntArray | None:
        dependent.extend(row)
        rows = np.array(settled[0], dtype=np.int64), np.array(settled[1], dtype=np.int64)
        del dependent[len(dependent) - len(row) :]
        node_limits = (options.nodes * MORE_NODES**attempt for attempt in count())
        return one_between(block, box, budget, node_limits, settled=rows)

    witness = some([])
    if witness is None:  # a selection with these levels is known
        raise OutOfBudgetError
    for row in range(block.size):
        if (row in witness) != block.selects_dependent:
            found = some([row])
            if found is None:
                base.append(row)
                continue
            witness = found
        dependent.append(row)
    return witness
