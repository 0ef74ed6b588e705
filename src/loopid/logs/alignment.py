"""Streams with their own time stamps on one even grid.

The grid follows the stream of the positions, at the median rate of its stamps. A gap in any
stream ends a stretch of the grid. Between the stamps of a stream its values are interpolated
linearly: they are off by at most h²/8 times their second derivative by time, h between stamps.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from loopid.arrays import FloatArray, IntArray
from loopid.errors import LogError
from loopid.logs.recording import Dropped
from loopid.logs.stream import LEAST_ROWS, Stream

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
    # Differences of whole nanoseconds are exact, however long ago the epoch.
    times = [(stream.stamps - zero) / 1e9 for stream in streams]
    spans = _common([_spans(time) for time in times])
    grids = [_grid(times[0], span) for span in spans]
    grids = [grid for grid in grids if len(grid) >= LEAST_ROWS]
    if not grids:
        raise LogError(_no_overlap(streams, times))
    time = np.concatenate(grids)
    values = tuple(
        np.stack([np.interp(time, t, column) for column in stream.values.T], axis=1)
        for stream, t in zip(streams, times, strict=True)
    )
    stretches = np.repeat(np.arange(len(grids)), [len(grid) for grid in grids])
    bad_rows = [dropped for stream in streams for dropped in stream.dropped(zero)]
    return Aligned(time, values, stretches, (*bad_rows, *_left_out(times[0], grids)))


def _step(time: FloatArray) -> float:
    return float(np.median(np.diff(time)))


def _spans(time: FloatArray) -> FloatArray:
    """First and last times (S, 2) of the parts without gaps."""
    gaps = np.flatnonzero(np.diff(time) > GAP_PERIODS * _step(time))
    return np.stack([time[np.append(0, gaps + 1)], time[np.append(gaps, len(time) - 1)]], axis=1)


def _common(spans: Sequence[FloatArray]) -> FloatArray:
    """Where all streams have a span."""
    common = spans[0]
    for other in spans[1:]:
        starts = np.maximum(common[:, None, 0], other[None, :, 0]).ravel()
        ends = np.minimum(common[:, None, 1], other[None, :, 1]).ravel()
        common = np.stack([starts, ends], axis=1)[starts < ends]
    return common


def _grid(time: FloatArray, span: FloatArray) -> FloatArray:
    """Even times from the first to the last stamp inside a span, at about the median rate."""
    inside = time[(time >= span[0]) & (time <= span[1])]
    if len(inside) < LEAST_ROWS:
        return np.empty(0)
    steps = max(round((inside[-1] - inside[0]) / _step(time)), 1)
    return np.asarray(np.linspace(inside[0], inside[-1], steps + 1), dtype=np.float64)


def _left_out(time: FloatArray, grids: Sequence[FloatArray]) -> tuple[Dropped, ...]:
    """Stamps before, between and after the stretches."""
    step = _step(time)
    edges = [-np.inf, *(edge for grid in grids for edge in (grid[0], grid[-1])), np.inf]
    dropped = []
    for k, (last, following) in enumerate(zip(edges[::2], edges[1::2], strict=True)):
        inside = time[(time > last) & (time < following)]
        if 0 < k < len(grids):
            missing = max(round((following - last) / step) - 1, 1)
            ends = (float(last), float(following))
            dropped.append(Dropped("gap in the time stamps", missing, *ends))
        elif len(inside):
            ends = (float(inside[0]), float(inside[-1]))
            dropped.append(Dropped("not in all streams", len(inside), *ends))
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
