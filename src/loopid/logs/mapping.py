"""What a mapping file says: which columns of a log are what, with their units and delays."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any, Literal, TypeVar

import numpy as np
from pydantic import AfterValidator, Discriminator, Field, Tag, ValidationError, model_validator

from loopid.arguments import NotNegative, Positive, checked
from loopid.border import Section, refusal, unknown
from loopid.errors import LogError, OptionError
from loopid.logs.table import COMPONENTS, POSE_PERIOD
from loopid.registry import log_formats
from loopid.yaml_files import read_yaml, yaml_text

# Condition number from which a joint map is no true one.
LARGEST_CONDITION = 1e6


class TimeColumns(Section):
    """One column with a unit, or two that add up."""

    column: str | None = None
    unit: Literal["s", "ms", "us", "ns"] | None = None
    seconds: str | None = None
    nanoseconds: str | None = None

    @model_validator(mode="after")
    def _one_way(self) -> TimeColumns:
        missing = [self.seconds, self.nanoseconds].count(None)
        if missing != (0 if self.column is None else 2):
            raise ValueError("give either 'column', or both 'seconds' and 'nanoseconds'")
        return self


class StreamColumns(Section):
    """Columns in the order of the motors; without names, all but those of the time."""

    stream: str | None = None
    columns: list[str] | None = None

    @model_validator(mode="after")
    def _something(self) -> StreamColumns:
        if self.stream is None and self.columns is None:
            raise ValueError("give 'stream', 'columns' or both")
        return self


class JointMap(Section):
    """Motors that move joints together, as in a differential: q_joints = matrix q_motors.

    Their power is the same. So forces of the joints are the inverse transpose times those of the
    motors.
    """

    joints: list[str] = Field(min_length=1)
    motors: list[str]
    matrix: list[list[float]]

    @model_validator(mode="after")
    def _invertible(self) -> JointMap:
        count = len(self.joints)
        sizes = {len(self.motors), len(self.matrix), *map(len, self.matrix)}
        if sizes != {count} or len(set(self.joints)) < count or len(set(self.motors)) < count:
            raise ValueError(
                f"{count} joints take as many motors, and a matrix with a row for each joint and a "
                "column for each motor"
            )
        if not np.linalg.cond(self.matrix) < LARGEST_CONDITION:
            raise ValueError(
                f"the matrix must be invertible, with a condition number of at most "
                f"{LARGEST_CONDITION:g}"
            )
        return self


class WrenchColumns(StreamColumns):
    """Six columns, force x, y, z and moment x, y, z, that the surroundings exert on a frame.

    Moments are about the frame's origin, or a point of the world. Values times the scale, of all or
    of each, plus the offset, are in N and N m.
    """

    frame: str
    axes: Literal["frame", "world"] = "frame"
    about: tuple[float, float, float] | None = None
    scale: float | list[float] | None = None
    offset: float | list[float] = 0.0

    @model_validator(mode="after")
    def _six_numbers(self) -> WrenchColumns:
        if self.columns is not None and len(self.columns) != len(COMPONENTS):
            raise ValueError(f"'columns' must be the six of {', '.join(COMPONENTS)}")
        for key in ("scale", "offset"):
            given = getattr(self, key)
            if isinstance(given, list) and len(given) != len(COMPONENTS):
                raise ValueError(f"'{key}' must be a number, or six")
        return self

    def six(self, key: str) -> list[Any]:
        """The scale or the offset of each column."""
        given = getattr(self, key)
        return given if isinstance(given, list) else [given] * len(COMPONENTS)


def _columns_tag(value: Any) -> str:
    listed = isinstance(value, StreamColumns)
    if isinstance(value, dict):  # a list stands in no mapping of joints to columns
        lists = any(isinstance(each, list) for each in value.values())
        listed = lists or bool({"stream", "columns"} & {*value})
    return "<several>" if listed else "<by joint>"


Columns = Annotated[
    Annotated[StreamColumns, Tag("<several>")] | Annotated[dict[str, str], Tag("<by joint>")],
    Discriminator(_columns_tag),
]
Number = TypeVar("Number")
OneOrEach = Annotated[
    Annotated[Number, Tag("<one>")] | Annotated[dict[str, Number], Tag("<by joint>")],
    Discriminator(lambda value: "<by joint>" if isinstance(value, dict) else "<one>"),
]


def _not_zero(scale: float) -> float:
    if scale == 0:
        raise ValueError("must not be 0")
    return scale


NotZero = Annotated[float, AfterValidator(_not_zero)]


def _known_format(name: str) -> str:
    if name not in log_formats:
        raise unknown("log format", name, log_formats)
    return name


# In schemas for editors.
KnownFormats = Field(json_schema_extra=lambda schema: schema.update(enum=[*log_formats]))


@checked
class LogMapping(Section):
    """Which columns hold time, positions and forces, and in which units.

    All may be left out. ``position`` and ``force`` give the column of each joint, as ``column`` or
    ``stream:column``, or list the columns in the order of the motors. So do ``velocity`` and
    ``acceleration`` where those that were measured are to be used. Values times the scale, plus the
    offset, are in m, rad, N, N m and s. Numbers hold for all joints, or are given by joint. Without
    a scale, columns are in the unit of their header, or else in these units. In all of them, the
    motors of ``joint_maps`` stand for the joints that they move. ``wrenches`` are what the
    surroundings exert on frames of the robot, each of six columns. ``free`` gives the columns of
    joints that no motor moves: one, or the seven of a floating base. ``delay`` is how much later
    forces are than positions, in s, of all joints or by joint. Or it is how late the time stamps of
    whole streams are, by their names. Without a column of times, rows are even: ``rate`` in Hz, or
    ``period`` in s between them. Or each row is a pose at rest, of no time: ``static``. ``topic``
    chooses among those of a bag, ``group`` among those of an HDF5 file.

    Raises
    ------
    OptionError
        Naming the key, the value and what is valid.

    Examples
    --------
    >>> import loopid
    >>> mapping = loopid.logs.LogMapping(rate=200, force_scale={"elbow": -1})
    >>> mapping.rate, mapping.force_scale
    (200.0, {'elbow': -1.0})
    """

    format: Annotated[str, AfterValidator(_known_format), KnownFormats] | None = None
    topic: str | None = None
    group: str | None = None
    time: TimeColumns | None = None
    rate: Positive | None = None
    period: Positive | None = None
    static: bool = False
    position: Columns | None = None
    force: Columns | None = None
    velocity: Columns | None = None
    acceleration: Columns | None = None
    position_scale: OneOrEach[NotZero] | None = None
    position_offset: OneOrEach[float] = 0.0
    force_scale: OneOrEach[NotZero] | None = None
    force_offset: OneOrEach[float] = 0.0
    velocity_scale: OneOrEach[NotZero] | None = None
    velocity_offset: OneOrEach[float] = 0.0
    acceleration_scale: OneOrEach[NotZero] | None = None
    acceleration_offset: OneOrEach[float] = 0.0
    saturation: OneOrEach[Positive] | None = None
    idle_speed: NotNegative | None = None
    joint_maps: list[JointMap] = Field(default_factory=list)
    wrenches: list[WrenchColumns] = Field(default_factory=list)
    free: dict[str, list[str]] = Field(default_factory=dict)
    delay: OneOrEach[float] = 0.0

    def __init__(self, **content: Any) -> None:
        try:
            super().__init__(**content)
        except ValidationError as error:
            raise refusal(error, content, kind=OptionError) from error

    def __hash__(self) -> int:
        return hash(type(self))

    # Files are validated as before, without passing here.
    __init__.__pydantic_base_init__ = True  # type: ignore[attr-defined]

    @model_validator(mode="after")
    def _one_time(self) -> LogMapping:
        given = [key for key in ("time", "rate", "period") if getattr(self, key) is not None]
        if len(given) > 1:
            raise ValueError(f"give only one of {', '.join(given)}")
        if self.static:
            moving = "velocity", "acceleration", "idle_speed", "delay"
            given += [key for key in moving if getattr(self, key) not in (None, 0.0)]
            if given:
                raise ValueError(f"poses at rest have no {', '.join(given)}: leave out {given[0]}")
        return self

    @property
    def row_period(self) -> float | None:
        """Seconds between rows that have no time of their own; None where they have one."""
        if self.static:
            return POSE_PERIOD
        return self.period if self.rate is None else 1 / self.rate

    @model_validator(mode="after")
    def _maps_are_apart(self) -> LogMapping:
        for kind in ("joints", "motors"):
            names = [name for one in self.joint_maps for name in getattr(one, kind)]
            if len(set(names)) < len(names):
                raise ValueError(f"joint_maps: {kind} must not be in two maps")
        if self.joint_maps and self.saturation is not None:
            raise ValueError("saturation is of single joints: leave it out beside joint_maps")
        return self

    def measured(self, source: str, joints: tuple[str, ...]) -> tuple[str, ...]:
        """The joints, and in the places of those that motors move together these motors."""
        motors = {j: m for a in self.joint_maps for j, m in zip(a.joints, a.motors, strict=True)}
        names = tuple(motors.get(joint, joint) for joint in joints)
        if not {*motors} <= {*joints} or len(set(names)) < len(names):
            raise LogError(
                f"{source}: joint_maps of the mapping must name joints among {', '.join(joints)}, "
                "and call no motor like another joint",
                valid=joints,
            )
        return names

    def stream_delays(
        self, source: str, joints: Sequence[str], streams: Sequence[str]
    ) -> dict[str, float]:
        """Delays of the time stamps of some streams, in s; not those of joints."""
        given = self.delay if isinstance(self.delay, Mapping) else {}
        for name in given:
            where = f" in delay of the mapping of {source}"
            LogError.require("joint or stream", name, (*joints, *streams), where)
        return {name: delay for name, delay in given.items() if name not in joints}

    def with_gains(
        self, gains: Mapping[str, float], scales: Sequence[Mapping[str, float]]
    ) -> LogMapping:
        """The mapping by which forces are this many times as large, by joint; 1 of those left out.

        ``scales`` are those of each log (``Log.force_scales``): of this mapping, or of the headers.
        """
        if self.joint_maps:
            raise OptionError("gains are of joints, which joint_maps make of several motors each")
        if any(each != scales[0] for each in scales[1:]):
            raise OptionError("forces of the logs are in different units: one mapping cannot hold")
        content, joints = self.model_dump(exclude_defaults=True, exclude_none=True), [*scales[0]]
        values = {"force_scale": [*scales[0].values()]}
        for more in ("force_offset", "saturation"):
            if more in content:
                values[more] = self.by_joint("the mapping", more, joints)
        for key, own in values.items():  # to digits that a gain is known to, and more
            pairs = zip(joints, own, strict=True)
            content[key] = {j: float(f"{gains.get(j, 1.0) * value:.6g}") for j, value in pairs}
        return LogMapping(**content)

    @property
    def content(self) -> str:
        """As it stands in a file."""
        return yaml_text(self.model_dump(exclude_defaults=True, exclude_none=True))

    def by_joint(self, source: str, key: str, joints: Sequence[str]) -> list[Any]:
        """What is given for all or by joint, in the order of the motors.

        Scales and offsets of motors that are not named are those of a mapping without any.
        """
        given = getattr(self, key)
        if not isinstance(given, Mapping):
            return [given] * len(joints)
        for name in given:
            LogError.require("motor", name, joints, f" in {key} of the mapping of {source}")
        left_out = [joint for joint in joints if joint not in given]
        if left_out and not key.endswith(("_scale", "_offset")):
            raise LogError(
                f"{source}: {key} of the mapping leaves out {', '.join(left_out)}: give a number "
                "for each motor, or one for all",
                key=key,
            )
        return [given.get(joint, getattr(LogMapping(), key)) for joint in joints]


def mapping_of(given: LogMapping | str | Path | None) -> LogMapping:
    """A mapping, that of a file, or one that says nothing."""
    if isinstance(given, LogMapping):
        return given
    return LogMapping() if given is None else read_yaml(Path(given), LogMapping, LogError)
