"""What Schur complements say of the free rows: alone, in pairs, and in threes.

A matrix M on the free rows stands for a rule: rows R may be settled together only where
M_RR > 0. One row needs a positive diagonal entry, two a positive pivot of the second after the
first; two that have none are in conflict.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from loopid.arrays import BoolArray, FloatArray, IntArray

# Pivots at most this large are zero: round-off of matrices whose norm is about 1.
ZERO_PIVOT = 1e-13


def eliminated(matrix: FloatArray, rows: IntArray, kept: IntArray) -> FloatArray | None:
    """Schur complement on some rows, restricted to others; None unless they may be settled."""
    rest = matrix[kept[:, None], kept]
    if len(rows) == 0:
        return rest
    try:
        factor = np.linalg.cholesky(matrix[rows[:, None], rows])
    except np.linalg.LinAlgError:
        return None
    if factor.diagonal().min() ** 2 <= ZERO_PIVOT:
        return None
    across = np.linalg.solve(factor, matrix[rows[:, None], kept])
    return np.asarray(rest - across.T @ across, dtype=np.float64)


def options(
    takes: Sequence[FloatArray], leave: FloatArray, places: tuple[int, int]
) -> tuple[BoolArray, BoolArray]:
    """Which of the free rows can be taken, and which left.

    Parameters
    ----------
    takes : sequence of FloatArray
        (f, f), the rules for rows taken.
    leave : FloatArray
        (f, f), the rule for rows left.
    places : tuple of int
        How many rows are to be taken and to be left in all.
    """
    takeable = np.all([matrix.diagonal() > ZERO_PIVOT for matrix in takes], axis=0)
    takeable &= places[0] > 0
    leavable = (leave.diagonal() > ZERO_PIVOT) & (places[1] > 0)
    if not (takeable & leavable).all():
        return takeable, leavable
    apart = np.any([conflicts(matrix) for matrix in takes], axis=0)
    return consistent(apart, conflicts(leave), places)


def conflicts(matrix: FloatArray) -> BoolArray:
    """Which two rows (f, f) cannot be settled together; all of them may be alone."""
    diagonal = matrix.diagonal()
    pivots = diagonal - matrix**2 / diagonal[:, None]
    found = pivots <= ZERO_PIVOT
    np.fill_diagonal(found, False)
    return np.asarray(found | found.T)


def consistent(
    apart: BoolArray, together: BoolArray, places: tuple[int, int]
) -> tuple[BoolArray, BoolArray]:
    """Which rows can be taken and left, given which two cannot both be taken, or both left.

    To take a row leaves those it is in conflict with: there must be places for them, and no
    conflict among themselves. And the other way round.
    """
    if not (apart.any() or together.any()):
        return apart.diagonal() == 0, together.diagonal() == 0
    takeable = (apart.sum(axis=1) <= places[1]) & ~_triangles(apart, together)
    leavable = (together.sum(axis=1) <= places[0]) & ~_triangles(together, apart)
    return takeable, leavable


def _triangles(sides: BoolArray, base: BoolArray) -> BoolArray:
    """Which rows have two neighbours in one graph that are neighbours in the other."""
    reached = sides.astype(np.float32) @ base.astype(np.float32)
    return np.asarray(((reached > 0) & sides).any(axis=1))
