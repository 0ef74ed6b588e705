"""Data of any form as recordings: paths, tables in memory, logs, recordings, or several."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from loopid.errors import OptionError
from loopid.logs.log import Log
from loopid.logs.mapping import LogMapping, read_mapping
from loopid.logs.preparing import prepare
from loopid.logs.reading import read_log
from loopid.logs.recording import Recording
from loopid.robot.robot import Robot

FORMS = "a path, a table of pandas or Polars, a Log or a Recording"


def recordings_of(
    robot: Robot, data: Any, mapping: LogMapping | str | Path | None = None
) -> tuple[Recording, ...]:
    """Recordings of data of any form.

    Parameters
    ----------
    data
        A path, a table with columns by name (of pandas or Polars, a dictionary of arrays), a
        ``Log``, a ``Recording``; or a list of these.
    mapping : LogMapping or path, optional
        Which columns are what, in paths and tables.

    Raises
    ------
    OptionError
        When the data are nothing of that.
    """
    return tuple(_recording(robot, each, mapping) for each in each_of(data))


def each_of(data: Any) -> Sequence[Any]:
    """Data as a list, also of a single one."""
    return data if isinstance(data, list | tuple) else [data]


def _recording(robot: Robot, data: Any, mapping: LogMapping | str | Path | None) -> Recording:
    if isinstance(data, Recording):
        return data
    if isinstance(data, str | Path):
        data = read_log(robot, data, mapping=mapping)
    elif isinstance(data, Mapping) or hasattr(data, "columns"):
        own = read_mapping(mapping) if isinstance(mapping, str | Path) else mapping
        data = Log.from_frame(data, robot.actuated, mapping=own)
    if not isinstance(data, Log):
        raise OptionError(
            f"data must be {FORMS}, or a list of these, not {type(data).__name__}", given=data
        )
    return prepare(robot, data)
