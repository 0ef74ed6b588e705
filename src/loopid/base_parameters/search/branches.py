"""Branch decomposition: a tree of sets of vectors that each meet the rest in few directions.

For a set C of the rows of X, XᵀX = I, every c in R^k is a null vector X c. The eigenvalues of
X_Cᵀ X_C are 1 on null vectors inside C, 0 on those outside, and between for the directions that C
shares with the rest: its boundary. Their number is the connectivity of C in the matroid of the
rows [Oxley2011, ch. 8]; for the limb of a robot it is 3 behind a revolute joint, however long the
limb is. Derivation in docs/derivations.md.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from heapq import heapify, heappop, heappush

import numpy as np

from loopid.arrays import FloatArray, IntArray

# Shares and couplings (square roots of eigenvalues, at most 1) below this are round-off.
NEGLIGIBLE = 1e-10
# Eigenvalues this close to 0 or 1 count as that while the tree is being planned.
PLANNED = 1e-13
# Where null vectors connect two rows of X at all.
CONNECTED = 1e-9


@dataclass(frozen=True, eq=False)
class Branch:
    """A set C of vectors.

    Attributes
    ----------
    rows : tuple of int
        The vectors in the set.
    boundary : FloatArray
        (k, w), orthonormal: the directions shared with the rest.
    weights : FloatArray
        (w,), eigenvalues of X_Cᵀ X_C on them; those of the rest are 1 - weights.
    inside : int
        Dimension of the null vectors inside the set.
    children : tuple of Branch
        The two sets it is made of; none for a single vector.
    maps : tuple of FloatArray
        (w_child, m) each: the boundary of a child in coordinates of the parent, whose boundary
        comes first and then the directions that become inside with it.
    """

    rows: tuple[int, ...]
    boundary: FloatArray
    weights: FloatArray
    inside: int
    children: tuple[Branch, ...] = ()
    maps: tuple[FloatArray, ...] = ()

    @property
    def width(self) -> int:
        """Number w of shared directions."""
        return len(self.weights)

    @property
    def closing(self) -> int:
        """Number of directions that become inside with this set."""
        return self.inside - sum((child.inside for child in self.children), start=0)

    def walk(self) -> Iterator[Branch]:
        """All sets of the tree, children first."""
        for child in self.children:
            yield from child.walk()
        yield self


def branch_decomposition(vectors: FloatArray) -> Branch:
    """A branch decomposition of the rows (n, k) of one block, as narrow as was found.

    The columns must be orthonormal, and the rows connected by their inner products. Sets are
    joined greedily. No measure of what to join next is best for every robot, so some are tried
    and the plan that is cheapest to search is carried out.
    """
    _, plan = min((_planned(vectors, measure) for measure in MEASURES), key=lambda found: found[0])
    branches = {row: _single(vectors, row) for row in range(len(vectors))}
    for number, (a, b) in enumerate(plan, len(vectors)):
        branches[number] = _joined(vectors, branches.pop(a), branches.pop(b))
    return branches[len(vectors) + len(plan) - 1]


# How urgent it is to join sets of widths a and b into one of width w; least first.
Measure = Callable[[int, int, int], float]
MEASURES: tuple[Measure, ...] = (
    lambda w, a, b: w - max(a, b),
    lambda w, a, b: w - max(a, b) - 0.25 * min(a, b),
    lambda w, a, b: w - a - b,
    lambda w, a, b: 1.25 * w - a - b,
    lambda w, a, b: 1.5 * w - a - b,
    lambda w, a, b: 2 * w - a - b,
)
# Fronts grow about this much with each direction of the boundary.
GROWTH = 3.0


@dataclass(frozen=True)
class _Sketch:
    """A set while planning: its boundary scaled by the square roots of the weights."""

    scaled: FloatArray
    size: int

    @property
    def width(self) -> int:
        return int(self.scaled.shape[1])


def _planned(vectors: FloatArray, measure: Measure) -> tuple[float, list[tuple[int, int]]]:
    """Cost and pairs to join, in turn; the i-th pair makes set n + i."""
    sets = {row: _Sketch(vector[:, None], 1) for row, vector in enumerate(vectors)}
    beside = _neighbours(vectors)
    queue: list[tuple[float, int, int, int]] = []
    for row in sets:
        queue += _urgencies(measure, sets, row, [other for other in beside[row] if other < row])
    heapify(queue)
    cost = 0.0
    plan: list[tuple[int, int]] = []
    while len(sets) > 1:
        *_, a, b = heappop(queue)
        if a not in sets or b not in sets:
            continue
        first, second = sets.pop(a), sets.pop(b)
        new = len(vectors) + len(plan)
        plan.append((a, b))
        cost += GROWTH ** (first.width + second.width)
        sets[new] = _Sketch(_shared(first, second), first.size + second.size)
        beside[new] = (beside.pop(a) | beside.pop(b)) - {a, b}
        for other in beside[new]:
            beside[other] = (beside[other] - {a, b}) | {new}
        for entry in _urgencies(measure, sets, new, sorted(beside[new])):
            heappush(queue, entry)
    return cost, plan


def _neighbours(vectors: FloatArray) -> dict[int, set[int]]:
    connected = np.abs(vectors @ vectors.T) > CONNECTED
    np.fill_diagonal(connected, False)
    return {row: set(np.flatnonzero(others).tolist()) for row, others in enumerate(connected)}


def _urgencies(
    measure: Measure, sets: dict[int, _Sketch], new: int, others: list[int]
) -> list[tuple[float, int, int, int]]:
    """Entries of the queue for joining a set with each of others."""
    entries = []
    for width in {sets[other].width for other in others}:
        alike = [other for other in others if sets[other].width == width]
        stack = np.stack([sets[other].scaled for other in alike])
        shared = _shared_widths(sets[new].scaled, stack)
        for other, together in zip(alike, shared.tolist(), strict=True):
            urgency = measure(together, sets[new].width, width)
            entries.append((urgency, sets[other].size + sets[new].size, other, new))
    return entries


def _shared_widths(scaled: FloatArray, others: FloatArray) -> IntArray:
    """Widths (N,) of a set (k, w) joined with each of others (N, k, v)."""
    cross = scaled.T @ others
    grams = np.zeros((len(others), *np.add(cross.shape[1:], cross.shape[:0:-1])))
    own = scaled.shape[1]
    grams[:, :own, :own] = scaled.T @ scaled
    grams[:, own:, own:] = np.swapaxes(others, 1, 2) @ others
    grams[:, :own, own:], grams[:, own:, :own] = cross, np.swapaxes(cross, 1, 2)
    values = np.linalg.eigvalsh(grams)
    return np.asarray(((values > PLANNED) & (values < 1 - PLANNED)).sum(axis=1))


def _shared(first: _Sketch, second: _Sketch) -> FloatArray:
    both = np.concatenate([first.scaled, second.scaled], axis=1)
    values, turns = np.linalg.eigh(both.T @ both)
    shared = (values > PLANNED) & (values < 1 - PLANNED)
    return np.asarray(both @ turns[:, shared], dtype=np.float64)


def _single(vectors: FloatArray, row: int) -> Branch:
    share = float(np.linalg.norm(vectors[row]))
    return Branch((row,), vectors[row][:, None] / share, np.array([share**2]), 0)


def _joined(vectors: FloatArray, a: Branch, b: Branch) -> Branch:
    rows = (*a.rows, *b.rows)
    scaled = [child.boundary * np.sqrt(child.weights) for child in (a, b)]
    directions, shares, _ = np.linalg.svd(np.concatenate(scaled, axis=1), full_matrices=False)
    directions = directions[:, shares > NEGLIGIBLE]
    weights = shares[shares > NEGLIGIBLE] ** 2
    # 1 - weights is round-off where the coupling to the rest is small, so that is measured.
    rest = np.delete(vectors, rows, axis=0)
    coupling = np.linalg.norm(rest @ directions, axis=0)
    shared = coupling > NEGLIGIBLE
    order = np.argsort(~shared, kind="stable")
    directions, width = directions[:, order], int(shared.sum())
    return Branch(
        rows=rows,
        boundary=directions[:, :width],
        weights=np.where(weights > 0.5, 1 - coupling**2, weights)[order][:width],
        inside=a.inside + b.inside + len(order) - width,
        children=(a, b),
        maps=(a.boundary.T @ directions, b.boundary.T @ directions),
    )
