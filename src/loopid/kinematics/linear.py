"""Batched linear algebra that tells a rank before it divides."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from loopid.arrays import FloatArray, IntArray

# Singular values below this fraction of the largest are taken as zero. Closed configurations
# are exact to round-off, so a redundant row shows at 1e-15; CAD files rounded to six digits
# close to 1e-9 only.
RANK_TOLERANCE = 1e-8


@dataclass(frozen=True)
class Factorisation:
    """Singular value decompositions of N matrices (N, m, n), for repeated solves.

    Attributes
    ----------
    left, values, right : FloatArray
        U (N, m, k), singular values (N, k), Vᵀ (N, k, n) with k = min(m, n).
    rank : IntArray
        (N,), with singular values relative to the largest of each matrix.
    """

    left: FloatArray
    values: FloatArray
    right: FloatArray
    rank: IntArray

    @classmethod
    def of(cls, matrices: FloatArray, tolerance: float = RANK_TOLERANCE) -> Factorisation:
        """Factor a stack of matrices."""
        if 0 in matrices.shape[1:]:
            count, rows, columns = matrices.shape
            empty = np.empty((count, rows, 0)), np.empty((count, 0)), np.empty((count, 0, columns))
            return cls(*empty, np.zeros(count, dtype=np.int64))
        left, values, right = np.linalg.svd(matrices, full_matrices=False)
        rank = (values > tolerance * values[:, :1]).sum(axis=1)
        return cls(left, values, right, rank)

    def solve(self, right_hand_sides: FloatArray, damping: FloatArray | None = None) -> FloatArray:
        """Minimum-norm least-squares solutions (N, n, c) of stacked systems with (N, m, c).

        With a damping (N,) the steps of Levenberg and Marquardt, (AᵀA + d² I)⁻¹ Aᵀ b.
        """
        values = self.values
        if damping is None:
            kept = np.arange(values.shape[1]) < self.rank[:, None]
            inverse = np.divide(1.0, values, out=np.zeros_like(values), where=kept)
        else:
            inverse = values / (values**2 + damping[:, None] ** 2)
        projected = inverse[:, :, None] * (self.left.transpose(0, 2, 1) @ right_hand_sides)
        return np.asarray(self.right.transpose(0, 2, 1) @ projected, dtype=np.float64)


def null_space(matrix: FloatArray, tolerance: float = RANK_TOLERANCE) -> FloatArray:
    """Orthonormal basis (n, d) of the null space of one matrix (m, n)."""
    columns = matrix.shape[1]
    if matrix.shape[0] == 0:
        return np.eye(columns)
    _, values, right = np.linalg.svd(matrix)
    rank = int((values > tolerance * values.max(initial=0.0)).sum())
    return np.asarray(right[rank:].T, dtype=np.float64)
