"""A block: k of n vectors to select, with both extreme eigenvalues of their Gram matrix in view.

The squared singular values of the selected rows X_S are the eigenvalues of X_S X_Sᵀ; "smallest"
and "largest" mean these throughout the exact search.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.linalg import qr

from loopid.arrays import FloatArray, IntArray

# Vectors count as equal up to their sign when they differ by this fraction of their norm.
PARALLEL = 1e-10
LEAST_GAIN = 1.01  # a swap must enlarge the volume by at least this factor


@dataclass(frozen=True)
class Levels:
    """Smallest and largest eigenvalue of the selected Gram matrix."""

    smallest: float
    largest: float

    @property
    def ratio(self) -> float:
        """Squared condition number."""
        return self.largest / self.smallest if self.smallest > 0 else np.inf


@dataclass(frozen=True)
class Block:
    """Vectors of which ``count`` are to be selected.

    Of vectors that agree up to their sign at most one can be selected, and it does not matter
    which: one stands for all.

    Attributes
    ----------
    vectors : FloatArray
        (n, k), one row a representative, of rank k.
    columns : tuple of IntArray
        For each representative the columns it stands for, ascending.
    """

    vectors: FloatArray
    columns: tuple[IntArray, ...]

    @property
    def size(self) -> int:
        """Number n of representatives."""
        return len(self.vectors)

    @property
    def count(self) -> int:
        """Number k of vectors to select."""
        return int(self.vectors.shape[1])

    @cached_property
    def gram(self) -> FloatArray:
        """X Xᵀ, shape (n, n)."""
        return self.vectors @ self.vectors.T

    def levels(self, selection: IntArray) -> Levels:
        """Extreme eigenvalues for a selection (k,) of representatives."""
        values = np.linalg.svd(self.vectors[selection], compute_uv=False) ** 2
        return Levels(float(values[-1]), float(values[0]))

    def least_largest(self) -> float:
        """What the largest eigenvalue of every selection reaches at least.

        It exceeds every diagonal entry, and k of them are selected; and leaving n - k rows out
        lowers it at most to the eigenvalue that follows as many others (Cauchy interlacing).
        """
        entry = np.sort(np.diag(self.gram))[self.count - 1]
        values = np.linalg.svd(self.vectors, compute_uv=False) ** 2
        left_out = self.size - self.count
        return float(max(entry, values[left_out] if left_out < self.count else 0.0))

    def start(self) -> IntArray:
        """A good selection: pivoted Cholesky, then swaps that enlarge the volume.

        These are the pivots of a strong rank-revealing factorisation [Gu1996].
        """
        if self.size == self.count:
            return np.arange(self.size)
        _, _, order = qr(self.vectors.T, mode="economic", pivoting=True)
        chosen = order[: self.count].copy()
        # Swapping row i of the selection for vector j changes the volume by C[j, i]. Every swap
        # enlarges it by a factor, so this ends.
        while True:
            C = self.vectors @ np.linalg.inv(self.vectors[chosen])
            j, i = np.unravel_index(np.abs(C).argmax(), C.shape)
            if abs(C[j, i]) < LEAST_GAIN:
                return np.sort(chosen)
            chosen[i] = j


def make_block(vectors: FloatArray, columns: IntArray) -> Block:
    """Build a block from vectors (n, m) of rank k <= m and the columns (n,) they belong to."""
    differences = vectors[:, None] - vectors
    sums = vectors[:, None] + vectors
    apart = np.minimum(np.linalg.norm(differences, axis=2), np.linalg.norm(sums, axis=2))
    same = apart <= PARALLEL * np.linalg.norm(vectors, axis=1)
    first = same.argmax(axis=0)
    representatives = np.unique(first)
    groups = tuple(columns[first == representative] for representative in representatives)
    return Block(np.ascontiguousarray(vectors[representatives]), groups)
