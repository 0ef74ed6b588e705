"""Independent blocks: groups of parameters that no null vector connects.

Regrouping never mixes parameters of different blocks, so a choice is made block by block.
"""

from __future__ import annotations

import numpy as np
from scipy.sparse import csr_array
from scipy.sparse.csgraph import connected_components

from loopid.arrays import FloatArray, IntArray, finite
from loopid.errors import DataError

# Entries of the null-space projector below this are round-off; entries are at most 1.
CONNECTED = 1e-9


def independent_blocks(null_basis: FloatArray) -> tuple[IntArray, ...]:
    """Connected components of the null-space projector N = V2 V2ᵀ.

    Parameters
    ----------
    null_basis : FloatArray
        (n, d), orthonormal.

    Returns
    -------
    tuple of IntArray
        Ascending columns of each block, blocks in the order of their first columns. Columns
        that no null vector touches are blocks of their own.
    """
    basis = finite(null_basis, "null_basis")
    if basis.ndim != 2:
        raise DataError(f"null_basis must have shape (n, d), not {basis.shape}")
    projector = basis @ basis.T
    graph = csr_array(np.abs(projector) > CONNECTED)
    count, labels = connected_components(graph, directed=False)
    return tuple(np.flatnonzero(labels == block) for block in range(count))
