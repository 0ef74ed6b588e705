"""One stream of a log with the motors' values in SI units, its bad rows left out."""

from __future__ import annotations

import warnings
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from loopid.arrays import FloatArray, IntArray
from loopid.errors import LogError, LogWarning
from loopid.logs.messages import rows_text
from loopid.logs.recording import Dropped
from loopid.logs.stamp_checks import check_stamps
from loopid.logs.table import NO_STAMP, Table
from loopid.logs.time_columns import TimeColumn

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

    def without(self, bad: IntArray, reason: str) -> Stream:
        """The stream without some rows (indices), which a warning names.

        Raises
        ------
        LogError
            When they are too many.
        """
        if len(bad) == 0:
            return self
        rows = self.rows[bad]
        refuse_or_warn(self.source, rows, len(self.rows), reason)
        kept = np.setdiff1d(np.arange(len(self.rows)), bad)
        return replace(
            self,
            rows=self.rows[kept],
            stamps=self.stamps[kept],
            values=self.values[kept],
            left_out=(*self.left_out, (reason, rows)),
        )

    def dropped(self, zero: int) -> tuple[Dropped, ...]:
        """What was left out, at times from a stamp on; rows without a time lie between others."""
        found = []
        for reason, rows in self.left_out:
            times = np.interp(rows, self.rows, (self.stamps - zero) / 1e9)
            found.append(Dropped(reason, len(rows), float(times[0]), float(times[-1])))
        return tuple(found)


def refuse_or_warn(source: str, rows: IntArray, count: int, reason: str) -> None:
    """Warn of rows that are left out; refuse a log with too many of them."""
    sentence = f"{source}: {reason} in {rows_text(rows)} of {count}"
    if len(rows) > MOST_BAD_ROWS * count:
        raise LogError(f"{sentence} (at most {MOST_BAD_ROWS:.0%} may be left out)")
    warnings.warn(f"{sentence}: left out", LogWarning, stacklevel=2)


def make_stream(table: Table, time: TimeColumn, channels: tuple[Channel, ...]) -> Stream:
    """Turn cells into numbers.

    Raises
    ------
    LogError
        When there are too few rows, too many bad ones, or impossible times.
    """
    columns = [c.scale * table.numbers(c.column) + c.offset for c in channels]
    values, stamps = np.stack(columns, axis=1), time.stamps(table)
    flags = {c.column: np.isnan(x) for c, x in zip(channels, columns, strict=True)}
    flags[time.name] = stamps == NO_STAMP
    bad = np.any(list(flags.values()), axis=0)
    count = len(table.rows) + len(table.garbled)
    left_out = []
    for reason, rows in (
        (f"no number in {', '.join(n for n, f in flags.items() if f.any())}", table.rows[bad]),
        ("another number of cells than in the header", table.garbled),
    ):
        if len(rows):
            refuse_or_warn(table.source, rows, count, reason)
            left_out.append((reason, rows))
    if table.cut_off is not None:
        left_out.append(("last row without an end: cut off?", np.array([table.cut_off])))
    if (~bad).sum() < LEAST_ROWS:
        raise LogError(
            f"{table.source} has {(~bad).sum()} rows of numbers: it takes at least {LEAST_ROWS}"
        )
    rows, stamps = table.rows[~bad], stamps[~bad]
    check_stamps(table.source, rows, stamps)
    return Stream(table.source, channels, rows, stamps, values[~bad], tuple(left_out))
