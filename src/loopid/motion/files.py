"""Motion files: named motions between poses, written as steps, and rows of sampled motions."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from contextlib import closing
from dataclasses import dataclass, replace
from io import BytesIO
from itertools import chain
from pathlib import Path
from types import MappingProxyType
from typing import Annotated, Any

import numpy as np
from pydantic import Discriminator, Field, Tag, model_validator

from loopid.arguments import (
    FloatArray,
    checked,
    frozen,
    number,
)
from loopid.errors import (
    DataError,
    FileError,
    LogError,
    OptionError,
    RobotFileError,
)
from loopid.files import (
    text_blocks,
    why_no_file,
)
from loopid.loading.files import find_motion_file
from loopid.motion.filtering import (
    LowPass,
    differentiate,
)
from loopid.motion.trajectories import (
    MOST_SAMPLES,
    Arc,
    FourierCurve,
    Motion,
    SplineCurve,
    Waypoint,
    point_to_point,
)
from loopid.yaml_files import (
    Section,
    read_yaml,
)

# References drawn with straight lines have steps in velocity. At 2 Hz these become accelerations
# that a drive can follow, and the path cuts a corner by 0.6 mm at 0.02 m/s (1 mrad at 0.035 rad/s).
SMOOTHING = LowPass(2.0)
# Ways in a motion: nested repeats multiply, and a slip of the pen should not fill the memory.
MOST_WAYS = 100_000

Positive = Annotated[float, Field(gt=0)]
Pose = Annotated[dict[str, float], Field(min_length=1)]


# ---- what a file may say ----------------------------------------------------------------------


class HoldStep(Section):
    """Stay for some seconds."""

    hold: Positive


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


class RepeatStep(Section):
    """Do some steps several times."""

    repeat: Annotated[int, Field(ge=1)]
    steps: Steps


class ThereAndBackStep(Section):
    """Do some steps, then others that end where they begin, then the first ones backwards."""

    there_and_back: Steps
    between: Steps | None = None


class HarmonicsDescription(Section):
    """Sines and cosines of one coordinate, see ``FourierCurve``."""

    sine: list[float]
    cosine: list[float]


class FourierStep(Section):
    """One period of Fourier series, from rest to rest."""

    fourier: Annotated[dict[str, HarmonicsDescription], Field(min_length=1)]
    seconds: Positive


class SplineStep(Section):
    """A spline through poses at equal times and back, from rest to rest."""

    spline: Annotated[list[Pose], Field(min_length=1)]
    seconds: Positive


KINDS = ("hold", "to", "repeat", "there_and_back", "fourier", "spline")


def _kind(content: Any) -> str | None:
    """Tag of the step that a mapping describes, by the key that says so."""
    keys = content if isinstance(content, dict) else ()
    return next((f"<{kind}>" for kind in KINDS if kind in keys), None)


Step = Annotated[
    Annotated[HoldStep, Tag("<hold>")]
    | Annotated[MoveStep, Tag("<to>")]
    | Annotated[RepeatStep, Tag("<repeat>")]
    | Annotated[ThereAndBackStep, Tag("<there_and_back>")]
    | Annotated[FourierStep, Tag("<fourier>")]
    | Annotated[SplineStep, Tag("<spline>")],
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


@dataclass(frozen=True, repr=False)
class PlannedMotion:
    """A motion of a file, with its steps followed."""

    description: str  # what the file says of it
    start: FloatArray  # (c,) in m or rad
    waypoints: tuple[Waypoint, ...]  # repeats and ways back are written out

    def __repr__(self) -> str:
        ways = len(self.waypoints)
        return f"<PlannedMotion {self.description!r:.200}: {ways} waypoints, {self.seconds:g} s>"

    @property
    def seconds(self) -> float:
        """How long it takes."""
        return sum(waypoint.seconds for waypoint in self.waypoints)


@dataclass(frozen=True, repr=False)
class MotionProgram:
    """The motions of a file."""

    path: Path  # file it was read from
    # The c coordinates that all motions move: platform coordinates or joints
    coordinates: tuple[str, ...]
    rate: float  # samples per second where nothing else is asked for
    # From the names to ``PlannedMotion``, in the order of the file
    motions: Mapping[str, PlannedMotion]

    def __repr__(self) -> str:
        names = f"{', '.join(self.motions):.500}"
        return f"<MotionProgram {self.path.name}: {names} of {', '.join(self.coordinates)}>"

    @property
    def seconds(self) -> dict[str, float]:
        """How long each motion takes, by its name."""
        return {name: plan.seconds for name, plan in self.motions.items()}

    @checked
    def motion(self, name: str | None = None, rate: float | None = None) -> Motion:
        """Sample a motion, smooth to the acceleration and at rest in every waypoint.

        By default the first one of the file, with the file's rate in Hz.
        """
        name = next(iter(self.motions)) if name is None else name
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
    FileError
        When there is no such file.
    RobotFileError
        Naming the file, the place in it and what is valid.

    Examples
    --------
    >>> import loopid
    >>> program = loopid.read_motion_program("3ups_rpu")
    >>> list(program.motions)
    ['1', '2', '3', '4', '5', '6', '7', '8', '9']
    >>> round(program.motions["5"].seconds, 1)
    191.8
    """
    file = find_motion_file(path)
    content = read_yaml(file, ProgramDescription)
    reader = _StepReader(tuple(content.coordinates), content.speeds, content.shortest)
    reader.check(content.speeds, f"{file}: speeds")
    motions = {
        name: reader.plan(motion, f"{file}: motions.{name}")
        for name, motion in content.motions.items()
    }
    return MotionProgram(file, reader.coordinates, content.rate, MappingProxyType(motions))


@dataclass(frozen=True)
class _StepReader:
    """Follows steps from pose to pose; ``place`` says in errors where they are written."""

    coordinates: tuple[str, ...]
    speeds: Mapping[str, float]
    shortest: float

    def plan(self, motion: MotionDescription, place: str) -> PlannedMotion:
        missing = [name for name in self.coordinates if name not in motion.start]
        if missing:
            raise RobotFileError(f"{place}.start: leaves out {', '.join(missing)}")
        start = self._pose(motion.start, np.zeros(len(self.coordinates)), f"{place}.start")
        ways = self._ways(motion.steps, start, f"{place}.steps")
        return PlannedMotion(motion.description, start, tuple(ways))

    def check(self, names: Iterable[str], place: str) -> None:
        """Refuse names that are no coordinates."""
        for name in names:
            if name not in self.coordinates:
                listed = ", ".join(self.coordinates)
                raise RobotFileError(f"{place}: unknown coordinate {name!r}: choose among {listed}")

    def _pose(self, values: Mapping[str, float], start: FloatArray, place: str) -> FloatArray:
        """The start with some coordinates changed; (c,)."""
        self.check(values, place)
        return frozen([values.get(n, x) for n, x in zip(self.coordinates, start, strict=True)])

    def _ways(self, steps: Sequence[Step], start: FloatArray, place: str) -> list[Waypoint]:
        found: list[Waypoint] = []
        for k, step in enumerate(steps):
            here = found[-1].position if found else start
            found += self._step(step, here, f"{place}.{k}")
            if len(found) > MOST_WAYS:
                raise RobotFileError(f"{place}.{k}: more than {MOST_WAYS} ways in one motion")
        return found

    def _step(self, step: Step, here: FloatArray, place: str) -> list[Waypoint]:
        match step:
            case HoldStep():
                return [Waypoint(here, step.hold)]
            case MoveStep():
                end = self._pose(step.to, here, f"{place}.to")
                self.check(step.arcs, f"{place}.arcs")
                arcs = tuple(Arc(name, arc.height, arc.flatness) for name, arc in step.arcs.items())
                seconds = step.seconds
                if seconds is None:
                    seconds = self._seconds(step.speed, end - here, place)
                return [Waypoint(end, seconds, arcs)]
            case FourierStep():
                return [Waypoint(here, step.seconds, curve=self._series(step, place))]
            case SplineStep():
                through = [self._pose(pose, here, f"{place}.spline") for pose in step.spline]
                return [Waypoint(here, step.seconds, curve=SplineCurve(np.array(through) - here))]
            case RepeatStep():
                # Each round starts where the one before ended, which need not be its start.
                found = self._ways(step.steps, here, f"{place}.steps")
                if step.repeat * len(found) > MOST_WAYS:
                    raise RobotFileError(f"{place}: more than {MOST_WAYS} ways in one motion")
                for _ in range(step.repeat - 1):
                    found += self._ways(step.steps, found[-1].position, f"{place}.steps")
                return found
            case ThereAndBackStep():
                there = self._ways(step.there_and_back, here, f"{place}.there_and_back")
                far = there[-1].position
                between = self._ways(step.between or [], far, f"{place}.between")
                if between and (between[-1].position != far).any():
                    raise RobotFileError(
                        f"{place}.between: must end where it begins, at {self._said(far)}, "
                        f"not at {self._said(between[-1].position)}"
                    )
                # The same paths and times from end to start: arcs are symmetric.
                starts = [here, *(way.position for way in there[:-1])]
                back = [
                    replace(w, position=s, curve=w.curve and w.curve.backwards())
                    for w, s in zip(there, starts, strict=True)
                ]
                return [*there, *between, *reversed(back)]

    def _series(self, step: FourierStep, place: str) -> FourierCurve:
        self.check(step.fourier, f"{place}.fourier")
        series = step.fourier.values()
        counts = {len(terms) for each in series for terms in (each.sine, each.cosine)}
        if counts == {0} or len(counts) > 1:
            raise RobotFileError(
                f"{place}.fourier: needs equally many sines and cosines everywhere"
            )
        shape = np.zeros((2 * counts.pop(), len(self.coordinates)))
        for name, each in step.fourier.items():
            shape[:, self.coordinates.index(name)] = [*each.sine, *each.cosine]
        try:
            return FourierCurve(shape)
        except DataError as error:
            raise RobotFileError(f"{place}.fourier: {error}") from None

    def _seconds(self, speed: float | None, change: FloatArray, place: str) -> float:
        """Time for a change (c,) at the speed of its only coordinate, or at those of the file."""
        changes = {n: abs(float(x)) for n, x in zip(self.coordinates, change, strict=True) if x}
        if not changes:
            raise RobotFileError(f"{place}: is there already, so that it needs seconds, or a hold")
        if speed is not None:
            if len(changes) > 1:
                raise RobotFileError(
                    f"{place}.speed: is of one coordinate, but {', '.join(changes)} move: give "
                    "seconds"
                )
            return next(iter(changes.values())) / speed
        for name in changes:
            if name not in self.speeds:
                raise RobotFileError(
                    f"{place}: needs seconds or a speed, as 'speeds' has none for {name}"
                )
        return max(self.shortest, *(change / self.speeds[n] for n, change in changes.items()))

    def _said(self, pose: FloatArray) -> str:
        values = zip(self.coordinates, pose, strict=True)
        return ", ".join(f"{name} = {value:g}" for name, value in values)


# ---- sampled motions ---------------------------------------------------------------------------


@checked
def read_reference(
    path: str | Path, names: Sequence[str], rate: float = 100.0, lowpass: LowPass = SMOOTHING
) -> Motion:
    """Read an evenly sampled motion, smoothed without delay so that it has accelerations.

    Parameters
    ----------
    path : str or Path
        Text, or text packed by gzip (``.gz``): rows of numbers with white space between.
    names : sequence of str
        The c coordinates, in the order of the columns.
    rate : float
        Rows per second.
    lowpass : LowPass
        Smooths the positions; velocities and accelerations are their central differences.

    Raises
    ------
    FileError
        When there is no such file.
    LogError
        Naming the line that is not c finite numbers, or when there are too few.
    OptionError
        When a name comes twice, or the rate or the cut-off frequency does not fit.

    Examples
    --------
    >>> import numpy as np
    >>> import loopid
    >>> from pathlib import Path
    >>> from tempfile import TemporaryDirectory
    >>> with TemporaryDirectory() as folder:
    ...     path = Path(folder) / "reference.txt"
    ...     np.savetxt(path, np.linspace(0, 1, 301))
    ...     loopid.motion.read_reference(path, ["crank_joint"], rate=100)
    <Motion of crank_joint: 301 samples, 3 s>
    """
    if not names or len(set(names)) < len(names):
        raise OptionError(f"the names of the columns must differ, not {', '.join(names) or 'none'}")
    if not 0 < rate < np.inf:
        raise OptionError(f"the rate must be positive, not {rate} Hz")
    file = Path(path)
    rows: list[list[float]] = []
    if why_no_file(file) == "does not exist":
        raise FileError(f"{file} does not exist")
    with closing(text_blocks(file)) as blocks:
        for line, data in enumerate(chain.from_iterable(map(BytesIO, blocks)), 1):
            words = data.decode("utf-8", "replace").split()
            values = [number(word) for word in words]
            whole = len(values) == len(names) and bool(np.isfinite(values).all())
            if words and not (whole and line == len(rows) + 1):  # blank lines are at the end only
                raise LogError(
                    f"{file}, line {line}: must follow a row, and be {len(names)} finite numbers "
                    f"({', '.join(names)}), not {' '.join(words)!r:.60}"
                )
            rows += [values] if words else []
            if len(rows) > MOST_SAMPLES:
                raise LogError(f"{file} has more than the {MOST_SAMPLES:,} rows of a motion")
    least = lowpass.least_samples(rate)
    if len(rows) < least:
        raise LogError(
            f"{file}: {len(rows)} samples are too few to smooth at {lowpass.cutoff:g} Hz: it "
            f"takes {least} at {rate:g} Hz"
        )
    position = lowpass.apply(np.array(rows), rate)
    velocity = differentiate(position, rate)
    time = np.arange(len(position)) / rate
    return Motion(tuple(names), time, position, velocity, differentiate(velocity, rate))
