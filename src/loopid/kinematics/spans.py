"""Indices that follow one another as slices: views of arrays instead of copies."""

from __future__ import annotations

import numpy as np

from loopid.arrays import IntArray

Span = slice | IntArray


def span(indices: IntArray) -> Span:
    """The indices (n,), as a slice where each is one more than that before."""
    if len(indices) and np.array_equal(indices, indices[0] + np.arange(len(indices))):
        return slice(int(indices[0]), int(indices[-1]) + 1)
    return indices
