"""Batched linear algebra that tells a rank before it divides."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

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
        if 0 in matrices.shape:
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


@dataclass(frozen=True)
class Solver:
    """Least-squares solves with N matrices (N, m, n): inverses where these are proven regular.

    An inverse takes a fifth of the time of a singular value decomposition; the Frobenius norms of
    a matrix and its inverse bound its condition.

    Attributes
    ----------
    matrices : FloatArray
        (N, m, n).
    inverses : FloatArray or None
        (N, n, n); None where the matrices are not square, or one is exactly singular.
    ill_conditioned : IntArray
        Samples whose ratio of least to largest singular value is not proven to exceed a bound.
    """

    matrices: FloatArray
    inverses: FloatArray | None
    ill_conditioned: IntArray

    @classmethod
    def of(cls, matrices: FloatArray, bound: float) -> Solver:
        """Invert what is proven to have a ratio of singular values above the bound."""
        count, rows, columns = matrices.shape
        if columns == 0:
            return cls(matrices, None, np.empty(0, dtype=np.int64))
        if rows == columns:
            try:
                inverses = np.asarray(np.linalg.inv(matrices), dtype=np.float64)
            except np.linalg.LinAlgError:
                pass  # the singular ones are told by their singular values
            else:
                condition = np.sqrt(_square_norm(matrices) * _square_norm(inverses))
                return cls(matrices, inverses, np.flatnonzero(~(1.001 * bound * condition < 1)))
        return cls(matrices, None, np.arange(count))

    @cached_property
    def factors(self) -> Factorisation:
        """Singular value decompositions at the ill-conditioned samples."""
        return Factorisation.of(self.matrices[self.ill_conditioned])

    def solve(self, right_hand_sides: FloatArray) -> FloatArray:
        """Minimum-norm least-squares solutions (N, n, c) of stacked systems with (N, m, c)."""
        if self.inverses is None:
            if not len(self.ill_conditioned):
                return np.empty((len(self.matrices), 0, right_hand_sides.shape[2]))
            return self.factors.solve(right_hand_sides)
        solutions = self.inverses @ right_hand_sides
        if len(self.ill_conditioned):
            solutions[self.ill_conditioned] = self.factors.solve(
                right_hand_sides[self.ill_conditioned]
            )
        return np.asarray(solutions, dtype=np.float64)


def _square_norm(matrices: FloatArray) -> FloatArray:
    return np.asarray(np.einsum("nij,nij->n", matrices, matrices), dtype=np.float64)


def null_space(matrix: FloatArray, tolerance: float = RANK_TOLERANCE) -> FloatArray:
    """Orthonormal basis (n, d) of the null space of one matrix (m, n)."""
    columns = matrix.shape[1]
    if matrix.shape[0] == 0:
        return np.eye(columns)
    _, values, right = np.linalg.svd(matrix)
    rank = int((values > tolerance * values.max(initial=0.0)).sum())
    return np.asarray(right[rank:].T, dtype=np.float64)
