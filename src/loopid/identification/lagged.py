"""Sums over pairs of rows that are so many samples apart, block by block."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from loopid.arrays import BoolArray, FloatArray
from loopid.identification.autoregression import Autoregression
from loopid.scratch import row_blocks


def lagged_grams(
    columns: FloatArray | BoolArray, pieces: tuple[slice, ...], order: int
) -> FloatArray:
    """Σ_t x_t x_{t+k}ᵀ (order + 1, n, n) for each lag k, over rows x (N, n) within each piece."""
    width = columns.shape[1]
    grams = np.zeros((order + 1, width, width))
    for piece in pieces:
        for rows in row_blocks(piece):
            first = max(rows.start - order, piece.start)
            window = np.asarray(columns[first : rows.stop], dtype=np.float64)
            for k, earlier, later in _pairs(window, window, rows.start - first, order):
                grams[k] += earlier.T @ later
    return grams


def past_sums(
    model: Autoregression, columns: FloatArray, used: BoolArray, pieces: tuple[slice, ...]
) -> tuple[FloatArray, FloatArray]:
    """What the past part Z of Ω X adds up to in a pass forwards.

    Returns
    -------
    sums : FloatArray
        (n, n), Xᵀ Z.
    shared : FloatArray
        (order + 1,), Σ_t u_t z_t · (x_{t+k} + x_{t-k}), u_t = 1 where a sample is used.
    """
    width, order = columns.shape[1], model.order
    sums, shared = np.zeros((width, width)), np.zeros(order + 1)
    for piece in pieces:
        state, before = None, np.zeros((0, width))
        for rows in row_blocks(piece):
            lead = len(before)
            window = columns[rows.start - lead : rows.stop]
            past, state = model.past_part(window[lead:], state)
            sums += window[lead:].T @ past
            present = np.concatenate([before, past * used[rows, None]])
            for one, other in ((window, present), (present, window)):
                for k, earlier, later in _pairs(one, other, lead, order):
                    shared[k] += np.vdot(earlier, later)
            before = present[max(len(present) - order, 0) :]
    return sums, shared


def _pairs(
    one: FloatArray, other: FloatArray, lead: int, order: int
) -> Iterator[tuple[int, FloatArray, FloatArray]]:
    """For each lag, rows of one and the later rows of the other, these after the first ``lead``."""
    for k in range(order + 1):
        first = max(lead, k)
        yield k, one[first - k : max(len(one) - k, first - k)], other[first:]
