"""Links and joints of a URDF whose tags are known to be sound."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from loopid.arrays import FloatArray, frozen
from loopid.errors import RobotFileError
from loopid.loading.urdf.markup import Element, numbers, required
from loopid.loading.urdf.tags import MOMENTS


@dataclass(frozen=True)
class Inertial:
    """Mass in kg, and the six moments in kg m²."""

    mass: float
    inertia: FloatArray


@dataclass(frozen=True)
class Link:
    """A link, with its ``<inertial>`` if it has one."""

    name: str
    inertial: Inertial | None


@dataclass(frozen=True)
class Mimic:
    """The joint that is followed: q = multiplier * leader + offset."""

    joint: str
    multiplier: float
    offset: float


@dataclass(frozen=True)
class Joint:
    """A joint between two links."""

    name: str
    type: str
    parent: str
    child: str
    mimic: Mimic | None


@dataclass(frozen=True)
class Robot:
    """Links and joints, in the order of the file."""

    name: str
    links: tuple[Link, ...]
    joints: tuple[Joint, ...]


def parse_robot(tree: Element) -> Robot:
    """Read what ``check_tags`` has passed."""
    return Robot(
        tree.get("name", ""),
        tuple(_link(element) for element in tree if element.tag == "link"),
        tuple(_joint(element) for element in tree if element.tag == "joint"),
    )


def _link(element: Element) -> Link:
    return Link(required(element, "name"), _inertial(element.find("inertial")))


def _inertial(element: Element | None) -> Inertial | None:
    if element is None:
        return None
    mass, inertia = _child(element, "mass"), _child(element, "inertia")
    moments = np.array([numbers(inertia, key)[0] for key in MOMENTS])
    return Inertial(numbers(mass, "value")[0], frozen(moments))


def _joint(element: Element) -> Joint:
    return Joint(
        name=required(element, "name"),
        type=required(element, "type"),
        parent=required(_child(element, "parent"), "link"),
        child=required(_child(element, "child"), "link"),
        mimic=_mimic(element.find("mimic")),
    )


def _mimic(element: Element | None) -> Mimic | None:
    if element is None:
        return None
    multiplier = numbers(element, "multiplier", default="1")[0]
    offset = numbers(element, "offset", default="0")[0]
    return Mimic(required(element, "joint"), multiplier, offset)


def _child(element: Element, tag: str) -> Element:
    """A tag that must be there."""
    child = element.find(tag)
    if child is None:
        raise RobotFileError(f"<{tag}> is missing")
    return child
