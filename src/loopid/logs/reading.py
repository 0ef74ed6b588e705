"""Logs of any known format, on an even grid and checked."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from loopid.arguments import checked
from loopid.arrays import FloatArray
from loopid.errors import LogError, MissingFileError
from loopid.files import why_no_file
from loopid.logs.actuation import require_known_motion
from loopid.logs.alignment import align
from loopid.logs.limit_checks import check_limits
from loopid.logs.log import Log
from loopid.logs.mapping import LogMapping, read_mapping
from loopid.logs.signal_checks import (
    check_efforts,
    check_moving,
    check_speeds,
    drop_glitches,
    unwrap_turns,
)
from loopid.logs.sources import by_joint, read_streams
from loopid.logs.stream import Stream
from loopid.logs.text_lines import stream_name
from loopid.robot import Mechanism
from loopid.scratch import mapped_rows


@checked
def read_log(
    path: str | Path, mechanism: Mechanism, mapping: LogMapping | str | Path | None = None
) -> Log:
    """Read the positions and forces of the motors.

    Parameters
    ----------
    path : path
        A table of text (.csv, .txt, .tsv, also .gz), an .npz, a folder with one table a stream;
        with the extra ``logs`` also Parquet, HDF5, or a bag of ROS 1 or 2 (.bag, .mcap, .db3, or
        the folder of one) with messages of type ``sensor_msgs/JointState``.
    mechanism : Mechanism
    mapping : LogMapping or path, optional
        Which columns are what, and their units; by default as their names say, in SI units.

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
        When the motors do not tell where the robot is.
    LogError
        When it is no log of this robot: unreadable, columns not found, times that do not increase,
        too many bad rows, the wrong unit, nothing that moves.

    Warns
    -----
    LogWarning
        Of rows that are left out, and of values that look wrong.
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
    streams = [_checked(mechanism, stream) for stream in read_streams(place, joints, mapping)]
    check_moving(streams)
    aligned = align(streams)
    known = mapping.saturation is not None
    return Log(
        name=stream_name(place.resolve()),
        joints=joints,
        time=aligned.time,
        position=_gathered(streams, aligned.values, "position", joints),
        force=_gathered(streams, aligned.values, "force", joints),
        stretches=aligned.stretches,
        dropped=aligned.dropped,
        saturation=np.array(by_joint(place, "saturation", mapping, joints)) if known else None,
        idle_speed=mapping.idle_speed,
    )


def _checked(mechanism: Mechanism, stream: Stream) -> Stream:
    stream = drop_glitches(check_limits(mechanism, stream))
    stream = unwrap_turns(mechanism, stream)
    check_speeds(mechanism, stream)
    check_efforts(mechanism, stream)
    return stream


def _gathered(
    streams: list[Stream], values: tuple[FloatArray, ...], quantity: str, joints: tuple[str, ...]
) -> FloatArray:
    """One column a joint (N, dof), from whichever stream it is in."""
    found = {
        channel.joint: table[:, k]
        for stream, table in zip(streams, values, strict=True)
        for k, channel in enumerate(stream.channels)
        if channel.quantity == quantity
    }
    columns = [found[joint] for joint in joints]
    return mapped_rows(
        lambda rows: np.stack([column[rows] for column in columns], axis=1), len(columns[0])
    )
