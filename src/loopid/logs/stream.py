"""One stream of a log with the motors' values in SI units, its bad rows left out."""

from __future__ import annotations

import warnings
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from loopid.arrays import BoolArray, FloatArray, IntArray
from loopid.errors import LogError, LogWarning
from loopid.logs.interpolation import surrounding
from loopid.logs.messages import rows_text
from loopid.logs.recording import Dropped
from loopid.scratch import mapped_rows

# Fraction of the rows that may be left out before a log is refused.
MOST_BAD_ROWS = 0.1
# Shorter streams, and shorter stretches without gaps, are none.
LEAST_ROWS = 4


class Channel(NamedTuple):
    """What a column holds: value = scale * number + offset, in SI units."""

    quantity: str  # "position" or "force"
    joint: str
    column: str
    scale: float
    offset: float


@dataclass(frozen=True)
class Stream:
    """Values at time stamps.

    Attributes
    ----------
    source : str
        The file, for messages.
    channels : tuple of Channel
    rows : IntArray
        (R,), row numbers in the file.
    stamps : IntArray
        (R,) in ns, increasing.
    values : FloatArray
        (R, k) in SI units, one column a channel.
    left_out : tuple of (str, IntArray)
        Why rows were left out, and their numbers.
    """

    source: str
    channels: tuple[Channel, ...]
    rows: IntArray
    stamps: IntArray
    values: FloatArray
    left_out: tuple[tuple[str, IntArray], ...] = ()

    def __len__(self) -> int:
        return len(self.rows)

    def without(self, bad: IntArray, reason: str) -> Stream:
        """The stream without some rows (ascending indices), which a warning names.

        Raises
        ------
        LogError
            When they are too many.
        """
        if len(bad) == 0:
            return self
        numbers = self.rows[bad]
        refuse_or_warn(self.source, numbers, len(self), reason)

        def left(column: NDArray[Any]) -> NDArray[Any]:
            return mapped_rows(lambda rows: column[rows][~_among(bad, rows)], len(self))

        return replace(
            self,
            rows=left(self.rows),
            stamps=left(self.stamps),
            values=left(self.values),
            left_out=(*self.left_out, (reason, numbers)),
        )

    def dropped(self, zero: int) -> tuple[Dropped, ...]:
        """What was left out, at times from a stamp on; rows without a time lie between others."""
        found = []
        for reason, numbers in self.left_out:
            ends = np.array([numbers[0], numbers[-1]], dtype=np.int64)
            window = surrounding(ends, self.rows)
            stamps = (self.stamps[window] - zero) / 1e9
            times = np.interp(ends, self.rows[window], stamps)
            found.append(Dropped(reason, len(numbers), float(times[0]), float(times[1])))
        return tuple(found)


def _among(numbers: IntArray, rows: slice) -> BoolArray:
    """Which of a block of rows are among ascending numbers."""
    first, last = np.searchsorted(numbers, [rows.start, rows.stop])
    flags = np.zeros(rows.stop - rows.start, dtype=bool)
    flags[numbers[first:last] - rows.start] = True
    return flags


def refuse_or_warn(source: str, rows: IntArray, count: int, reason: str) -> None:
    """Warn of rows that are left out; refuse a log with too many of them."""
    sentence = f"{source}: {reason} in {rows_text(rows)} of {count}"
    if len(rows) > MOST_BAD_ROWS * count:
        raise LogError(f"{sentence} (at most {MOST_BAD_ROWS:.0%} may be left out)")
    warnings.warn(f"{sentence}: left out", LogWarning, stacklevel=2)
