"""Branch and bound at a threshold: all selections with eigenvalues in a given range.

With X (n, k), G = X Xᵀ and F = XᵀX, a selection S of k rows with smallest eigenvalue above t and
largest below u contains no subset C, and leaves out no set T, that break (Cauchy interlacing)

    G_CC - t I > 0,    u I - G_CC > 0,    F - t I - X_Tᵀ X_T > 0.

The last is (I - X (F - t I)⁻¹ Xᵀ)_TT > 0 by Schur's complement. So three n x n matrices decide:
taking rows eliminates them in the first two, leaving rows out eliminates them in the third, and
the Schur complements on the free rows say of every row, and of every two, whether they can still
be taken or left. Rows with one option are settled at once. Derivation in docs/derivations.md.

Round-off must not lose a selection: the tree is pruned on a range that is wider by ``SLACK``, and
the singular values of every selection that is left have the last word.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from time import perf_counter

import numpy as np

from loopid.arrays import BoolArray, FloatArray, IntArray
from loopid.base_parameters.search.block import Block
from loopid.base_parameters.search.conflicts import eliminated, options

# Selections in the range keep their pivots above this, well clear of round-off.
SLACK = 1e-12


class OutOfBudgetError(Exception):
    """The search used up its nodes or its time."""


@dataclass
class Budget:
    """Nodes and time that all the searches of one problem may use together."""

    deadline: float
    nodes: int = 0
    leaves: int = 0
    most_nodes: float = np.inf

    def spend(self) -> None:
        """Count a node."""
        self.nodes += 1
        self.check()

    def check(self) -> None:
        """Stop where it is used up."""
        if self.nodes > self.most_nodes or perf_counter() > self.deadline:
            raise OutOfBudgetError


@dataclass(frozen=True)
class _Node:
    """Rows that are free (f,) and taken, and the Schur complements (f, f) on the free ones."""

    free: IntArray
    taken: IntArray
    take: FloatArray
    leave: FloatArray
    cap: FloatArray | None

    def settled(self, taken: BoolArray, left: BoolArray) -> _Node | None:
        """The node with some of the free rows taken and some left; None where that is ruled out."""
        kept, taking, leaving = np.flatnonzero(~(taken | left)), *map(np.flatnonzero, (taken, left))
        take = eliminated(self.take, taking, kept)
        leave = eliminated(self.leave, leaving, kept)
        cap = None if self.cap is None else eliminated(self.cap, taking, kept)
        if take is None or leave is None or (self.cap is not None and cap is None):
            return None
        chosen = np.concatenate([self.taken, self.free[taking]])
        return _Node(self.free[kept], chosen, take, leave, cap)


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
    stack = [_root(block, above, below)]
    while stack:
        budget.spend()
        node = _settle_forced(stack.pop(), block.count)
        if node is None:
            continue
        if len(node.free) == 0:
            budget.leaves += 1
            yield from _verified(block, np.sort(node.taken), above, below)
            continue
        stack.extend(_branches(node, np.diag(block.gram)[node.free]))


def _verified(
    block: Block, selection: IntArray, above: float, below: float | None
) -> Iterator[IntArray]:
    levels = block.levels(selection)
    if levels.smallest > above and (below is None or levels.largest < below):
        yield selection


def _root(block: Block, above: float, below: float | None) -> _Node | None:
    X, n = block.vectors, block.size
    left, values, _ = np.linalg.svd(X, full_matrices=False)
    # Singular values are known to an absolute error, so small levels need but a small slack.
    level = above - SLACK * np.sqrt(max(above, 0.0))
    room = values**2 - level
    if room.min() <= 0:
        return None
    return _Node(
        free=np.arange(n),
        taken=np.empty(0, dtype=np.int64),
        take=block.gram - (above - SLACK) * np.eye(n),
        leave=(1 + SLACK) * np.eye(n) - (left * (values**2 / room)) @ left.T,
        cap=None if below is None else (below + SLACK) * np.eye(n) - block.gram,
    )


def _settle_forced(node: _Node | None, count: int) -> _Node | None:
    """Settle the rows that have one option left; None where a row has none."""
    while node is not None:
        to_take = count - len(node.taken)
        places = (to_take, len(node.free) - to_take)
        if min(places) < 0:
            return None
        takes = [node.take] if node.cap is None else [node.take, node.cap]
        takeable, leavable = options(takes, node.leave, places)
        if not (takeable | leavable).all():
            return None
        if (takeable & leavable).all():
            return node
        node = node.settled(~leavable, ~takeable)
    return None


def _branches(node: _Node, scales: FloatArray) -> list[_Node | None]:
    """Branch where least is left of one of the two options; the roomier one comes last."""
    can_take, can_leave = np.diag(node.take) / scales, np.diag(node.leave)
    tightest = int(np.minimum(can_take, can_leave).argmin())
    nothing = np.zeros(len(node.free), dtype=np.bool_)
    row = nothing.copy()
    row[tightest] = True
    both = [node.settled(row, nothing), node.settled(nothing, row)]
    return both if can_leave[tightest] > can_take[tightest] else both[::-1]
