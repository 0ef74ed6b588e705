"""From the steps of a motion file to the ways between poses."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from loopid.arrays import FloatArray, frozen
from loopid.errors import RobotFileError
from loopid.trajectories.program_file import (
    HoldStep,
    MoveStep,
    RepeatStep,
    Step,
    ThereAndBackStep,
)
from loopid.trajectories.waypoints import Arc, Waypoint

# Ways in a motion: nested repeats multiply, and a slip of the pen should not fill the memory.
MOST_WAYS = 100_000


@dataclass(frozen=True)
class Way:
    """From a pose to a pose, both (c,), in some seconds."""

    start: FloatArray
    end: FloatArray
    seconds: float
    arcs: tuple[Arc, ...] = ()

    def backwards(self) -> Way:
        """The same path and time from end to start: arcs are symmetric."""
        return Way(self.end, self.start, self.seconds, self.arcs)

    @property
    def waypoint(self) -> Waypoint:
        """Where the way leads."""
        return Waypoint(self.end, self.seconds, self.arcs)


@dataclass(frozen=True)
class StepReader:
    """Follow steps from pose to pose.

    Attributes
    ----------
    coordinates : tuple of str
    speeds : mapping
        Average speeds of coordinates, in m/s or rad/s, for moves that name neither time nor speed.
    shortest : float
        Least time in s of moves at these speeds: short ways would be jerky otherwise.
    """

    coordinates: tuple[str, ...]
    speeds: Mapping[str, float]
    shortest: float = 0.0

    def ways(self, steps: Sequence[Step], start: FloatArray, place: str) -> list[Way]:
        """Ways of all steps in turn; ``place`` says in errors where the steps are written.

        Raises
        ------
        RobotFileError
            Naming the step.
        """
        found: list[Way] = []
        for number, step in enumerate(steps):
            here = found[-1].end if found else start
            found += self._step(step, here, f"{place}.{number}")
            if len(found) > MOST_WAYS:
                raise RobotFileError(f"{place}.{number}: more than {MOST_WAYS} ways in one motion")
        return found

    def pose(self, values: Mapping[str, float], start: FloatArray, place: str) -> FloatArray:
        """The start with some coordinates changed; (c,)."""
        self.check(values, place)
        return frozen([values.get(n, x) for n, x in zip(self.coordinates, start, strict=True)])

    def check(self, names: Iterable[str], place: str) -> None:
        """Refuse names that are no coordinates."""
        for name in names:
            if name not in self.coordinates:
                listed = ", ".join(self.coordinates)
                raise RobotFileError(f"{place}: unknown coordinate {name!r}: choose among {listed}")

    def _step(self, step: Step, here: FloatArray, place: str) -> list[Way]:
        match step:
            case HoldStep():
                return [Way(here, here, step.hold)]
            case MoveStep():
                return [self._move(step, here, place)]
            case RepeatStep():
                return self._repeat(step, here, place)
            case ThereAndBackStep():
                return self._there_and_back(step, here, place)

    def _repeat(self, step: RepeatStep, here: FloatArray, place: str) -> list[Way]:
        # Each round starts where the one before ended, which need not be where that one started.
        found = self.ways(step.steps, here, f"{place}.steps")
        if step.repeat * len(found) > MOST_WAYS:
            raise RobotFileError(f"{place}: more than {MOST_WAYS} ways in one motion")
        for _ in range(step.repeat - 1):
            found += self.ways(step.steps, found[-1].end, f"{place}.steps")
        return found

    def _there_and_back(self, step: ThereAndBackStep, here: FloatArray, place: str) -> list[Way]:
        there = self.ways(step.there_and_back, here, f"{place}.there_and_back")
        far = there[-1].end
        between = self.ways(step.between or [], far, f"{place}.between")
        if between and (between[-1].end != far).any():
            raise RobotFileError(
                f"{place}.between: must end where it begins, at {self._said(far)}, "
                f"not at {self._said(between[-1].end)}"
            )
        return [*there, *between, *(way.backwards() for way in reversed(there))]

    def _move(self, step: MoveStep, here: FloatArray, place: str) -> Way:
        end = self.pose(step.to, here, f"{place}.to")
        self.check(step.arcs, f"{place}.arcs")
        arcs = tuple(Arc(name, arc.height, arc.flatness) for name, arc in step.arcs.items())
        seconds = step.seconds
        if seconds is None:
            seconds = self._seconds(step.speed, end - here, place)
        return Way(here, end, seconds, arcs)

    def _seconds(self, speed: float | None, change: FloatArray, place: str) -> float:
        """Time for a change (c,) at the speed of its only coordinate, or at those of the file."""
        changes = dict(zip(self.coordinates, np.abs(change), strict=True))
        moved = [name for name, change in changes.items() if change > 0]
        if not moved:
            raise RobotFileError(f"{place}: is there already, so that it needs seconds, or a hold")
        shortest = 0.0
        if speed is None:
            speeds, shortest = self.speeds, self.shortest
        elif len(moved) == 1:
            speeds = {moved[0]: speed}
        else:
            raise RobotFileError(
                f"{place}.speed: is of one coordinate, but {', '.join(moved)} move: give seconds"
            )
        for name in moved:
            if name not in speeds:
                raise RobotFileError(
                    f"{place}: needs seconds or a speed, as 'speeds' has none for {name}"
                )
        return max(shortest, *(float(changes[name]) / speeds[name] for name in moved))

    def _said(self, pose: FloatArray) -> str:
        values = zip(self.coordinates, pose, strict=True)
        return ", ".join(f"{name} = {value:g}" for name, value in values)
