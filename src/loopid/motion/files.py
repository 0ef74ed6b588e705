"""Motion files: named motions between poses, written as steps, and rows of sampled motions."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from difflib import get_close_matches
from pathlib import Path
from typing import Annotated, Any, NoReturn

import numpy as np
from pydantic import Discriminator, Field, Tag, model_validator

from loopid.arguments import FloatArray, Positive, checked
from loopid.border import Section
from loopid.errors import DataError, OptionError, RobotFileError, unknown_word
from loopid.loading.files import find_motion_file
from loopid.motion.trajectories import Arc, FourierCurve, Motion, Waypoint, point_to_point
from loopid.records import record
from loopid.yaml_files import placing, read_yaml, yaml_text

# Ways in a motion: nested repeats multiply, and a slip of the pen should not fill the memory.
MOST_WAYS = 100_000

Pose = Annotated[dict[str, float], Field(min_length=1)]


# ---- what a file may say ----------------------------------------------------------------------


@dataclass(frozen=True)
class Place:
    """Where in a file steps are written, and what it says of all its motions."""

    path: Path
    keys: tuple[str | int, ...]
    coordinates: tuple[str, ...]
    speeds: Mapping[str, float]
    shortest: float

    def at(self, part: str | int) -> Place:
        """A place inside this one."""
        return replace(self, keys=(*self.keys, part))

    def refuse(self, problem: str, **facts: Any) -> NoReturn:
        """Raise an error that names the place."""
        with placing(self.path):
            raise RobotFileError(f"{self.path}: {problem}", keys=self.keys, **facts)

    def require_known(self, names: Iterable[str]) -> None:
        """Refuse names that are no coordinates."""
        for name in names:
            if name not in self.coordinates:
                problem = unknown_word("coordinate", name, self.coordinates)
                self.at(name).refuse(problem, given=name, valid=self.coordinates)

    def pose(self, values: Mapping[str, float], start: FloatArray) -> FloatArray:
        """The start with some coordinates changed; (c,)."""
        self.require_known(values)
        known = zip(self.coordinates, start, strict=True)
        return np.array([values.get(name, x) for name, x in known], dtype=np.float64)

    def ways(self, steps: Sequence[Step], start: FloatArray) -> list[Waypoint]:
        """The ways of steps, each from where the one before ended."""
        found: list[Waypoint] = []
        for k, step in enumerate(steps):
            found += step.ways(found[-1].position if found else start, self.at(k))
            self.at(k).require_few(len(found))
        return found

    def require_few(self, count: int) -> None:
        """Refuse more ways than a motion may have."""
        if count > MOST_WAYS:
            self.refuse(f"more than {MOST_WAYS} ways in one motion", count=count, valid=MOST_WAYS)


class HoldStep(Section):
    """Stay for some seconds."""

    hold: Positive

    def ways(self, here: FloatArray, place: Place) -> list[Waypoint]:
        """What a step does from where it begins (c,); a RobotFileError names its place."""
        return [Waypoint(here, self.hold)]


class ArcDescription(Section):
    """See ``Arc``."""

    height: float
    flatness: Annotated[float, Field(ge=0, lt=1)] = 0.0


class MoveStep(Section):
    """Move the coordinates that are named, in a time or at the average speed of the only one."""

    to: Pose
    seconds: Positive | None = None
    speed: Positive | None = None
    arcs: dict[str, ArcDescription] = Field(default={})

    @model_validator(mode="after")
    def _one_time(self) -> MoveStep:
        if self.seconds is not None and self.speed is not None:
            raise ValueError("give either seconds or a speed, not both")
        return self

    def ways(self, here: FloatArray, place: Place) -> list[Waypoint]:
        end = place.at("to").pose(self.to, here)
        place.at("arcs").require_known(self.arcs)
        arcs = tuple(Arc(name, arc.height, arc.flatness) for name, arc in self.arcs.items())
        seconds = self.seconds if self.seconds is not None else self._seconds(end - here, place)
        return [Waypoint(end, seconds, arcs)]

    def _seconds(self, change: FloatArray, place: Place) -> float:
        """Time for a change (c,) at the speed of its only coordinate, or at those of the file."""
        changes = {n: abs(float(x)) for n, x in zip(place.coordinates, change, strict=True) if x}
        if not changes:
            place.refuse("is there already, so that it needs seconds, or a hold")
        if self.speed is not None:
            if len(changes) > 1:
                moved = ", ".join(changes)
                place.at("speed").refuse(f"is of one coordinate, but {moved} move: give seconds")
            return next(iter(changes.values())) / self.speed
        for name in changes:
            if name not in place.speeds:
                place.refuse(f"needs seconds or a speed: 'speeds' has none for {name}")
        return max(place.shortest, *(x / place.speeds[name] for name, x in changes.items()))


class RepeatStep(Section):
    """Do some steps several times."""

    repeat: Annotated[int, Field(ge=1)]
    steps: Steps

    def ways(self, here: FloatArray, place: Place) -> list[Waypoint]:
        # Each round starts where the one before ended, which need not be its start.
        inside, found = place.at("steps"), list[Waypoint]()
        for _ in range(self.repeat):
            found += inside.ways(self.steps, found[-1].position if found else here)
            place.require_few(max(len(found), self.repeat))  # a round is a way at least
        return found


class ThereAndBackStep(Section):
    """Do some steps, then others that end where they begin, then the first ones backwards."""

    there_and_back: Steps
    between: Steps | None = None

    def ways(self, here: FloatArray, place: Place) -> list[Waypoint]:
        there = place.at("there_and_back").ways(self.there_and_back, here)
        far = there[-1].position
        between = place.at("between").ways(self.between or [], far)
        if between and (between[-1].position != far).any():
            begin, end = (
                ", ".join(f"{n} = {x:g}" for n, x in zip(place.coordinates, pose, strict=True))
                for pose in (far, between[-1].position)
            )
            place.at("between").refuse(f"must end where it begins, at {begin}, not at {end}")
        # The same paths and times from end to start: arcs are symmetric.
        starts = [here, *(way.position for way in there[:-1])]
        back = [
            replace(way, position=start, curve=way.curve and way.curve.backwards())
            for way, start in zip(there, starts, strict=True)
        ]
        return [*there, *between, *reversed(back)]


class HarmonicsDescription(Section):
    """Sines and cosines of one coordinate, see ``FourierCurve``."""

    sine: list[float]
    cosine: list[float]


class FourierStep(Section):
    """One period of Fourier series, from rest to rest."""

    fourier: Annotated[dict[str, HarmonicsDescription], Field(min_length=1)]
    seconds: Positive

    def ways(self, here: FloatArray, place: Place) -> list[Waypoint]:
        inside = place.at("fourier")
        inside.require_known(self.fourier)
        counts = {len(part) for each in self.fourier.values() for part in (each.sine, each.cosine)}
        if counts == {0} or len(counts) > 1:
            inside.refuse("needs equally many sines and cosines everywhere")
        shape = np.zeros((2 * counts.pop(), len(place.coordinates)))
        for name, each in self.fourier.items():
            shape[:, place.coordinates.index(name)] = [*each.sine, *each.cosine]
        try:
            return [Waypoint(here, self.seconds, curve=FourierCurve(shape))]
        except DataError as error:
            inside.refuse(str(error))


KINDS = ("hold", "to", "repeat", "there_and_back", "fourier")


def _kind(content: Any) -> str | None:
    """Tag of the step that a mapping describes, by the key that says so."""
    keys = [*map(str, content)] if isinstance(content, dict) else []
    meant = [kind for key in keys for kind in get_close_matches(key, KINDS, n=1)]
    kinds = [*(kind for kind in KINDS if kind in keys), *meant]
    return f"<{kinds[0]}>" if kinds else None


Step = Annotated[
    Annotated[HoldStep, Tag("<hold>")]
    | Annotated[MoveStep, Tag("<to>")]
    | Annotated[RepeatStep, Tag("<repeat>")]
    | Annotated[ThereAndBackStep, Tag("<there_and_back>")]
    | Annotated[FourierStep, Tag("<fourier>")],
    Discriminator(
        _kind,
        custom_error_type="step",
        custom_error_message=f"a step has one of the keys {', '.join(KINDS)}",
    ),
]
Steps = Annotated[list[Step], Field(min_length=1)]


class MotionDescription(Section):
    """A motion: where it starts, and its steps."""

    description: str = ""
    start: Pose
    steps: Steps


class ProgramDescription(Section):
    """The whole file."""

    coordinates: Annotated[list[str], Field(min_length=1)]
    rate: Positive = 100.0
    speeds: dict[str, Positive] = Field(default={})
    shortest: Annotated[float, Field(ge=0)] = 0.0
    motions: Annotated[dict[str, MotionDescription], Field(min_length=1)]

    @model_validator(mode="after")
    def _coordinates_differ(self) -> ProgramDescription:
        for name in self.coordinates:
            if self.coordinates.count(name) > 1:
                raise ValueError(f"coordinate {name!r} is listed twice")
        return self


# ---- what is made of it -----------------------------------------------------------------------


@record(checked="outside")
class PlannedMotion:
    """A motion of a file, with its steps followed.

    Examples
    --------
    >>> import loopid
    >>> plan = loopid.motion.read_motion_program("3ups_rpu").motions["5"]
    >>> plan.name, plan.start.shape
    ('5', (4,))
    """

    name: str
    description: str  # what the file says of it
    start: FloatArray  # (c,) in m or rad
    waypoints: tuple[Waypoint, ...]  # repeats and ways back are written out

    @property
    def seconds(self) -> float:
        """How long it takes."""
        return sum(waypoint.seconds for waypoint in self.waypoints)


@record(checked=True)
class MotionProgram:
    """The motions of a file.

    Examples
    --------
    >>> import loopid
    >>> program = loopid.motion.read_motion_program("3ups_rpu")
    >>> program.coordinates, len(program.motions)
    (('x_m', 'z_m', 'theta', 'psi'), 9)
    """

    path: Path = field(compare=False)  # file it was read from
    # The c coordinates that all motions move: platform coordinates or joints
    coordinates: tuple[str, ...]
    rate: float  # samples per second where none is given
    plans: tuple[PlannedMotion, ...]  # in the order of the file

    @property
    def motions(self) -> dict[str, PlannedMotion]:
        """The motions by their names."""
        return {plan.name: plan for plan in self.plans}

    @property
    def seconds(self) -> dict[str, float]:
        """How long each motion takes, by its name."""
        return {name: plan.seconds for name, plan in self.motions.items()}

    def motion(self, name: str | None = None, rate: float | None = None) -> Motion:
        """Sample a motion, smooth to the acceleration and at rest in every waypoint.

        By default the first one of the file, with the file's rate in Hz.
        """
        name = next(iter(self.motions)) if name is None else name
        OptionError.require("motion", name, self.motions)
        plan, rate = self.motions[name], self.rate if rate is None else rate
        return point_to_point(self.coordinates, plan.start, plan.waypoints, rate=rate)


@checked
def read_motion_program(path: str | Path) -> MotionProgram:
    """Read and check a motion file.

    Parameters
    ----------
    path : str or Path
        A YAML file (see docs/motion_files.md), or the name of a robot with bundled motions such as
        ``"3ups_rpu"``.

    Returns
    -------
    MotionProgram

    Raises
    ------
    FileError
        When there is no such file.
    RobotFileError
        Naming the file, the place in it and what is valid.

    Examples
    --------
    >>> import loopid
    >>> program = loopid.motion.read_motion_program("3ups_rpu")
    >>> list(program.motions)
    ['1', '2', '3', '4', '5', '6', '7', '8', '9']
    >>> round(program.motions["5"].seconds, 1)
    191.8
    """
    file = find_motion_file(path)
    content = read_yaml(file, ProgramDescription)
    coordinates = tuple(content.coordinates)

    def place(*keys: str) -> Place:
        return Place(file, keys, coordinates, content.speeds, content.shortest)

    place("speeds").require_known(content.speeds)
    every = content.motions.items()
    plans = tuple(_planned(name, motion, place("motions", name)) for name, motion in every)
    return MotionProgram(file, coordinates, content.rate, plans)


def _planned(name: str, motion: MotionDescription, place: Place) -> PlannedMotion:
    """A motion with its steps followed."""
    missing = [name for name in place.coordinates if name not in motion.start]
    if missing:
        place.at("start").refuse(f"leaves out {', '.join(missing)}", missing=tuple(missing))
    start = place.at("start").pose(motion.start, np.zeros(len(place.coordinates)))
    ways = place.at("steps").ways(motion.steps, start)
    return PlannedMotion(name, motion.description, start, tuple(ways))


def motion_text(
    name: str, description: str, motion: Motion, start: FloatArray, waypoints: Iterable[Waypoint]
) -> str:
    """The file of one motion from a start (c,), as ``read_motion_program`` reads it."""

    def pose(values: FloatArray) -> dict[str, float]:
        return dict(zip(motion.names, values.tolist(), strict=True))

    here, steps = start, list[dict[str, Any]]()
    for waypoint in waypoints:
        curve, step = waypoint.curve, dict[str, Any](seconds=float(waypoint.seconds))
        if isinstance(curve, FourierCurve):
            parts = (part.T.tolist() for part in np.split(curve.shape, 2))
            both = zip(motion.names, *parts, strict=True)
            step = {"fourier": {x: {"sine": s, "cosine": c} for x, s, c in both}} | step
        elif (waypoint.position == here).all():
            step = {"hold": step["seconds"]}
        else:
            step = {"to": pose(waypoint.position)} | step
        steps.append(step)
        here = waypoint.position
    rate = float((len(motion) - 1) / motion.duration)
    said = {"description": description, "start": pose(start), "steps": steps}
    return yaml_text({"coordinates": [*motion.names], "rate": rate, "motions": {name: said}})
