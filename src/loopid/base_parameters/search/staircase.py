"""The least ratio of largest to smallest eigenvalue over blocks chosen together.

The objective is max_b largest_b / min_b smallest_b. Walking down a staircase solves it exactly:
under a ceiling on the largest eigenvalues, raise the least smallest eigenvalue as far as it goes;
then lower the ceiling below the largest eigenvalue of that solution, since whatever lies between
is worse. The walk ends when no selection under the ceiling could still improve the ratio.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from loopid.arrays import IntArray
from loopid.base_parameters.search.block import Block, Levels
from loopid.base_parameters.search.strategy import TIE_TOLERANCE
from loopid.base_parameters.search.threshold import Budget, OutOfBudgetError, selections_between

Selections = list[IntArray]


@dataclass
class Optimum:
    """The best selections seen, one a block, and every pair of levels that reaches their ratio.

    Attributes
    ----------
    selections : list of IntArray
    levels : Levels
        Of all blocks together.
    tied : list of Levels
        All pairs of levels, each proven extreme, whose ratio ties with the best.
    certified : bool
        Whether the walk came to its end.
    """

    selections: Selections
    levels: Levels
    tied: list[Levels]
    certified: bool = False

    def offer(self, selections: Selections, levels: Levels) -> None:
        """Take note of a solution that is extreme under its ceiling."""
        if levels.ratio < self.levels.ratio * (1 - TIE_TOLERANCE):
            self.tied = []
        if levels.ratio <= self.levels.ratio * (1 + TIE_TOLERANCE):
            self.tied.append(levels)
        if levels.ratio < self.levels.ratio:
            self.selections, self.levels = selections, levels


def least_ratio(blocks: Sequence[Block], budget: Budget) -> Optimum:
    """Minimise the ratio; the result is certified unless the budget runs out."""
    start = [block.start() for block in blocks]
    optimum = Optimum(start, joint_levels(blocks, start), [])
    floor = max(block.least_largest() for block in blocks)
    ceiling: float | None = None
    try:
        while ceiling is None or ceiling > floor:
            above = floor / optimum.levels.ratio * (1 - TIE_TOLERANCE)
            found = _highest_smallest(blocks, optimum.selections, above, ceiling, budget)
            if found is None:
                break
            levels = joint_levels(blocks, found)
            optimum.offer(found, levels)
            reach = optimum.levels.ratio * levels.smallest * (1 + 2 * TIE_TOLERANCE)
            ceiling = min(levels.largest * (1 - TIE_TOLERANCE), reach)
        optimum.certified = True
    except OutOfBudgetError:
        pass
    return optimum


def joint_levels(blocks: Sequence[Block], selections: Selections) -> Levels:
    """Extreme eigenvalues over all blocks."""
    levels = [block.levels(chosen) for block, chosen in zip(blocks, selections, strict=True)]
    return Levels(min(x.smallest for x in levels), max(x.largest for x in levels))


def _highest_smallest(
    blocks: Sequence[Block],
    hints: Selections,
    above: float,
    ceiling: float | None,
    budget: Budget,
) -> Selections | None:
    """Selections whose least smallest eigenvalue is highest, all eigenvalues in a range."""
    chosen: Selections = []
    for block, hint in zip(blocks, hints, strict=True):
        levels = block.levels(hint)
        fits = levels.smallest > above and (ceiling is None or levels.largest < ceiling)
        selection = hint if fits else _first(block, above, ceiling, budget)
        if selection is None:
            return None
        chosen.append(selection)
    smallest = [block.levels(s).smallest for block, s in zip(blocks, chosen, strict=True)]
    while True:
        # Only the block with the least smallest eigenvalue limits the others.
        weakest = int(np.argmin(smallest))
        threshold = smallest[weakest] * (1 + TIE_TOLERANCE)
        better = _first(blocks[weakest], threshold, ceiling, budget)
        if better is None:
            return chosen
        chosen[weakest] = better
        smallest[weakest] = blocks[weakest].levels(better).smallest


def _first(block: Block, above: float, below: float | None, budget: Budget) -> IntArray | None:
    return next(selections_between(block, above, below, budget), None)
