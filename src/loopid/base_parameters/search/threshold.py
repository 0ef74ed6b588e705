"""Branch and bound at a threshold: all selections with eigenvalues in a given range.

With X (n, k), G = X Xᵀ and F = XᵀX, a selection S of k rows with smallest eigenvalue above t and
largest below u contains no subset C, and leaves out no set T, that break (Cauchy interlacing)

    G_CC - t I > 0,    u I - G_CC > 0,    F - t I - X_Tᵀ X_T > 0.

The last is (I - X (F - t I)⁻¹ Xᵀ)_TT > 0 by Schur's complement. So three n x n matrices decide:
taking a row pivots on it in the first two, leaving one out pivots in the third, and the diagonals
of the Schur complements say of every free row whether it can still be taken or left. Rows that
can only be taken, or only be left, are settled at once. Derivation in docs/derivations.md.

Round-off must not lose a selection: the tree is pruned on a range that is wider by ``SLACK``, and
the singular values of every selection that is left have the last word.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from time import perf_counter

import numpy as np

from loopid.arrays import BoolArray, FloatArray, IntArray
from loopid.base_parameters.search.block import Block

# Pivots at most this large are zero: round-off of matrices whose norm is about 1.
ZERO_PIVOT = 1e-13
# Selections in the range keep their pivots above this, well clear of round-off.
SLACK = 1e-12
FREE, TAKEN, LEFT = 0, 1, -1


class OutOfBudgetError(Exception):
    """The search used up its nodes or its time."""


@dataclass
class Budget:
    """Nodes and time that all the searches of one problem may use together."""

    deadline: float
    nodes: int = 0
    leaves: int = 0

    def spend(self) -> None:
        """Count a node."""
        self.nodes += 1
        if perf_counter() > self.deadline:
            raise OutOfBudgetError


@dataclass
class _Node:
    """Schur complements on the rows settled so far, and which rows those are."""

    take: FloatArray
    leave: FloatArray
    cap: FloatArray | None
    state: IntArray = field(repr=False)

    def settle(self, row: int, decision: int) -> _Node:
        state = self.state.copy()
        state[row] = decision
        if decision == LEFT:
            return _Node(self.take, _pivot(self.leave, row), self.cap, state)
        cap = None if self.cap is None else _pivot(self.cap, row)
        return _Node(_pivot(self.take, row), self.leave, cap, state)


def selections_between(
    block: Block, above: float, below: float | None, budget: Budget
) -> Iterator[IntArray]:
    """Yield the selections whose eigenvalues lie in a range, depth first.

    Parameters
    ----------
    block : Block
    above : float
        Every eigenvalue is larger than this.
    below : float or None
        Every eigenvalue is smaller than this; None for no such bound.
    budget : Budget

    Yields
    ------
    IntArray
        (k,), ascending.

    Raises
    ------
    OutOfBudgetError
    """
    if block.size == block.count:
        yield from _verified(block, np.arange(block.size), above, below)
        return
    root = _root(block, above - SLACK, None if below is None else below + SLACK)
    stack = [] if root is None else [root]
    scales = np.diag(block.gram)
    while stack:
        budget.spend()
        node = _settle_forced(stack.pop(), block.count)
        if node is None:
            continue
        free = np.flatnonzero(node.state == FREE)
        if len(free) == 0:
            budget.leaves += 1
            yield from _verified(block, np.flatnonzero(node.state == TAKEN), above, below)
            continue
        can_take = node.take[free, free] / scales[free]
        can_leave = node.leave[free, free]
        # Branch where least is left of one of the two options; try the roomier one first.
        tightest = int(np.minimum(can_take, can_leave).argmin())
        both = [node.settle(int(free[tightest]), decision) for decision in (TAKEN, LEFT)]
        stack.extend(both if can_leave[tightest] > can_take[tightest] else reversed(both))


def _verified(
    block: Block, selection: IntArray, above: float, below: float | None
) -> Iterator[IntArray]:
    levels = block.levels(selection)
    if levels.smallest > above and (below is None or levels.largest < below):
        yield selection


def _root(block: Block, above: float, below: float | None) -> _Node | None:
    X, n = block.vectors, block.size
    rest = X.T @ X - above * np.eye(block.count)
    if np.linalg.eigvalsh(rest)[0] <= ZERO_PIVOT:
        return None
    return _Node(
        take=block.gram - above * np.eye(n),
        leave=np.eye(n) - X @ np.linalg.solve(rest, X.T),
        cap=None if below is None else below * np.eye(n) - block.gram,
        state=np.zeros(n, dtype=np.int64),
    )


def _settle_forced(node: _Node, count: int) -> _Node | None:
    """Settle the rows that have one option left; None where a row has none."""
    while True:
        taken = int((node.state == TAKEN).sum())
        left = int((node.state == LEFT).sum())
        places = (count - taken, len(node.state) - count - left)
        if min(places) < 0:
            return None
        free = np.flatnonzero(node.state == FREE)
        takeable, leavable = _options(node, free, places)
        if not (takeable | leavable).all():
            return None
        forced = np.flatnonzero(takeable != leavable)
        if len(forced) == 0:
            return node
        row = forced[0]
        node = node.settle(int(free[row]), TAKEN if takeable[row] else LEFT)


def _options(node: _Node, free: IntArray, places: tuple[int, int]) -> tuple[BoolArray, BoolArray]:
    """Which free rows can be taken, and which left, with the places that remain."""
    takeable = (node.take[free, free] > ZERO_PIVOT) & (places[0] > 0)
    if node.cap is not None:
        takeable &= node.cap[free, free] > ZERO_PIVOT
    leavable = (node.leave[free, free] > ZERO_PIVOT) & (places[1] > 0)
    return takeable, leavable


def _pivot(matrix: FloatArray, row: int) -> FloatArray:
    """Schur complement on one more row; that row becomes zero."""
    column = matrix[:, row]
    return np.asarray(matrix - np.outer(column, column / column[row]), dtype=np.float64)
