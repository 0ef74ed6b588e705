"""Combinations by number: the i-th of C(n, k) in lexicographic order, many at once."""

from __future__ import annotations

from math import comb

import numpy as np

from loopid.arrays import IntArray

LARGEST = np.iinfo(np.int64).max


def unrank(ranks: IntArray, size: int, count: int) -> IntArray:
    """Combinations with the given lexicographic ranks.

    Parameters
    ----------
    ranks : IntArray
        (c,), in 0 ... C(size, count) - 1, which must fit in 64 bits.
    size, count : int
        Choose ``count`` of ``range(size)``.

    Returns
    -------
    IntArray
        (c, count), ascending in each row.
    """
    # The combinatorial number system counts backwards: C(n, k) - 1 - rank = Σ C(c_j, k - j),
    # and the element chosen at place j is n - 1 - c_j.
    left = comb(size, count) - 1 - np.asarray(ranks, dtype=np.int64)
    chosen = np.empty((len(left), count), dtype=np.int64)
    for place in range(count):
        # Entries beyond every rank only have to stay beyond them.
        entries = [min(comb(c, count - place), LARGEST) for c in range(size)]
        table = np.array(entries, dtype=np.int64)
        digit = np.searchsorted(table, left, side="right") - 1
        left = left - table[digit]
        chosen[:, place] = size - 1 - digit
    return chosen
