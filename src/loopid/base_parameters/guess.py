"""A good selection, fast: pivoted QR, then swaps between barriers that close in on the eigenvalues.

With a barrier b below the eigenvalues of M = X_SᵀX_S, the potential tr (M - b I)⁻¹ sees all of
them, and those near the barrier most [Batson2012]; likewise tr (b I - M)⁻¹ above them. To swap a
row for a vector changes M by a matrix of rank two; so with E = (M - b I)⁻¹ the Gram matrices
P = X E Xᵀ and Q = X E² Xᵀ hold the potential after every one of the k (n - k) swaps in closed
form, and the best of them updates both in O(n²). Derivation in docs/derivations.md.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations, product
from math import comb

import numpy as np

from loopid.arguments import FloatArray, IntArray, random_generator
from loopid.base_parameters.blocks import Block, Levels
from loopid.base_parameters.rank import pivots
from loopid.base_parameters.tree import Budget, OutOfBudgetError

BELOW, ABOVE = 1.0, -1.0
SIDES = ((BELOW,), (BELOW, ABOVE))
# Barriers, as fractions of the eigenvalue next to them; far ones see more of the others.
FRACTIONS = (0.8, 0.97)
LEAST_GAIN = 1e-6  # relative, in the potential, to be worth a swap
# A swap keeps at least this fraction of |det (M - b I)|, which is well clear of round-off.
LEAST_VOLUME = 1e-6
MOST_SWAPS = 200  # between two barriers; round-off must not turn a walk into a cycle
LOOKED_AT = 4096  # selections times k² that are all looked at instead
MOST_STAGES = 100  # in a walk; far more than one takes
LEAST_RATIO = 1e-13  # of the eigenvalues of a selection that walks can start from
# Blocks of more vectors are worth walks from near the best selection, by random swaps that keep
# much of |det X_S|.
LARGE, KICKS, KICK_SWAPS, KICK_VOLUME = 36, 20, 4, 0.3
HUGE = 300  # vectors of blocks whose walks take longer than they are worth repeating


def good_selection(block: Block, budget: Budget, least_largest: float = 0.0) -> IntArray:
    """A selection (k,) with a low ratio of largest to smallest eigenvalue, often the lowest.

    The deadline of the budget ends the walks, not the first guess. Largest eigenvalues below
    ``least_largest`` are no better than this one.
    """
    if block.size == block.count:
        return np.arange(block.size)
    if comb(block.size, block.count) * block.count**2 <= LOOKED_AT:
        every = np.array(list(combinations(range(block.size), block.count)))
        values = np.linalg.svd(block.vectors[every], compute_uv=False) ** 2
        largest = np.maximum(values[:, 0], least_largest or 1.0)
        return np.asarray(every[(values[:, -1] / largest).argmax()])
    best = np.sort(pivots(block.vectors, block.count))

    def ratio(selection: IntArray) -> float:
        levels = block.levels(selection)
        return Levels(levels.smallest, max(levels.largest, least_largest)).ratio

    first, random = best, random_generator(block.size)
    try:
        for fraction, sides in product(FRACTIONS, SIDES):
            best = min(best, walked(block, first, budget, fraction, sides), key=ratio)
        for kick in range(KICKS if LARGE < block.size <= HUGE else 0):
            start = _kicked(block, best, random)
            walk = walked(block, start, budget, FRACTIONS[-1], SIDES[kick % 2])
            best = min(best, walk, key=ratio)
    except OutOfBudgetError:
        pass
    return best


def walked(
    block: Block,
    selection: IntArray,
    budget: Budget,
    fraction: float,
    sides: Sequence[float] = (BELOW,),
) -> IntArray:
    """Swap until the potential is at rest, close in with the barriers, and so on.

    Of the selections (k,) at rest the one with the highest smallest eigenvalue, or with barriers
    on both sides the one with the lowest ratio; the given one if that is it.
    """
    chosen, best, least = selection, selection, np.inf
    for _ in range(MOST_STAGES):
        levels = block.levels(chosen)
        if not levels.smallest > LEAST_RATIO * levels.largest:
            break
        value = levels.ratio if ABOVE in sides else 1 / levels.smallest
        if not value < least * (1 - LEAST_GAIN):
            break
        best, least = chosen, value
        barriers = []
        for side in sides:
            outermost = levels.smallest if side == BELOW else levels.largest
            level = outermost * fraction if side == BELOW else outermost / fraction
            # The weight makes the potential a number without unit.
            barriers.append((outermost, Barrier.at(level, block.vectors, chosen, side)))
        chosen = _at_rest(barriers, chosen, budget)
    return np.sort(best)


def _at_rest(
    barriers: Sequence[tuple[float, Barrier]], selection: IntArray, budget: Budget
) -> IntArray:
    """The best swap of all, again and again, while it lowers the weighted potentials."""
    chosen = selection.copy()
    rest = np.setdiff1d(np.arange(len(barriers[0][1].first)), chosen)
    for _ in range(MOST_SWAPS if len(rest) else 0):
        budget.check()
        changes = np.sum([weight * it.changes(chosen, rest) for weight, it in barriers], axis=0)
        place, other = np.unravel_index(changes.argmin(), changes.shape)
        potential = sum(weight * barrier.potential for weight, barrier in barriers)
        # A potential is the trace of a positive matrix: to fall below zero takes round-off.
        if not -potential < changes[place, other] < -LEAST_GAIN * potential:
            break
        out, into = int(chosen[place]), int(rest[other])
        barriers = [(weight, barrier.swapped(out, into)) for weight, barrier in barriers]
        chosen[place], rest[other] = into, out
    return chosen


def _kicked(block: Block, selection: IntArray, random: np.random.Generator) -> IntArray:
    """A few random swaps, none of which loses much of the volume."""
    chosen = selection.copy()
    for _ in range(KICK_SWAPS):
        kept = np.abs(block.vectors @ np.linalg.pinv(block.vectors[chosen]))
        kept[chosen] = 0.0
        place = int(random.integers(len(chosen)))
        others = np.flatnonzero(kept[:, place] > KICK_VOLUME)
        if len(others) > 0:
            chosen[place] = random.choice(others)
    return chosen


@dataclass(frozen=True)
class Barrier:
    """Every swap of a selection, seen from a barrier b on one side of its eigenvalues.

    ``side`` is 1 where the barrier is below them, -1 above. With E = (side (M - b I))⁻¹, ``first``
    is P = X E Xᵀ (n, n), ``second`` Q = X E² Xᵀ, and ``potential`` tr E.
    """

    side: float
    first: FloatArray
    second: FloatArray
    potential: float

    @classmethod
    def at(cls, level: float, vectors: FloatArray, chosen: IntArray, side: float) -> Barrier:
        """The barrier at a level; all eigenvalues of the selection must be on its other side."""
        _, values, right = np.linalg.svd(vectors[chosen])
        inverse = side / (values**2 - level)
        along = vectors @ right.T
        first, second = (along * inverse) @ along.T, (along * inverse**2) @ along.T
        return cls(side, first, second, float(inverse.sum()))

    def changes(self, chosen: IntArray, rest: IntArray) -> FloatArray:
        """Change (k, n - k) of the potential by each swap; infinite where it gets too close."""
        p, q = self.side * np.diag(self.first), self.side * np.diag(self.second)
        between = self.first[np.ix_(chosen, rest)]
        # Factors of det (M - b I), positive where all eigenvalues stay on their side.
        volumes = (1 - p[chosen, None]) * (1 + p[rest]) + between**2
        crossed = between * self.second[np.ix_(chosen, rest)]
        numerators = (1 + p[rest]) * q[chosen, None] - 2 * crossed - (1 - p[chosen, None]) * q[rest]
        changes = np.full(volumes.shape, np.inf)
        np.divide(numerators, volumes, out=changes, where=volumes > LEAST_VOLUME)
        return changes

    def swapped(self, out: int, into: int) -> Barrier:
        """The same barrier with one row of X taken out of the selection for another."""
        pair = [out, into]
        P, Q = self.first[:, pair], self.second[:, pair]
        # Woodbury: E loses E U K⁻¹ Uᵀ E, with the two rows in U and K = ∓diag(1, -1) + Uᵀ E U.
        inverse = np.linalg.pinv(np.diag([-self.side, self.side]) + P[pair])
        turned = P @ inverse
        mixed = turned @ Q.T
        return Barrier(
            self.side,
            self.first - turned @ P.T,
            self.second - mixed - mixed.T + turned @ Q[pair] @ turned.T,
            self.potential - float(np.sum(inverse * Q[pair])),
        )
