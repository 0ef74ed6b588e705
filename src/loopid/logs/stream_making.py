"""From raw cells to a stream: numbers in SI units, rows that are no samples left out."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from loopid.arrays import BoolArray, IntArray
from loopid.errors import LogError
from loopid.logs.stamp_checks import check_stamps
from loopid.logs.stream import LEAST_ROWS, Channel, Stream, refuse_or_warn
from loopid.logs.table import NO_STAMP, Table
from loopid.logs.time_columns import TimeColumn
from loopid.scratch import Spool


def make_stream(tables: Iterable[Table], time: TimeColumn, channels: tuple[Channel, ...]) -> Stream:
    """Turn cells into numbers.

    Raises
    ------
    LogError
        When there are too few rows, too many bad ones, or impossible times.
    """
    good = Spool(), Spool(), Spool()
    bad = _BadRows([channel.column for channel in channels] + [time.name])
    for table in tables:
        columns = [c.scale * table.numbers(c.column) + c.offset for c in channels]
        stamps = time.stamps(table)
        fine = bad.sort_out(table, [*map(np.isnan, columns), stamps == NO_STAMP])
        for spool, column in zip(
            good, (table.rows, stamps, np.stack(columns, axis=1)), strict=True
        ):
            spool.append(column[fine])
        source = table.source
    rows, stamps, values = (spool.array() for spool in good)
    left_out = bad.left_out(source, len(rows))
    if len(rows) < LEAST_ROWS:
        raise LogError(f"{source} has {len(rows)} rows of numbers: it takes at least {LEAST_ROWS}")
    check_stamps(source, rows, stamps)
    return Stream(source, channels, rows, stamps, values, left_out)


class _BadRows:
    """Rows that are no samples, collected block by block.

    Parameters
    ----------
    names : list of str
        The columns that are looked at.
    """

    def __init__(self, names: list[str]) -> None:
        self._flagged = dict.fromkeys(names, False)
        self._numbers: list[IntArray] = []
        self._garbled: list[IntArray] = []
        self._cut_off: int | None = None

    def sort_out(self, table: Table, flags: list[BoolArray]) -> BoolArray:
        """Which rows (R,) are fine, none of the columns' flags (R,) being set."""
        for name, column in zip(self._flagged, flags, strict=True):
            self._flagged[name] |= bool(column.any())
        bad = np.any(flags, axis=0)
        self._numbers.append(table.rows[bad])
        self._garbled.append(table.garbled)
        self._cut_off = table.cut_off
        return np.asarray(~bad, dtype=bool)

    def left_out(self, source: str, good: int) -> tuple[tuple[str, IntArray], ...]:
        """Why rows were left out, and their numbers; refuse too many."""
        named = ", ".join(name for name, flagged in self._flagged.items() if flagged)
        numbers, garbled = np.concatenate(self._numbers), np.concatenate(self._garbled)
        count, found = good + len(numbers) + len(garbled), []
        for reason, rows in (
            (f"no number in {named}", numbers),
            ("another number of cells than in the header", garbled),
        ):
            if len(rows):
                refuse_or_warn(source, rows, count, reason)
                found.append((reason, rows))
        if self._cut_off is not None:
            found.append(("last row without an end: cut off?", np.array([self._cut_off])))
        return tuple(found)
