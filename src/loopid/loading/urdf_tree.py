"""The tree of a URDF: its links and joints, whose names and numbers are sound.

Damage passes silently elsewhere: Pinocchio leaves out an ``<inertial>`` with a number that it
cannot read. So it gets a copy of what the tree is made of, with sound names and numbers.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pinocchio as pin
from lxml import etree

from loopid.arguments import checked_outside
from loopid.errors import ModelWarning, RobotFileError, naming, shown, warn
from loopid.inertia import Inertial
from loopid.loading import xml_elements as xml
from loopid.robot.robot import shortened

JOINT_TYPES = ("revolute", "continuous", "prismatic", "fixed", "floating", "planar")
MOMENTS = ("ixx", "ixy", "ixz", "iyy", "iyz", "izz")
# What the tree is made of: tags inside tags, names, and numbers with their count and the default of
# URDF. Geometry and extensions may be broken without harm.
TAGS = {
    "link": ("inertial",),
    "inertial": ("origin", "mass", "inertia"),
    "joint": ("parent", "child", "origin", "axis", "limit", "mimic"),
}
NAMES = {"link": "name", "joint": "name", "parent": "link", "child": "link", "mimic": "joint"}
NUMBERS: dict[str, dict[str, tuple[int, str | None]]] = {
    "origin": {"xyz": (3, "0 0 0"), "rpy": (3, "0 0 0")},
    "mass": {"value": (1, None)},
    "inertia": dict.fromkeys(MOMENTS, (1, None)),
    "axis": {"xyz": (3, "1 0 0")},
    # An effort or velocity of zero is none, and many files give none.
    "limit": dict.fromkeys(("lower", "upper", "effort", "velocity"), (1, "0")),
    "mimic": {"multiplier": (1, "1"), "offset": (1, "0")},
}
LEAST_AXIS = 1e-9
ROOT_JOINT = "root_joint"


class Link(NamedTuple):
    """A ``<link>``."""

    name: str
    inertial: Inertial | None


class Joint(NamedTuple):
    """A ``<joint>``."""

    name: str
    type: str
    parent: str
    child: str
    axis: tuple[float, ...]
    mimic: tuple[str, float, float] | None  # the joint that leads, multiplier and offset


@checked_outside
@dataclass(frozen=True)
class UrdfFile:
    """A URDF whose names, numbers and tree are sound.

    Examples
    --------
    >>> import loopid
    >>> from loopid.loading.urdf_tree import read_urdf_file
    >>> file = read_urdf_file(loopid.loading.bundled_directory() / "five_bar.urdf")
    >>> file.name, len(file.joints)
    ('five_bar', 6)
    """

    root: xml.Element  # the whole file
    tree: str  # XML of links and joints only, for Pinocchio
    name: str
    links: tuple[Link, ...]  # in the order of the file
    joints: tuple[Joint, ...]
    # Joints that give a link a second parent: they are no part of the tree
    second: tuple[xml.Element, ...] = ()


def read_urdf_file(path: Path, root: xml.Element | None = None) -> UrdfFile:
    """Read a URDF; errors name the file, the element and the offending value.

    ``root`` is what the file says, where that is no URDF itself.
    """
    with naming(path):
        root = urdf_root(path) if root is None else root
        # Numbers as Python writes them: Pinocchio's parser knows fewer spellings.
        name = " ".join(root.get("name", "").split())
        if not name.isprintable():
            raise RobotFileError(f"the name of <robot> must be printable, not {shown(name)}")
        _warn_of_repetition(path, root)
        copy = etree.Element("robot", {"name": name})
        second, carried = list[xml.Element](), set[str]()
        for element in root.iterchildren("link", "joint"):
            with naming(f"{element.tag!s} {xml.required(element, 'name')}"):
                sound = _sound(element)
            link = "" if element.tag == "link" else xml.required(xml.child(sound, "child"), "link")
            if link in carried:
                second.append(element)
            else:
                copy.append(sound)
            carried |= {link} - {""}
        links = tuple(map(_link, copy.iterchildren("link")))
        joints = tuple(map(_joint, copy.iterchildren("joint")))
        if not links:
            raise RobotFileError("not a valid URDF: it has no <link>")
        xml.refuse_repetition("link", (link.name for link in links))
        xml.refuse_repetition("joint", (joint.name for joint in joints))
        _check_tree(links, joints)
    return UrdfFile(root, etree.tostring(copy).decode(), name, links, joints, tuple(second))


def urdf_root(path: Path) -> xml.Element:
    """Root of a URDF; another root is refused."""
    root = xml.read_xml(path)
    # Some simulators declare a default namespace.
    space = f"{{{root.nsmap.get(None)}}}"
    for element in root.iter(f"{space}*"):
        element.tag = str(element.tag).removeprefix(space)
    if root.tag != "robot":
        hint = ": let its name end in .sdf" if root.tag == "sdf" else ""
        raise RobotFileError(f"it is no URDF: the root is <{root.tag!s}>, not <robot>{hint}")
    return root


def _warn_of_repetition(path: Path, root: xml.Element) -> None:
    """Warn of tags of joints that are written twice."""
    found = {tag: list[str]() for tag in (*TAGS["joint"], "dynamics") if tag not in xml.REQUIRED}
    for joint in root.iterchildren("joint"):
        for tag, names in found.items():
            if len(joint.findall(tag)) > 1:
                names.append(joint.get("name", ""))
    for tag, names in found.items():
        if names:
            what = f"{path}: <{tag}> stands twice or more in joint {shortened(names)}"
            warn(f"{what}: the first counts, as for Pinocchio; keep one", ModelWarning)


def _sound(element: xml.Element) -> xml.Element:
    """What the tree needs of an element."""
    tag, kind = str(element.tag), element.get("type", "").strip()
    copy = etree.Element(tag, {"type": kind} if tag == "joint" else None)
    if tag in NAMES:
        copy.set(NAMES[tag], xml.required(element, NAMES[tag]))
    for attribute, (count, default) in NUMBERS.get(tag, {}).items():
        copy.set(attribute, " ".join(map(repr, xml.numbers(element, attribute, count, default))))
    for inner in TAGS.get(tag, ()):
        there = xml.child(element, inner) if inner in xml.REQUIRED else xml.single(element, inner)
        if there is not None and not (inner == "axis" and kind in ("fixed", "floating")):
            copy.append(_sound(there))
    return copy


def _link(element: xml.Element) -> Link:
    """A sound ``<link>``."""
    name, own = xml.required(element, "name"), element.find("inertial")
    if own is None:
        return Link(name, None)
    place, (mass,) = xml.placement(own.find("origin")), xml.numbers(xml.child(own, "mass"), "value")
    xx, xy, xz, yy, yz, zz = (xml.numbers(xml.child(own, "inertia"), key)[0] for key in MOMENTS)
    tensor = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
    if mass < 0:
        raise RobotFileError(f"link {name}: mass must not be negative: {mass:g} kg")
    return Link(name, Inertial(mass, place.translation, place.rotation, tensor))


def _joint(element: xml.Element) -> Joint:
    """A sound ``<joint>``, whose type, axis and limits can be."""
    name, kind = xml.required(element, "name"), element.get("type", "")
    axis, limit, mimic = (element.find(tag) for tag in ("axis", "limit", "mimic"))
    parent, carried = (xml.required(xml.child(element, tag), "link") for tag in ("parent", "child"))
    along = (1.0, 0.0, 0.0) if axis is None else xml.numbers(axis, "xyz", 3)
    with naming(f"joint {name}"):
        RobotFileError.require("type", kind, JOINT_TYPES)
        if np.abs(along).max() < LEAST_AXIS:
            raise RobotFileError("<axis> is zero")
        if limit is not None:
            _check_limit(*_values(limit))
        elif kind in ("revolute", "prismatic"):
            raise RobotFileError(f"a {kind} joint needs a <limit>")
    if mimic is None:
        return Joint(name, kind, parent, carried, along, None)
    factor, offset = _values(mimic)
    return Joint(name, kind, parent, carried, along, (xml.required(mimic, "joint"), factor, offset))


def _values(element: xml.Element) -> Iterator[float]:
    """Single numbers of a sound element."""
    return (xml.numbers(element, attribute)[0] for attribute in NUMBERS[str(element.tag)])


def _check_limit(lower: float, upper: float, effort: float, velocity: float) -> None:
    if lower > upper:
        raise RobotFileError(f"<limit> lower {lower} exceeds upper {upper}")
    for key, most in {"effort": effort, "velocity": velocity}.items():
        if most < 0:
            raise RobotFileError(f"<limit> {key} must not be negative: {most}")


def _check_tree(every: Sequence[Link], joints: Sequence[Joint]) -> None:
    """Refuse joints between links that are not there, and links that do not form one tree."""
    links = {link.name for link in every}
    for joint in joints:
        for end in (joint.parent, joint.child):
            if end not in links:
                raise RobotFileError(f"joint {joint.name} names link {end!r}, which is not there")
    carriers = {joint.child for joint in joints}
    roots = sorted(links - carriers)
    if len(roots) != 1:
        listed = ", ".join(roots) or "none"
        hint = "" if roots else ": a joint closes a loop there: write it as a closure in a YAML"
        raise RobotFileError(f"the links must form one tree with one root, not {listed}{hint}")
    reached, more = set(roots), set(roots)
    while more:
        more = {joint.child for joint in joints if joint.parent in more}
        reached |= more
    if reached != links:
        lost = ", ".join(sorted(links - reached))
        raise RobotFileError(f"links {lost} hang on a cycle of joints, not on root {roots[0]}")


def build_model(urdf: UrdfFile, floating_base: bool) -> pin.Model:
    """Pinocchio's model, with mimicking joints as joints of their own."""
    taken = {"universe": "the ground"}
    if floating_base:
        taken[ROOT_JOINT] = "the joint of the floating base"
    for joint in urdf.joints:
        if joint.name in taken:
            what = f"joint {joint.name} must not be called like {taken[joint.name]}"
            raise RobotFileError(f"{what}: rename it")
    base = [pin.JointModelFreeFlyer()] if floating_base else []
    try:
        model = pin.buildModelFromXML(urdf.tree, *base)
    except (ValueError, RuntimeError) as error:
        reason = " ".join(str(error).split())
        raise RobotFileError(f"Pinocchio refuses it: {reason}") from error
    for joint in urdf.joints:
        if joint.type == "planar" and joint.axis != (0.0, 0.0, 1.0):
            _turn_plane(model, model.getJointId(joint.name), joint.axis)
    return model


def _turn_plane(model: pin.Model, index: int, axis: tuple[float, ...]) -> None:
    """Turn the frame of a planar joint, whose xy plane Pinocchio takes, across its axis."""
    turn = pin.Quaternion.FromTwoVectors(np.array([0.0, 0.0, 1.0]), np.array(axis)).matrix()
    there = pin.SE3(turn, np.zeros(3))
    model.jointPlacements[index] = model.jointPlacements[index] * there
    model.inertias[index] = there.actInv(model.inertias[index])
    for k in map(int, np.flatnonzero(np.array(model.parents) == index)):
        model.jointPlacements[k] = there.actInv(model.jointPlacements[k])
    for frame in model.frames:
        if frame.parentJoint == index:
            frame.placement = there.actInv(frame.placement)
