"""Streams with their own time stamps on one even grid.

The grid follows the stream of the positions, at the median rate of its stamps. A gap in any
stream ends a stretch of the grid. Between the stamps of a stream its values are interpolated
linearly: they are off by at most h²/8 times their second derivative by time, h between stamps.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from loopid.arrays import FloatArray, IntArray
from loopid.errors import LogError
from loopid.logs.interpolation import interpolated
from loopid.logs.recording import Dropped
from loopid.logs.stream import LEAST_ROWS, Stream
from loopid.order_statistics import median
from loopid.scratch import mapped_rows, row_blocks, rows_where, spooled, steps

# A step between stamps longer than so many median steps is a gap.
GAP_PERIODS = 5.0


@dataclass(frozen=True)
class Aligned:
    """Streams on one grid.

    Attributes
    ----------
    time : FloatArray
        (N,) in s from the first stamp of the first stream.
    values : tuple of FloatArray
        For each stream its values (N, k).
    stretches : IntArray
        (N,).
    dropped : tuple of Dropped
    """

    time: FloatArray
    values: tuple[FloatArray, ...]
    stretches: IntArray
    dropped: tuple[Dropped, ...]


def align(streams: Sequence[Stream]) -> Aligned:
    """Put streams on the grid of the first.

    Raises
    ------
    LogError
        When the streams do not overlap.
    """
    zero = int(streams[0].stamps[0])
    times = [_seconds(stream, zero) for stream in streams]
    spans = _common([_spans(time) for time in times])
    step = _step(times[0])
    grids = [grid for span in spans if (grid := Grid.inside(times[0], span, step)) is not None]
    if not grids:
        raise LogError(_no_overlap(streams, times))
    values = tuple(
        spooled(interpolated(at, time, stream.values) for grid in grids for at in grid.blocks())
        for stream, time in zip(streams, times, strict=True)
    )
    numbers = (
        np.full(len(at), k, dtype=np.int64) for k, grid in enumerate(grids) for at in grid.blocks()
    )
    bad_rows = [dropped for stream in streams for dropped in stream.dropped(zero)]
    return Aligned(
        time=spooled(at for grid in grids for at in grid.blocks()),
        values=values,
        stretches=spooled(numbers),
        dropped=(*bad_rows, *_left_out(times[0], grids, step)),
    )


@dataclass(frozen=True)
class Grid:
    """Even times, from a first to a last in so many steps."""

    first: float
    last: float
    steps: int

    @classmethod
    def inside(cls, time: FloatArray, span: FloatArray, step: float) -> Grid | None:
        """From the first to the last stamp inside a span; None for too few."""
        start, end = np.searchsorted(time, span[0]), np.searchsorted(time, span[1], "right")
        if end - start < LEAST_ROWS:
            return None
        first, last = float(time[start]), float(time[end - 1])
        count = max(round((last - first) / step), 1)
        return cls(first, last, count) if count + 1 >= LEAST_ROWS else None

    def blocks(self) -> Iterator[FloatArray]:
        """The times, some at a time."""
        for rows in row_blocks(self.steps + 1):
            at = np.arange(rows.start, rows.stop) * ((self.last - self.first) / self.steps)
            at += self.first
            if rows.stop > self.steps:
                at[-1] = self.last
            yield at


def _seconds(stream: Stream, zero: int) -> FloatArray:
    # Differences of whole nanoseconds are exact, however long ago the epoch.
    return mapped_rows(lambda rows: (stream.stamps[rows] - zero) / 1e9, len(stream))


def _step(time: FloatArray) -> float:
    return median(lambda rows: steps(time, rows), len(time) - 1)


def _spans(time: FloatArray) -> FloatArray:
    """First and last times (S, 2) of the parts without gaps."""
    longest = GAP_PERIODS * _step(time)
    gaps = rows_where(lambda rows: steps(time, rows) > longest, len(time) - 1)
    return np.stack([time[np.append(0, gaps + 1)], time[np.append(gaps, len(time) - 1)]], axis=1)


def _common(spans: Sequence[FloatArray]) -> FloatArray:
    """Where all streams have a span."""
    common = spans[0]
    for other in spans[1:]:
        starts = np.maximum(common[:, None, 0], other[None, :, 0]).ravel()
        ends = np.minimum(common[:, None, 1], other[None, :, 1]).ravel()
        common = np.stack([starts, ends], axis=1)[starts < ends]
    return common


def _left_out(time: FloatArray, grids: Sequence[Grid], step: float) -> tuple[Dropped, ...]:
    """Stamps before, between and after the stretches."""
    edges = [-np.inf, *(edge for grid in grids for edge in (grid.first, grid.last)), np.inf]
    dropped = []
    for k, (last, following) in enumerate(zip(edges[::2], edges[1::2], strict=True)):
        start, end = np.searchsorted(time, last, "right"), np.searchsorted(time, following)
        if 0 < k < len(grids):
            missing = max(round((following - last) / step) - 1, 1)
            ends = (float(last), float(following))
            dropped.append(Dropped("gap in the time stamps", missing, *ends))
        elif start < end:
            ends = (float(time[start]), float(time[end - 1]))
            dropped.append(Dropped("not in all streams", int(end - start), *ends))
    return tuple(dropped)


def _no_overlap(streams: Sequence[Stream], times: Sequence[FloatArray]) -> str:
    spans = ", ".join(
        f"{stream.source} from {time[0]:.3f} to {time[-1]:.3f} s"
        for stream, time in zip(streams, times, strict=True)
    )
    return (
        f"no {LEAST_ROWS} samples in a row, without a gap of more than {GAP_PERIODS:g} median "
        f"steps, are in all streams: {spans}"
    )
