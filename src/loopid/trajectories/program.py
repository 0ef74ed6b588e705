"""Motion files: named motions between poses, written as steps."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType

import numpy as np

from loopid.arguments import checked
from loopid.arrays import FloatArray
from loopid.errors import OptionError, RobotFileError
from loopid.loading import find_motion_file, read_yaml
from loopid.trajectories.motion import Motion
from loopid.trajectories.program_file import MotionDescription, ProgramDescription
from loopid.trajectories.steps import StepReader
from loopid.trajectories.waypoints import Waypoint, point_to_point


@dataclass(frozen=True)
class PlannedMotion:
    """A motion of a file, with its steps followed.

    Attributes
    ----------
    description : str
        What the file says of it.
    start : FloatArray
        (c,) in m or rad.
    waypoints : tuple of Waypoint
        Repeats and ways back are written out.
    """

    description: str
    start: FloatArray
    waypoints: tuple[Waypoint, ...]

    @property
    def seconds(self) -> float:
        """How long it takes."""
        return sum(waypoint.seconds for waypoint in self.waypoints)


@dataclass(frozen=True)
class MotionProgram:
    """The motions of a file.

    Attributes
    ----------
    path : Path
        File it was read from.
    coordinates : tuple of str
        The c coordinates that all motions move: platform coordinates or joints.
    rate : float
        Samples per second where nothing else is asked for.
    motions : mapping
        From the names to ``PlannedMotion``, in the order of the file.
    """

    path: Path
    coordinates: tuple[str, ...]
    rate: float
    motions: Mapping[str, PlannedMotion]

    @checked
    def motion(self, name: str, rate: float | None = None) -> Motion:
        """Sample a motion, smooth to the acceleration and at rest in every waypoint.

        Parameters
        ----------
        name : str
        rate : float, optional
            Samples per second; by default the rate of the file.

        Raises
        ------
        OptionError
            Listing the motions.
        DataError
            When the rate is not positive.
        """
        if name not in self.motions:
            raise OptionError.unknown("motion", name, self.motions)
        plan, rate = self.motions[name], self.rate if rate is None else rate
        return point_to_point(self.coordinates, plan.start, plan.waypoints, rate)


@checked
def read_motion_program(path: str | Path) -> MotionProgram:
    """Read and check a motion file.

    Parameters
    ----------
    path : str or Path
        A YAML file (see docs/motion_files.md), or the name of a robot with bundled motions such as
        ``"3ups_rpu"``.

    Raises
    ------
    MissingFileError
        When there is no such file.
    RobotFileError
        Naming the file, the place in it and what is valid.
    """
    file = find_motion_file(path)
    content = read_yaml(file, ProgramDescription)
    reader = StepReader(tuple(content.coordinates), content.speeds, content.shortest)
    reader.check(content.speeds, f"{file}: speeds")
    motions = {
        name: _plan(reader, motion, f"{file}: motions.{name}")
        for name, motion in content.motions.items()
    }
    return MotionProgram(file, reader.coordinates, content.rate, MappingProxyType(motions))


def _plan(reader: StepReader, motion: MotionDescription, place: str) -> PlannedMotion:
    missing = [name for name in reader.coordinates if name not in motion.start]
    if missing:
        raise RobotFileError(f"{place}.start: leaves out {', '.join(missing)}")
    nowhere = np.zeros(len(reader.coordinates))
    start = reader.pose(motion.start, nowhere, f"{place}.start")
    ways = reader.ways(motion.steps, start, f"{place}.steps")
    return PlannedMotion(motion.description, start, tuple(way.waypoint for way in ways))
