"""Selections of a block of null vectors with eigenvalues in a range, by fronts of few states.

Relaxed passes of growing resolution prove that there is none; restricted passes, guided by what
the relaxed ones know of the rest, find one.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial

import numpy as np

from loopid.arrays import IntArray
from loopid.base_parameters.search.block import Block
from loopid.base_parameters.search.branches import Branch, branch_decomposition
from loopid.base_parameters.search.fronts import Front, Range
from loopid.base_parameters.search.passes import (
    Fronts,
    downwards,
    relaxed,
    restricted,
    selection,
    upwards,
)
from loopid.base_parameters.search.threshold import Budget, OutOfBudgetError

# States a front may have of each excess: this to the power of the effort plus one. Restricted
# fronts stop growing.
FINENESS = 4
MOST_RESTRICTED = 64
# Fraction by which the range is widened in the passes, so that round-off loses no selection.
SLACK = 4e-10


@dataclass(frozen=True)
class Knowledge:
    """Bounds of what is outside each set, for all selections with eigenvalues in a range.

    Attributes
    ----------
    wanted : Range
    limit : int
        States of each excess of the fronts they come from.
    outside : dict of Front
    """

    wanted: Range
    limit: int
    outside: Fronts

    def replaces(self, other: Knowledge) -> bool:
        """Whether it holds wherever the other does, and is as fine."""
        return self.limit >= other.limit and self.wanted.contains(other.wanted)


NOTHING = Knowledge(Range(0.0), 0, {})


class NarrowSearch:
    """Search a block through a branch decomposition of its vectors.

    Parameters
    ----------
    block : Block
        Of null vectors: orthonormal, XᵀX = I, once every representative stands there as many times
        as there are columns it stands for.
    """

    def __init__(self, block: Block) -> None:
        self._block = block
        sizes = [len(columns) for columns in block.columns]
        self._representatives = np.repeat(np.arange(block.size), sizes)
        vectors = block.vectors[self._representatives]
        self.branches = tuple(branch_decomposition(vectors).walk())
        self._known: list[Knowledge] = []

    @property
    def width(self) -> int:
        """Most directions that a set shares with the rest."""
        return max(branch.width for branch in self.branches)

    @property
    def crowded(self) -> bool:
        """Whether every selection contains a null vector, and has a largest eigenvalue of 1.

        Selected vectors are at least as many as there are dimensions inside a set; a selection
        without a null vector leaves out as many.
        """
        return any(2 * branch.inside > len(branch.rows) for branch in self.branches)

    def first(
        self, above: float, below: float | None, effort: int, budget: Budget
    ) -> IntArray | None:
        """A selection (k,) of representatives in the range, or None if there is none.

        Parameters
        ----------
        above : float
        below : float or None
        effort : int
            From 0; the last passes are finer with more.
        budget : Budget

        Raises
        ------
        OutOfBudgetError
            Where the last passes do not decide.
        """
        wanted = _widened(above, below)
        known = self._known_for(wanted)
        for limit in (FINENESS ** (power + 1) for power in range(effort + 1)):
            if limit < known.limit:
                continue
            fronts = self._relaxed_pass(wanted, known, limit, budget)
            if fronts is None:
                return None
            if not all(front.exact for front in fronts.values()):
                known = self._learn(wanted, fronts, limit, budget)
                fronts = self._restricted_pass(wanted, known, budget)
            if fronts is not None:
                return self._selected(fronts)
        raise OutOfBudgetError

    def guess(self, above: float, below: float | None, budget: Budget) -> IntArray | None:
        """A selection (k,) in the range that what is known already leads to, or None."""
        wanted = _widened(above, below)
        known = self._known_for(wanted)
        fronts = self._restricted_pass(wanted, known, budget) if known.outside else None
        return None if fronts is None else self._selected(fronts)

    def _selected(self, fronts: Fronts) -> IntArray:
        """The best selection among the states of the root."""
        states = range(len(fronts[self.branches[-1]]))
        found = [self._representatives[selection(self.branches, fronts, state)] for state in states]
        return max(found, key=lambda chosen: self._block.levels(chosen).smallest)

    def _known_for(self, wanted: Range) -> Knowledge:
        """The finest bounds that hold for a range, of the narrowest one among equally fine ones."""
        valid = [known for known in self._known if known.wanted.contains(wanted)]
        return max(valid, key=lambda known: (known.limit, known.wanted.above), default=NOTHING)

    def _learn(self, wanted: Range, fronts: Fronts, limit: int, budget: Budget) -> Knowledge:
        outside = downwards(self.branches, fronts, limit, budget)
        learnt = Knowledge(wanted, limit, outside)
        # Coarser bounds that hold for part of this range only are of no more use.
        self._known = [known for known in self._known if not learnt.replaces(known)]
        self._known.append(learnt)
        return learnt

    def _relaxed_pass(
        self, wanted: Range, known: Knowledge, limit: int, budget: Budget
    ) -> Fronts | None:
        thin = partial(_relaxed, limit=limit)
        return upwards(self.branches, wanted, known.outside, thin, budget)

    def _restricted_pass(self, wanted: Range, known: Knowledge, budget: Budget) -> Fronts | None:
        limit = min(known.limit, MOST_RESTRICTED)
        thin = partial(_restricted, outside=known.outside, limit=limit)
        return upwards(self.branches, wanted, known.outside, thin, budget)


def _widened(above: float, below: float | None) -> Range:
    return Range(above * (1 - SLACK), None if below is None else below * (1 + SLACK))


def _relaxed(branch: Branch, front: Front, limit: int) -> Front:
    return relaxed(front, limit)


def _restricted(branch: Branch, front: Front, outside: Fronts, limit: int) -> Front:
    return restricted(front, outside[branch], limit, branch.width)
