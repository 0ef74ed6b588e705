"""The least ratio of largest to smallest eigenvalue over blocks chosen together.

The objective is max_b largest_b / min_b smallest_b. Walking down a staircase solves it exactly:
under a ceiling on the largest eigenvalues, raise the least smallest eigenvalue as far as it goes;
then lower the ceiling below the largest eigenvalue of that solution, since whatever lies between
is worse. The walk ends when no selection under the ceiling could still improve the ratio.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from loopid.arrays import IntArray
from loopid.base_parameters.search.block import Levels
from loopid.base_parameters.search.bracket import Bracket
from loopid.base_parameters.search.engines import Engine
from loopid.base_parameters.search.strategy import TIE_TOLERANCE
from loopid.base_parameters.search.threshold import Budget, OutOfBudgetError

Selections = list[IntArray]
# Efforts spent on raising the floor, and the fraction of the top at which it steps there.
FLOOR_EFFORTS = 2
FINEST_FLOOR = 0.02


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
    least : float
        No selections have a smaller ratio, up to ties.
    """

    selections: Selections
    levels: Levels
    tied: list[Levels] = field(default_factory=list)
    least: float = 1.0

    @property
    def certified(self) -> bool:
        """Whether the walk came to its end."""
        return self.least >= self.levels.ratio

    def offer(self, selections: Selections, levels: Levels) -> None:
        """Take note of a solution that is extreme under its ceiling."""
        if levels.ratio < self.levels.ratio * (1 - TIE_TOLERANCE):
            self.tied = []
        if levels.ratio <= self.levels.ratio * (1 + TIE_TOLERANCE):
            self.tied.append(levels)
        if levels.ratio < self.levels.ratio:
            self.selections, self.levels = selections, levels


def least_ratio(engines: Sequence[Engine], budget: Budget) -> Optimum:
    """Minimise the ratio; the result is certified unless the budget runs out."""
    floor = max(engine.least_largest for engine in engines)
    start = [engine.start(floor) for engine in engines]
    optimum = Optimum(start, joint_levels(engines, start))
    brackets = [
        Bracket(engine, selection, engine.most_smallest)
        for engine, selection in zip(engines, start, strict=True)
    ]
    ceiling = np.inf
    try:
        floor = _raised_floor(engines, optimum, floor, budget)
        while ceiling > floor:
            _raise_smallest(brackets, budget)
            found = [bracket.selection for bracket in brackets]
            levels = joint_levels(engines, found)
            optimum.offer(found, levels)
            reach = optimum.levels.ratio * levels.smallest * (1 + 2 * TIE_TOLERANCE)
            ceiling = min(levels.largest * (1 - TIE_TOLERANCE), reach)
            above = floor / optimum.levels.ratio * (1 - TIE_TOLERANCE)
            if ceiling <= floor or not _lower_ceiling(brackets, ceiling, above, budget):
                break
        optimum.least = optimum.levels.ratio
    except OutOfBudgetError:
        reached = [bracket.selection for bracket in brackets]
        optimum.offer(reached, joint_levels(engines, reached))
        # Under the ceiling the smallest eigenvalue is at most that of the lowest bracket.
        highest = min(bracket.high for bracket in brackets)
        optimum.least = min(optimum.levels.ratio, floor / highest)
    return optimum


def _raised_floor(
    engines: Sequence[Engine], optimum: Optimum, floor: float, budget: Budget
) -> float:
    """A level that the largest eigenvalue of all better selections reaches.

    A better selection with a largest eigenvalue below a level u and at least the floor has a
    smallest one above floor / ratio. Where one block has none such, u is a floor as well.
    """
    pairs = zip(engines, optimum.selections, strict=True)
    highest, _ = max(pairs, key=lambda pair: pair[0].block.levels(pair[1]).largest)
    top = optimum.levels.largest * (1 - TIE_TOLERANCE)
    for effort in range(FLOOR_EFFORTS):
        level = (floor + top) / 2
        while floor < top:
            above = floor / optimum.levels.ratio * (1 - TIE_TOLERANCE)
            try:
                found = highest.first(above, level, effort, budget)
            except OutOfBudgetError:
                break
            if found is not None:
                return floor
            floor, level = level, top if top - level < FINEST_FLOOR * top else (level + top) / 2
    return floor


def joint_levels(engines: Sequence[Engine], selections: Selections) -> Levels:
    """Extreme eigenvalues over all blocks."""
    levels = [engine.block.levels(own) for engine, own in zip(engines, selections, strict=True)]
    return Levels(min(x.smallest for x in levels), max(x.largest for x in levels))


def _raise_smallest(brackets: Sequence[Bracket], budget: Budget) -> None:
    """Raise the least smallest eigenvalue of all blocks together as far as it goes."""
    while True:
        # Only the block with the least smallest eigenvalue limits the others.
        weakest, *others = sorted(brackets, key=lambda bracket: bracket.low)
        if weakest.closed:
            return
        enough = others[0].low * (1 + TIE_TOLERANCE) if others else np.inf
        weakest.raise_to(enough, budget)


def _lower_ceiling(
    brackets: Sequence[Bracket], ceiling: float, above: float, budget: Budget
) -> bool:
    """Bring all blocks below a ceiling; whether there are selections that stay above a level."""
    return all(bracket.lower(ceiling, above, budget) for bracket in brackets)
