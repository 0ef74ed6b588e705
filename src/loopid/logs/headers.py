"""Where a header cell becomes a name and a unit: "tau1 [N m]" is called tau1, in N m.

Names are compared by their words: "Joint 1.Position", "joint1_position" and "joint_1/position" are
the same.
"""

from __future__ import annotations

import re
import unicodedata
from collections.abc import Mapping
from math import pi
from typing import NamedTuple


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


# Words of what was asked for, not measured.
COMMANDED = {"cmd", "command", "commanded", "desired", "target", "reference", "ref", "setpoint"}


def endings(name: str) -> list[str]:
    """Ends of a path as ``words``: of "/joint_states/elbow/position", "elbow_position", ...

    None of what was commanded.
    """
    parts = [words(part) for part in re.split(r"[/.]", name)]
    if COMMANDED & set(words(name).split("_")):
        return []
    return ["_".join(parts[k:]) for k in range(1, len(parts)) if parts[k]]
