"""Blocks of a choice problem: parts that can be searched apart.

A block asks for k of its vectors. The squared singular values of the selected rows X_S are the
eigenvalues of X_S X_Sᵀ; "smallest" and "largest" mean these throughout the exact search.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from math import prod

import numpy as np

from loopid.arguments import FloatArray, IntArray
from loopid.base_parameters.choice import ChoiceProblem
from loopid.base_parameters.structure import base_columns, independent_blocks

# Vectors count as equal up to their sign when they differ by this fraction of their norm.
PARALLEL = 1e-10
NEARLY_PARALLEL = 1e-6  # of the product of norms, by which the inner product falls short of it


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

    Of vectors that agree up to their sign at most one can be selected, and it does not matter
    which: one stands for all.
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
        key = selection.tobytes()
        if key not in self._levels:
            values = np.linalg.svd(self.vectors[selection], compute_uv=False) ** 2
            self._levels[key] = Levels(float(values[-1]), float(values[0]))
        return self._levels[key]

    @cached_property
    def _levels(self) -> dict[bytes, Levels]:
        """Those asked for so far."""
        return {}

    @cached_property
    def least_largest(self) -> float:
        """What the largest eigenvalue of every regular selection reaches at least.

        It exceeds every diagonal entry, and k of those above zero are selected; and leaving m - k
        rows out lowers it at most to the eigenvalue that follows as many others (interlacing).
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
