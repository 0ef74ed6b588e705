"""Data of any form as recordings: paths, tables in memory, logs, recordings, or several."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from itertools import chain, count
from pathlib import Path
from typing import Any

import numpy as np

from loopid.errors import DataError, OptionError
from loopid.identification.force_models import ForceModel
from loopid.logs.log import Log
from loopid.logs.preparing import prepare
from loopid.logs.recording import Recording, require_robot
from loopid.motion.simulation import Measurement
from loopid.robot.robot import Robot

FORMS = "a path, a table of pandas or Polars, a Log or a Recording"


def read(
    robot: Robot | ForceModel, *data: Any, mapping: Any = None
) -> tuple[Robot | ForceModel, list[tuple[Recording, ...]]]:
    """The robot, locked where the first log has it, and ``recordings_of`` several data."""
    first = require_some(data[0])
    if isinstance(robot, Robot) and isinstance(first, str | Path):
        from loopid.logs.reading import locked_as_logged  # where files are read

        robot = locked_as_logged(robot, first, mapping=mapping)
    own = robot if isinstance(robot, Robot) else robot.robot
    return robot, recordings_of(own, *data, mapping=mapping)


def recordings_of(robot: Robot, *data: Any, mapping: Any = None) -> list[tuple[Recording, ...]]:
    """Recordings of several data, each of any form that ``identify`` takes.

    Other logs of one name are numbered: ``run``, ``run 2``. Parts of a log share its name, as do
    poses at rest of one name whose rows do not overlap. Data of another form are refused, and a
    mapping that none of them needs.
    """
    given = [each_of(each) for each in data]
    known = [isinstance(one, Log | Recording | Measurement) for each in given for one in each]
    if mapping is not None and known and all(known):
        raise OptionError(
            "mapping says which columns of paths and tables are what, but a Log or a Recording has "
            "none: leave it out",
            argument="mapping",
            given=mapping,
        )
    return _named_apart([[_recording(robot, one, mapping) for one in each] for each in given])


def _named_apart(data: Sequence[Sequence[Recording]]) -> list[tuple[Recording, ...]]:
    """The recordings, by names that tell their logs apart."""
    logs = list[tuple[str, Log | None, list[Recording]]]()

    def named(run: Recording) -> Recording:
        known = next((each for each in logs if _are_of_one_log(run, each[2])), None)
        if known is None:
            more, taken = (f"{run.name} {k}" for k in count(2)), [name for name, *_ in logs]
            name = next(name for name in chain([run.name], more) if name not in taken)
            log = run.log
            if log is not None and name != run.name:
                log = replace(log, name=name)
            logs.append(known := (name, log, []))
        name, log, parts = known
        parts.append(run)
        return run if name == run.name else replace(run, name=name, log=log)

    return [tuple(map(named, each)) for each in data]


def _are_of_one_log(run: Recording, parts: Sequence[Recording]) -> bool:
    """Whether a recording is a part of the log of others: where that is not kept, by its times."""
    if run.log is not None or parts[0].log is not None:
        return run.log is parts[0].log
    start, end = run.motion.time[[0, -1]]
    apart = (end < part.motion.time[0] or part.motion.time[-1] < start for part in parts)
    return run.name == parts[0].name and (any(run is part for part in parts) or all(apart))


def each_of(data: Any) -> Sequence[Any]:
    """Data as a list, also of a single one."""
    return data if isinstance(data, list | tuple) else [data]


def require_some(data: Any) -> Any:
    """The first of the data; an OptionError where there are none."""
    for first in each_of(data):
        return first
    raise OptionError(f"data must be {FORMS}, or a list of these, not an empty list", given=data)


def require_no_repetition(recordings: Sequence[Recording]) -> None:
    """Refuse a log that is there twice: what is left out of a fit would be in it."""
    for k, run in enumerate(recordings):
        for other in recordings[:k]:
            if np.array_equal(run.force, other.force):
                names = run.name if run.name == other.name else f"{other.name} and {run.name}"
                raise DataError(
                    f"the forces of two logs are the same ({names}): give each log once, as one "
                    "that stands twice judges itself"
                )


def _recording(robot: Robot, data: Any, mapping: Any) -> Recording:
    if isinstance(data, Recording):
        require_robot(data, robot)
        return data
    if isinstance(data, str | Path):
        from loopid.logs.reading import read_log  # where files are read

        data = read_log(data, robot, mapping=mapping)
    elif isinstance(data, Measurement):
        data = Log.from_arrays(data.time, data.position, data.force, data.motors, name="simulated")
    elif isinstance(data, Mapping) or hasattr(type(data), "columns"):
        data = Log.from_frame(data, robot.actuated, mapping=mapping)
    if not isinstance(data, Log):
        raise OptionError(
            f"data must be {FORMS}, or a list of these, not {type(data).__name__}", given=data
        )
    return prepare(robot, data)
