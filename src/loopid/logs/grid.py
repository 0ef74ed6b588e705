"""Streams of a log, values at time stamps, and all of them on one even grid.

The grid follows the stream of the positions at the median rate of its stamps. A gap in any stream
ends a segment of the grid. Between the stamps of a stream its values are interpolated linearly.
They are off by at most h²/8 times their second derivative by time, h between stamps.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from types import MappingProxyType
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from loopid.arguments import BoolArray, FloatArray, IntArray, finite, samples
from loopid.errors import DataError, DataWarning, LogError, counted, first_of, warn
from loopid.logs.signals import POSE, Channel, TimeColumn
from loopid.logs.table import NO_STAMP, POSE_PERIOD, QUANTITIES, Table, numbers_in
from loopid.numbers import ROUND_OFF
from loopid.records import record

if TYPE_CHECKING:
    from loopid.logs.mapping import JointMap

BAD_ROWS = 0.1  # part of the rows that may be left out
# Part of the rows that may have the time stamp of the row before and other values: loggers that are
# late do so in one row of a hundred; a clock that is too coarse in most.
REPEATED_STAMPS = 0.02
GAP = 5.0  # median steps: a longer one between time stamps is a gap
LEAST_ROWS = 4  # of a stream, and of a segment without gaps: shorter ones are none
# Part of a step by which samples may be off an even grid, and are taken as they are.
EVEN = 0.01
APART = 0.5  # median steps by which samples of one source are apart, none of which is doubled
MOST_NAMED = 5  # rows in a message
UNIT = 0.1  # by which the length of a measured quaternion may be off one


@record
class Dropped:
    """Samples that are left out, and why."""

    reason: str  # as in "leg4_stroke stands still"
    count: int
    first: float  # times of the first and the last of them, in s
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
    values: FloatArray  # (R, channels) in SI units
    left_out: tuple[tuple[str, IntArray], ...] = ()  # why rows were, and their numbers

    def places(self, quantity: str) -> list[int]:
        """Columns of a quantity."""
        return [k for k, channel in enumerate(self.channels) if channel.quantity == quantity]

    def signals(self, quantity: str) -> Iterator[tuple[str, FloatArray]]:
        """Joints of which a quantity is here, and the values (R,)."""
        return ((self.channels[k].joint, self.values[:, k]) for k in self.places(quantity))

    def refused(self, said: str, **facts: object) -> LogError:
        """An error that names the stream."""
        return LogError(f"{self.source}: {said}", source=self.source, **facts)

    def earlier(self, delay: float) -> Stream:
        """The stream with stamps that are this many s too late put right."""
        return replace(self, stamps=self.stamps - round(1e9 * delay)) if delay else self

    def without(self, bad: BoolArray, reason: str, most: float = BAD_ROWS) -> Stream:
        """The stream without some rows (R,), which a warning names; a LogError for too many."""
        if not bad.any():
            return self
        numbers, good = self.rows[bad], ~bad
        refuse_or_warn(self.source, numbers, len(self.rows), reason, most)
        return replace(
            self,
            rows=self.rows[good],
            stamps=self.stamps[good],
            values=self.values[good],
            left_out=(*self.left_out, (reason, numbers)),
        )


def make_streams(
    source: str, table: Table, time: TimeColumn, channels: tuple[Channel, ...]
) -> list[Stream]:
    """The stream of a table, or those of several rates, each with cells in rows of its own.

    There columns that are empty in the same rows lack no sample: their other rows are even.
    """
    columns = [c.scale * numbers_in(source, table.cells[c.column]) + c.offset for c in channels]
    values, stamps = np.stack(columns, axis=1), time.stamps(source, table.cells, table.rows)
    whole, empty = Stream(source, channels, table.rows, stamps, values), np.isnan(values)
    groups: dict[bytes, list[int]] = {}
    for k, own in enumerate(empty.T):
        groups.setdefault(own.tobytes(), []).append(k)
    stamped, firsts = stamps != NO_STAMP, [own[0] for own in groups.values()]
    if not (
        empty.any(axis=1).mean() > BAD_ROWS
        and all(_lacks_none(stamps[stamped & ~empty[:, k]]) for k in firsts)
    ):
        return [_of_samples(whole, table, time)]
    said = (f"{channels[k].column} in {(~empty[:, k]).sum()}" for k in firsts)
    warn(
        f"{source}: columns have samples in rows of their own, of {len(stamps)} "
        f"{', '.join(said)}: each is read at its own rate",
        DataWarning,
    )
    found = []
    for own in groups.values():
        filled = ~empty[:, own[0]]
        parts = table.rows[filled], stamps[filled], values[filled][:, own]
        part = Stream(source, tuple(channels[k] for k in own), *parts)
        found.append(_of_samples(part, table, time))
        table = Table(table.cells, table.rows)  # rows that are garbled or cut off are said once
    return found


def _lacks_none(stamps: IntArray) -> bool:
    """Whether samples at stamps (R,) follow one another evenly, so that few are missing."""
    steps = np.diff(stamps)
    return len(steps) >= LEAST_ROWS and bool(steps.mean() <= (1 + BAD_ROWS) * np.median(steps))


def _of_samples(stream: Stream, table: Table, time: TimeColumn) -> Stream:
    """The stream without rows that are no samples, as of its table; too many are refused."""
    source, rows = stream.source, stream.rows
    lacks = np.column_stack([np.isnan(stream.values), stream.stamps == NO_STAMP])
    fine = ~lacks.any(axis=1)
    names = np.array([*(one.column for one in stream.channels), time.name or "no column"])
    reasons = {
        f"no number in {', '.join(names[lacks.any(axis=0)])}": rows[~fine],
        "another number of cells than there are columns": table.garbled,
    }
    left_out = [(reason, bad) for reason, bad in reasons.items() if len(bad)]
    for reason, bad in left_out:
        refuse_or_warn(source, bad, len(rows) + len(table.garbled), reason)
    if table.cut_off is not None:
        left_out.append(("last row without an end: cut off?", np.array([table.cut_off])))
    if fine.sum() < LEAST_ROWS:
        few = counted(int(fine.sum()), "row")
        raise LogError(f"{source} has {few} of numbers: it takes at least {LEAST_ROWS}")
    kept = rows[fine], stream.stamps[fine], stream.values[fine]
    return with_increasing_stamps(Stream(source, stream.channels, *kept, tuple(left_out)))


def stream_of(
    name: str,
    joints: tuple[str, ...],
    time: FloatArray,
    signals: Mapping[str, FloatArray],
    slides: Mapping[str, bool] = MappingProxyType({}),
) -> Stream:
    """Signals (N, k) by their quantities, in SI units, at times (N,) in s."""
    channels = tuple(
        Channel(what, one, f"{one}.{what}", 1.0, 0.0, slides.get(f"{one}.{what}"))
        for what, values in signals.items()
        for one in (joints if what in QUANTITIES else map(str, range(values.shape[1])))
    )
    stamps = np.round((time - time[0]) * 1e9).astype(np.int64)
    rows, values = np.arange(1, len(time) + 1), np.concatenate([*signals.values()], axis=1)
    return Stream(name, channels, rows, stamps, values)


def with_increasing_stamps(stream: Stream) -> Stream:
    """The stream without rows that repeat a time stamp; a LogError where the time goes back.

    A row that comes a little late, as packets of a network do, is put where its time is.
    """
    if (stream.stamps[1:] > stream.stamps[:-1]).all():
        return stream
    stream = _in_order(stream)
    same = np.append(False, np.diff(stream.stamps) == 0)
    same[1:] &= (stream.values[1:] == stream.values[:-1]).all(axis=1)
    stream = stream.without(same, "the same time and values as in the row before", 1.0)
    again = np.append(False, np.diff(stream.stamps) == 0)
    span = (stream.stamps[-1] - stream.stamps[0]) / 1e9
    if again.mean() > REPEATED_STAMPS and span > 0:
        rate = float(np.ptp(stream.rows)) / span
        raise stream.refused(
            f"time stands still, with other values, in {rows_text(stream.rows[again])} of "
            f"{len(again)} (at most {REPEATED_STAMPS:.0%} may be left out): if rows are even and "
            f"the clock is coarse, give rate: {rate:.6g} in a mapping, or such times in Python",
            tolerance=REPEATED_STAMPS,
            rate=rate,
        )
    stream = stream.without(again, "time stands still, with other values,", REPEATED_STAMPS)
    wrong = np.flatnonzero(np.diff(stream.stamps) <= 0) + 1
    if len(wrong):
        raise stream.refused(
            f"time must increase from row to row, but goes back {counted(len(wrong), 'time')}, in "
            f"{rows_text(stream.rows[wrong])}: sort its rows by time, or give parts that were "
            "recorded one after the other as logs of their own"
        )
    return stream


def _in_order(stream: Stream) -> Stream:
    """The stream with few late rows where their times are, if there is just their place."""
    order = np.argsort(stream.stamps, kind="stable")
    stamps, late = stream.stamps[order], np.maximum.accumulate(stream.stamps) - stream.stamps
    step = float(np.median(np.diff(stamps)))
    gone = np.append(False, np.diff(order) != 1)  # from their neighbours
    beside = np.diff(stamps)[gone[1:]]
    fitting = beside.size and beside.min() >= APART * step
    if not (fitting and late.max() <= GAP * step and (late > 0).mean() <= BAD_ROWS):
        return stream
    warn(
        f"{stream.source}: {rows_text(stream.rows[late > 0])} of {len(late)} came late, by up to "
        f"{late.max() / 1e6:.3g} ms: rows are sorted by time",
        DataWarning,
    )
    return replace(stream, rows=stream.rows[order], stamps=stamps, values=stream.values[order])


def static_poses(streams: Sequence[Stream]) -> Stream:
    """The stream of poses, evenly stamped, so that none is made between others."""
    stream, *others = streams
    if others:
        raise LogError(
            f"poses at rest must stand in one table, but are in {stream.source} and "
            f"{others[0].source}: join these"
        )
    steps = np.arange(len(stream.rows), dtype=np.int64)
    return replace(stream, stamps=round(1e9 * POSE_PERIOD) * steps)


def on_joints(stream: Stream, maps: Sequence[JointMap]) -> Stream:
    """The stream of joints that motors move together, from that of these motors."""
    channels, values = list(stream.channels), stream.values.copy()
    for one in maps:
        matrix = np.array(one.matrix)
        for quantity in QUANTITIES:
            factors = np.linalg.inv(matrix).T if quantity == "force" else matrix
            places = {stream.channels[k].joint: k for k in stream.places(quantity)}
            here = [places[motor] for motor in one.motors if motor in places]
            if not here:
                continue
            if len(here) < len(one.motors):
                raise LogError(
                    f"{stream.source} does not have the {quantity} of all motors that move "
                    f"{', '.join(one.joints)}: they must have the same time stamps"
                )
            values[:, here] = stream.values[:, here] @ factors.T
            for place, joint in zip(here, one.joints, strict=True):
                channels[place] = channels[place]._replace(joint=joint, straight=None)
    return replace(stream, channels=tuple(channels), values=values)


def refuse_or_warn(
    source: str, rows: IntArray, count: int, reason: str, most: float = BAD_ROWS
) -> None:
    """Warn of rows that are left out; refuse a log with more than a part of them."""
    sentence = f"{source}: {reason} in {rows_text(rows)} of {count}"
    if len(rows) > most * count:
        raise LogError(f"{sentence} (at most {most:.0%} may be left out)", tolerance=most)
    warn(f"{sentence}: left out", DataWarning)


def rows_text(rows: IntArray) -> str:
    """As in "rows 3, 4, 5 and 17 more"."""
    named = first_of([*map(str, rows.tolist())], MOST_NAMED)
    return f"row{'s' if len(rows) > 1 else ''} {named}"


# ---- one grid ---------------------------------------------------------------------------------


class Aligned(NamedTuple):
    """Streams on one grid."""

    time: FloatArray  # (N,) in s from the first stamp of the first stream
    signals: dict[str, FloatArray]  # by quantity (N, m), one column a motor, or a component
    segments: IntArray  # (N,)
    dropped: tuple[Dropped, ...]


def align(streams: Sequence[Stream], joints: tuple[str, ...]) -> Aligned:
    """Put streams on the grid of the first; a LogError when they do not overlap.

    A step of more than ``GAP`` median steps starts a new segment.
    """
    zero = int(streams[0].stamps[0])
    # Differences of whole nanoseconds are exact, however long ago the epoch.
    times = [(stream.stamps - zero) / 1e9 for stream in streams]
    step = float(np.median(np.diff(times[0])))
    parts = np.stack([_parts(times[0], own) for own in times])
    cuts = np.flatnonzero((np.diff(parts, axis=1) != 0).any(axis=0)) + 1
    every, least = np.arange(len(times[0])), parts.min(axis=0)
    runs = [times[0][run] for run in np.split(every, cuts) if least[run[0]] >= 0]
    grids = [_grid(run, step) for run in runs if len(run) >= LEAST_ROWS]
    grids = [grid for grid in grids if len(grid) >= LEAST_ROWS]
    if not grids:
        listed = ", ".join(
            f"{stream.source} from {stamps[0]:.3f} to {stamps[-1]:.3f} s"
            for stream, stamps in zip(streams, times, strict=True)
        )
        raise LogError(
            f"no {LEAST_ROWS} samples in a row, without a gap of more than {GAP:g} median "
            f"steps, are in all streams: {listed}",
            tolerance=GAP,
        )
    time = np.concatenate(grids)
    segments = np.repeat(np.arange(len(grids)), [len(grid) for grid in grids])
    columns: dict[str, tuple[str, ...]] = {}
    for channel in (channel for stream in streams for channel in stream.channels):
        name, own = channel.quantity, columns.get(channel.quantity, ())
        columns[name] = joints if name in QUANTITIES else (*own, channel.joint)
    tables = {name: np.empty((len(time), len(own))) for name, own in columns.items()}
    dropped = []
    for stream, stamps in zip(streams, times, strict=True):
        for channel, values in zip(stream.channels, stream.values.T, strict=True):
            place = columns[channel.quantity].index(channel.joint)
            tables[channel.quantity][:, place] = np.interp(time, stamps, values)
        for reason, numbers in stream.left_out:  # rows without a time lie between others
            ends = np.interp(numbers[[0, -1]], np.sort(stream.rows), stamps)
            dropped.append(Dropped(reason, len(numbers), *ends.tolist()))
    dropped += _outside(times[0], grids, step)
    return Aligned(time, tables, segments, tuple(dropped))


def _parts(time: FloatArray, stamps: FloatArray) -> IntArray:
    """In which part without gaps of a stream times (N,) are; -1 outside of all."""
    steps = np.diff(stamps)
    gaps = np.flatnonzero(steps > GAP * np.median(steps))
    part = np.searchsorted(stamps[np.append(0, gaps + 1)], time, "right") - 1
    return np.where(time <= stamps[np.append(gaps, len(stamps) - 1)][part], part, -1)


def _grid(time: FloatArray, step: float) -> FloatArray:
    """Even times from the first stamp to the last.

    Of an even log each is a stamp, to the bit, lest values that are held seem to change.
    """
    grid = np.linspace(time[0], time[-1], round((time[-1] - time[0]) / step) + 1)
    whole = np.round(1e9 * grid) / 1e9  # ns, as stamps are
    return np.where(np.abs(grid - whole) <= ROUND_OFF * whole[-1], whole, grid)


def _outside(time: FloatArray, grids: Sequence[FloatArray], step: float) -> Iterable[Dropped]:
    """Stamps before, between and after the segments."""
    edges = [-np.inf, *(float(edge) for grid in grids for edge in grid[[0, -1]]), np.inf]
    for k, (last, following) in enumerate(zip(edges[::2], edges[1::2], strict=True)):
        start, end = np.searchsorted(time, last, "right"), np.searchsorted(time, following)
        if 0 < k < len(grids):
            missing = max(round((following - last) / step) - 1, 1)
            yield Dropped("gap in the time stamps", missing, last, following)
        elif start < end:
            yield Dropped.at("not in all streams", time[start:end])


def off_grid(time: FloatArray) -> float:
    """How far times are off an even grid, in s."""
    return float(np.abs(time - np.linspace(time[0], time[-1], len(time))).max())


def on_even_grids(
    name: str,
    joints: tuple[str, ...],
    time: FloatArray,
    signals: dict[str, FloatArray],
    segments: IntArray,
) -> Aligned:
    """Times and signals of each segment (N,), in which there may be more gaps, on an even grid."""
    ends = [0, *(np.flatnonzero(np.diff(segments)) + 1).tolist(), len(time)]
    found, short = [], list[Dropped]()
    for a, b in pairwise(ends):
        if b - a < LEAST_ROWS:
            short.append(Dropped.at("segment too short", time[a:b]))
        else:
            own = {one: signals[one][a:b] for one in signals}
            found.append(_on_even_grid(name, joints, time[a:b], own))
    if not found:
        raise LogError(f"{name}: no segment has {LEAST_ROWS} samples")
    first = np.cumsum([0, *(each.segments[-1] + 1 for each in found)])
    return Aligned(
        np.concatenate([each.time for each in found]),
        {one: np.concatenate([each.signals[one] for each in found]) for one in signals},
        np.concatenate([each.segments + k for each, k in zip(found, first, strict=False)]),
        (*short, *(one for each in found for one in each.dropped)),
    )


def _on_even_grid(
    name: str, joints: tuple[str, ...], time: FloatArray, signals: dict[str, FloatArray]
) -> Aligned:
    """The same of one segment: as they are where the steps are even between gaps."""
    steps = np.diff(time)
    median = float(np.median(steps))
    segments = np.cumsum(np.append(False, steps > GAP * median))
    parts = np.split(time, np.flatnonzero(np.diff(segments)) + 1)
    if max(map(off_grid, parts)) <= EVEN * median and (steps > 0).all():
        return Aligned(time, signals, segments, ())
    stream = with_increasing_stamps(stream_of(name, joints, time, signals))
    aligned, start = align([stream], joints), float(time[0])
    dropped = (replace(d, first=start + d.first, last=start + d.last) for d in aligned.dropped)
    return aligned._replace(time=aligned.time + start, dropped=tuple(dropped))


# ---- poses --------------------------------------------------------------------------------------


def free_values(joint: str, values: ArrayLike, count: int) -> FloatArray:
    """Checked values (N, 1) of a joint, or (N, 7) poses with quaternions that do not jump."""
    found = finite(values, joint)
    found = found[:, None] if found.ndim == 1 else found
    width = len(POSE) if found.ndim == 2 and found.shape[1] != 1 else 1
    return continued(samples(found, width, joint, count))


def continued(values: FloatArray) -> FloatArray:
    """Poses (N, 7) whose quaternions keep their sign from sample to sample; others as they are."""
    turn = values[:, 3:]
    if not turn.shape[1]:
        return values
    off = np.abs(np.linalg.norm(turn, axis=1) - 1)
    if off.max(initial=0.0) > UNIT:
        raise DataError(
            f"sample {int(off.argmax())} of a pose ends in no unit quaternion: its length is off "
            f"by {off.max():.3g} (tolerance {UNIT:g}; columns are {', '.join(POSE)})",
            tolerance=UNIT,
        )
    flips = np.where((turn[1:] * turn[:-1]).sum(axis=1) < 0, -1.0, 1.0)
    signs = np.cumprod(np.append(1.0, flips))
    return np.concatenate([values[:, :3], signs[:, None] * turn], axis=1)
