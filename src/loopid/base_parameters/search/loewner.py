"""Stacks of symmetric matrices in the Loewner order: A <= B when B - A has no negative eigenvalue.

A *form* here is one such stack: (..., w, w), compared matrix by matrix.
"""

from __future__ import annotations

import numpy as np

from loopid.arrays import BoolArray, FloatArray, IntArray
from loopid.base_parameters.search.acceleration import kernels
from loopid.base_parameters.search.conflicts import ZERO_PIVOT

# A matrix that exceeds another but for this much, relative to norms of about 1, counts as larger.
EQUAL = 1e-13
COMPARED = 64  # forms that are compared with all others at a time
# Numbers in the forms of a batch of pairs: few enough to stay in a fast cache.
BATCH = 1 << 18


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


def sums(
    first: FloatArray, second: FloatArray, excess: IntArray, width: int
) -> tuple[FloatArray, IntArray]:
    """Schur complements on the first ``width`` coordinates of sums of pairs.

    Parameters
    ----------
    first, second : FloatArray
        (N_a, kinds, m, m) and (N_b, kinds, m, m).
    excess : IntArray
        (N_a, N_b); pairs with an excess outside 0 ... width are left away.

    Returns
    -------
    FloatArray
        (M, kinds, width, width), of those where every pivot was positive.
    IntArray
        (M, 2), the pairs.
    """
    compiled = kernels(excess.size)
    if compiled is not None:
        return compiled.sums(first, second, excess, width, ZERO_PIVOT)  # type: ignore[no-any-return]
    a, b = np.nonzero((excess >= 0) & (excess <= width))
    size = max(1, BATCH // max(1, int(np.prod(first.shape[1:]))))
    forms, pairs = [np.empty((0, first.shape[1], width, width))], [np.empty((0, 2), np.int64)]
    for start in range(0, len(a), size):
        i, j = a[start : start + size], b[start : start + size]
        left, kept = eliminate(first[i] + second[j], first.shape[-1] - width)
        forms.append(left)
        pairs.append(np.stack([i[kept], j[kept]], axis=1))
    return np.concatenate(forms), np.concatenate(pairs)


def positive_definite(forms: FloatArray) -> BoolArray:
    """Which of (N, kinds, m, m) have only positive definite matrices."""
    positive = np.zeros(len(forms), dtype=np.bool_)
    positive[eliminate(forms, forms.shape[-1])[1]] = True
    return positive


def room(forms: FloatArray, partners: FloatArray, enough: float = np.inf) -> FloatArray:
    """For each form (N, kinds, w, w) the least pivot beside the partner that leaves the largest.

    At least ``ZERO_PIVOT``, which means that no partner makes the form positive definite. The
    search ends for a form above ``enough``.
    """
    compiled = kernels(len(forms) * len(partners))
    if compiled is not None:
        return compiled.room(forms, partners, enough, ZERO_PIVOT)  # type: ignore[no-any-return]
    found = np.full(len(forms), ZERO_PIVOT)
    size = max(1, BATCH // max(1, forms.size))
    for start in range(0, len(partners), size):
        some, open_ = partners[start : start + size], np.flatnonzero(found <= enough)
        both = forms[open_, None] + some
        least = _least_pivots(both.reshape(len(open_) * len(some), *some.shape[1:]))
        best = least.reshape(len(open_), len(some)).max(axis=1, initial=ZERO_PIVOT)
        found[open_] = np.maximum(found[open_], best)
    return found


def _least_pivots(forms: FloatArray) -> FloatArray:
    """The least pivot of (N, kinds, m, m), where all are above ``ZERO_PIVOT``, or that."""
    least, kept = np.full(len(forms), ZERO_PIVOT), np.arange(len(forms))
    found = np.full(len(forms), np.inf)
    for size in range(forms.shape[-1], 0, -1):
        pivots = forms[..., size - 1, size - 1].min(axis=1)
        found = np.minimum(found, pivots)
        forms, positive = eliminate(forms, 1)
        kept, found = kept[positive], found[positive]
    least[kept] = found
    return least


def maximal(forms: FloatArray) -> IntArray:
    """Indices of forms (N, kinds, w, w) that no other exceeds, those of the largest trace first."""
    if len(forms) < 2 or forms.shape[-1] == 0:
        return np.arange(len(forms))[:1]
    diagonals = np.diagonal(forms, axis1=2, axis2=3).reshape(len(forms), -1)
    order = np.argsort(-diagonals.sum(axis=1), kind="stable")
    compiled = kernels(len(forms) ** 2 // 2)
    if compiled is not None:
        kept = compiled.unexceeded(forms[order], diagonals[order], EQUAL, ZERO_PIVOT)
        return np.asarray(order[kept], dtype=np.int64)
    return np.asarray(order[_unexceeded(forms[order], diagonals[order])], dtype=np.int64)


def _unexceeded(forms: FloatArray, diagonals: FloatArray) -> IntArray:
    """Indices of forms, those of the largest trace first, that no earlier one exceeds.

    What exceeds a form has a larger trace, and what exceeds that one exceeds the form too: so
    each batch of forms is compared with those after it, and what is exceeded drops out.
    """
    kept, first = np.arange(len(forms)), 0
    while first < len(kept):
        batch = kept[first : first + COMPARED]
        lower = (diagonals[kept] <= diagonals[batch][:, None] + EQUAL).all(axis=2)
        above, below = np.nonzero(lower & (kept > batch[:, None]))
        differences = forms[batch[above]] - forms[kept[below]]
        # Round-off on both sides of zero: equal forms keep positive pivots.
        exceeded = positive_definite(differences + 4 * EQUAL * np.eye(forms.shape[-1]))
        first += len(batch) - len(np.intersect1d(batch, kept[below[exceeded]]))
        kept = np.delete(kept, below[exceeded])
    return kept


def upper_bounds(forms: FloatArray, labels: IntArray) -> FloatArray:
    """For each group a form (kinds, w, w) that exceeds all its members of (N, kinds, w, w).

    Of two matrices, half their sum plus half the absolute value of their difference: both
    (A - B) / 2 and (B - A) / 2 are at most |A - B| / 2. Neighbours of all groups at a time.
    """
    order = np.argsort(labels, kind="stable")
    forms, labels = forms[order], labels[order]
    while True:
        places = np.arange(len(labels)) - np.searchsorted(labels, labels)
        odd = np.flatnonzero(places % 2)
        if len(odd) == 0:
            return forms
        joined = (forms[odd] + forms[odd - 1] + _absolute(forms[odd] - forms[odd - 1])) / 2
        forms[odd - 1] = joined
        forms, labels = np.delete(forms, odd, axis=0), np.delete(labels, odd)


def _absolute(forms: FloatArray) -> FloatArray:
    values, turns = np.linalg.eigh(forms)
    scaled = turns * np.abs(values)[..., None, :]
    return np.asarray(scaled @ np.swapaxes(turns, -1, -2), dtype=np.float64)


def groups(forms: FloatArray, count: int) -> IntArray:
    """Labels (N,) of at most ``count`` groups of forms that lie close together.

    Each centre is the form farthest from the centres before it [Gonzalez1985].
    """
    points = forms.reshape(len(forms), -1)
    compiled = kernels(len(points) * count)
    if compiled is not None:
        return compiled.groups(points, count)  # type: ignore[no-any-return]
    labels = np.zeros(len(forms), dtype=np.int64)
    distance = ((points - points[0]) ** 2).sum(axis=1)
    for label in range(1, min(count, len(forms))):
        own = ((points - points[distance.argmax()]) ** 2).sum(axis=1)
        closer = own < distance
        labels[closer], distance[closer] = label, own[closer]
    return labels
