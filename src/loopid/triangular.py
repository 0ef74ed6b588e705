"""Triangular factors: R of W = Q R, of matrices whole or in parts.

Householder's method by blocks of columns, on as many rows at a time as stay in the processor's
cache [Demmel2012]. Columns of zeros cost nothing.
"""

from __future__ import annotations

from itertools import pairwise

import numpy as np
from scipy.linalg.lapack import dtpqrt

from loopid.arrays import BoolArray, FloatArray, IntArray
from loopid.errors import DataError
from loopid.threads import one_blas_thread

# Rows that are reduced at a time, and columns whose reflections are applied together: so many, or
# a part of all.
ROWS = 400
PANEL, PANEL_PART = 8, 16


def triangular_factor(matrix: FloatArray) -> FloatArray:
    """Square upper triangular R of matrices (..., m, n), padded with zero rows where m < n."""
    *stack, _, width = matrix.shape
    factors = np.zeros((*stack, width, width))
    with one_blas_thread():
        for k in np.ndindex(*stack):
            kept = np.flatnonzero(_touched(matrix[k]))
            factors[k][np.ix_(kept, kept)] = _updated(_zeros(len(kept)), matrix[k], kept)
    return factors


class RowFactors:
    """Triangular factors of samples (N, dof, n), one for each of the dof rows of a sample.

    The row of a joint has columns of those bodies only that move with it: in a tree, few of all.
    So each row is reduced on its own columns, and the rows with each other only at the end.

    Parameters
    ----------
    width : int
        Number n of columns.

    Attributes
    ----------
    rows : int
        Rows reduced so far, dof a sample.
    """

    def __init__(self, width: int) -> None:
        self.rows = 0
        self._width = width
        self._columns: list[IntArray] = []
        self._factors: list[FloatArray] = []

    def add(self, samples: FloatArray) -> None:
        """Reduce further samples (N, dof, n)."""
        count, dof, _ = samples.shape
        for _ in range(len(self._factors), dof):
            self._columns.append(np.empty(0, dtype=np.int64))
            self._factors.append(_zeros(0))
        with one_blas_thread():
            for row in range(dof):
                self._widen(row, _touched(samples[:, row]))
                self._factors[row] = _updated(
                    self._factors[row], samples[:, row], self._columns[row]
                )
        self.rows += count * dof

    def _widen(self, row: int, touched: BoolArray) -> None:
        """Let a row's factor have columns (n,) that its samples have not touched before."""
        known = self._columns[row]
        columns = np.union1d(known, np.flatnonzero(touched))
        if len(columns) > len(known):
            factor, places = _zeros(len(columns)), np.searchsorted(columns, known)
            factor[np.ix_(places, places)] = self._factors[row]
            self._columns[row], self._factors[row] = columns, factor

    def factor(self) -> FloatArray:
        """One triangular factor (n, n) of all rows."""
        stacked = np.zeros((sum(map(len, self._factors)), self._width))
        first = 0
        for columns, factor in zip(self._columns, self._factors, strict=True):
            stacked[first : first + len(factor), columns] = factor
            first += len(factor)
        return triangular_factor(stacked[stacked.any(axis=1)])


def _touched(matrix: FloatArray) -> BoolArray:
    """Which columns (n,) of a matrix (m, n) are not zero; most show it in the first rows."""
    touched = np.asarray(matrix[: matrix.shape[1]].any(axis=0), dtype=bool)
    touched[~touched] = matrix[:, ~touched].any(axis=0)
    return touched


def _zeros(width: int) -> FloatArray:
    """The factor of no rows, as LAPACK stores it."""
    return np.zeros((width, width), order="F")


def _updated(factor: FloatArray, matrix: FloatArray, columns: IntArray) -> FloatArray:
    """The factor (n, n) of what a factor stands for and of n columns of a matrix (m, ...)."""
    width = len(columns)
    if width == 0 or len(matrix) == 0:
        return factor
    step = min(max(ROWS, width), len(matrix))
    panel = min(max(PANEL, width // PANEL_PART), width)
    for start, end in pairwise([*range(0, len(matrix), step), len(matrix)]):
        part = np.asfortranarray(matrix[start:end, columns])
        factor, _, _, failed = dtpqrt(0, panel, factor, part, overwrite_a=True, overwrite_b=True)
        if failed:
            raise DataError(f"the triangular factor failed with LAPACK's code {failed}")
    return np.asfortranarray(np.triu(factor), dtype=np.float64)
