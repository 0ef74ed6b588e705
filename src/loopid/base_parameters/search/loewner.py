"""Stacks of symmetric matrices in the Loewner order: A <= B when B - A has no negative eigenvalue.

A *form* here is one such stack: (..., w, w), compared matrix by matrix.
"""

from __future__ import annotations

import numpy as np

from loopid.arrays import BoolArray, FloatArray, IntArray
from loopid.base_parameters.search.conflicts import ZERO_PIVOT

# A matrix that exceeds another but for this much, relative to norms of about 1, counts as larger.
EQUAL = 1e-13
COMPARED = 64  # forms that are compared with all others at a time


def eliminate(forms: FloatArray, count: int) -> tuple[FloatArray, IntArray]:
    """Schur complements on the last coordinates, where these are positive definite.

    Parameters
    ----------
    forms : FloatArray
        (N, kinds, m, m).
    count : int
        Coordinates to eliminate.

    Returns
    -------
    FloatArray
        (M, kinds, m - count, m - count), of those where every pivot was positive.
    IntArray
        (M,), which they are.
    """
    kept = np.arange(len(forms))
    for last in range(forms.shape[-1] - 1, forms.shape[-1] - 1 - count, -1):
        positive = (forms[..., last, last] > ZERO_PIVOT).all(axis=1)
        if not positive.all():
            forms, kept = forms[positive], kept[positive]
        column = forms[..., :last, last]
        scaled = column / forms[..., last, last][..., None]
        forms = forms[..., :last, :last] - column[..., :, None] * scaled[..., None, :]
    return forms, kept


def positive_definite(forms: FloatArray) -> BoolArray:
    """Which of (N, kinds, m, m) have only positive definite matrices."""
    positive = np.zeros(len(forms), dtype=np.bool_)
    positive[eliminate(forms, forms.shape[-1])[1]] = True
    return positive


def maximal(forms: FloatArray) -> IntArray:
    """Indices of forms (N, kinds, w, w) that no other exceeds, those of the largest trace first."""
    if len(forms) < 2 or forms.shape[-1] == 0:
        return np.arange(len(forms))[:1]
    diagonals = np.diagonal(forms, axis1=2, axis2=3).reshape(len(forms), -1)
    order = np.argsort(-diagonals.sum(axis=1), kind="stable")
    forms, diagonals = forms[order], diagonals[order]
    kept = np.arange(len(forms))
    first = 0
    # What exceeds a form has a larger trace, and what exceeds that one exceeds the form too: so
    # each batch of forms is compared with those after it, and what is exceeded drops out.
    while first < len(kept):
        batch = kept[first : first + COMPARED]
        lower = (diagonals[kept] <= diagonals[batch][:, None] + EQUAL).all(axis=2)
        above, below = np.nonzero(lower & (kept > batch[:, None]))
        differences = forms[batch[above]] - forms[kept[below]]
        # Round-off on both sides of zero: equal forms keep positive pivots.
        exceeded = positive_definite(differences + 4 * EQUAL * np.eye(forms.shape[-1]))
        first += len(batch) - len(np.intersect1d(batch, kept[below[exceeded]]))
        kept = np.delete(kept, below[exceeded])
    return np.asarray(order[kept], dtype=np.int64)


def upper_bound(forms: FloatArray) -> FloatArray:
    """A form (kinds, w, w) that exceeds all of (N, kinds, w, w).

    Of two matrices, half their sum plus half the absolute value of their difference: both
    (A - B) / 2 and (B - A) / 2 are at most |A - B| / 2.
    """
    while len(forms) > 1:
        odd, even = forms[1::2], forms[: len(forms) // 2 * 2 : 2]
        joined = (odd + even + _absolute(odd - even)) / 2
        forms = np.concatenate([joined, forms[len(forms) // 2 * 2 :]])
    return np.asarray(forms[0], dtype=np.float64)


def _absolute(forms: FloatArray) -> FloatArray:
    values, turns = np.linalg.eigh(forms)
    scaled = turns * np.abs(values)[..., None, :]
    return np.asarray(scaled @ np.swapaxes(turns, -1, -2), dtype=np.float64)


def groups(forms: FloatArray, count: int) -> IntArray:
    """Labels (N,) of at most ``count`` groups of forms that lie close together.

    Each centre is the form farthest from the centres before it [Gonzalez1985].
    """
    points = forms.reshape(len(forms), -1)
    labels = np.zeros(len(forms), dtype=np.int64)
    distance = ((points - points[0]) ** 2).sum(axis=1)
    for label in range(1, min(count, len(forms))):
        own = ((points - points[distance.argmax()]) ** 2).sum(axis=1)
        closer = own < distance
        labels[closer], distance[closer] = label, own[closer]
    return labels
