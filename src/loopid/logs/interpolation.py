"""Linear interpolation that looks only at the points around."""

from __future__ import annotations

import numpy as np

from loopid.arrays import FloatArray, IntArray


def surrounding(places: FloatArray | IntArray, points: FloatArray | IntArray) -> slice:
    """Which of ascending points (N,) lie around ascending places (M,)."""
    first = int(np.searchsorted(points, places[0], "right")) - 1
    return slice(max(first, 0), int(np.searchsorted(points, places[-1])) + 1)


def interpolated(places: FloatArray, points: FloatArray, values: FloatArray) -> FloatArray:
    """Columns (M, k) at ascending places (M,) between ascending points (N,) with values (N, k)."""
    window = surrounding(places, points)
    columns = [np.interp(places, points[window], column) for column in values[window].T]
    return np.stack(columns, axis=1)
