"""Raw columns of some rows of a log, before anything is understood."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from decimal import Decimal
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
        if column.dtype.kind not in "iufUO":
            raise LogError(f"{self.source}: column {name!r} holds {column.dtype}, not times")
        cells = column.tolist()
        return np.array([_stamp(cell, nanoseconds) for cell in cells], dtype=np.int64)


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
