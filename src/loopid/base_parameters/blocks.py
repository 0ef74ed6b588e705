"""Blocks of a choice problem: parts that can be searched apart, and good selections of each, fast.

Of a block k vectors are selected, the rows X_S. "Smallest" and "largest" mean eigenvalues of
X_S X_Sᵀ throughout the exact search. A good selection comes from pivoted QR, then swaps between
barriers that close in on the eigenvalues [Batson2012]. Derivation in docs/derivations.md.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import combinations
from math import comb, prod
from time import thread_time
from typing import TypeVar

import numpy as np

from loopid.arguments import FloatArray, IntArray
from loopid.base_parameters.choice import ChoiceProblem
from loopid.base_parameters.rank import pivots
from loopid.base_parameters.structure import base_columns, independent_blocks

# Vectors count as equal up to their sign when they differ by this fraction of their norm.
PARALLEL = 1e-10
NEARLY_PARALLEL = 1e-6  # of the product of norms, by which the inner product falls short of it
BELOW, ABOVE = 1.0, -1.0
SIDES = ((BELOW,), (BELOW, ABOVE))
FRACTION = 0.97  # of the eigenvalue next to a barrier, that it is at
LEAST_GAIN = 1e-6  # relative, in the potential, to be worth a swap
# A swap keeps at least this fraction of |det (M - b I)|, which is well clear of round-off.
LEAST_VOLUME = 1e-6
MOST_SWAPS = 200  # between two barriers; round-off must not turn a walk into a cycle
LOOKED_AT = 4096  # selections times k² that are all looked at instead
MOST_STAGES = 100  # in a walk; far more than one takes
LEAST_RATIO = 1e-13  # of the eigenvalues of a selection that walks can start from

Thing = TypeVar("Thing")


class OutOfBudgetError(Exception):
    """The search used up its nodes or its time."""


@dataclass
class Budget:
    """Nodes and processor time that all the searches of one problem may use together."""

    deadline: float
    nodes: int = 0
    leaves: int = 0
    most_nodes: float = np.inf

    def spend(self) -> None:
        """Count a node; stop where the budget is used up."""
        self.nodes += 1
        if self.nodes > self.most_nodes:
            raise OutOfBudgetError
        self.check()

    def check(self) -> None:
        """Stop where the time is used up."""
        if thread_time() > self.deadline:
            raise OutOfBudgetError

    def checking(self, things: Iterable[Thing]) -> Iterator[Thing]:
        """Each of the things, as long as there is time."""
        for thing in things:
            self.check()
            yield thing

    def part(self, nodes: float) -> Budget:
        """A budget of ``nodes`` with the same deadline; ``add`` counts what it used."""
        return Budget(self.deadline, most_nodes=nodes)

    def add(self, part: Budget) -> None:
        """Count the nodes and leaves of a part."""
        self.nodes += part.nodes
        self.leaves += part.leaves


@dataclass(frozen=True)
class Levels:
    """Smallest and largest eigenvalue of the selected Gram matrix."""

    smallest: float
    largest: float

    @property
    def ratio(self) -> float:
        """Squared condition number."""
        return self.largest / self.smallest if self.smallest > 0 else np.inf

    def box(self, slack: float) -> tuple[float, float]:
        """A range that these levels are inside of, by a fraction of each."""
        return self.smallest * (1 - slack), self.largest * (1 + slack)

    def inside(self, above: float, below: float) -> bool:
        """Whether both are in a range."""
        return self.smallest > above and self.largest < below

    def near(self, other: Levels, tolerance: float) -> bool:
        """Whether both are those of the other levels, up to a fraction."""
        return (
            abs(self.smallest - other.smallest) <= tolerance * other.smallest
            and abs(self.largest - other.largest) <= tolerance * other.largest
        )


@dataclass(frozen=True, eq=False)
class Block:
    """Vectors of which ``count`` are to be selected.

    Of vectors that agree up to their sign at most one can be selected. It does not matter which:
    one stands for all.
    """

    columns: IntArray  # (n,), columns of the problem, ascending
    null_basis: FloatArray  # (n, d), null vectors of these columns only
    vectors: FloatArray  # (m, k), one row a representative, of rank k
    # For each representative the positions in ``columns`` it stands for, ascending
    groups: tuple[IntArray, ...]
    # Whether a selection means dependent parameters (``nullspace``) or base ones
    selects_dependent: bool

    @property
    def size(self) -> int:
        """Number m of representatives."""
        return len(self.vectors)

    @property
    def count(self) -> int:
        """Number k of vectors to select."""
        return int(self.vectors.shape[1])

    @cached_property
    def gram(self) -> FloatArray:
        """X Xᵀ, shape (m, m)."""
        return self.vectors @ self.vectors.T

    @cached_property
    def svd(self) -> tuple[FloatArray, FloatArray]:
        """U (m, k) and singular values (k,) of X = U S Vᵀ."""
        U, values, _ = np.linalg.svd(self.vectors, full_matrices=False)
        return U, values

    def levels(self, selection: IntArray) -> Levels:
        """Extreme eigenvalues for a selection (k,) of representatives."""
        values = np.linalg.svd(self.vectors[selection], compute_uv=False) ** 2
        return Levels(float(values[-1]), float(values[0]))

    @cached_property
    def least_largest(self) -> float:
        """What the largest eigenvalue of every regular selection reaches at least.

        It exceeds every diagonal entry, and k of those above zero are selected. Leaving m - k rows
        out lowers it at most to the eigenvalue that follows as many others (interlacing).
        """
        entries = np.sort(np.diag(self.gram))
        entry = entries[entries > 0][: self.count].max(initial=0.0)
        left_out = self.size - self.count
        return float(max(entry, self.svd[1][left_out] ** 2 if left_out < self.count else 0.0))

    def dependent(self, selections: IntArray) -> IntArray:
        """Positions (c, d) of the dependent columns for selections (c, k) of representatives.

        Of columns that stand for each other the first becomes dependent.
        """
        if self.selects_dependent:
            first = np.array([group[0] for group in self.groups])
            return np.sort(first[selections], axis=1)
        last = np.array([group[-1] for group in self.groups])
        return np.array([base_columns(len(self.columns), base) for base in last[selections]])

    def ways(self, selection: IntArray) -> int:
        """Choices that the selection stands for."""
        return prod(len(self.groups[representative]) for representative in selection)


def split(problem: ChoiceProblem) -> tuple[tuple[Block, ...], float]:
    """The blocks of a problem, and a bound on what they change of singular values of any choice.

    The null-space criterion falls apart into independent blocks; those without a null vector need
    no choice. The regressor criterion is one block. Neglected are entries between blocks and
    distances among vectors that stand for each other.
    """
    V2 = problem.structure.null_basis
    if problem.criterion == "regressor":
        vectors, groups, error = _representatives(problem.vectors)
        everything = np.arange(problem.size)
        return (Block(everything, V2, vectors, groups, selects_dependent=False),), error
    blocks, errors = [], []
    joint = np.zeros((problem.size, 0))
    for columns in independent_blocks(V2):
        # Singular values of these rows are 0 or 1: the ones are the null vectors of the block.
        left, values, _ = np.linalg.svd(V2[columns], full_matrices=False)
        if values[0] <= 0.5:
            continue
        own = left[:, values > 0.5]
        vectors, groups, error = _representatives(own)
        blocks.append(Block(columns, own, vectors, groups, selects_dependent=True))
        errors.append(error)
        part = np.zeros((problem.size, own.shape[1]))
        part[columns] = own
        joint = np.concatenate([joint, part], axis=1)
    # The nearest rotation of V2 to the blocks' vectors shows what lies between.
    turned, _, other = np.linalg.svd(V2.T @ joint, full_matrices=False)
    apart = float(np.linalg.norm(V2 @ (turned @ other) - joint))
    return tuple(blocks), float(np.linalg.norm(errors)) + apart


def _representatives(vectors: FloatArray) -> tuple[FloatArray, tuple[IntArray, ...], float]:
    """One of all vectors (n, k) that are equal up to sign, their groups, and the error made."""
    norms = np.linalg.norm(vectors, axis=1)
    gram = vectors @ vectors.T
    # Only of vectors with almost the same direction the difference is worth its memory.
    i, j = np.nonzero(np.abs(gram) >= (1 - NEARLY_PARALLEL) * np.outer(norms, norms))
    apart = np.full(gram.shape, np.inf)
    signs = np.where(gram[i, j] < 0, -1.0, 1.0)
    apart[i, j] = np.linalg.norm(vectors[i] - signs[:, None] * vectors[j], axis=1)
    same = apart <= PARALLEL * norms
    first = same.argmax(axis=0)
    chosen = np.unique(first)
    groups = tuple(np.flatnonzero(first == representative) for representative in chosen)
    error = float(np.linalg.norm(apart[first, np.arange(len(vectors))]))
    return np.ascontiguousarray(vectors[chosen]), groups, error


def good_selection(block: Block, budget: Budget) -> IntArray:
    """A selection (k,) with a low ratio of largest to smallest eigenvalue, often the lowest.

    The deadline of the budget ends the walks, not the first guess.
    """
    if block.size == block.count:
        return np.arange(block.size)
    if comb(block.size, block.count) * block.count**2 <= LOOKED_AT:
        every = np.array(list(combinations(range(block.size), block.count)))
        values = np.linalg.svd(block.vectors[every], compute_uv=False) ** 2
        ratios = values[:, -1] / np.maximum(values[:, 0], LEAST_RATIO)
        return np.asarray(every[ratios.argmax()])
    best = np.sort(pivots(block.vectors, block.count))
    first = best
    try:
        for sides in SIDES:
            walk = walked(block, first, budget, sides)
            best = min(best, walk, key=lambda own: block.levels(own).ratio)
    except OutOfBudgetError:
        pass
    return best


def walked(
    block: Block, selection: IntArray, budget: Budget, sides: Sequence[float] = (BELOW,)
) -> IntArray:
    """Swap until the potential is at rest, close in with the barriers, and so on.

    Of the selections (k,) at rest the one with the highest smallest eigenvalue. With barriers on
    both sides it is the one with the lowest ratio. It may be the given one.
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
            level = outermost * FRACTION if side == BELOW else outermost / FRACTION
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
