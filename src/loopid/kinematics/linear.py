"""Stacks of small linear systems: ranks told before anything is divided, repeated solves.

Redundant rows are the norm in closed loops. Every factorisation tells its rank, by singular values
relative to the largest, and the tolerance that it took.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import NamedTuple

import numpy as np
from scipy.linalg.lapack import dgetrf, dgetri
from scipy.sparse import block_array, csr_array
from scipy.sparse.csgraph import connected_components

from loopid.arguments import FloatArray, IntArray
from loopid.records import record
from loopid.robot.mechanism import RANK_TOLERANCE

LARGE = 400  # entries of a matrix that is worth looking at for blocks


class _Block(NamedTuple):
    """L blocks of one shape of N matrices, with their singular value decompositions."""

    rows: IntArray  # (L, r)
    columns: IntArray  # (L, c)
    left: FloatArray  # (N, L, r, k)
    values: FloatArray  # (N, L, k)
    right: FloatArray  # (N, L, k, c)


@record
class Factorisation:
    """Singular value decompositions of N matrices (N, m, n), for repeated solves.

    Large matrices fall apart into the blocks of loops that have no coordinates in common.
    """

    blocks: tuple[_Block, ...]
    width: int  # n
    values: FloatArray  # (N, k), singular values, descending
    rank: IntArray  # (N,)
    least: FloatArray  # (N,), the values up to which they count as zero
    tolerance: float = RANK_TOLERANCE  # these relative to the largest value

    @classmethod
    def of(cls, matrices: FloatArray, tolerance: float = RANK_TOLERANCE) -> Factorisation:
        """Factor a stack of matrices."""
        parts = []
        for rows, columns in _independent_blocks(matrices):
            block = matrices[:, rows[:, :, None], columns[:, None, :]]
            parts.append(_Block(rows, columns, *np.linalg.svd(block, full_matrices=False)))
        spectra = [part.values.reshape(len(matrices), -1) for part in parts]
        values = -np.sort(-np.concatenate([np.empty((len(matrices), 0)), *spectra], axis=1), axis=1)
        least = tolerance * values[:, :1].max(axis=1, initial=0.0)
        rank = (values > least[:, None]).sum(axis=1)
        return cls(tuple(parts), matrices.shape[2], values, rank, least, tolerance)

    @property
    def least_over_largest(self) -> FloatArray:
        """Ratio (N,) of the n-th singular value to the first; 1 without columns."""
        count, found = self.values.shape
        if self.width == 0:
            return np.ones(count)
        if found < self.width:
            return np.zeros(count)
        largest = np.maximum(self.values[:, 0], np.finfo(float).tiny)
        return np.asarray(self.values[:, self.width - 1] / largest, dtype=np.float64)

    def solve(self, right_hand_sides: FloatArray, damping: FloatArray | None = None) -> FloatArray:
        """Minimum-norm least-squares solutions (N, n, c) of stacked systems with (N, m, c).

        With a damping (N,) the steps of Levenberg and Marquardt, (AᵀA + d² I)⁻¹ Aᵀ b.
        """
        count, _, width = right_hand_sides.shape
        solutions = np.zeros((count, self.width, width))
        for rows, columns, left, values, right in self.blocks:
            values = np.where(values > self.least[:, None, None], values, np.inf)
            inverse = 1.0 / values
            if damping is not None:
                inverse = 1.0 / (values + damping[:, None, None] ** 2 / values)
            projected = left.swapaxes(2, 3) @ right_hand_sides[:, rows]
            solutions[:, columns] = right.swapaxes(2, 3) @ (inverse[..., None] * projected)
        return solutions


def _independent_blocks(matrices: FloatArray) -> list[tuple[IntArray, IntArray]]:
    """Rows (L, r) and columns (L, c) of the blocks that matrices (N, m, n) consist of, by shape."""
    _, m, n = matrices.shape
    if 0 in matrices.shape:
        return []
    if m * n < LARGE:
        return [(np.arange(m)[None], np.arange(n)[None])]
    return _blocks_of((matrices != 0.0).any(axis=0).tobytes(), m, n)


@lru_cache(maxsize=64)
def _blocks_of(nonzero: bytes, m: int, n: int) -> list[tuple[IntArray, IntArray]]:
    """As ``_independent_blocks``, for a sparsity pattern; cached, as a robot's rarely changes."""
    pattern = np.frombuffer(nonzero, dtype=bool).reshape(m, n)
    count, group = connected_components(
        block_array([[None, csr_array(pattern)], [csr_array(pattern.T), None]]), directed=False
    )
    shapes: dict[tuple[int, int], list[tuple[IntArray, IntArray]]] = {}
    for k in range(count):
        rows, columns = np.flatnonzero(group[:m] == k), np.flatnonzero(group[m:] == k)
        if len(rows) and len(columns):
            shapes.setdefault((len(rows), len(columns)), []).append((rows, columns))
    return [
        (np.stack([rows for rows, _ in same]), np.stack([columns for _, columns in same]))
        for same in shapes.values()
    ]


@dataclass(eq=False)
class Solver:
    """Least-squares solves with N matrices (N, m, n): inverses where these are proven regular.

    An inverse takes a fifth of the time of a singular value decomposition. The Frobenius norms of
    a matrix and its inverse bound its condition; where the bound proves nothing, singular values
    decide.
    """

    matrices: FloatArray  # (N, m, n)
    inverses: FloatArray | None  # (N, n, n); None where not square, or one is exactly singular
    ill_conditioned: IntArray  # samples whose ratio of singular values is not proven to be larger

    @classmethod
    def of(cls, matrices: FloatArray, bound: float) -> Solver:
        """Invert what is proven to have a ratio of singular values above the bound."""
        count, rows, columns = matrices.shape
        if columns == 0:
            return cls(matrices, None, np.empty(0, dtype=np.int64))
        inverses = _inverses(matrices) if rows == columns else None
        if inverses is None:
            return cls(matrices, None, np.arange(count))
        square_norms = _square_norms(matrices) * _square_norms(inverses)
        # Written so that a NaN counts as not proven.
        unproven = ~(square_norms < 1.0 / (1.001 * bound) ** 2)
        return cls(matrices, inverses, unproven.nonzero()[0])

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
        solutions: FloatArray = self.inverses @ right_hand_sides
        if len(self.ill_conditioned):
            doubtful = right_hand_sides[self.ill_conditioned]
            solutions[self.ill_conditioned] = self.factors.solve(doubtful)
        return solutions


def _inverses(matrices: FloatArray) -> FloatArray | None:
    """None where one is exactly singular: singular values tell which."""
    if len(matrices) == 1:  # LAPACK itself, in a third of the time
        factors, pivots, singular = dgetrf(matrices[0])
        return None if singular else dgetri(factors, pivots)[0][None]
    try:
        return np.asarray(np.linalg.inv(matrices), dtype=np.float64)
    except np.linalg.LinAlgError:
        return None


def _square_norms(matrices: FloatArray) -> FloatArray:
    flat = matrices.reshape(len(matrices), matrices.shape[1] * matrices.shape[2])
    return np.asarray(np.vecdot(flat, flat), dtype=np.float64)


def null_space(matrix: FloatArray, tolerance: float = RANK_TOLERANCE) -> FloatArray:
    """Orthonormal basis (n, d) of the null space of one matrix (m, n)."""
    columns = matrix.shape[1]
    if matrix.shape[0] == 0:
        return np.eye(columns)
    spaces, most = list[tuple[IntArray, FloatArray, FloatArray]](), 0.0
    free = np.ones(columns, dtype=bool)
    for all_rows, all_columns in _independent_blocks(matrix[None]):
        for rows, own in zip(all_rows, all_columns, strict=True):
            _, values, right = np.linalg.svd(matrix[np.ix_(rows, own)])
            spaces.append((own, values, right))
            free[own], most = False, max(most, values.max(initial=0.0))
    basis = [np.eye(columns)[:, free]]
    for own, values, right in spaces:
        kept = right[int((values > tolerance * most).sum()) :]
        part = np.zeros((columns, len(kept)))
        part[own] = kept.T
        basis.append(part)
    return np.concatenate(basis, axis=1)


def least_over_largest(matrices: FloatArray) -> FloatArray:
    """Ratio (N,) of the n-th singular value to the first of matrices (N, m, n)."""
    return Factorisation.of(matrices).least_over_largest
