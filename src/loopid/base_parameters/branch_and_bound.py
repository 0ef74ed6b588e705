"""All selections of a block in a box, by branch and bound.

A box is a range of eigenvalues, above t and below u. With X (m, k), G = X Xᵀ and F = XᵀX, three
m x m matrices say which rows a selection can still take or leave. Taking rows eliminates them in
G - t I and u I - G, leaving them in I - X (F - t I)⁻¹ Xᵀ (Schur complements). Rows with one option
are settled at once. Derivation in docs/derivations.md.

Round-off must not lose a selection. The matrices are scaled to a diagonal of about 1. The box is
widened by twice the ``margin``, and a row is ruled out only by a pivot below it. The singular
values of every selection that is left have the last word.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from itertools import combinations
from math import comb

import numpy as np
from scipy.linalg.lapack import dpotrf, dtrtrs

from loopid.arguments import BoolArray, FloatArray, IntArray
from loopid.base_parameters.blocks import Block, Budget, OutOfBudgetError
from loopid.numbers import UNIT_ROUND_OFF

# The margin: a proven multiple of the unit round-off, and at least this.
LEAST_MARGIN = 1e-12
# Thresholds closer than this fraction to the smallest eigenvalue of F would amplify round-off.
NEAR_LIMIT = 1e-4
# Rows shorter than the threshold by this factor are as short as any.
MOST_SHORT, LEAST_NORM = 1e6, 1e-200
# Rows are compared after rounding, so that round-off does not choose the branch.
DECIMALS = 4
# A node with few selections left is settled by looking at them: at most this many times k².
LOOKED_AT = 4096

NONE = np.empty(0, dtype=np.int64)


def margin(rows: int, terms: int) -> float:
    """Bound of round-off in pivots of a matrix (rows, rows) of sums of ``terms`` products."""
    return max(LEAST_MARGIN, 4 * rows * (terms + 4) * UNIT_ROUND_OFF)


@dataclass(frozen=True)
class _Node:
    """Rows that are free (f,), taken and left, and the Schur complements (f, f) on the free."""

    free: IntArray
    taken: IntArray
    left: IntArray
    takes: tuple[FloatArray, ...]
    leave: FloatArray


def tightest(node: _Node) -> FloatArray:
    """How little is left of one of the options of each free row (f,)."""
    return -np.minimum(node.takes[0].diagonal(), node.leave.diagonal())


def weightiest(node: _Node) -> FloatArray:
    """How much each free row (f,) takes from the diagonals of the others, taken and left."""

    def lowered(matrix: FloatArray) -> FloatArray:
        diagonal = matrix.diagonal()
        lost = np.minimum(matrix**2 / diagonal[:, None], diagonal)
        return np.asarray(lost.sum(axis=1) - diagonal)

    return lowered(node.takes[0]) * lowered(node.leave)


# Which free row to branch on: that of the highest value. Some problems yield to one rule, some to
# the other, by factors of hundreds.
RULES = tightest, weightiest


def selections_between(
    block: Block,
    above: float,
    below: float,
    budget: Budget,
    *,
    settled: tuple[IntArray, IntArray] = (NONE, NONE),
    rule: Callable[[_Node], FloatArray] = tightest,
) -> Iterator[IntArray]:
    """Yield the selections (k,), ascending, with all eigenvalues in a range, depth first.

    Every selection contains the first of the rows ``settled`` and none of the second.
    OutOfBudgetError ends the walk.
    """
    taken, left = settled
    tree = Tree(block, above, below, rule)
    root = tree.root()
    if root and len(taken) + len(left):
        root = tree.settled(root, np.isin(root.free, taken), np.isin(root.free, left))
    stack = [root]
    while stack:
        budget.spend()
        node = stack.pop()
        node = node and tree.forced(node)
        if node is None:
            continue
        completions = comb(len(node.free), block.count - len(node.taken))
        if len(node.free) == 0 or completions * block.count**2 <= LOOKED_AT:
            budget.leaves += completions
            yield from tree.listed(node)
        else:
            stack.extend(tree.branches(node))


def one_between(
    block: Block,
    box: tuple[float, float],
    budget: Budget,
    node_limits: Iterable[float],
    *,
    settled: tuple[IntArray, IntArray] = (NONE, NONE),
) -> IntArray | None:
    """A selection (k,) as ``selections_between`` yields them, None if there is none.

    Each rule gets the nodes of each limit in turn; OutOfBudgetError where none decides it.
    """
    for most, rule in ((nodes, rule) for nodes in node_limits for rule in RULES):
        part = budget.part(most)
        walk = selections_between(block, *box, part, settled=settled, rule=rule)
        try:
            return next(walk, None)
        except OutOfBudgetError:
            budget.check()
        finally:
            budget.add(part)
    raise OutOfBudgetError


class Tree:
    """The rules of one box."""

    def __init__(
        self, block: Block, above: float, below: float, rule: Callable[[_Node], FloatArray]
    ) -> None:
        self.block, self.above, self.below, self.rule = block, above, below, rule
        self.zero = margin(block.count, block.count)
        self.leave_zero = margin(block.size - block.count, block.size)

    def root(self) -> _Node | None:
        """Nothing settled; None where no selection reaches the threshold."""
        block, t, zero = self.block, self.above, self.zero
        U, values = block.svd
        # Singular values are known to an absolute error, so small levels need but a small shift.
        if values[-1] <= np.sqrt(t) - zero:
            return None
        squares = values**2
        level = min(t - 2 * zero * np.sqrt(t), (1 - NEAR_LIMIT) * squares[-1])
        norms = np.maximum(np.diag(block.gram), LEAST_NORM)
        short = np.minimum(t, MOST_SHORT * norms) / norms
        identity = np.eye(block.size)
        scale = np.sqrt(norms)
        take = block.gram / scale / scale[:, None]
        np.fill_diagonal(take, 1 + 2 * zero - short)
        cap = () if np.isinf(self.below) else ((1 + 2 * zero) * identity - block.gram / self.below,)
        leave = (1 + 2 * self.leave_zero) * identity - (U * (squares / (squares - level))) @ U.T
        return _Node(np.arange(block.size), NONE, NONE, (take, *cap), leave)

    def settled(self, node: _Node, taken: BoolArray, left: BoolArray) -> _Node | None:
        """The node with some of the free rows taken and some left; None where that is ruled out."""
        kept, taking, leaving = np.flatnonzero(~(taken | left)), *map(np.flatnonzero, (taken, left))
        takes = [_eliminated(matrix, taking, kept, self.zero) for matrix in node.takes]
        leave = _eliminated(node.leave, leaving, kept, self.leave_zero)
        if leave is None or any(matrix is None for matrix in takes):
            return None
        more = np.concatenate([node.taken, node.free[taking]])
        fewer = np.concatenate([node.left, node.free[leaving]])
        return _Node(node.free[kept], more, fewer, tuple(m for m in takes if m is not None), leave)

    def forced(self, node: _Node | None) -> _Node | None:
        """Settle the rows that have one option left; None where a row has none."""
        while node is not None:
            to_take = self.block.count - len(node.taken)
            places = (to_take, len(node.free) - to_take)
            if min(places) < 0:
                return None
            takeable, leavable = self.options(node, places)
            if (takeable & leavable).all():
                return node
            if not (takeable | leavable).all():
                return None
            node = self.settled(node, ~leavable, ~takeable)
        return None

    def options(self, node: _Node, places: tuple[int, int]) -> tuple[BoolArray, BoolArray]:
        """Which free rows can be taken, and which left.

        Taking a row leaves those in conflict: there must be places for them, and none among
        themselves.
        """
        takeable = np.all([matrix.diagonal() > self.zero for matrix in node.takes], axis=0)
        takeable &= places[0] > 0
        leavable = (node.leave.diagonal() > self.leave_zero) & (places[1] > 0)
        if not (takeable & leavable).all():
            return takeable, leavable
        apart, together = self.conflicts(node)
        if apart.any() or together.any():
            takeable = (apart.sum(axis=1) <= places[1]) & ~_triangles(apart, together)
            leavable = (together.sum(axis=1) <= places[0]) & ~_triangles(together, apart)
        return takeable, leavable

    def conflicts(self, node: _Node) -> tuple[BoolArray, BoolArray]:
        """Which two free rows cannot both be taken, and which not both left; each may be alone."""
        apart = np.any([_conflicts(matrix, self.zero) for matrix in node.takes], axis=0)
        return apart, _conflicts(node.leave, self.leave_zero)

    def branches(self, node: _Node) -> list[_Node | None]:
        """Branch on the first row by the rule; the roomier option comes last."""
        best = int(self.rule(node).round(DECIMALS).argmax())
        row, nothing = np.arange(len(node.free)) == best, np.zeros(len(node.free), dtype=np.bool_)
        both = [self.settled(node, row, nothing), self.settled(node, nothing, row)]
        can_take, can_leave = (m[best, best].round(DECIMALS) for m in (node.takes[0], node.leave))
        return both if can_leave > can_take else both[::-1]

    def listed(self, node: _Node) -> Iterator[IntArray]:
        """The selections that agree with a node, those in the box."""
        chosen = self.agreeing(node)
        values = np.linalg.svd(self.block.vectors[chosen], compute_uv=False) ** 2
        inside = (values[:, -1] > self.above) & (values[:, 0] < self.below)
        yield from chosen[inside]

    def agreeing(self, node: _Node) -> IntArray:
        """The selections (c, k) that agree with a node."""
        more = self.block.count - len(node.taken)
        subsets = list(combinations(node.free, more))
        rest = np.array(subsets, dtype=np.int64).reshape(len(subsets), more)
        chosen = np.concatenate([np.tile(node.taken, (len(rest), 1)), rest], axis=1)
        chosen.sort(axis=1)
        return chosen


def _triangles(sides: BoolArray, base: BoolArray) -> BoolArray:
    """Which rows have two neighbours in one graph that are neighbours in the other."""
    reached = sides.astype(np.float32) @ base.astype(np.float32)
    return np.asarray(((reached > 0) & sides).any(axis=1))


def _eliminated(
    matrix: FloatArray, rows: IntArray, kept: IntArray, zero: float
) -> FloatArray | None:
    """Schur complement on some rows, restricted to others; None unless they may be settled."""
    rest: FloatArray = matrix[kept[:, None], kept]
    if len(rows) == 1:
        pivot, across = matrix[rows[0], rows[0]], matrix[rows[0], kept]
        return rest - np.outer(across, across / pivot) if pivot > zero else None
    if len(rows) > 1:
        factor, failed = dpotrf(matrix[rows[:, None], rows], lower=1)
        if failed or not factor.diagonal().min() ** 2 > zero:
            return None
        across, _ = dtrtrs(factor, matrix[rows[:, None], kept], lower=1)
        rest -= across.T @ across
    return rest


def _conflicts(matrix: FloatArray, zero: float) -> BoolArray:
    """Which two rows (f, f) cannot be settled together; all of them may be alone."""
    diagonal = matrix.diagonal()
    found = diagonal - matrix**2 / diagonal[:, None] <= zero
    np.fill_diagonal(found, False)
    return np.asarray(found | found.T)
