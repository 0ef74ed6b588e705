"""Compiled forms of what the fronts spend their time on; only where numba is installed.

Each takes pairs of forms one at a time and leaves off at the first pivot that is not positive,
which most pairs meet at once; arrays of all pairs at a time do all of the work in slow memory.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numba import njit

from loopid.arrays import BoolArray, FloatArray, IntArray

Compiled: Any = njit(cache=True, error_model="numpy")


@Compiled
def _eliminated(form: FloatArray, first: int, zero: float) -> bool:
    """Eliminate all coordinates from the last to ``first`` in the lower triangle of (m, m)."""
    for last in range(len(form) - 1, first - 1, -1):
        if not form[last, last] > zero:
            return False
        for row in range(last):
            scaled = form[last, row] / form[last, last]
            for column in range(row + 1):
                form[row, column] -= scaled * form[last, column]
    return True


@Compiled
def _least_pivot(form: FloatArray, least: float) -> float:
    """The least pivot of the lower triangle of (m, m), or ``least`` if one is not above that."""
    found = np.inf
    for last in range(len(form) - 1, -1, -1):
        pivot = form[last, last]
        if not pivot > least:
            return least
        found = min(found, pivot)
        for row in range(last):
            scaled = form[last, row] / pivot
            for column in range(row + 1):
                form[row, column] -= scaled * form[last, column]
    return found


@Compiled
def _hopeless(first: FloatArray, second: FloatArray, start: int, zero: float) -> bool:
    """Whether a diagonal entry of the sum of two (m, m) from ``start`` on is not positive."""
    hopeless = False
    for row in range(start, len(first)):
        hopeless |= not first[row, row] + second[row, row] > zero
    return hopeless


@Compiled
def _combined(first: FloatArray, second: FloatArray, times: float, form: FloatArray) -> None:
    """The lower triangle of one (m, m) plus so many times another."""
    for row in range(len(form)):
        for column in range(row + 1):
            form[row, column] = first[row, column] + times * second[row, column]


@Compiled
def sums(
    first: FloatArray, second: FloatArray, excess: IntArray, width: int, zero: float
) -> tuple[FloatArray, IntArray]:
    """Schur complements (M, kinds, width, width) of sums of pairs, and the pairs (M, 2).

    ``first`` and ``second`` are (N, kinds, m, m); of the pairs those count with an ``excess``
    (N_a, N_b) of 0 ... width and with positive pivots.
    """
    kinds, size = first.shape[1], first.shape[2]
    capacity, count = 256, 0
    forms, pairs = np.empty((capacity, kinds, width, width)), np.empty((capacity, 2), np.int64)
    form = np.empty((kinds, size, size))
    for i in range(len(first)):
        for j in range(len(second)):
            positive = 0 <= excess[i, j] <= width
            for kind in range(kinds):
                if positive and _hopeless(first[i, kind], second[j, kind], width, zero):
                    positive = False
            for kind in range(kinds):
                if positive:
                    _combined(first[i, kind], second[j, kind], 1.0, form[kind])
                    positive = _eliminated(form[kind], width, zero)
            if not positive:
                continue
            if count == capacity:
                forms, pairs = np.concatenate((forms, forms)), np.concatenate((pairs, pairs))
                capacity *= 2
            for kind in range(kinds):
                for row in range(width):
                    for column in range(row + 1):
                        forms[count, kind, row, column] = form[kind, row, column]
                        forms[count, kind, column, row] = form[kind, row, column]
            pairs[count, 0], pairs[count, 1] = i, j
            count += 1
    return forms[:count].copy(), pairs[:count].copy()


@Compiled
def room(forms: FloatArray, partners: FloatArray, enough: float, zero: float) -> FloatArray:
    """For each of (N, kinds, w, w) the least pivot beside the partner that leaves the largest.

    Where that is not above ``zero``, ``zero``; the search for a partner ends above ``enough``.
    """
    kinds, size = forms.shape[1], forms.shape[2]
    found, form, last = np.full(len(forms), zero), np.empty((size, size)), 0
    for i in range(len(forms)):
        # Neighbours in a front often suit the same partner.
        for turn in range(len(partners)):
            j = (last + turn) % len(partners)
            least = np.inf
            for kind in range(kinds):
                if _hopeless(forms[i, kind], partners[j, kind], 0, found[i]):
                    least = found[i]
                if least > found[i]:
                    _combined(forms[i, kind], partners[j, kind], 1.0, form)
                    least = min(least, _least_pivot(form, found[i]))
            if least > found[i]:
                found[i] = least
                if least > enough:
                    last = j
                    break
    return found


@Compiled
def unexceeded(forms: FloatArray, diagonals: FloatArray, equal: float, zero: float) -> BoolArray:
    """Which of (N, kinds, w, w), those of the largest trace first, no earlier one exceeds.

    Diagonals are (N, kinds w).
    """
    kept = np.ones(len(forms), np.bool_)
    form = np.empty(forms.shape[2:])
    for i in range(len(forms)):
        for j in range(i + 1, len(forms) if kept[i] else 0):
            exceeds = kept[j]
            for k in range(diagonals.shape[1]):
                if not exceeds:
                    break
                exceeds = diagonals[j, k] <= diagonals[i, k] + equal
            for kind in range(forms.shape[1]):
                if exceeds:
                    _combined(forms[i, kind], forms[j, kind], -1.0, form)
                    for row in range(len(form)):
                        form[row, row] += 4 * equal
                    exceeds = _eliminated(form, 0, zero)
            kept[j] &= not exceeds
    return kept


@Compiled
def groups(points: FloatArray, count: int) -> IntArray:
    """Labels (N,) of points (N, d) by the nearest of so many centres, each farthest from others."""
    labels, distance = np.zeros(len(points), np.int64), np.full(len(points), np.inf)
    centre = 0
    for label in range(min(count, len(points))):
        for i in range(len(points)):
            own = 0.0
            for k in range(points.shape[1]):
                own += (points[i, k] - points[centre, k]) ** 2
                if own >= distance[i]:
                    break
            if own < distance[i]:
                labels[i], distance[i] = label, own
        centre = int(distance.argmax())
    return labels
