"""Streams with their own time stamps on one even grid.

The grid follows the stream of the positions, at the median rate of its stamps. A gap in any
stream ends a stretch of the grid. Between the stamps of a stream its values are interpolated
linearly: they are off by at most h²/8 times their second derivative by time, h between stamps.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from loopid.arrays import FloatArray, IntArray
from loopid.errors import LogError
from loopid.logs.streams import LEAST_ROWS, Dropped, Stream
from loopid.scratch import empty_columns, release_pages

# A step between stamps longer than so many median steps is a gap.
GAP_PERIODS = 5.0


class Aligned(NamedTuple):
    """Streams on one grid."""

    time: FloatArray  # (N,) in s from the first stamp of the first stream
    position: FloatArray  # (N, m), one column a motor
    force: FloatArray  # (N, m)
    stretches: IntArray  # (N,)
    dropped: tuple[Dropped, ...]


class Grid(NamedTuple):
    """Even times, from a first to a last in so many steps."""

    first: float
    last: float
    steps: int


def align(streams: Sequence[Stream], joints: tuple[str, ...]) -> Aligned:
    """Put streams on the grid of the first.

    Raises
    ------
    LogError
        When the streams do not overlap.
    """
    zero = int(streams[0].stamps[0])
    # Differences of whole nanoseconds are exact, however long ago the epoch.
    times = [(stream.stamps - zero) / 1e9 for stream in streams]
    spans = _spans(times[0])
    for time in times[1:]:
        spans = _overlaps(spans, _spans(time))
    step = float(np.median(np.diff(times[0])))
    grids = [grid for span in spans if (grid := _grid(times[0], span, step)) is not None]
    if not grids:
        raise LogError(_no_overlap(streams, times))
    time = np.concatenate([np.linspace(g.first, g.last, g.steps + 1) for g in grids])
    stretches = np.repeat(np.arange(len(grids)), [grid.steps + 1 for grid in grids])
    tables = {what: empty_columns(len(time), len(joints)) for what in ("position", "force")}
    for stream, stamps in zip(streams, times, strict=True):
        for quantity, table in tables.items():
            for joint, values in stream.signals(quantity):
                table[:, joints.index(joint)] = np.interp(time, stamps, values)
                release_pages()
    bad_rows = [dropped for stream in streams for dropped in stream.dropped(zero)]
    left_out = (*bad_rows, *_left_out(times[0], grids, step))
    return Aligned(time, tables["position"], tables["force"], stretches, left_out)


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


def _grid(time: FloatArray, span: FloatArray, step: float) -> Grid | None:
    """From the first to the last stamp inside a span; None for too few."""
    start, end = np.searchsorted(time, span[0]), np.searchsorted(time, span[1], "right")
    if end - start < LEAST_ROWS:
        return None
    first, last = float(time[start]), float(time[end - 1])
    count = max(round((last - first) / step), 1)
    return Grid(first, last, count) if count + 1 >= LEAST_ROWS else None


def _left_out(time: FloatArray, grids: Sequence[Grid], step: float) -> tuple[Dropped, ...]:
    """Stamps before, between and after the stretches."""
    edges = [-np.inf, *(edge for grid in grids for edge in (grid.first, grid.last)), np.inf]
    dropped = []
    for k, (last, following) in enumerate(zip(edges[::2], edges[1::2], strict=True)):
        start, end = np.searchsorted(time, last, "right"), np.searchsorted(time, following)
        if 0 < k < len(grids):
            missing = max(round((following - last) / step) - 1, 1)
            dropped.append(Dropped("gap in the time stamps", missing, last, following))
        elif start < end:
            dropped.append(Dropped.at("not in all streams", time[start:end]))
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
