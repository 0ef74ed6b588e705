"""Samples in blocks that stay in the processor's cache, whatever their number."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import cache

import numpy as np

from loopid.arrays import FloatArray

# Numbers in the largest array of a block, small enough for the cache, and samples of a block,
# enough of them to spread the cost of calling NumPy.
NUMBERS = 800_000
FEWEST, MOST = 50, 1000


def blocks(count: int, width: int = 1) -> Iterator[slice]:
    """Slices of samples with so many numbers each, at least one slice."""
    size = min(max(NUMBERS // max(width, 1), FEWEST), MOST)
    for first in range(0, max(count, 1), size):
        yield slice(first, min(first + size, count))


def in_blocks(
    count: int, block_values: Callable[[slice], tuple[FloatArray, ...]], width: int = 1
) -> tuple[FloatArray, ...]:
    """Arrays with samples first (N, ...) from those of the blocks, with samples last (..., N).

    Parameters
    ----------
    count : int
    block_values : callable
        The arrays at a slice of the samples.
    width : int
        Numbers per sample in the largest array on the way.
    """
    _keep_freed_memory()
    whole: list[FloatArray] = []
    for rows in blocks(count, width):
        parts = block_values(rows)
        whole = whole or [np.empty((count, *part.shape[:-1])) for part in parts]
        for values, part in zip(whole, parts, strict=True):
            values[rows] = np.moveaxis(part, -1, 0)
    return tuple(whole)


@cache
def _keep_freed_memory() -> None:
    """Let the C library keep the memory of one block for the next.

    glibc hands freed memory back to the system, which costs as much as using it, until it has
    seen a large array come and go (``M_MMAP_THRESHOLD`` in mallopt(3)). Elsewhere this does
    nothing: the array is never written to.
    """
    np.empty(31 << 17)
