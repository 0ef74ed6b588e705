"""Three ways to find selections with eigenvalues in a range, or to prove that there are none."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterator
from itertools import combinations
from math import comb

import numpy as np

from loopid.arrays import IntArray
from loopid.base_parameters.search.block import Block
from loopid.base_parameters.search.narrow import NarrowSearch
from loopid.base_parameters.search.swaps import FRACTIONS, good_selection, improved, walked
from loopid.base_parameters.search.threshold import Budget, selections_between

# Selections of a block that are looked at one by one.
LARGEST_TABLE = 200
# Larger blocks of null vectors are searched along a branch decomposition, unless that is as wide.
LARGEST_TREE = 36
WIDEST = 24
# Walks from nearby that are worth their time before a pass over a large block.
KICKS = 20
# Nodes of a search tree at the first effort, and how many times more at every further one.
FIRST_NODES, MORE_NODES = 1024, 4


class Engine(ABC):
    """A search of one block; more effort decides more.

    Attributes
    ----------
    most_smallest, least_largest : float
        What the smallest eigenvalue of every selection is at most, and the largest at least.
    """

    def __init__(self, block: Block) -> None:
        self.block = block
        smallest = np.linalg.svd(block.vectors, compute_uv=False)[-1]
        self.most_smallest = float(smallest**2)
        self.least_largest = block.least_largest()

    def start(self, least_largest: float) -> IntArray:
        """A good selection; largest eigenvalues below the given one are no better than it."""
        return good_selection(self.block, least_largest=least_largest)

    def polished(self, selection: IntArray) -> IntArray:
        """The selection (k,), or one a few swaps away that may be better."""
        return walked(self.block, selection, FRACTIONS[-1])

    def guess(self, above: float, below: float | None, budget: Budget) -> IntArray | None:
        """A selection in the range if one is found at little cost; None proves nothing."""
        return None

    def between(self, above: float, below: float | None, budget: Budget) -> Iterator[IntArray]:
        """All selections (k,) of representatives in the range.

        Raises
        ------
        OutOfBudgetError
        """
        return selections_between(self.block, above, below, budget)

    @abstractmethod
    def first(
        self, above: float, below: float | None, effort: int, budget: Budget
    ) -> IntArray | None:
        """A selection (k,) of representatives in the range, or None if there is none.

        Raises
        ------
        OutOfBudgetError
            Where the effort did not decide, or the budget is used up; ``budget.check`` tells.
        """


class TableEngine(Engine):
    """All selections of a small block."""

    def __init__(self, block: Block) -> None:
        self.block = block
        self.selections = np.array(list(combinations(range(block.size), block.count)))
        values = np.linalg.svd(block.vectors[self.selections], compute_uv=False) ** 2
        self.smallest, self.largest = values[:, -1], values[:, 0]
        self.most_smallest = float(self.smallest.max())
        self.least_largest = float(self.largest.min())

    def start(self, least_largest: float) -> IntArray:
        """The selection of the least ratio."""
        with np.errstate(divide="ignore"):
            ratios = np.maximum(self.largest, least_largest) / self.smallest
        return np.asarray(self.selections[ratios.argmin()], dtype=np.int64)

    def between(self, above: float, below: float | None, budget: Budget) -> Iterator[IntArray]:
        """All selections (k,) of representatives in the range."""
        budget.leaves += len(self.selections)
        within = (self.smallest > above) & (self.largest < (np.inf if below is None else below))
        return iter(self.selections[within])

    def first(
        self, above: float, below: float | None, effort: int, budget: Budget
    ) -> IntArray | None:
        """A selection (k,) of representatives in the range, or None if there is none."""
        return next(self.between(above, below, budget), None)


class TreeEngine(Engine):
    """Branch and bound over the vectors of any block."""

    def first(
        self, above: float, below: float | None, effort: int, budget: Budget
    ) -> IntArray | None:
        allowed = FIRST_NODES * MORE_NODES**effort
        spent = Budget(budget.deadline, most_nodes=min(allowed, budget.most_nodes - budget.nodes))
        try:
            return next(selections_between(self.block, above, below, spent), None)
        finally:
            budget.nodes += spent.nodes
            budget.leaves += spent.leaves


class BranchEngine(Engine):
    """Fronts along a branch decomposition of a block of null vectors."""

    def __init__(self, block: Block, narrow: NarrowSearch) -> None:
        super().__init__(block)
        self.narrow = narrow
        if narrow.crowded:
            self.least_largest = 1.0

    def first(
        self, above: float, below: float | None, effort: int, budget: Budget
    ) -> IntArray | None:
        return self.narrow.first(above, below, effort, budget)

    def start(self, least_largest: float) -> IntArray:
        return good_selection(self.block, KICKS, least_largest)

    def polished(self, selection: IntArray) -> IntArray:
        best = super().polished(selection)
        return improved(self.block, best, KICKS, self.least_largest)

    def guess(self, above: float, below: float | None, budget: Budget) -> IntArray | None:
        return self.narrow.guess(above, below, budget)


def engine_for(block: Block, null_vectors: bool) -> Engine:
    """The engine that suits a block."""
    if comb(block.size, block.count) <= LARGEST_TABLE:
        return TableEngine(block)
    if not null_vectors or block.size <= LARGEST_TREE:
        return TreeEngine(block)
    narrow = NarrowSearch(block)
    return BranchEngine(block, narrow) if narrow.width <= WIDEST else TreeEngine(block)
