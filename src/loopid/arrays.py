"""Array types, and the checks and safeguards that every room uses on them."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from loopid.errors import DataError

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]
BoolArray = NDArray[np.bool_]


def frozen(array: ArrayLike, dtype: Any = np.float64) -> NDArray[Any]:
    """A read-only copy, for the fields of frozen dataclasses."""
    copy = np.array(array, dtype=dtype)
    copy.setflags(write=False)
    return copy


def finite(array: ArrayLike, name: str) -> FloatArray:
    """The array as floats, refused when it holds NaN or infinity."""
    try:
        values = np.asarray(array, dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise DataError(f"{name} must be numbers: {error}") from error
    if not np.isfinite(values).all():
        first = tuple(int(i) for i in np.argwhere(~np.isfinite(values))[0])
        raise DataError(f"{name} must be finite, but entry {first} is {values[first]}")
    return values


def spread_rows(count: int, most: int) -> IntArray:
    """Evenly spread numbers of at most so many of the rows, the first and the last among them."""
    rows = np.linspace(0, count - 1, min(count, most)).round().astype(np.int64)
    return np.asarray(np.unique(rows), dtype=np.int64)


def samples(array: ArrayLike, width: int, name: str, count: int | None = None) -> FloatArray:
    """The array as finite rows of a given width; one row may come without its axis.

    Parameters
    ----------
    count : int, optional
        Number of rows that there must be.

    Returns
    -------
    FloatArray
        Shape (N, width).
    """
    values = np.atleast_2d(finite(array, name))
    if values.ndim != 2 or values.shape[1] != width:
        raise DataError(f"{name} must have shape (samples, {width}), not {np.shape(array)}")
    if count is not None and len(values) != count:
        raise DataError(f"{name} must have {count} rows, one a sample, not {len(values)}")
    return values
