"""What the columns of a log are: names, units, and which column is what.

"tau1 [N m]" is called tau1, in N m. Names are compared by their words: "Joint 1.Position",
"joint1_position" and "joint_1/position" are the same.
"""

from __future__ import annotations

import re
import unicodedata
from collections import defaultdict
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import chain, count, product
from math import pi
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from loopid.arguments import IntArray
from loopid.errors import DataWarning, LogError, first_of, warn
from loopid.logs.table import COMPONENTS, MOST_LISTED, NANOSECONDS, NO_STAMP, QUANTITIES, stamps_in
from loopid.records import derived

if TYPE_CHECKING:
    import polars

    from loopid.logs.mapping import Columns, LogMapping, StreamColumns, TimeColumns

# Columns of the pose of a floating base; a joint with one coordinate has one.
POSE = ("x", "y", "z", "qx", "qy", "qz", "qw")

# ---- units -------------------------------------------------------------------------------------


class Unit(NamedTuple):
    """A unit of a quantity."""

    name: str
    scale: float  # in s, m or rad, N or N m
    straight: bool | None = None  # of slides, or of hinges; None of times


def _plain(unit: str) -> str:
    """A unit without what people write differently."""
    text = unicodedata.normalize("NFKC", unit.replace("º", "°")).replace("\u03bc", "u")
    return re.sub(r"[\s_.·⋅∙•*^\-\u2212]+", "", text).casefold()


def _units(table: Mapping[str, tuple[float, bool | None, str]], *ends: str) -> dict[str, Unit]:
    """Units by their spellings, with ends behind that mean the same; the first are the name."""
    return {
        _plain(word + end): Unit(name + (ends or ("",))[0], scale, straight)
        for name, (scale, straight, others) in table.items()
        for word in (name, *others.split())
        for end in ends or ("",)
    }


_PLACES = {
    "m": (1.0, True, "metre meter metres meters"),
    "cm": (1e-2, True, "centimetre centimeter centimetres centimeters"),
    "mm": (1e-3, True, "millimetre millimeter millimetres millimeters"),
    "um": (1e-6, True, "micrometre micrometer micrometres micrometers micron microns"),
    "rad": (1.0, False, "rads radian radians"),
    "mrad": (1e-3, False, "mrads milliradian milliradians"),
    "deg": (pi / 180, False, "degs degree degrees °"),
    "rev": (2 * pi, False, "revs revolution revolutions turn turns"),
}
# By quantity and spelling.
UNITS: dict[str, dict[str, Unit]] = {
    "time": _units(
        {
            "s": (1.0, None, "sec secs second seconds"),
            "ms": (1e-3, None, "msec msecs millisecond milliseconds"),
            "us": (1e-6, None, "usec usecs microsecond microseconds"),
            "ns": (1e-9, None, "nsec nsecs nanosec nanosecs nanosecond nanoseconds"),
        }
    ),
    "position": _units(_PLACES),
    "force": _units(
        {
            "N": (1.0, True, "newton newtons"),
            "mN": (1e-3, True, ""),
            "kN": (1e3, True, ""),
            "N m": (1.0, False, "newtonmeter newtonmeters newtonmetre newtonmetres"),
            "N cm": (1e-2, False, ""),
            "N mm": (1e-3, False, ""),
            "mN m": (1e-3, False, ""),
            "kN m": (1e3, False, ""),
        }
    ),
    "velocity": _units(_PLACES, "/s", "/sec", "/second", "s^-1", "ps")
    | _units({"rpm": (pi / 30, False, "rev/min revs/min r/min 1/min min^-1")}),
    "acceleration": _units(_PLACES, "/s^2", "/sec^2", "/s/s", "_s2", "s^-2"),
}
BRACKETS = re.compile(r"\s*[\[({<](?P<inside>[^\[\](){}<>]*)[\])}>]")
# What may stand before a unit without brackets.
BEFORE = re.compile(r"\s*/\s*|\s*,\s*|\s+in\s+|(?P<weak>[_\s]+)")
MEASURED = "m"  # behind a name it rather says that something was measured


def unit_of(quantity: str, spelling: str) -> Unit | None:
    """The unit of a quantity with a spelling, such as ``"N·m"``; None where there is none."""
    if quantity == "force" and spelling.strip().startswith("M"):  # mega, not milli
        return None
    return UNITS[quantity].get(_plain(spelling))


def unit_names(quantity: str) -> list[str]:
    """The usual names of the units of a quantity."""
    return list(dict.fromkeys(unit.name for unit in UNITS[quantity].values()))


def is_unit(text: str) -> bool:
    """Whether text is a unit of any quantity."""
    return any(unit_of(quantity, text) for quantity in UNITS)


class Heading(NamedTuple):
    """What a header cell says."""

    name: str
    unit: str | None = None  # as it is written, also where it is unknown
    sure: bool = True  # in brackets: what else could it be


def heading(cell: str, joint: str = "") -> Heading:
    """Name and unit of a header cell; brackets may also hold a number, or be in a joint's name."""
    first = cell.lower().find(joint.lower()) if joint else -1
    last = first + len(joint) if first >= 0 else 0
    found = [
        one
        for one in BRACKETS.finditer(cell)
        if not (first < one.end() and one.start() < last)
        and not one["inside"].strip().isdecimal()
        and not (joint and words(one["inside"]) == words(joint))
    ]
    if found:
        one = next((one for one in found if is_unit(one["inside"])), found[-1])
        name = cell[: one.start()] + cell[one.end() :]
        return Heading(name.strip(" _"), one["inside"].strip() or None)
    for one in BEFORE.finditer(cell, last):
        rest = cell[one.end() :]
        for unit in (rest.replace("_", "/"), rest):  # as in speed_rad_s
            if one.start() and is_unit(unit) and not (one["weak"] and unit == MEASURED):
                return Heading(cell[: one.start()], unit, sure=False)
    return Heading(cell)


def words(name: str) -> str:
    """The words and numbers of a name in lower case, with "_" between."""
    found = re.findall(r"[^\W\d_]+|\d+", unicodedata.normalize("NFKC", name).casefold())
    return "_".join(word.lstrip("0") or "0" if word.isdecimal() else word for word in found)


# Words of what was commanded, not measured.
COMMANDED = {"cmd", "command", "commanded", "desired", "target", "reference", "ref", "setpoint"}
COMMANDED |= {"goal"}


def endings(name: str) -> list[str]:
    """Ends of a path as ``words``, as "elbow_position" of "/joint_states/elbow/position"."""
    parts = [words(part) for part in re.split(r"[/.]", name)]
    if COMMANDED & set(words(name).split("_")):
        return []
    return ["_".join(parts[k:]) for k in range(1, len(parts)) if parts[k]]


# ---- columns -----------------------------------------------------------------------------------

# Quantities of the wrenches, in the order of the mapping.
wrench_name = "wrench {}".format
# Of joints that no motor moves, by their names.
free_name = "free {}".format

# Names that are known without a mapping, as ``words``: of the time,
TIME_PAIRS = tuple(
    (f"{prefix}{seconds}", f"{prefix}{rest}")
    for prefix in ("time_", "", "stamp_", "header_stamp_")
    for seconds, rest in (("sec", "nanosec"), ("secs", "nsecs"))
)
TIMES = {"time", "t", "timestamp", "timestamps", "time_stamp", "stamp", "elapsed_time"}
TIMES |= {"header_stamp"}
# of quantities, with the name of a joint,
WITH_JOINT = {
    "position": ("position", "pos", "angle", "q", "theta", "θ"),
    "force": ("force", "effort", "torque", "tau", "τ"),
}
# or with the number of a motor, from 0 or from 1 on, as in "force_0", "tau1" and "joint 1 torque".
WITH_NUMBER = {
    "position": (
        *(*WITH_JOINT["position"], "joint_position", "joint_angle", "actual_q"),
        *("positions", "joint_positions", "angles", "joint_angles"),
    ),
    "force": (
        *(*WITH_JOINT["force"], "joint_torque", "tau_j", "control_action", "actual_current"),
        *("joint_effort", "efforts", "joint_efforts", "torques", "joint_torques"),
        *("motor_current", "current", "currents"),
    ),
}
NUMBERED = ("{word}_{k}", "joint_{k}_{word}", "{word}_joint_{k}", "axis_{k}_{word}", "j_{k}_{word}")
CURRENTS = {"current", "currents", "curr"}  # words of what holds amperes
# Where a stream's own name says what it holds, as that of a file, columns may be just called so.
JUST_NUMBERED = ("joint_{k}", "axis_{k}", "motor_{k}", "j_{k}", "{k}")
OF_STREAMS = {
    "position": {*WITH_JOINT["position"], "positions", "angles", "encoder", "encoders"},
    "force": {*WITH_JOINT["force"], "forces", "efforts", "torques", *CURRENTS},
    "velocity": {"velocity", "velocities", "vel", "speed", "speeds", "dq", "qd", "qdot"},
    "acceleration": {"acceleration", "accelerations", "acc", "accel", "ddq", "qdd"},
    "command": COMMANDED,
}
# Relative difference of scales that are the same: how many digits people give.
SAME_SCALE = 1e-2


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
    straight: bool | None = None  # whether the header's unit is of slides; None where it says none


class TimeColumn(NamedTuple):
    """A column of times; a second one may add whole nanoseconds below one second.

    Without a column, rows are evenly sampled.
    """

    name: str
    unit: float  # ns; between rows, where there is no column
    rest: str | None = None

    @property
    def names(self) -> tuple[str, ...]:
        """The one or two columns; none of even rows."""
        return tuple(filter(None, (self.name, self.rest)))

    def stamps(self, source: str, cells: polars.DataFrame, rows: IntArray) -> IntArray:
        """Whole nanoseconds (R,) of rows by their numbers, ``NO_STAMP`` where there is no time."""
        if not self.name:
            return np.asarray(np.round(rows * self.unit), dtype=np.int64)
        stamps = stamps_in(source, cells[self.name], round(self.unit))
        if self.rest is None:
            return stamps
        rest = stamps_in(source, cells[self.rest], 1)
        valid = (stamps != NO_STAMP) & (rest >= 0) & (rest < NANOSECONDS["s"])
        return np.where(valid, stamps + np.where(valid, rest, 0), NO_STAMP)


@dataclass(frozen=True)
class ColumnFinder:
    """Finds columns of a log by name, as a mapping says or as they are usually called."""

    source: str  # the log, for messages
    streams: Mapping[str, tuple[str, ...]]  # names of the columns
    mapping: LogMapping
    ordered: bool = True  # whether columns of a stream stand in an order that says something
    choice: str | None = None  # the key of the mapping that chooses among the streams

    def channels(self, joints: tuple[str, ...], *, forces: bool = True) -> dict[str, list[Channel]]:
        """The columns of all quantities by stream, that of the first position first.

        Without ``forces`` there may be none, as of motions that are commanded.
        """
        found: dict[Place, Channel] = {}
        wanted = [
            quantity
            for quantity in QUANTITIES
            if (quantity in WITH_JOINT or getattr(self.mapping, quantity) is not None)
            and (forces or quantity != "force")
        ]
        of_motors = (self.channels_of(quantity, joints) for quantity in wanted)
        for place, channel in chain(*of_motors, self._wrenches(), self._free()):
            self._refuse_current(place, channel)
            if place in found:
                raise self._refused(f"column {place.column!r} is mapped twice")
            found[place] = channel
        streams: dict[str, list[Channel]] = {}
        for place, channel in found.items():
            streams.setdefault(place.stream, []).append(channel)
            if channel.column in self.time(place.stream).names:
                raise self._refused(
                    f"column {channel.column!r} is the time, so that it cannot be the "
                    f"{channel.quantity} of {channel.joint}, too"
                )
        return streams

    def _refuse_current(self, place: Place, channel: Channel) -> None:
        """Refuse currents as forces without the force of an ampere."""
        if channel.quantity == "force" and self.is_current(place):
            raise self._refused(
                f"column {str(place) if len(self.streams) > 1 else place.column!r} is a current, "
                "not a force: give the force of one ampere, or what its unit is (N m or N, by "
                "joint) as 'force_scale' in a mapping; with 1, identify says what it is by the "
                "robot file's masses, where all motors have the same"
            )

    def is_current(self, place: Place) -> bool:
        """Whether a column of forces holds currents, of which the mapping says no force."""
        said = words(self._names[place])
        if self._says[place.stream] == "force":
            said += f"_{words(place.stream)}"
        return bool(CURRENTS & {*said.split("_")}) and self.mapping.force_scale is None

    def channels_of(
        self, quantity: str, joints: tuple[str, ...]
    ) -> Iterator[tuple[Place, Channel]]:
        """Columns of a quantity, one for each motor, with their scales and offsets."""
        places = self._motor_columns(joints, quantity)
        self._require_count(places, f"the {quantity}", joints)
        scales = self.mapping.by_joint(self.source, f"{quantity}_scale", joints)
        offsets = self.mapping.by_joint(self.source, f"{quantity}_offset", joints)
        for joint, place, scale, offset in zip(joints, places, scales, offsets, strict=True):
            unit = self._unit(quantity, place.column, scale, f"{quantity}_scale", joint)
            yield place, Channel(quantity, joint, place.column, unit.scale, offset, unit.straight)

    def _wrenches(self) -> Iterator[tuple[Place, Channel]]:
        """Columns of the wrenches, each of them a quantity."""
        for k, given in enumerate(self.mapping.wrenches):
            places = self._listed_columns(given)
            self._require_count(places, f"the wrench on {given.frame}", COMPONENTS)
            numbers = zip(places, COMPONENTS, given.six("scale"), given.six("offset"), strict=True)
            for place, component, scale, offset in numbers:
                column = place.column
                unit = self._unit("force", column, scale, "scale of wrenches")
                if unit.straight is not None and unit.straight != component.startswith("force"):
                    raise self._refused(
                        f"the unit of column {column!r} is not that of the {component} on "
                        f"{given.frame}: forces stand before moments"
                    )
                yield place, Channel(wrench_name(k), component, column, unit.scale, offset)

    def _free(self) -> Iterator[tuple[Place, Channel]]:
        """Columns of joints that no motor moves, each joint a quantity."""
        for joint, columns in self.mapping.free.items():
            if len(columns) != 1:
                self._require_count(columns, f"{joint} (one, or a pose)", POSE)
            for component, place in zip(POSE, map(self._called, columns), strict=False):
                unit = self._unit("position", place.column, None, "a header's unit")
                yield place, Channel(free_name(joint), component, place.column, unit.scale, 0.0)

    def _require_count(self, found: Sequence[object], of: str, names: Sequence[str]) -> None:
        if len(found) != len(names):
            raise self._refused(
                f"there are {len(found)} columns for {of}, but it takes {len(names)}: "
                f"{', '.join(names)}"
            )

    def _unit(
        self, quantity: str, column: str, given: float | None, key: str, joint: str = ""
    ) -> Unit:
        """Unit of a column, as a key of the mapping or else its header says."""
        said = heading(column, joint)
        known = None if said.unit is None else unit_of(quantity, said.unit)
        if given is not None:
            if known is not None and abs(abs(given) / known.scale - 1) > SAME_SCALE:
                warn(
                    f"{self.source}: column {column!r} is in {known.name}, which is "
                    f"{known.scale:.4g}, but {key} of the mapping says {given:.4g}: the mapping "
                    "holds",
                    DataWarning,
                )
            return Unit(key, given)
        if known is not None:
            return known
        if said.unit is not None and said.sure:
            raise self._refused(
                f"column {column!r} is in {said.unit!r}, which is no known unit of a {quantity} "
                f"({', '.join(unit_names(quantity))}): give {key} in a mapping",
                valid=tuple(unit_names(quantity)),
            )
        return Unit("SI", 1.0)

    @derived
    def time(self, stream: str) -> TimeColumn:
        """The time of a stream; a LogError when it is not found, or there are several."""
        given, period = self.mapping.time, self.mapping.row_period
        if period is not None:
            return TimeColumn("", NANOSECONDS["s"] * period)
        return self._found_time(stream) if given is None else self._given_time(given, stream)

    def _found_time(self, stream: str) -> TimeColumn:
        here = self.streams[stream]
        called = {words(name): name for name in here}
        for seconds, rest in TIME_PAIRS:
            if {seconds, rest} <= {*called}:
                return TimeColumn(called[seconds], NANOSECONDS["s"], called[rest])
        found = [name for name in here if {words(name), words(heading(name).name)} & TIMES]
        found = found or [name for name in here if {*endings(heading(name).name)} & TIMES]
        if len(found) == 1:
            return TimeColumn(found[0], self._nanoseconds(found[0]))
        problem = f"several columns for the time ({', '.join(found)})" if found else "no time"
        raise self._refused(
            f"{stream} has {problem}: call one column time, or name it in a mapping, or give the "
            "'rate' of even rows there, in Hz, or 'static: true' where each row is a pose at rest; "
            f"{self._choices()}"
        )

    def _given_time(self, given: TimeColumns, stream: str) -> TimeColumn:
        columns = [n for n in (given.column, given.seconds, given.nanoseconds) if n is not None]
        here = {heading(name).name: name for name in self.streams[stream]}
        here |= {name: name for name in self.streams[stream]}
        for name in columns:
            if name not in here:
                raise self._refused(f"{stream} has no time {name!r}: {self._choices()}", given=name)
        first, *rest = (here[name] for name in columns)
        unit = NANOSECONDS["s"] if rest else self._nanoseconds(first, given.unit)
        return TimeColumn(first, unit, *rest)

    def _nanoseconds(self, column: str, given: str | None = None) -> int:
        """The unit of a column of times, as the mapping or else its header says."""
        scale = None if given is None else NANOSECONDS[given] / NANOSECONDS["s"]
        unit = self._unit("time", column, scale, "the unit of the time")
        return round(unit.scale * NANOSECONDS["s"])

    def _motor_columns(self, joints: tuple[str, ...], quantity: str) -> list[Place]:
        """Columns of a quantity in the order of the motors."""
        given: Columns | None = getattr(self.mapping, quantity)
        if given is not None and not isinstance(given, Mapping):
            return self._listed_columns(given, joints)
        if given is not None:
            names = self.mapping.by_joint(self.source, quantity, joints)
            return [self._called(name) for name in names]
        known = ((self._says[stream], names) for stream, names in self.streams.items())
        if self._places and all(_are_numbered(names) and not said for said, names in known):
            raise self._refused(
                f"it starts with numbers: name its columns by their numbers in a mapping; "
                f"{self._choices()}"
            )
        own = [self._of_joint(joint, quantity) for joint in joints]
        if not all(own) and (numbered := self._numbered(quantity)):
            return numbered
        both = [*zip(joints, own, strict=True)]
        lacking = ", ".join(f'"{joint}"' for joint, found in both if not found)
        also = f", or lock=[{lacking}] if not moved" if any(own) else ""
        if not any(own) and len(self.streams) == 1:
            also = ", or give the folder if another file has it"
        return [self._only(joint, quantity, found, also) for joint, found in both]

    def _listed_columns(self, given: StreamColumns, joints: tuple[str, ...] = ()) -> list[Place]:
        """Columns in the order of the motors.

        By default those of a stream that are called as joints are, or all of it but its time.
        """
        if given.stream is None:
            return [self._called(name) for name in given.columns or []]
        LogError.require("stream", given.stream, self.streams, f" of {self.source}")
        if given.columns is not None:
            return [self._called(f"{given.stream}:{name}") for name in given.columns]
        if not self.ordered:
            raise self._refused(
                f"the columns of {given.stream} stand in no order: list them in that of the "
                f"motors; {self._choices()}"
            )
        times, names = self.time(given.stream).names, self.streams[given.stream]
        places = [Place(given.stream, name) for name in names if name not in times]
        named = {words(self._names[place]): place for place in places}
        if joints and all(words(joint) in named for joint in joints):
            return [named[words(joint)] for joint in joints]
        return places

    def _numbered(self, quantity: str) -> list[Place]:
        """Columns such as position_0, position_1, ... or tau1, tau2, ..."""
        usual = [
            (pattern.replace("{word}", word), "")
            for word, pattern in product(WITH_NUMBER.get(quantity, ()), NUMBERED)
        ]
        numbers = [(pattern, quantity) for pattern in JUST_NUMBERED]
        for (pattern, said), first in product([*usual, *numbers], (0, 1)):
            places: list[Place] = []
            for k in count(first):
                found = self._matching([pattern.format(k=k)])
                found = [each for each in found if self._says[each.stream] == said or not said]
                if not found:
                    break
                likeliest = self._likeliest(found, quantity)
                places.append(self._only(f"motor {k}", quantity, likeliest))
            if places:
                return places
        return []

    def _of_joint(self, joint: str, quantity: str) -> list[Place]:
        """Columns such as leg1.force, leg1_force, force.leg1; a position may be leg1, too.

        So may what the name of a stream says, as of a file.
        """
        alone = self._matching([joint], ends=False)
        alone = [each for each in alone if (self._says[each.stream] or "position") == quantity]
        for kind in (WITH_JOINT[quantity], CURRENTS if quantity == "force" else ()):
            names = [
                pattern.format(joint, word)
                for word in kind
                for pattern in ("{}.{}", "{}_{}", "{1}.{0}", "{1}_{0}")
            ]
            if found := [*dict.fromkeys((*self._matching(names), *alone))]:
                return self._likeliest(found, quantity)
        return []

    def _likeliest(self, found: list[Place], quantity: str) -> list[Place]:
        """Of several columns those in streams that say what they hold, or nothing else."""
        for said in (quantity, "") if len(found) > 1 else ():
            if best := [place for place in found if self._says[place.stream] == said]:
                return best
        return found

    @cached_property
    def _says(self) -> dict[str, str]:
        """What streams hold by their own names, as those of files; nothing of one alone."""
        return {name: _said(name) if len(self.streams) > 1 else "" for name in self.streams}

    def names(self, joint: str) -> bool:
        """Whether a column has the name of a joint in its own, or the mapping names one for it."""
        given = (getattr(self.mapping, quantity) for quantity in WITH_JOINT)
        mapped = any(isinstance(each, Mapping) and joint in each for each in given)
        called = f"_{words(joint)}_"
        return mapped or any(called in f"_{words(place.column)}_" for place in self._places)

    def own_position(self, joint: str) -> tuple[Place, float] | None:
        """The column with the position of a joint by its name, and its unit; None without one."""
        found = self._of_joint(joint, "position")
        if len(found) != 1:
            return None
        scale = self.mapping.position_scale
        given = scale.get(joint) if isinstance(scale, Mapping) else scale
        return found[0], self._unit("position", found[0].column, given, "position_scale").scale

    def _only(self, joint: str, quantity: str, found: Sequence[Place], also: str = "") -> Place:
        if not found:
            columns, spread = {place.column for place in self._places}, ""
            for name in sorted(columns):
                if _said(name) == quantity and "_" not in words(name):  # of all joints
                    beside = ", and name_0, ... of 'name'" * ("name" in columns)
                    spread = f"; lists in cells of {name!r} are read from {name}_0, ...{beside}"
            raise self._refused(
                f"there is no {quantity} of {joint}: call a column {joint}.{quantity}, "
                f"{'' if also else 'or '}name it in a mapping{also}{spread}; {self._choices()}"
            )
        if len(found) > 1:
            several = self.choice is not None and len(self.streams) > 1
            also = f", or a {self.choice}," if several else ""
            raise self._refused(
                f"there are {len(found)} columns for the {quantity} of {joint}: "
                f"{', '.join(map(str, found))}; name one{also} in a mapping"
            )
        return found[0]

    def _called(self, reference: str) -> Place:
        """The column called ``column`` or ``stream:column``, with or without its unit."""
        found = [place for place in self._places if reference in (place.column, str(place))]
        named = ((place, (name, f"{place.stream}:{name}")) for place, name in self._names.items())
        found = found or [place for place, both in named if reference in both]
        if len(found) != 1:
            columns = tuple(map(str, found))
            choice = f"write {' or '.join(columns)}" if found else self._choices()
            said = f"there {'are several columns' if found else 'is no column'} {reference!r}"
            raise self._refused(f"{said}: {choice}", given=reference)
        return found[0]

    def _matching(self, names: Sequence[str], *, ends: bool = True) -> list[Place]:
        """Columns by the words of names, or else, with ``ends``, those at the end of a path."""
        keys = dict.fromkeys(map(words, names))
        for found in self._by_name[: 1 + ends]:
            if places := [place for key in keys for place in found.get(key, ())]:
                return list(dict.fromkeys(places))
        return []

    @cached_property
    def _places(self) -> list[Place]:
        return [Place(stream, column) for stream, names in self.streams.items() for column in names]

    @cached_property
    def _names(self) -> dict[Place, str]:
        """Columns with their names without units."""
        return {place: heading(place.column).name for place in self._places}

    @cached_property
    def _by_name(self) -> tuple[dict[str, list[Place]], ...]:
        """Columns by the words of their names, and by those at the end of a path."""
        found = tuple(defaultdict[str, list[Place]](list) for _ in range(2))
        for place, name in self._names.items():
            path = endings(f"{place.stream}/{name}" if len(self.streams) > 1 else name)
            for places, own in zip(found, ({words(place.column), words(name)}, path), strict=True):
                for key in own:
                    places[key].append(place)
        return found

    def _choices(self) -> str:
        """The columns, for messages."""
        several = len(self.streams) > 1
        names = [str(place) if several else place.column for place in self._places]
        nameless = [stream for stream, names in self.streams.items() if _are_numbered(names)]
        ends = f" (no header in {', '.join(nameless)})" if nameless else ""
        listed = first_of([name[:60] for name in names], MOST_LISTED)
        return f"choose among {listed}{ends}" if names else "it has no columns"

    def _refused(self, said: str, **facts: object) -> LogError:
        return LogError(f"{self.source}: {said}", source=self.source, **facts)


def _said(stream: str) -> str:
    """The quantity in the words of a stream's name; of several, or of none, nothing."""
    said = {*words(stream).split("_")}
    found = [quantity for quantity, known in OF_STREAMS.items() if known & said]
    return "command" if "command" in found else found[0] if len(found) == 1 else ""


def _are_numbered(names: Sequence[str]) -> bool:
    """Whether columns have no names of their own."""
    return list(names) == [str(k + 1) for k in range(len(names))]
