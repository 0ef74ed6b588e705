"""Medians and percentiles of signals of any length: exact, in several passes."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from loopid.arrays import FloatArray, IntArray
from loopid.scratch import BLOCK_ROWS, row_blocks

# Gives the values of a block of rows.
Signal = Callable[[slice], FloatArray | IntArray]

BINS = 4096


def largest(signal: Signal, count: int) -> float:
    """The maximum of so many values."""
    return max(float(signal(rows).max()) for rows in row_blocks(count))


def median(signal: Signal, count: int) -> float:
    """As ``np.median`` of so many values."""
    low = order_statistic(signal, count, (count - 1) // 2)
    return low if count % 2 else (low + order_statistic(signal, count, count // 2)) / 2


def percentile(signal: Signal, count: int, percent: float) -> float:
    """As ``np.percentile`` of so many values."""
    place = (count - 1) * (percent / 100)
    rank = int(place)
    low = order_statistic(signal, count, rank)
    high = order_statistic(signal, count, min(rank + 1, count - 1))
    part = place - rank
    # From the nearer end, as NumPy does.
    return low + (high - low) * part if part < 0.5 else high - (high - low) * (1 - part)


def order_statistic(signal: Signal, count: int, rank: int) -> float:
    """The value that comes so many places after the smallest.

    A histogram tells in which of its bins the value lies, until few enough are left to be sorted.
    """
    low, high, before, inside = -np.inf, np.inf, 0, count
    while inside > BLOCK_ROWS and low < high:
        low, high, before, inside = _narrowed(signal, count, (low, high, before), rank)
    if low == high:
        return float(low)
    found = np.concatenate([_within(signal(rows), low, high) for rows in row_blocks(count)])
    return float(np.partition(found, rank - before)[rank - before])


def _narrowed(
    signal: Signal, count: int, bounds: tuple[float, float, int], rank: int
) -> tuple[float, float, int, int]:
    """Closer bounds of the value, and how many values lie before and within them."""
    low, high, before = bounds
    blocks = (_within(signal(rows), low, high) for rows in row_blocks(count))
    ends = [(block.min(), block.max()) for block in blocks if len(block)]
    low, high = float(min(end[0] for end in ends)), float(max(end[1] for end in ends))
    # The first bin holds nothing but the smallest value, so that the bounds close in every time.
    inner = np.linspace(np.nextafter(low, np.inf), high, BINS)[:-1]
    counts = np.zeros(BINS, dtype=np.int64)
    for rows in row_blocks(count):
        bins = np.searchsorted(inner, _within(signal(rows), low, high), "right")
        counts += np.bincount(bins, minlength=BINS)
    ranks = before + np.cumsum(counts)
    chosen = int(np.searchsorted(ranks, rank, "right"))
    edges = [low, *inner, np.nextafter(high, np.inf)]
    below = float(np.nextafter(edges[chosen + 1], -np.inf))
    return edges[chosen], below, int(ranks[chosen] - counts[chosen]), int(counts[chosen])


def _within(values: FloatArray | IntArray, low: float, high: float) -> FloatArray | IntArray:
    return values[(values >= low) & (values <= high)]
