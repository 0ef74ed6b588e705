"""Finds the columns of a log by their names, or as a mapping says."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from loopid.arguments import IntArray
from loopid.errors import LogError
from loopid.logs.formats import MOST_LISTED, NO_STAMP, UNITS, stamps_in
from loopid.logs.mapping import QUANTITIES, Columns, LogMapping, StreamColumns, TimeColumns

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
    mapping: LogMapping
    ordered: bool = True  # whether columns of a stream stand in an order that says something
    choice: str | None = None  # the key of the mapping that chooses among the streams

    def channels(self, joints: tuple[str, ...]) -> dict[str, list[Channel]]:
        """The columns of all quantities by stream, that of the first position first."""
        found: dict[Place, Channel] = {}
        for quantity in QUANTITIES:
            if quantity in WITH_JOINT or getattr(self.mapping, quantity) is not None:
                for place, channel in self._channels_of(quantity, joints):
                    if place in found:
                        raise self._refused(
                            f"column {place.column!r} is mapped twice: each {quantity} has a "
                            "column of its own",
                            column=place.column,
                        )
                    found[place] = channel
        streams: dict[str, list[Channel]] = {}
        for place, channel in found.items():
            if channel.column in self.time(place.stream).names:
                raise self._refused(
                    f"column {channel.column!r} is the time, so that it cannot be the "
                    f"{channel.quantity} of {channel.joint}, too",
                    column=channel.column,
                )
            streams.setdefault(place.stream, []).append(channel)
        return streams

    def _channels_of(
        self, quantity: str, joints: tuple[str, ...]
    ) -> Iterator[tuple[Place, Channel]]:
        """Columns of a quantity, one for each motor, with their scales and offsets."""
        places = self._motor_columns(joints, quantity)
        if len(places) != len(joints):
            raise LogError(
                f"{self.source} has {len(places)} columns for the {quantity} "
                f"({_listed([place.column for place in places])}), but the robot has "
                f"{len(joints)} motors: {', '.join(joints)}",
                source=self.source,
                columns=tuple(map(str, places)),
                joints=joints,
            )
        scales = self.mapping.by_joint(self.source, f"{quantity}_scale", joints)
        offsets = self.mapping.by_joint(self.source, f"{quantity}_offset", joints)
        for joint, place, *linear in zip(joints, places, scales, offsets, strict=True):
            yield place, Channel(quantity, joint, place.column, *linear)

    # ---- the time

    def time(self, stream: str) -> TimeColumn:
        """The time of a stream; a LogError when it is not found, or there are several."""
        if self.mapping.time is not None:
            return self._given_time(self.mapping.time, stream)
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
        raise self._refused(
            f"{stream} has {problem}: call one column time, or name it in a mapping; "
            f"{self._choices()}",
            stream=stream,
            columns=tuple(found),
        )

    def _given_time(self, given: TimeColumns, stream: str) -> TimeColumn:
        columns = [n for n in (given.column, given.seconds, given.nanoseconds) if n is not None]
        for name in columns:
            if name not in self.streams[stream]:
                raise self._refused(
                    f"{stream} has no column {name!r} for the time: {self._choices()}",
                    stream=stream,
                    given=name,
                )
        unit = UNITS[given.unit] if given.column is not None else UNITS["s"]
        return TimeColumn(columns[0], unit, *columns[1:])

    # ---- a quantity of the motors

    def _motor_columns(self, joints: tuple[str, ...], quantity: str) -> list[Place]:
        """Columns of a quantity in the order of the motors."""
        given: Columns | None = getattr(self.mapping, quantity)
        if isinstance(given, StreamColumns):
            return self._listed_columns(given)
        if given is not None:
            names = self.mapping.by_joint(self.source, quantity, joints)
            return [self._called(name) for name in names]
        if self._places and all(map(_are_numbered, self.streams.values())):
            raise self._refused(
                f"it starts with numbers: name its columns by their numbers in a mapping; "
                f"{self._choices()}"
            )
        return self._numbered(quantity) or [self._of_joint(joint, quantity) for joint in joints]

    def _listed_columns(self, given: StreamColumns) -> list[Place]:
        """Columns in the order of the motors; by default all of a stream but its time."""
        if given.stream is None:
            return [self._called(name) for name in given.columns or []]
        if given.stream not in self.streams:
            valid = ", ".join(self.streams)
            raise LogError(
                f"{self.source} has no stream {given.stream!r}: choose among {valid}",
                source=self.source,
                given=given.stream,
                valid=tuple(self.streams),
            )
        if given.columns is not None:
            return [self._called(f"{given.stream}:{name}") for name in given.columns]
        if not self.ordered:
            raise self._refused(
                f"the columns of {given.stream} stand in no order: list them in that of the "
                f"motors; {self._choices()}",
                stream=given.stream,
            )
        times, names = self.time(given.stream).names, self.streams[given.stream]
        return [Place(given.stream, name) for name in names if name not in times]

    def _numbered(self, quantity: str) -> list[Place]:
        """Columns such as position_0, position_1, ..."""
        for prefix in WITH_NUMBER.get(quantity, ()):
            places: list[Place] = []
            while found := self._matching([f"{prefix}_{len(places)}"]):
                places.append(self._only(f"motor {len(places)}", quantity, found))
            if places:
                return places
        return []

    def _of_joint(self, joint: str, quantity: str) -> Place:
        """A column such as leg1.force, leg1_force, force.leg1; a position may be leg1, too."""
        names = [
            pattern.format(joint, word)
            for word in WITH_JOINT[quantity]
            for pattern in ("{}.{}", "{}_{}", "{1}.{0}", "{1}_{0}")
        ]
        found = self._matching([*names, joint] if quantity == "position" else names)
        if not found:
            raise LogError(
                f"{self.source} has no {quantity} of {joint}: call a column {names[0]}, or "
                f"name it in a mapping; {self._choices()}",
                source=self.source,
                quantity=quantity,
                joint=joint,
            )
        return self._only(joint, quantity, found)

    def _only(self, joint: str, quantity: str, found: Sequence[Place]) -> Place:
        if len(found) > 1:
            several = self.choice is not None and len(self.streams) > 1
            also = f", or a {self.choice}," if several else ""
            raise LogError(
                f"{self.source} has {len(found)} columns for the {quantity} of {joint}: "
                f"{', '.join(map(str, found))}; name one{also} in a mapping",
                source=self.source,
                quantity=quantity,
                joint=joint,
                columns=tuple(map(str, found)),
            )
        return found[0]

    def _called(self, reference: str) -> Place:
        """The column called ``column`` or ``stream:column``."""
        found = [place for place in self._places if reference in (place.column, str(place))]
        if len(found) == 1:
            return found[0]
        if found:
            several = ", ".join(map(str, found))
            said = f"{self.source} has several columns {reference!r}: write {several}"
        else:
            said = f"{self.source} has no column {reference!r}: {self._choices()}"
        columns = tuple(map(str, found))
        raise LogError(said, source=self.source, given=reference, columns=columns)

    # ---- the columns by name

    def _matching(self, names: Iterable[str]) -> list[Place]:
        """Columns with one of the names, whatever their case."""
        wanted = dict.fromkeys(name.casefold() for name in names)
        return [place for name in wanted for place in self._by_name.get(name, ())]

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

    def _choices(self) -> str:
        """The columns, for messages."""
        several = len(self.streams) > 1
        names = [str(place) if several else place.column for place in self._places]
        nameless = [stream for stream, names in self.streams.items() if _are_numbered(names)]
        ends = f" (no header in {', '.join(nameless)})" if nameless else ""
        return f"choose among {_listed(names)}{ends}"

    def _refused(self, said: str, **facts: object) -> LogError:
        return LogError(f"{self.source}: {said}", source=self.source, **facts)


def _listed(names: Sequence[str]) -> str:
    more = f" and {len(names) - MOST_LISTED} more" if len(names) > MOST_LISTED else ""
    return ", ".join(f"{name:.60}" for name in names[:MOST_LISTED]) + more


def _are_numbered(names: Sequence[str]) -> bool:
    """Whether columns have no names of their own."""
    return list(names) == [str(k + 1) for k in range(len(names))]
