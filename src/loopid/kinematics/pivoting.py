"""An order of pivots that suits many matrices with the same sparsity [Duff2017, ch. 7]."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from loopid.arrays import BoolArray, FloatArray

LEAST_PIVOT = 0.1  # of the largest entry in its column: bounds the growth of round-off


class Pivot(NamedTuple):
    """The entry in row i and column j, and which entries (n,) of these are not zero then."""

    i: int
    j: int
    row: BoolArray
    column: BoolArray


def pivot_order(typical: FloatArray) -> list[Pivot]:
    """Pivots of Gauss-Jordan elimination, chosen on typical matrices (n, n, k)."""
    tried, pattern = typical.copy(), np.asarray(typical.any(axis=2), dtype=bool)
    rows, columns = np.ones((2, len(typical)), dtype=bool)
    pivots = []
    for _ in typical:
        i, j = _best(pattern, np.abs(tried), rows, columns)
        rows[i] = columns[j] = False
        pivots.append(Pivot(i, j, pattern[i].copy(), pattern[:, j].copy()))
        with np.errstate(all="ignore"):  # a singular one is told by its inverse
            tried -= tried[:, j, None] * tried[i] / tried[i, j]
        pattern[pattern[:, j]] |= pattern[i]
    return pivots


def _best(
    pattern: BoolArray, size: FloatArray, rows: BoolArray, columns: BoolArray
) -> tuple[int, int]:
    """The entry that fills in least among those that are large in their column at all samples."""
    free = rows[:, None] & columns
    size = np.where(free[:, :, None], size, 0.0)
    largest = np.maximum(size.max(axis=0), np.finfo(float).tiny)
    least = (size / largest).min(axis=2)
    inside = pattern & free
    fill = (inside.sum(axis=1)[:, None] - 1) * (inside.sum(axis=0) - 1)
    good = free & (least >= min(LEAST_PIVOT, least.max()))
    best = np.lexsort((-least.ravel(), fill.ravel(), ~good.ravel()))[0]
    i, j = divmod(int(best), len(pattern))
    return i, j
