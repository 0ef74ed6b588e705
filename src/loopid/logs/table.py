"""Raw columns of some rows of a log, before anything is understood."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from decimal import Decimal
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from loopid.arrays import FloatArray, IntArray
from loopid.errors import LogError

# Larger numbers (in the file's units) are no measurements, and would overflow later.
LARGEST_NUMBER = 1e15
NO_STAMP = np.iinfo(np.int64).min
# Nanoseconds of a stamp: 1e19 would overflow, and 9e18 is the year 2255.
LARGEST_STAMP = 9 * 10**18
# Of the units of NumPy's dates and durations; coarser ones are no times of a log.
NANOSECONDS = {"s": 10**9, "ms": 10**6, "us": 10**3, "ns": 1}


@dataclass(frozen=True)
class Table:
    """Columns of text or numbers.

    Attributes
    ----------
    source : str
        The file, for messages.
    columns : mapping
        From names to arrays (R,).
    rows : IntArray
        (R,), row numbers in the file, from 1.
    garbled : IntArray
        (G,), row numbers with the wrong number of cells, which the columns leave out.
    cut_off : int or None
        Row number of a last row that was left out because its line does not end.
    """

    source: str
    columns: Mapping[str, NDArray[Any]]
    rows: IntArray
    garbled: IntArray
    cut_off: int | None = None

    @classmethod
    def of_rows(cls, source: str, columns: Mapping[str, NDArray[Any]], start: int) -> Table:
        """Whole rows, of which so many came before."""
        count = len(next(iter(columns.values())))
        numbers = np.arange(start + 1, start + count + 1)
        return cls(source, columns, numbers, np.empty(0, dtype=np.int64))

    def numbers(self, name: str) -> FloatArray:
        """A column as floats (R,), NaN for cells that are no finite number of sensible size."""
        column = self.columns[name]
        if column.dtype.kind not in "iufUO":
            raise LogError(f"{self.source}: column {name!r} holds {column.dtype}, not numbers")
        try:
            values = column.astype(np.float64)
        except ValueError:
            values = np.array([_number(cell) for cell in column])
        return np.where(np.abs(values) <= LARGEST_NUMBER, values, np.nan)

    def stamps(self, name: str, nanoseconds: int) -> IntArray:
        """A column of times as whole nanoseconds (R,), exact; ``NO_STAMP`` for other cells.

        Parameters
        ----------
        nanoseconds : int
            In one unit of the column.
        """
        column = self.columns[name]
        if column.dtype.kind in "mM":
            return _typed_stamps(column)
        if column.dtype.kind not in "iufUO":
            raise LogError(f"{self.source}: column {name!r} holds {column.dtype}, not times")
        if column.dtype.kind == "i":
            return _whole_stamps(column.astype(np.int64), nanoseconds)
        cells = column.tolist()
        return np.array([_stamp(cell, nanoseconds) for cell in cells], dtype=np.int64)


def common_length(path: Path, lengths: Mapping[str, int]) -> int:
    """How many rows columns have.

    Raises
    ------
    LogError
        When they differ, or there are none.
    """
    if not any(lengths.values()):
        raise LogError(f"{path} has no rows in {', '.join(lengths)}")
    if len(set(lengths.values())) > 1:
        short, long = (pick(lengths, key=lambda name: lengths[name]) for pick in (min, max))
        raise LogError(
            f"{path}: {short!r} has {lengths[short]} rows, but {long!r} has {lengths[long]}"
        )
    return next(iter(lengths.values()))


def _whole_stamps(cells: IntArray, nanoseconds: int) -> IntArray:
    largest = LARGEST_STAMP // nanoseconds
    valid = (cells >= -largest) & (cells <= largest)
    return np.where(valid, np.where(valid, cells, 0) * nanoseconds, NO_STAMP)


def _typed_stamps(column: NDArray[Any]) -> IntArray:
    """Dates or durations, which know their unit."""
    (unit, count), cells = np.datetime_data(column.dtype), column.view(np.int64)
    if unit not in NANOSECONDS:
        return np.full(len(column), NO_STAMP)
    return _whole_stamps(cells, count * NANOSECONDS[unit])


def _number(cell: str | float) -> float:
    try:
        return float(cell)
    except ValueError:
        return np.nan


def _stamp(cell: str | float, nanoseconds: int) -> int:
    """A time as whole nanoseconds: epoch times have more digits than a float."""
    if not abs(_number(cell)) * nanoseconds <= LARGEST_STAMP:
        return int(NO_STAMP)
    return round(Decimal(str(cell).strip()) * nanoseconds)
