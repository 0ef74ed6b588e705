"""From a file of any registered format to a log: read, map columns, and check for its robot."""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import nullcontext
from dataclasses import replace
from pathlib import Path

import numpy as np

from loopid.arguments import checked
from loopid.errors import FileError, LogError, ModelWarning, OptionError, warn
from loopid.files import near_file, require_name, why_no_file
from loopid.logs.checks import check_streams, frame_index, require_known_motion, with_checked_rates
from loopid.logs.grid import Stream, make_streams, on_joints
from loopid.logs.log import Log
from loopid.logs.mapping import LogMapping, mapping_of
from loopid.logs.signals import ColumnFinder
from loopid.logs.table import LogFormat, numbers_in, stream_name
from loopid.registry import log_formats
from loopid.robot.robot import Robot
from loopid.yaml_files import placing

# How far a locked joint may be from its lock, in rad or m.
LOCKED = 2e-3
# Logged joints in a chain that are an arm; fewer may be motors of a loop.
ARM = 3


@checked
def read_log(
    path: str | Path,
    robot: Robot,
    *,
    mapping: LogMapping | str | Path | None = None,
    rows: tuple[int, int | None] | None = None,
    forces: bool = True,
) -> Log:
    """Read the positions and forces of the motors.

    Parameters
    ----------
    path : path
        A table of text (.csv, .txt, .tsv, also .gz), Parquet, an .npz, a folder with one table a
        stream; with the extra ``logs`` also HDF5, or a bag of ROS 1 or 2 (.bag, .mcap, .db3, or
        the folder of one) with messages of type ``sensor_msgs/JointState``. More formats may be
        registered in ``loopid.registry.log_formats``.
    robot : Robot
    mapping : LogMapping or path, optional
        Which columns are what, and their units; by default as their names say, in SI units.
    rows : tuple of int, optional
        First and last row (None for the end) to be read, as messages count them: as if there were
        no others. In a log of several streams, of that with the first position.
    forces : bool
        False of a motion that was commanded: forces that a log has are passed over, and are zeros.

    Returns
    -------
    Log
        Evenly sampled in segments without gaps, at the rate of the positions.

    Raises
    ------
    FileError
        When there is no such log or mapping.
    MissingExtraError
        When the library that reads the format is not installed.
    OptionError
        When motors and free joints do not determine the pose, or no row is within ``rows``.
    LogError
        When it is no log of this robot: unreadable, columns not found, times that do not increase,
        too many bad rows, the wrong unit, nothing that moves.

    Warns
    -----
    DataWarning
        Of rows that are left out, and of values that look wrong.

    Examples
    --------
    >>> import loopid
    >>> from loopid.loading import bundled_directory
    >>> robot = loopid.load("five_bar")
    >>> loopid.read_log(bundled_directory() / "logs" / "five_bar.csv", robot)
    <Log 'five_bar': 2241 samples of left_crank_joint, right_crank_joint over 22.40 s in 1 segment>
    """
    file = nullcontext() if isinstance(mapping, LogMapping | None) else placing(Path(mapping))
    with file:
        mapping = mapping_of(mapping)
        if not forces:
            mapping = mapping.model_copy(update={"wrenches": []})
        require_known_motion(robot, mapping.free)
        for wrench in mapping.wrenches:
            frame_index(robot, wrench.frame)
        found = read_streams(path, robot, mapping, rows=rows, forces=forces)
        streams = check_streams(robot, found, static=mapping.static)
        name = stream_name(Path(path).resolve())
        log = Log.from_streams(name, streams, robot.actuated, mapping)
        log = with_checked_rates(log)
    return replace(log, checked=True)


def read_streams(
    path: str | Path,
    robot: Robot,
    mapping: LogMapping,
    *,
    rows: tuple[int, int | None] | None = None,
    forces: bool = True,
) -> list[Stream]:
    """The streams of the motors, that of the first position first; of it, only some ``rows``."""
    if rows is not None and (rows[0] < 1 or (rows[1] is not None and rows[1] < rows[0])):
        raise OptionError(
            f"rows must be counted from 1, the first before the last, not {rows[0]} to {rows[1]}",
            given=rows,
        )
    log, finder = open_log(path, mapping)
    source, joints = finder.source, robot.actuated
    for joint, value in _elsewhere(log, finder, robot.locked).items():
        raise LogError(
            f"{source}: {joint} is locked at {robot.locked[joint]:.6g}, but stands at {value:.6g}: "
            f'load the robot with lock=["{joint}={value:.6g}"]',
            given=value,
            tolerance=LOCKED,
        )
    streams: list[Stream] = []
    channels_of = finder.channels(mapping.measured(source, joints), forces=forces)
    delays = mapping.stream_delays(source, joints, [*channels_of])
    for name, channels in channels_of.items():
        time = finder.time(name)
        columns = [channel.column for channel in channels]
        for table in log.tables(name, time.names, columns):
            source = log.source(name)
            if rows is not None and not streams:
                table = table.between(*rows)
                source = f"{source}[{rows[0]}:{'' if rows[1] is None else rows[1]}]"
            here = tuple(c for c in channels if c.column in table.cells.columns)
            for stream in make_streams(source, table, time, here):
                stream = stream.earlier(delays.get(name, 0.0))
                streams.append(on_joints(stream, mapping.joint_maps))
    return streams


def _elsewhere(
    log: LogFormat, finder: ColumnFinder, locked: Mapping[str, float | None]
) -> dict[str, float]:
    """Where a log has joints that are locked elsewhere; one in which they move is refused."""
    found = {}
    for joint, value in locked.items():
        column = finder.own_position(joint)
        if value is None or column is None:
            continue
        place, scale = column
        times = finder.time(place.stream).names
        (table, *_) = log.tables(place.stream, times, [place.column])
        positions = scale * numbers_in(finder.source, table.cells[place.column])
        low, high = np.nanpercentile(positions, (1, 99)) if len(positions) else (value, value)
        if high - low > LOCKED:
            raise LogError(
                f"{finder.source}: {joint} is locked, but moves from {low:.4g} to {high:.4g} in "
                f"column {place.column!r}: load the robot without that lock"
            )
        middle = float(np.nanmedian(positions))
        if abs(middle - value) > LOCKED:
            found[joint] = middle
    return found


@checked
def locked_as_logged(
    robot: Robot, path: str | Path, *, mapping: LogMapping | str | Path | None = None
) -> Robot:
    """The robot, its locked joints where a log has them, and motors locked that a log lacks.

    Locked are only motors that move no other motor and no loop, such as those of a gripper. It is
    warned of; a log in which a locked joint moves is refused.
    """
    from loopid.loading.robot_files import load  # logs are read without it

    if robot.path is None:
        return robot
    mapping = mapping_of(mapping)
    require_known_motion(robot, mapping.free)
    log, finder = open_log(path, mapping)
    found = _elsewhere(log, finder, robot.locked)
    if found:
        places = ", ".join(f"{joint} at {value:.6g}" for joint, value in found.items())
        warn(f"{path}: locked where the log has it: {places}", ModelWarning)
    lacking = _lacking(robot, finder)
    if lacking:
        names = ", ".join(lacking)
        warn(f"{path} has no columns of {names}: locked as the robot file has it", ModelWarning)
    if not (found or lacking):
        return robot
    lock = [
        each for each in robot.options["lock"] if (each.rpartition("=")[0] or each) not in found
    ]
    lock += [f"{joint}={value:.6g}" for joint, value in found.items()]
    return load(robot.path, **{**robot.options, "lock": [*lock, *lacking]})


def _lacking(robot: Robot, finder: ColumnFinder) -> list[str]:
    """Joints without columns beyond the last joint of a logged arm, or apart from it.

    Where others stood matters, or they are passive in a loop that the robot file does not close.
    """
    motors = finder.mapping.measured(finder.source, robot.actuated)
    both = zip(robot.actuated, motors, strict=True)
    supports = robot.model.supports
    logged = [joint for joint, name in both if finder.names(name)]
    # A coordinate of a joint that has several is named by both; a joint may have a dot in its name.
    owners = (each if each in robot.joints else each.rpartition(".")[0] for each in logged)
    arm = {robot.model.getJointId(each) for each in owners}
    last = max(arm, key=lambda k: len(supports[k]), default=0)
    if len(arm) < ARM or not arm <= {*supports[last]}:
        return []
    frames = [robot.model.frames[k] for each in robot.closures for k in each.frame_ids]
    kept = {k for end in (last, *(one.parentJoint for one in frames)) for k in supports[end]}
    moved = {*robot.actuated, *robot.following}
    lacking = [
        name
        for k, name in enumerate(robot.joints, 1)
        if name in moved and k not in kept and (last in supports[k] or not arm & {*supports[k]})
    ]
    # What is coupled to a joint that moves is moved by it, as a rotor that stands on the base.
    moving = {*robot.joints} - {*lacking}
    for _ in robot.couplings:
        moving |= {j for c in robot.couplings if moving & {*c.joints} for j in c.joints}
    return [name for name in lacking if name not in moving]


def open_log(path: str | Path, mapping: LogMapping) -> tuple[LogFormat, ColumnFinder]:
    """The log in its format, and its columns.

    The format is as the mapping says, or that of those registered which accepts it.
    """
    require_name(path, "the log")
    path = Path(path)
    reason = why_no_file(path)
    if reason == "does not exist":
        raise FileError(f"there is no log {path}{near_file(path)}", file=path)
    if reason not in ("", "is a folder"):
        raise LogError(f"log {path} {reason}", file=path)
    accepting = (name for name in reversed([*log_formats]) if log_formats[name].accepts(path))
    name = mapping.format or next(accepting, None)
    if name is None:
        endings = dict.fromkeys(end for kind in log_formats for end in log_formats[kind].endings)
        raise LogError(
            f"{path} is of no known format: its name must end in {', '.join(endings)}; otherwise "
            f"give the format in a mapping ({', '.join(sorted(log_formats))})",
            file=path,
            valid=tuple(endings),
        )
    kind: type[LogFormat] = log_formats[name]
    for key in ("topic", "group"):
        if getattr(mapping, key) is not None and kind.choice != key:
            raise LogError(
                f"{path}: {key} {getattr(mapping, key)!r} of the mapping chooses nothing in a log "
                f"of format {name}",
                file=path,
                key=key,
            )
    log = kind(path, getattr(mapping, kind.choice) if kind.choice else None)
    return log, ColumnFinder(str(path), log.columns(), mapping, log.ordered, log.choice)
