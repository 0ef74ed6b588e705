"""From a file of any known format to a log: evenly sampled, and checked.

A file holds streams: values of the motors in SI units at time stamps. They are put on one even
grid, which follows the stream of the positions at the median rate of its stamps. A gap in any
stream ends a stretch of the grid. Between the stamps of a stream its values are interpolated
linearly: they are off by at most h²/8 times their second derivative by time, h between stamps.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from contextlib import closing
from dataclasses import dataclass, replace
from functools import partial
from itertools import pairwise
from math import inf
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from loopid.arguments import (
    BoolArray,
    FloatArray,
    IntArray,
    checked,
    checked_fields,
    finite,
    frozen,
    samples,
)
from loopid.errors import (
    DataError,
    DataWarning,
    FileError,
    LogError,
    OptionError,
    warn,
)
from loopid.files import why_no_file
from loopid.formats.bags import BagFormat
from loopid.logs.formats import (
    NO_STAMP,
    Batch,
    FolderFormat,
    Hdf5Format,
    LogFormat,
    NpzFormat,
    ParquetFormat,
    TextFormat,
    numbers_in,
    rows_between,
    stream_name,
)
from loopid.logs.mapping import (
    QUANTITIES,
    Channel,
    ColumnFinder,
    JointMap,
    LogMapping,
    TimeColumn,
    read_mapping,
)
from loopid.robot.mechanism import (
    Mechanism,
    lock_options,
)
from loopid.scratch import (
    Spool,
    empty_columns,
    mapped_rows,
)

# Time over which measured rates are compared with positions, in s; how far they may differ with a
# warning, and the ratio (or its inverse) from which on they are something else.
COMPARED_OVER, APART, WRONG_GAIN = 0.5, 0.1, 1.25
# The first that accepts a path reads it.
FORMATS: tuple[type[LogFormat], ...] = (
    BagFormat,
    FolderFormat,
    TextFormat,
    NpzFormat,
    ParquetFormat,
    Hdf5Format,
)
# Fraction of the rows that may be left out before a log is refused.
MOST_BAD_ROWS = 0.1
# Shorter streams, and shorter stretches without gaps, are none.
LEAST_ROWS = 4
# Rows that a message names.
MOST_NAMED = 5
# Median steps (s) that a log may have: others mean that the unit of the time is another.
SHORTEST_STEP, LONGEST_STEP = 1e-5, 0.2
OTHER_UNITS = (1e-9, 1e-6, 1e-3, 1e3, 1e6, 1e9)
# Of the range of a joint: how far outside its limits a value may be without a word, and from how
# far on it is no position of the joint.
OUTSIDE, FAR_OUTSIDE = 1e-3, 1.0
# Fraction of the values that a change of unit must bring inside.
FITTING = 0.9
# From the smallest change on, as limits around zero hold whatever is small.
UNITS_OF_LENGTH = {"0.001 (mm to m)": 1e-3, "1000 (km to m)": 1e3, "1e-6 (um to m)": 1e-6}
UNITS_OF_ANGLE = {"pi/180 (deg to rad)": np.pi / 180, "0.001 (mrad to rad)": 1e-3}
# Forces this many times their 99th percentile are no forces.
GLITCH = 100.0
# Relative excess over a limit that is round-off of how it was written.
EXCESS = 1e-3
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


@checked_fields
@dataclass(frozen=True, repr=False)
class Log:
    """Positions and forces of the motors over time, in stretches without gaps.

    Attributes
    ----------
    name : str
    joints : tuple of str
        The m actuated joints, in the order of the columns.
    time : FloatArray
        (N,) in s from the log's first sample, increasing, even within each stretch.
    position, force : FloatArray
        (N, m) in m or rad, and N or N m.
    stretches : IntArray
        (N,), number of the gap-free stretch that a sample belongs to, ascending from 0.
    dropped : tuple of Dropped
        What was left out while reading.
    saturation : FloatArray or None
        (m,), force from which each drive saturates; by default the effort limit of the robot file
        unless a tenth of the forces exceeds it, or the force that they are clipped at.
    idle_speed : float or None
        Speed in m/s or rad/s at or below which a motor counts as standing, 0 if none ever does; by
        default a twentieth of the motor's own usual top speed.
    velocity, acceleration : FloatArray or None
        (N, m) in units of the positions and s, where they were measured.
    """

    name: str
    joints: tuple[str, ...]
    time: FloatArray
    position: FloatArray
    force: FloatArray
    stretches: IntArray
    dropped: tuple[Dropped, ...] = ()
    saturation: FloatArray | None = None
    idle_speed: float | None = None
    velocity: FloatArray | None = None
    acceleration: FloatArray | None = None

    def __post_init__(self) -> None:
        time = finite(self.time, "time")
        if time.ndim != 1 or not len(time) or (np.diff(time) <= 0).any():
            raise DataError("the time of a log must be a row of increasing numbers")
        numbers: Any = self.stretches
        if not isinstance(numbers, np.ndarray) or numbers.dtype.kind not in "iu":
            numbers = finite(numbers, "stretches")
        if numbers.shape != time.shape or (np.diff(numbers) < 0).any():
            raise DataError(f"stretches must be {len(time)} ascending numbers, one a sample")
        object.__setattr__(self, "time", frozen(time))
        object.__setattr__(self, "stretches", frozen(numbers, np.int64))
        for name in QUANTITIES:
            if name in ("position", "force") or getattr(self, name) is not None:
                values = samples(getattr(self, name), len(self.joints), name, len(time))
                object.__setattr__(self, name, frozen(values))
        if self.saturation is not None:
            limits = frozen(samples(self.saturation, len(self.joints), "saturation", 1)[0])
            if not limits.min() > 0:
                raise DataError(f"saturation must be positive numbers, not {limits.tolist()}")
            object.__setattr__(self, "saturation", limits)
        if self.idle_speed is not None and not 0 <= self.idle_speed < inf:
            raise DataError(f"idle_speed must be a number from 0 on, not {self.idle_speed}")

    def __len__(self) -> int:
        return len(self.time)

    def __repr__(self) -> str:
        count = len(self.parts())
        return (
            f"<Log {self.name!r}: {len(self)} samples of {', '.join(self.joints)} over "
            f"{self.time[-1] - self.time[0]:.2f} s in {count} stretch{'es' if count > 1 else ''}>"
        )

    def parts(self) -> list[slice]:
        """The samples of each stretch, in order."""
        changes = np.flatnonzero(np.diff(self.stretches)) + 1
        return [slice(a, b) for a, b in pairwise([0, *changes.tolist(), len(self)])]

    def rate(self, part: slice) -> float:
        """Samples per second of a stretch; 0 for a single sample."""
        time = self.time[part]
        return (len(time) - 1) / float(time[-1] - time[0]) if len(time) > 1 else 0.0


@checked
def read_log(
    path: str | Path,
    mechanism: Mechanism,
    mapping: LogMapping | str | Path | None = None,
    rows: tuple[int, int | None] | None = None,
) -> Log:
    """Read the positions and forces of the motors.

    Parameters
    ----------
    path : path
        A table of text (.csv, .txt, .tsv, also .gz), Parquet, an .npz, a folder with one table a
        stream; with the extra ``logs`` also HDF5, or a bag of ROS 1 or 2 (.bag, .mcap, .db3, or
        the folder of one) with messages of type ``sensor_msgs/JointState``.
    mechanism : Mechanism
    mapping : LogMapping or path, optional
        Which columns are what, and their units; by default as their names say, in SI units.
    rows : tuple of int, optional
        First and last row (None for the end) to be read, as messages count them: as if there were
        no others. In a log of several streams, of that with the first position.

    Returns
    -------
    Log
        Evenly sampled in stretches without gaps, at the rate of the positions.

    Raises
    ------
    FileError
        When there is no such log or mapping.
    MissingExtraError
        When the library that reads the format is not installed.
    OptionError
        When the motors do not tell where the robot is, or no row is within ``rows``.
    LogError
        When it is no log of this robot: unreadable, columns not found, times that do not increase,
        too many bad rows, the wrong unit, nothing that moves.

    Warns
    -----
    DataWarning
        Of rows that are left out, and of values that look wrong.

    Examples
    --------
    >>> import numpy as np
    >>> import loopid
    >>> from pathlib import Path
    >>> from tempfile import TemporaryDirectory
    >>> robot = loopid.load_mechanism("four_bar")
    >>> time = np.arange(0, 2, 0.01)
    >>> columns = np.stack([time, 1 + np.sin(time), np.cos(time)], axis=1)
    >>> names = "time,crank_joint.position,crank_joint.force"
    >>> with TemporaryDirectory() as folder:
    ...     path = Path(folder) / "run.csv"
    ...     np.savetxt(path, columns, delimiter=",", header=names)
    ...     log = loopid.read_log(path, robot)
    >>> log
    <Log 'run': 200 samples of crank_joint over 1.99 s in 1 stretch>
    """
    place, joints = Path(path), mechanism.actuated
    require_known_motion(mechanism)
    reason = why_no_file(place)
    if reason == "does not exist":
        raise FileError(f"there is no log {place}")
    if reason not in ("", "is a folder"):
        raise LogError(f"log {place} {reason}")
    if not isinstance(mapping, LogMapping):
        mapping = LogMapping() if mapping is None else read_mapping(mapping)
    first, last = rows or (1, None)
    if first < 1 or (last is not None and last < first):
        raise OptionError(f"rows must be counted from 1, the first before the last, not {rows}")
    found = read_streams(place, joints, mapping, None if rows is None else (first, last))
    streams = [checked_stream(mechanism, stream) for stream in found]
    check_moving(streams)
    saturation = None
    if mapping.saturation is not None:
        saturation = np.array(mapping.by_joint(str(place), "saturation", joints))
    time, signals, stretches, dropped = align(streams, joints)
    log = Log(
        name=stream_name(place.resolve()),
        joints=joints,
        time=time,
        **signals,
        stretches=stretches,
        dropped=dropped,
        saturation=saturation,
        idle_speed=mapping.idle_speed,
    )
    check_rates(log)
    return log


def check_rates(log: Log) -> None:
    """Refuse measured velocities and accelerations that are not those of the positions.

    Compared are differences of positions over some time, with integrals over the same time: noise
    and the delays of filters in drives do not matter there.
    """
    for order, quantity in enumerate(("velocity", "acceleration"), 1):
        measured: FloatArray | None = getattr(log, quantity)
        if measured is None:
            continue
        for k, joint in enumerate(log.joints):
            changes: list[FloatArray] = []
            for part in log.parts():
                count, integral = part.stop - part.start, measured[part, k]
                lag = max(1, min(round(COMPARED_OVER * log.rate(part)), (count - 1) // (2 * order)))
                for _ in range(order):
                    steps = (integral[1:] + integral[:-1]) / (2 * log.rate(part))
                    integral = np.append(0.0, np.cumsum(steps))
                both = np.stack([integral, log.position[part, k]])
                for _ in range(order):
                    both = both[:, lag:] - both[:, :-lag]
                changes.append(both)
            given, expected = np.concatenate(changes, axis=1)
            size = float(expected @ expected)
            if size == 0:  # it stands
                continue
            gain, off = float(given @ expected) / size, given - expected
            apart = float(np.sqrt(off @ off / size))
            said = (
                f"{log.name}: the {quantity} of {joint} is {gain:.3g} times what its position "
                f"says, and differs from it by {apart:.0%} (root mean square)"
            )
            if not 1 / WRONG_GAIN < gain < WRONG_GAIN:
                raise LogError(f"{said}: is it in another unit ({quantity}_scale), or of another?")
            if apart > APART:
                warn(f"{said}: is it late, noisy, or in need of {quantity}_offset?", DataWarning)


def read_streams(
    path: Path,
    joints: tuple[str, ...],
    mapping: LogMapping,
    rows: tuple[int, int | None] | None = None,
) -> list[Stream]:
    """The streams that hold positions or forces, that of the first position first.

    Of that one, only ``rows`` are read, from first to last.
    """
    for known in FORMATS:
        if known.name == mapping.format or (mapping.format is None and known.accepts(path)):
            break
    else:
        raise LogError(
            f"{path} is of no known format: its name must end in .csv, .txt, .tsv (also .gz), "
            ".npz, .parquet, .h5, .hdf5, .bag, .mcap or .db3, or it must be a folder; otherwise "
            f"give the format in a mapping ({', '.join(sorted(f.name for f in FORMATS))})"
        )
    for key in ("topic", "group"):
        if getattr(mapping, key) is not None and known.choice != key:
            raise LogError(
                f"{path}: {key} {getattr(mapping, key)!r} of the mapping chooses nothing in a log "
                f"of format {known.name}"
            )
    log = known(path, getattr(mapping, known.choice) if known.choice else None)
    finder = ColumnFinder(str(path), log.columns(), known, mapping)
    streams: list[Stream] = []
    for name, channels in finder.channels(mapping.measured(str(path), joints)).items():
        time = finder.time(name)
        for columns in log.together(name, [channel.column for channel in channels]):
            here = tuple(channel for channel in channels if channel.column in columns)
            source = log.source(name)
            with closing(log.batches(name, [*time.names, *columns])) as batches:
                chosen: Iterable[Batch] = batches
                if rows is not None and not streams:
                    first, last = rows
                    source = f"{source}[{first}:{'' if last is None else last}]"
                    chosen = rows_between(batches, first, inf if last is None else last)
                stream = make_stream(source, chosen, time, here)
            streams.append(on_joints(stream, mapping.joint_maps))
    return streams


def require_known_motion(mechanism: Mechanism) -> None:
    """Refuse mechanisms whose configuration does not follow from one position a motor."""
    if mechanism.free:
        raise OptionError(
            f"a log of the motors does not tell where {', '.join(mechanism.free)} of "
            f"{mechanism.name} are, which the motors leave free: lock them "
            f"({lock_options(mechanism)})"
        )
    several = [name for name in mechanism.actuated if mechanism.joint(name).nv != 1]
    if several:
        raise OptionError(
            f"a log has one position a motor, but {', '.join(several)} of {mechanism.name} turn "
            "about several axes: name the motors in 'name_mot'"
        )


# ---- streams -----------------------------------------------------------------------------------


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
        """Joints of which a quantity is here, and the values (R,)."""
        for channel, values in zip(self.channels, self.values, strict=True):
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
        "another number of cells than there are columns": np.concatenate(garbled),
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


def on_joints(stream: Stream, maps: Sequence[JointMap]) -> Stream:
    """The stream of joints that motors move together, from that of these motors."""
    channels, signals = list(stream.channels), list(stream.values)
    for one in maps:
        matrix = np.array(one.matrix)
        for quantity in QUANTITIES:
            factors = np.linalg.inv(matrix).T if quantity == "force" else matrix
            places = {c.joint: k for k, c in enumerate(stream.channels) if c.quantity == quantity}
            here = [places[motor] for motor in one.motors if motor in places]
            if here and len(here) < len(one.motors):
                raise LogError(
                    f"{stream.source} has the {quantity} of {stream.channels[here[0]].joint}, but "
                    f"not of all motors that move {', '.join(one.joints)}: they must have the same "
                    "time stamps"
                )
            for place, joint, row in zip(here, one.joints, factors, strict=bool(here)):
                channels[place] = channels[place]._replace(joint=joint)
                parts = [(factor, stream.values[k]) for factor, k in zip(row, here, strict=True)]
                signals[place] = mapped_rows(partial(_sum, parts), len(stream.rows))
    return replace(stream, channels=tuple(channels), values=tuple(signals))


def _sum(parts: Sequence[tuple[float, FloatArray]], rows: slice) -> FloatArray:
    return np.asarray(sum(factor * values[rows] for factor, values in parts), dtype=np.float64)


def refuse_or_warn(source: str, rows: IntArray, count: int, reason: str) -> None:
    """Warn of rows that are left out; refuse a log with too many of them."""
    sentence = f"{source}: {reason} in {rows_text(rows)} of {count}"
    if len(rows) > MOST_BAD_ROWS * count:
        raise LogError(f"{sentence} (at most {MOST_BAD_ROWS:.0%} may be left out)")
    warn(f"{sentence}: left out", DataWarning)


def rows_text(rows: IntArray) -> str:
    """As in "rows 3, 4, 5 and 17 more"."""
    named = ", ".join(map(str, rows[:MOST_NAMED].tolist()))
    more = f" and {len(rows) - MOST_NAMED} more" if len(rows) > MOST_NAMED else ""
    return f"row{'s' if len(rows) > 1 else ''} {named}{more}"


# ---- what the robot lets expect ------------------------------------------------------------


def checked_stream(mechanism: Mechanism, stream: Stream) -> Stream:
    """The stream without impossible rows, and with turns counted on; warns of what looks wrong."""
    _check_stamps(stream)
    stream = _inside_limits(mechanism, stream)
    stream = _without_glitches(stream)
    stream = _unwrapped(mechanism, stream)
    seconds = np.diff(stream.stamps) / 1e9

    def limit_of(limits: FloatArray, joint: str) -> float:
        value = float(limits[mechanism.velocity_indices([joint])[0]])
        return value if value > 0 else np.inf  # zero stands for none, as exporters write it

    model = mechanism.model
    for joint, values in stream.signals("position"):
        limit = limit_of(model.upperVelocityLimit, joint)
        speed = np.abs(np.diff(values)) / seconds
        fast = np.flatnonzero(speed > limit * (1 + EXCESS))
        if len(fast):
            warn(
                f"{stream.source}: {joint} moves faster than its limit of {limit:g} per s "
                f"before {rows_text(stream.rows[fast + 1])}, at worst {speed.max():.3g} per s",
                DataWarning,
            )
    for joint, values in stream.signals("force"):
        limit = limit_of(model.upperEffortLimit, joint)
        strong = np.abs(values) > limit * (1 + EXCESS)
        if strong.any():
            warn(
                f"{stream.source}: the force of {joint} exceeds its effort limit of {limit:g} in "
                f"{rows_text(stream.rows[strong])}, at worst {np.abs(values).max():.4g}",
                DataWarning,
            )
    return stream


def check_moving(streams: Sequence[Stream]) -> None:
    """Warn of joints whose position or force never changes; refuse when no position does."""
    source = streams[0].source
    for quantity in ("position", "force"):
        signals = (signal for stream in streams for signal in stream.signals(quantity))
        moves = {joint: bool(np.ptp(values)) for joint, values in signals}
        dead = [joint for joint, moved in moves.items() if not moved]
        if quantity == "position" and len(dead) == len(moves):
            raise LogError(f"{source}: no position ever changes, so nothing moves")
        if dead:
            warn(
                f"{source}: the {quantity} of {', '.join(dead)} never changes: a dead sensor?",
                DataWarning,
            )


def _check_stamps(stream: Stream) -> None:
    """Refuse stamps that do not increase, or too fast or slowly for a log."""
    steps = np.diff(stream.stamps)
    wrong = np.flatnonzero(steps <= 0)
    if len(wrong):
        same = int((steps[wrong] == 0).sum())
        raise LogError(
            f"{stream.source}: time must increase from row to row, but goes back "
            f"{len(wrong) - same} times and stands still {same} times, in "
            f"{rows_text(stream.rows[wrong + 1])}"
        )
    step = float(np.median(steps)) / 1e9
    if not SHORTEST_STEP <= step <= LONGEST_STEP:
        fitting = [f for f in OTHER_UNITS if SHORTEST_STEP <= step * f <= LONGEST_STEP]
        factors = " or ".join(f"{factor:g}" for factor in fitting)
        raise LogError(
            f"{stream.source}: the median step between time stamps is {step:.3g} s, but must be "
            f"from {SHORTEST_STEP:g} to {LONGEST_STEP:g} s: give the unit of the time in a mapping"
            f"{f'; times {factors} it would fit' if factors else ''}"
        )


def _inside_limits(mechanism: Mechanism, stream: Stream) -> Stream:
    """The stream without rows where a position is far outside the limits of its joint."""
    lost = np.zeros(len(stream.rows), dtype=bool)
    for joint, values in stream.signals("position"):
        lower, upper = mechanism.limits(joint)
        if not lower < upper:  # limits that leave no room are none
            continue
        if lower <= values.min() and values.max() <= upper:
            continue
        distance = np.maximum(lower - values, values - upper)
        outside = distance > OUTSIDE * (upper - lower)
        far = distance > FAR_OUTSIDE * (upper - lower)
        refused = far.sum() > MOST_BAD_ROWS * len(values)
        told = far if refused else outside & ~far
        if told.any():
            said = (
                f"{stream.source}: {joint} is outside its limits [{lower:g}, {upper:g}] in "
                f"{rows_text(stream.rows[told])} of {len(values)}, at worst "
                f"{values[told][np.argmax(distance[told])]:g}"
            )
            if refused:
                straight = mechanism.velocity_indices([joint])[0] in mechanism.prismatic
                raise LogError(f"{said}; {_advice(straight, lower, upper, values)}")
            warn(f"{said}: kept", DataWarning)
        lost |= far
    return stream.without(lost, "positions far outside the limits of their joints")


def _advice(straight: bool, lower: float, upper: float, values: FloatArray) -> str:
    """What change of unit or origin would bring values (R,) inside limits."""
    for name, factor in (UNITS_OF_LENGTH if straight else UNITS_OF_ANGLE).items():
        scaled = values * factor
        if ((scaled >= lower) & (scaled <= upper)).mean() >= FITTING:
            return f"times {name} they would fit: give position_scale in a mapping"
    if np.ptp(values) <= upper - lower:
        return "with position_offset in a mapping they would fit"
    return "no change of unit brings them inside: are they those of another joint?"


def _without_glitches(stream: Stream) -> Stream:
    """The stream without rows where a force is out of all proportion."""
    bad = np.zeros(len(stream.rows), dtype=bool)
    for _, values in stream.signals("force"):
        sizes = np.abs(values)
        usual = np.percentile(sizes, 99)
        if usual > 0:
            bad |= sizes > GLITCH * usual
    return stream.without(bad, f"forces more than {GLITCH:g} times their 99th percentile")


def _unwrapped(mechanism: Mechanism, stream: Stream) -> Stream:
    """The stream with joints that turn without end counted on, not reset after each turn."""
    values = tuple(
        np.unwrap(signal)
        if what.quantity == "position" and mechanism.joint(what.joint).nq == 2
        else signal
        for what, signal in zip(stream.channels, stream.values, strict=True)
    )
    return replace(stream, values=values)


# ---- one grid ---------------------------------------------------------------------------------


class Aligned(NamedTuple):
    """Streams on one grid."""

    time: FloatArray  # (N,) in s from the first stamp of the first stream
    signals: dict[str, FloatArray]  # by quantity (N, m), one column a motor
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
    there = dict.fromkeys(channel.quantity for stream in streams for channel in stream.channels)
    tables = {quantity: empty_columns(len(time), len(joints)) for quantity in there}
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
    return Aligned(time, tables, stretches, tuple(dropped))


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
