"""From a file of any registered format to a log: read, map columns, check."""

from __future__ import annotations

from pathlib import Path

from loopid.arguments import checked
from loopid.errors import FileError, LogError, OptionError
from loopid.files import why_no_file
from loopid.logs.checks import check_moving, check_rates, check_stream
from loopid.logs.columns import ColumnFinder
from loopid.logs.formats import LogFormat, format_of, stream_name
from loopid.logs.log import Log
from loopid.logs.mapping import LogMapping, read_mapping
from loopid.logs.options import LogTolerances
from loopid.logs.streams import Stream, make_stream, on_joints
from loopid.robot.mechanism import Mechanism, lock_options


@checked
def read_log(
    path: str | Path,
    robot: Mechanism,
    *,
    mapping: LogMapping | str | Path | None = None,
    rows: tuple[int, int | None] | None = None,
    tolerances: LogTolerances = LogTolerances(),
) -> Log:
    """Read the positions and forces of the motors.

    Parameters
    ----------
    path : path
        A table of text (.csv, .txt, .tsv, also .gz), Parquet, an .npz, a folder with one table a
        stream; with the extra ``logs`` also HDF5, or a bag of ROS 1 or 2 (.bag, .mcap, .db3, or
        the folder of one) with messages of type ``sensor_msgs/JointState``. More formats may be
        registered in ``loopid.registry.log_formats``.
    robot : Mechanism
    mapping : LogMapping or path, optional
        Which columns are what, and their units; by default as their names say, in SI units.
    rows : tuple of int, optional
        First and last row (None for the end) to be read, as messages count them: as if there were
        no others. In a log of several streams, of that with the first position.
    tolerances : LogTolerances
        What may be wrong with a log.

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
    place = Path(path)
    require_known_motion(robot)
    require_log(place)
    if not isinstance(mapping, LogMapping):
        mapping = LogMapping() if mapping is None else read_mapping(mapping)
    found = read_streams(place, robot.actuated, mapping, rows=rows, tolerances=tolerances)
    streams = [check_stream(robot, stream, tolerances) for stream in found]
    check_moving(streams)
    name = stream_name(place.resolve())
    log = Log.from_streams(name, streams, robot.actuated, mapping, tolerances)
    check_rates(log, tolerances)
    return log


def read_streams(
    path: Path,
    joints: tuple[str, ...],
    mapping: LogMapping,
    *,
    rows: tuple[int, int | None] | None = None,
    tolerances: LogTolerances = LogTolerances(),
) -> list[Stream]:
    """The streams that hold quantities of the motors, that of the first position first.

    Of that one, only ``rows`` are read, from first to last.
    """
    if rows is not None and (rows[0] < 1 or (rows[1] is not None and rows[1] < rows[0])):
        raise OptionError(
            f"rows must be counted from 1, the first before the last, not {rows}", given=rows
        )
    log = open_log(path, mapping)
    source = str(path)
    finder = ColumnFinder(source, log.columns(), mapping, log.ordered, log.choice)
    streams: list[Stream] = []
    for name, channels in finder.channels(mapping.measured(source, joints)).items():
        time = finder.time(name)
        columns = [channel.column for channel in channels]
        for table in log.tables(name, [*time.names, *columns]):
            source = log.source(name)
            if rows is not None and not streams:
                table = table.between(*rows)
                source = f"{source}[{rows[0]}:{'' if rows[1] is None else rows[1]}]"
            here = tuple(c for c in channels if c.column in table.cells.columns)
            stream = make_stream(source, table, time, here, tolerances.bad_rows)
            streams.append(on_joints(stream, mapping.joint_maps))
    return streams


def open_log(path: Path, mapping: LogMapping) -> LogFormat:
    """The log in its format, as the mapping says or the path looks."""
    name, kind = format_of(path, mapping.format)
    for key in ("topic", "group"):
        if getattr(mapping, key) is not None and kind.choice != key:
            raise LogError(
                f"{path}: {key} {getattr(mapping, key)!r} of the mapping chooses nothing in a log "
                f"of format {name}",
                file=path,
                key=key,
                format=name,
            )
    return kind(path, getattr(mapping, kind.choice) if kind.choice else None)


def require_log(path: Path) -> None:
    """Refuse a path where there is no file or folder."""
    reason = why_no_file(path)
    if reason == "does not exist":
        raise FileError(f"there is no log {path}", file=path)
    if reason not in ("", "is a folder"):
        raise LogError(f"log {path} {reason}", file=path)


def require_known_motion(robot: Mechanism) -> None:
    """Refuse robots whose configuration does not follow from one position a motor."""
    if robot.free:
        raise OptionError(
            f"a log of the motors does not tell where {', '.join(robot.free)} of "
            f"{robot.name} are, which the motors leave free: lock them ({lock_options(robot)})",
            free=robot.free,
        )
    several = [name for name in robot.actuated if robot.joint(name).nv != 1]
    if several:
        raise OptionError(
            f"a log has one position a motor, but {', '.join(several)} of {robot.name} turn "
            "about several axes: name the motors in 'name_mot'",
            joints=tuple(several),
        )
