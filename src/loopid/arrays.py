"""Array types, and the checks and safeguards that every room uses on them."""

from __future__ import annotations

from numbers import Real
from typing import Annotated, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from pydantic import SkipValidation

from loopid.errors import DataError

# Arguments of these types are checked by the functions that take them, which know their shapes.
FloatArray = Annotated[NDArray[np.float64], SkipValidation]
IntArray = Annotated[NDArray[np.int64], SkipValidation]
BoolArray = Annotated[NDArray[np.bool_], SkipValidation]
# What NumPy's kinds of other than real numbers are called.
KINDS = {"U": "text", "S": "bytes", "c": "complex", "M": "dates", "m": "time differences"}
# Of any number that is taken: no product of a few such numbers overflows.
LARGEST = 1e100


def frozen(array: ArrayLike, dtype: Any = np.float64) -> NDArray[Any]:
    """A read-only copy, for the fields of frozen dataclasses."""
    copy = np.array(array, dtype=dtype)
    copy.setflags(write=False)
    return copy


def finite(array: ArrayLike, name: str) -> FloatArray:
    """The array as floats, refused when it holds NaN, infinity or what is no real number.

    Numbers beyond ``LARGEST`` are refused too, whose products overflow.
    """
    values = _real(array, name)
    if not all_measurable(values):
        first = tuple(int(i) for i in np.argwhere(~(np.abs(values) <= LARGEST))[0])
        bound = f" (at most {LARGEST:g})" if np.isfinite(values[first]) else ""
        raise DataError(f"{name} must be finite{bound}, but entry {first} is {values[first]}")
    return values


def all_measurable(values: FloatArray) -> bool:
    """Whether no entry is NaN, infinite or beyond ``LARGEST``."""
    return not values.size or bool(values.max() <= LARGEST and values.min() >= -LARGEST)


def rectangular(array: ArrayLike, name: str) -> NDArray[Any]:
    """The array as it is, of whatever type, refused when its rows differ in length."""
    try:
        return np.asarray(array)
    except (TypeError, ValueError) as error:
        raise DataError(f"{name} must be an array: its rows differ in length") from error


def _real(array: ArrayLike, name: str) -> FloatArray:
    """The array as floats: NumPy would read text and dates, and drop masks and imaginary parts."""
    given = rectangular(array, name)
    if given.dtype.kind == "O":
        strange = [x for x in given.flat if not isinstance(x, Real)]
        kind = type(strange[0]).__name__ if strange else ""
    else:
        kind = "" if given.dtype.kind in "biuf" else KINDS.get(given.dtype.kind, str(given.dtype))
    if kind:
        raise DataError(f"{name} must be numbers, not {kind}")
    if np.ma.is_masked(array):
        raise DataError(f"{name} must be whole, but some of its entries are masked")
    try:
        with np.errstate(over="ignore"):
            return given.astype(np.float64, copy=False)
    except OverflowError as error:
        raise DataError(f"{name} must be finite: {error}") from error


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
