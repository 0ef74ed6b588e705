"""Which columns of a log are what: by their names, or by a YAML that says so."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal, NamedTuple, TypeVar

import numpy as np
from pydantic import Discriminator, Field, Tag, ValidationError, model_validator

from loopid.arguments import (
    IntArray,
    checked,
)
from loopid.errors import (
    LogError,
    OptionError,
)
from loopid.logs.formats import (
    MOST_LISTED,
    NO_STAMP,
    UNITS,
    LogFormat,
    stamps_in,
)
from loopid.yaml_files import (
    Section,
    first_problem,
    read_yaml,
)

if TYPE_CHECKING:
    import polars

# Names that are known without a mapping, whatever their case: of the time,
TIME_PAIRS = (("time_sec", "time_nanosec"), ("sec", "nanosec"), ("secs", "nsecs"))
TIMES = {"time": "s", "t": "s", "timestamp": "s"} | {f"time_{unit}": unit for unit in UNITS}
# with the name of a joint, or with the number of a motor as in "force_0".
WITH_JOINT = {"position": ("position",), "force": ("force", "effort", "torque")}
WITH_NUMBER = {
    "position": ("position", "joint_position"),
    "force": ("force", "effort", "torque", "control_action"),
}
# All that is read, in this order.
QUANTITIES = ("position", "force", "velocity", "acceleration")
# Condition number from which a joint map is no true one.
LARGEST_CONDITION = 1e6

Positive = Annotated[float, Field(gt=0, allow_inf_nan=False)]
Finite = Annotated[float, Field(allow_inf_nan=False)]


# ---- the YAML ---------------------------------------------------------------------------------


class TimeColumns(Section):
    """One column with a unit, or two that add up."""

    column: str | None = None
    unit: Literal["s", "ms", "us", "ns"] = "s"
    seconds: str | None = None
    nanoseconds: str | None = None

    @model_validator(mode="after")
    def _one_way(self) -> TimeColumns:
        pair = [self.seconds, self.nanoseconds]
        if self.column is None and None in pair:
            raise ValueError("give 'column', or both 'seconds' and 'nanoseconds'")
        if self.column is not None and pair != [None, None]:
            raise ValueError("give either 'column', or 'seconds' and 'nanoseconds'")
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

    Their power is the same, so that forces of the joints are the inverse transpose times those of
    the motors.
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


def _columns_tag(value: Any) -> str:
    listed = isinstance(value, StreamColumns)
    listed = listed or (isinstance(value, dict) and bool({"stream", "columns"} & set(value)))
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


class LogMapping(Section):
    """Which columns hold time, positions and forces, and in which units.

    All may be left out. ``position`` and ``force`` give the column of each joint, as ``column`` or
    ``stream:column``, or list the columns in the order of the motors; so do ``velocity`` and
    ``acceleration`` where those that were measured are to be used. Values times the scale, plus
    the offset, are in m, rad, N, N m and s; numbers hold for all joints, or are given by joint.
    In all of them, the motors of ``joint_maps`` stand for the joints that they move.
    ``topic`` chooses among those of a bag, ``group`` among those of an HDF5 file.

    Raises
    ------
    OptionError
        Naming the key, the value and what is valid.
    """

    format: Literal["csv", "npz", "parquet", "hdf5", "bag", "folder"] | None = None
    topic: str | None = None
    group: str | None = None
    time: TimeColumns | None = None
    position: Columns | None = None
    force: Columns | None = None
    velocity: Columns | None = None
    acceleration: Columns | None = None
    position_scale: OneOrEach[Finite] = 1.0
    position_offset: OneOrEach[Finite] = 0.0
    force_scale: OneOrEach[Finite] = 1.0
    force_offset: OneOrEach[Finite] = 0.0
    velocity_scale: OneOrEach[Finite] = 1.0
    velocity_offset: OneOrEach[Finite] = 0.0
    acceleration_scale: OneOrEach[Finite] = 1.0
    acceleration_offset: OneOrEach[Finite] = 0.0
    saturation: OneOrEach[Positive] | None = None
    idle_speed: Annotated[float, Field(ge=0, allow_inf_nan=False)] | None = None
    joint_maps: list[JointMap] = Field(default_factory=list)

    def __init__(self, **content: Any) -> None:
        try:
            super().__init__(**content)
        except ValidationError as error:
            raise OptionError(first_problem(error)) from error

    # Files are validated as before, without passing here.
    __init__.__pydantic_base_init__ = True  # type: ignore[attr-defined]

    @model_validator(mode="after")
    def _scales_are_not_zero(self) -> LogMapping:
        for name in (f"{quantity}_scale" for quantity in QUANTITIES):
            scale = getattr(self, name)
            if 0 in (scale.values() if isinstance(scale, dict) else (scale,)):
                raise ValueError(f"{name} must not be 0")
        return self

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
        unknown = [joint for joint in motors if joint not in joints]
        if unknown or len(set(names)) < len(names):
            problem = f"name {unknown[0]!r}" if unknown else "call a motor like a joint"
            raise LogError(
                f"{source}: joint_maps of the mapping {problem}: the joints are {', '.join(joints)}"
            )
        return names

    def by_joint(self, source: str, key: str, joints: Sequence[str]) -> list[Any]:
        """What is given for all or by joint, in the order of the motors."""
        given = getattr(self, key)
        if not isinstance(given, Mapping):
            return [given] * len(joints)
        unknown = [name for name in given if name not in joints]
        missing = [name for name in joints if name not in given]
        if unknown or missing:
            problem = f"names {unknown[0]!r}" if unknown else f"leaves out {missing[0]}"
            raise LogError(
                f"{source}: {key} of the mapping {problem}: give the motors {', '.join(joints)}"
            )
        return [given[joint] for joint in joints]


@checked
def read_mapping(path: str | Path) -> LogMapping:
    """Read and validate a mapping file."""
    return read_yaml(Path(path), LogMapping, LogError)


# ---- columns ----------------------------------------------------------------------------------


class Place(NamedTuple):
    """A column of a stream."""

    stream: str
    column: str

    def __str__(self) -> str:
        return f"{self.stream}:{self.column}"


class Channel(NamedTuple):
    """What a column holds: value = scale * number + offset, in SI units."""

    quantity: str  # of QUANTITIES
    joint: str
    column: str
    scale: float
    offset: float


class TimeColumn(NamedTuple):
    """A column of times; a second one may add whole nanoseconds below one second."""

    name: str
    unit: int  # ns
    rest: str | None = None

    @property
    def names(self) -> tuple[str, ...]:
        """The one or two columns."""
        return (self.name,) if self.rest is None else (self.name, self.rest)

    def stamps(self, source: str, cells: polars.DataFrame) -> IntArray:
        """Whole nanoseconds (R,), ``NO_STAMP`` where there is no time."""
        stamps = stamps_in(source, cells[self.name], self.unit)
        if self.rest is None:
            return stamps
        rest = stamps_in(source, cells[self.rest], 1)
        valid = (stamps != NO_STAMP) & (rest >= 0) & (rest < UNITS["s"])
        return np.where(valid, stamps + np.where(valid, rest, 0), NO_STAMP)


@dataclass(frozen=True)
class ColumnFinder:
    """Finds columns of a log by name, as a mapping says or as they are usually called."""

    source: str  # the log, for messages
    streams: Mapping[str, tuple[str, ...]]  # names of the columns
    format: type[LogFormat]
    mapping: LogMapping

    def channels(self, joints: tuple[str, ...]) -> dict[str, list[Channel]]:
        """The columns of all quantities by stream, that of the first position first."""
        found: dict[Place, Channel] = {}
        for quantity in QUANTITIES:
            if quantity not in WITH_JOINT and getattr(self.mapping, quantity) is None:
                continue
            places = self._motor_columns(joints, quantity)
            if len(places) != len(joints):
                raise LogError(
                    f"{self.source} has {len(places)} columns for the {quantity} "
                    f"({_listed([place.column for place in places])}), but the robot has "
                    f"{len(joints)} motors: {', '.join(joints)}"
                )
            scales = self.mapping.by_joint(self.source, f"{quantity}_scale", joints)
            offsets = self.mapping.by_joint(self.source, f"{quantity}_offset", joints)
            for joint, place, *linear in zip(joints, places, scales, offsets, strict=True):
                if place in found:
                    raise LogError(
                        f"{self.source}: column {place.column!r} is mapped twice: each "
                        f"{quantity} has a column of its own"
                    )
                found[place] = Channel(quantity, joint, place.column, *linear)
        streams: dict[str, list[Channel]] = {}
        for place, channel in found.items():
            if channel.column in self.time(place.stream).names:
                raise LogError(
                    f"{self.source}: column {channel.column!r} is the time, so that it cannot be "
                    f"the {channel.quantity} of {channel.joint}, too"
                )
            streams.setdefault(place.stream, []).append(channel)
        return streams

    def time(self, stream: str) -> TimeColumn:
        """The time of a stream; a LogError when it is not found, or there are several."""
        given = self.mapping.time
        if given is not None:
            columns = [n for n in (given.column, given.seconds, given.nanoseconds) if n is not None]
            for name in columns:
                if name not in self.streams[stream]:
                    raise LogError(
                        f"{self.source}: {stream} has no column {name!r} for the time: "
                        f"{self._choices()}"
                    )
            unit = UNITS[given.unit] if given.column is not None else UNITS["s"]
            return TimeColumn(columns[0], unit, *columns[1:])
        here = self.streams[stream]
        for pair in TIME_PAIRS:
            both = [name for name in here if name.casefold() in pair]
            if len(both) == 2 and len({name.casefold() for name in both}) == 2:
                seconds, rest = sorted(both, key=lambda name: pair.index(name.casefold()))
                return TimeColumn(seconds, UNITS["s"], rest)
        found = [name for name in here if name.casefold() in TIMES]
        if len(found) == 1:
            return TimeColumn(found[0], UNITS[TIMES[found[0].casefold()]])
        problem = f"several columns for the time ({', '.join(found)})" if found else "no time"
        raise LogError(
            f"{self.source}: {stream} has {problem}: call one column time, or name it in a "
            f"mapping; {self._choices()}"
        )

    def _motor_columns(self, joints: tuple[str, ...], quantity: str) -> list[Place]:
        """Columns of a quantity in the order of the motors."""
        given: Columns | None = getattr(self.mapping, quantity)
        if isinstance(given, StreamColumns):
            return self._listed(given)
        if given is not None:
            return [
                self._find(name) for name in self.mapping.by_joint(self.source, quantity, joints)
            ]
        if self._places and all(map(_are_numbered, self.streams.values())):
            raise LogError(
                f"{self.source} starts with numbers: name its columns by their numbers in a "
                f"mapping; {self._choices()}"
            )
        for prefix in WITH_NUMBER[quantity]:  # such as position_0
            places: list[Place] = []
            while found := self._matching([f"{prefix}_{len(places)}"]):
                places.append(self._only(f"motor {len(places)}", quantity, found))
            if places:
                return places
        for joint in joints:  # such as leg1.force, leg1_force, force.leg1; a position also leg1
            names = [
                name
                for word in WITH_JOINT[quantity]
                for name in (
                    f"{joint}.{word}",
                    f"{joint}_{word}",
                    f"{word}.{joint}",
                    f"{word}_{joint}",
                )
            ]
            found = self._matching([*names, joint] if quantity == "position" else names)
            if not found:
                raise LogError(
                    f"{self.source} has no {quantity} of {joint}: call a column {names[0]}, or "
                    f"name it in a mapping; {self._choices()}"
                )
            places.append(self._only(joint, quantity, found))
        return places

    def _listed(self, given: StreamColumns) -> list[Place]:
        """Columns in the order of the motors; by default all of a stream but its time."""
        if given.stream is None:
            return [self._find(name) for name in given.columns or []]
        if given.stream not in self.streams:
            valid = ", ".join(self.streams)
            raise LogError(f"{self.source} has no stream {given.stream!r}: choose among {valid}")
        if given.columns is not None:
            return [self._find(f"{given.stream}:{name}") for name in given.columns]
        if not self.format.ordered:
            raise LogError(
                f"{self.source}: the columns of {given.stream} stand in no order: list them in "
                f"that of the motors; {self._choices()}"
            )
        times, names = self.time(given.stream).names, self.streams[given.stream]
        return [Place(given.stream, name) for name in names if name not in times]

    def _only(self, joint: str, quantity: str, found: Sequence[Place]) -> Place:
        if len(found) > 1:
            several = self.format.choice is not None and len(self.streams) > 1
            also = f", or a {self.format.choice}," if several else ""
            raise LogError(
                f"{self.source} has {len(found)} columns for the {quantity} of {joint}: "
                f"{', '.join(map(str, found))}; name one{also} in a mapping"
            )
        return found[0]

    def _find(self, reference: str) -> Place:
        """The column called ``column`` or ``stream:column``."""
        found = [place for place in self._places if reference in (place.column, str(place))]
        if not found:
            raise LogError(f"{self.source} has no column {reference!r}: {self._choices()}")
        if len(found) > 1:
            several = ", ".join(map(str, found))
            raise LogError(f"{self.source} has several columns {reference!r}: write {several}")
        return found[0]

    def _matching(self, names: Iterable[str]) -> list[Place]:
        """Columns with one of the names, whatever their case."""
        wanted = dict.fromkeys(name.casefold() for name in names)
        return [place for name in wanted for place in self._by_name.get(name, ())]

    def _choices(self) -> str:
        """The columns, for messages."""
        several = len(self.streams) > 1
        names = [str(place) if several else place.column for place in self._places]
        nameless = [stream for stream, names in self.streams.items() if _are_numbered(names)]
        ends = f" (no header in {', '.join(nameless)})" if nameless else ""
        return f"choose among {_listed(names)}{ends}"

    @cached_property
    def _places(self) -> list[Place]:
        return [Place(stream, column) for stream, names in self.streams.items() for column in names]

    @cached_property
    def _by_name(self) -> dict[str, list[Place]]:
        """Columns by name, whatever the case."""
        found: dict[str, list[Place]] = {}
        for place in self._places:
            found.setdefault(place.column.casefold(), []).append(place)
        return found


def _listed(names: Sequence[str]) -> str:
    more = f" and {len(names) - MOST_LISTED} more" if len(names) > MOST_LISTED else ""
    return ", ".join(f"{name:.60}" for name in names[:MOST_LISTED]) + more


def _are_numbered(names: Sequence[str]) -> bool:
    """Whether columns have no names of their own."""
    return list(names) == [str(k + 1) for k in range(len(names))]
