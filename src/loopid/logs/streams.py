"""Streams of a log: values of the motors in SI units at time stamps, without bad rows."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from loopid.arrays import BoolArray, FloatArray, IntArray
from loopid.errors import LogError, LogWarning, warn
from loopid.logs.formats import NO_STAMP, Batch, numbers_in
from loopid.logs.mapping import Channel, TimeColumn
from loopid.scratch import Spool, mapped_rows, release_pages

# Fraction of the rows that may be left out before a log is refused.
MOST_BAD_ROWS = 0.1
# Shorter streams, and shorter stretches without gaps, are none.
LEAST_ROWS = 4
# Rows that a message names.
MOST_NAMED = 5


@dataclass(frozen=True)
class Dropped:
    """Samples that are left out, and why.

    Attributes
    ----------
    reason : str
        As in "leg4_stroke stands still".
    count : int
        How many samples.
    first, last : float
        Times of the first and the last of them, in s.
    """

    reason: str
    count: int
    first: float
    last: float

    @classmethod
    def at(cls, reason: str, time: FloatArray) -> Dropped:
        """Samples at times (N,)."""
        return cls(reason, len(time), float(time[0]), float(time[-1]))

    def __str__(self) -> str:
        return f"{self.reason}: {self.count} samples between {self.first:.2f} and {self.last:.2f} s"


def flagged(reasons: Sequence[str], flags: BoolArray, time: FloatArray) -> tuple[Dropped, ...]:
    """For each column of flags (N, k) that is set anywhere, what is left out at times (N,)."""
    columns = zip(reasons, flags.T, strict=True)
    return tuple(Dropped.at(reason, time[column]) for reason, column in columns if column.any())


@dataclass(frozen=True)
class Stream:
    """Values at time stamps."""

    source: str  # the file, for messages
    channels: tuple[Channel, ...]
    rows: IntArray  # (R,), row numbers in the file
    stamps: IntArray  # (R,) in ns, increasing
    values: tuple[FloatArray, ...]  # of each channel (R,), in SI units
    left_out: tuple[tuple[str, IntArray], ...] = ()  # why rows were, and their numbers

    def __len__(self) -> int:
        return len(self.rows)

    def signals(self, quantity: str) -> Iterator[tuple[str, FloatArray]]:
        """Joints whose position or force is here, and the values (R,)."""
        for channel, values in zip(self.channels, self.values, strict=True):
            release_pages()
            if channel.quantity == quantity:
                yield channel.joint, values

    def without(self, bad: BoolArray, reason: str) -> Stream:
        """The stream without some rows (R,), which a warning names.

        Raises
        ------
        LogError
            When they are too many.
        """
        if not bad.any():
            return self
        numbers, good = self.rows[bad], ~bad
        refuse_or_warn(self.source, numbers, len(self), reason)

        def left(values: FloatArray) -> FloatArray:
            return mapped_rows(lambda rows: values[rows][good[rows]], len(self))

        return replace(
            self,
            rows=self.rows[good],
            stamps=self.stamps[good],
            values=tuple(map(left, self.values)),
            left_out=(*self.left_out, (reason, numbers)),
        )

    def dropped(self, zero: int) -> tuple[Dropped, ...]:
        """What was left out, at times from a stamp on; rows without a time lie between others."""
        found = []
        for reason, numbers in self.left_out:
            ends = np.interp(numbers[[0, -1]], self.rows, (self.stamps - zero) / 1e9)
            found.append(Dropped(reason, len(numbers), *ends.tolist()))
        return tuple(found)


def make_stream(
    source: str, batches: Iterable[Batch], time: TimeColumn, channels: tuple[Channel, ...]
) -> Stream:
    """Turn cells into numbers, and leave out rows that are no samples.

    Raises
    ------
    LogError
        When there are too few rows, or too many bad ones.
    """
    names = [*(channel.column for channel in channels), time.name]
    rows, stamps, *values = (Spool() for _ in range(2 + len(channels)))
    bad: list[IntArray] = []
    garbled: list[IntArray] = []
    without_number, cut_off = np.zeros(len(names), dtype=bool), None
    for batch in batches:
        found = [c.scale * numbers_in(source, batch.cells[c.column]) + c.offset for c in channels]
        at = time.stamps(source, batch.cells)
        flags = np.stack([*map(np.isnan, found), at == NO_STAMP], axis=1)
        fine = ~flags.any(axis=1)
        columns = (batch.rows, at, *found)
        for spool, column in zip((rows, stamps, *values), columns, strict=True):
            spool.append(column[fine])
        bad.append(batch.rows[~fine])
        garbled.append(batch.garbled)
        without_number |= flags.any(axis=0)
        cut_off = batch.cut_off
    named = ", ".join(name for name, flag in zip(names, without_number, strict=True) if flag)
    reasons = (
        (f"no number in {named}", np.concatenate(bad)),
        ("another number of cells than in the header", np.concatenate(garbled)),
    )
    left_out, count = [], len(rows) + sum(len(numbers) for _, numbers in reasons)
    for reason, numbers in reasons:
        if len(numbers):
            refuse_or_warn(source, numbers, count, reason)
            left_out.append((reason, numbers))
    if cut_off is not None:
        left_out.append(("last row without an end: cut off?", np.array([cut_off])))
    if len(rows) < LEAST_ROWS:
        raise LogError(f"{source} has {len(rows)} rows of numbers: it takes at least {LEAST_ROWS}")
    signals = tuple(spool.array() for spool in values)
    return Stream(source, channels, rows.array(), stamps.array(), signals, tuple(left_out))


def refuse_or_warn(source: str, rows: IntArray, count: int, reason: str) -> None:
    """Warn of rows that are left out; refuse a log with too many of them."""
    sentence = f"{source}: {reason} in {rows_text(rows)} of {count}"
    if len(rows) > MOST_BAD_ROWS * count:
        raise LogError(f"{sentence} (at most {MOST_BAD_ROWS:.0%} may be left out)")
    warn(f"{sentence}: left out", LogWarning)


def rows_text(rows: IntArray) -> str:
    """As in "rows 3, 4, 5 and 17 more"."""
    named = ", ".join(map(str, rows[:MOST_NAMED].tolist()))
    more = f" and {len(rows) - MOST_NAMED} more" if len(rows) > MOST_NAMED else ""
    return f"row{'s' if len(rows) > 1 else ''} {named}{more}"
