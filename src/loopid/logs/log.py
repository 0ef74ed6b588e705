"""From a file of any known format to a log: evenly sampled, and checked."""

from __future__ import annotations

from collections.abc import Iterable
from contextlib import closing
from dataclasses import dataclass
from itertools import pairwise
from math import inf
from pathlib import Path
from typing import Any

import numpy as np

from loopid.arguments import FloatArray, IntArray, checked, checked_fields, finite, frozen, samples
from loopid.errors import DataError, LogError, LogWarning, MissingFileError, OptionError, warn
from loopid.files import why_no_file
from loopid.logs.bags import BagFormat
from loopid.logs.formats import (
    Batch,
    FolderFormat,
    Hdf5Format,
    LogFormat,
    NpzFormat,
    ParquetFormat,
    TextFormat,
    rows_between,
    stream_name,
)
from loopid.logs.mapping import QUANTITIES, ColumnFinder, LogMapping, read_mapping
from loopid.logs.streams import (
    Dropped,
    Stream,
    align,
    check_moving,
    checked_stream,
    make_stream,
    on_joints,
)
from loopid.robot import Mechanism, lock_options

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
    MissingFileError
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
    LogWarning
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
        raise MissingFileError(f"there is no log {place}")
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
                warn(f"{said}: is it late, noisy, or in need of {quantity}_offset?", LogWarning)


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
