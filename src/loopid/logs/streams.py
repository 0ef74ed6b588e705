"""Streams of a log: values of the motors in SI units at time stamps, put on one even grid.

The grid follows the stream of the positions, at the median rate of its stamps. A gap in any
stream ends a stretch of the grid. Between the stamps of a stream its values are interpolated
linearly: they are off by at most h²/8 times their second derivative by time, h between stamps.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from loopid.arrays import BoolArray, FloatArray, IntArray
from loopid.errors import LogError, LogWarning, warn
from loopid.logs.formats import NO_STAMP, Batch, numbers_in
from loopid.logs.mapping import Channel, TimeColumn
from loopid.scratch import Spool, empty_columns, mapped_rows, release_pages

# Fraction of the rows that may be left out before a log is refused.
MOST_BAD_ROWS = 0.1
# Shorter streams, and shorter stretches without gaps, are none.
LEAST_ROWS = 4
# Rows that a message names.
MOST_NAMED = 5
# A step between stamps longer than so many median steps is a gap.
GAP_PERIODS = 5.0


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


@dataclass(frozen=True)
class Stream:
    """Values at time stamps."""

    source: str  # the file, for messages
    channels: tuple[Channel, ...]
    rows: IntArray  # (R,), row numbers in the file
    stamps: IntArray  # (R,) in ns, increasing
    values: tuple[FloatArray, ...]  # of each channel (R,), in SI units
    left_out: tuple[tuple[str, IntArray], ...] = ()  # why rows were, and their numbers

    def signals(self, quantity: str) -> Iterator[tuple[str, FloatArray]]:
        """Joints whose position or force is here, and the values (R,)."""
        for channel, values in zip(self.channels, self.values, strict=True):
            release_pages()
            if channel.quantity == quantity:
                yield channel.joint, values

    def without(self, bad: BoolArray, reason: str) -> Stream:
        """The stream without some rows (R,), which a warning names; a LogError for too many."""
        if not bad.any():
            return self
        numbers, good, count = self.rows[bad], ~bad, len(self.rows)
        refuse_or_warn(self.source, numbers, count, reason)

        def left(values: FloatArray) -> FloatArray:
            return mapped_rows(lambda rows: values[rows][good[rows]], count)

        return replace(
            self,
            rows=self.rows[good],
            stamps=self.stamps[good],
            values=tuple(map(left, self.values)),
            left_out=(*self.left_out, (reason, numbers)),
        )


def make_stream(
    source: str, batches: Iterable[Batch], time: TimeColumn, channels: tuple[Channel, ...]
) -> Stream:
    """Turn cells into numbers, and leave out rows that are no samples; too many are refused."""
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
        for spool, column in zip((rows, stamps, *values), (batch.rows, at, *found), strict=True):
            spool.append(column[fine])
        bad.append(batch.rows[~fine])
        garbled.append(batch.garbled)
        without_number |= flags.any(axis=0)
        cut_off = batch.cut_off
    named = ", ".join(name for name, flag in zip(names, without_number, strict=True) if flag)
    reasons = {
        f"no number in {named}": np.concatenate(bad),
        "another number of cells than in the header": np.concatenate(garbled),
    }
    count = len(rows) + sum(map(len, reasons.values()))
    left_out = [(reason, numbers) for reason, numbers in reasons.items() if len(numbers)]
    for reason, numbers in left_out:
        refuse_or_warn(source, numbers, count, reason)
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


# ---- one grid ---------------------------------------------------------------------------------


class Aligned(NamedTuple):
    """Streams on one grid."""

    time: FloatArray  # (N,) in s from the first stamp of the first stream
    position: FloatArray  # (N, m), one column a motor
    force: FloatArray  # (N, m)
    stretches: IntArray  # (N,)
    dropped: tuple[Dropped, ...]


def align(streams: Sequence[Stream], joints: tuple[str, ...]) -> Aligned:
    """Put streams on the grid of the first; a LogError when they do not overlap."""
    zero = int(streams[0].stamps[0])
    # Differences of whole nanoseconds are exact, however long ago the epoch.
    times = [(stream.stamps - zero) / 1e9 for stream in streams]
    spans = _spans(times[0])
    for other in times[1:]:
        spans = _overlaps(spans, _spans(other))
    step = float(np.median(np.diff(times[0])))
    grids = []
    for span in spans:  # evenly from its first to its last stamp
        inside = times[0][np.searchsorted(times[0], span[0]) :]
        inside = inside[: np.searchsorted(inside, span[1], "right")]
        count = round((inside[-1] - inside[0]) / step) + 1 if len(inside) >= LEAST_ROWS else 0
        if count >= LEAST_ROWS:
            grids.append(np.linspace(inside[0], inside[-1], count))
    if not grids:
        listed = ", ".join(
            f"{stream.source} from {stamps[0]:.3f} to {stamps[-1]:.3f} s"
            for stream, stamps in zip(streams, times, strict=True)
        )
        raise LogError(
            f"no {LEAST_ROWS} samples in a row, without a gap of more than {GAP_PERIODS:g} median "
            f"steps, are in all streams: {listed}"
        )
    time = np.concatenate(grids)
    stretches = np.repeat(np.arange(len(grids)), [len(grid) for grid in grids])
    tables = {what: empty_columns(len(time), len(joints)) for what in ("position", "force")}
    for stream, stamps in zip(streams, times, strict=True):
        for quantity, table in tables.items():
            for joint, values in stream.signals(quantity):
                table[:, joints.index(joint)] = np.interp(time, stamps, values)
    dropped = []
    for stream, stamps in zip(streams, times, strict=True):
        for reason, numbers in stream.left_out:  # rows without a time lie between others
            ends = np.interp(numbers[[0, -1]], stream.rows, stamps)
            dropped.append(Dropped(reason, len(numbers), *ends.tolist()))
    dropped += _outside(times[0], grids, step)
    return Aligned(time, tables["position"], tables["force"], stretches, tuple(dropped))


def _spans(time: FloatArray) -> FloatArray:
    """First and last times (S, 2) of the parts without gaps."""
    steps = np.diff(time)
    gaps = np.flatnonzero(steps > GAP_PERIODS * np.median(steps))
    return np.stack([time[np.append(0, gaps + 1)], time[np.append(gaps, len(time) - 1)]], axis=1)


def _overlaps(spans: FloatArray, others: FloatArray) -> FloatArray:
    """Where both have a span (S, 2); each ascending and disjoint."""
    first = np.searchsorted(others[:, 1], spans[:, 0], "right")
    last = np.searchsorted(others[:, 0], spans[:, 1])
    found = [
        (max(span[0], other[0]), min(span[1], other[1]))
        for span, a, b in zip(spans, first, last, strict=True)
        for other in others[a:b]
    ]
    return np.array(found).reshape(-1, 2)


def _outside(time: FloatArray, grids: Sequence[FloatArray], step: float) -> Iterator[Dropped]:
    """Stamps before, between and after the stretches."""
    edges = [-np.inf, *(float(edge) for grid in grids for edge in grid[[0, -1]]), np.inf]
    for k, (last, following) in enumerate(zip(edges[::2], edges[1::2], strict=True)):
        start, end = np.searchsorted(time, last, "right"), np.searchsorted(time, following)
        if 0 < k < len(grids):
            missing = max(round((following - last) / step) - 1, 1)
            yield Dropped("gap in the time stamps", missing, last, following)
        elif start < end:
            yield Dropped.at("not in all streams", time[start:end])
