"""The tree of a URDF: its links and joints, whose names and numbers are sound.

Damage passes silently elsewhere: yourdfpy reads a file that is cut off as a smaller robot and a
missing moment as 0 or 1; Pinocchio leaves out an ``<inertial>`` with a number that it cannot read.
So both get a copy of what the tree is made of, in which names and numbers are sound.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Collection, Iterable, Iterator
from dataclasses import dataclass
from io import BytesIO
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pinocchio as pin
from lxml import etree

from loopid.arguments import FloatArray
from loopid.errors import ModelWarning, RobotFileError, naming, warn
from loopid.robot.mechanism import shortened

if TYPE_CHECKING:
    from yourdfpy.urdf import Joint, Robot

Element = etree._Element
JOINT_TYPES = ("revolute", "continuous", "prismatic", "fixed", "floating", "planar")
MOMENTS = ("ixx", "ixy", "ixz", "iyy", "iyz", "izz")
# What the tree is made of: tags inside tags, those that must be there, names, and numbers with
# their count and the default of URDF. Geometry and extensions may be broken without harm.
TAGS = {
    "link": ("inertial",),
    "inertial": ("origin", "mass", "inertia"),
    "joint": ("parent", "child", "origin", "axis", "limit", "mimic"),
}
REQUIRED = ("mass", "inertia", "parent", "child")
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
WORDS = {
    1: "a finite number",
    3: "three finite numbers",
    6: "six finite numbers",
    7: "seven finite numbers",
}
LARGEST = 1e100  # so that no product of a few numbers overflows
MOST_BYTES = 20_000_000  # of a file: far more than robots have
# Angles that lost digits in print: multiples of 5°, which people draw. Fewer decimals may be meant
# as they are written; with more, nothing is lost. In units of the last digit: 1.57079 is cut off,
# and 3.14158 is twice that.
STEP = math.pi / 36
DECIMALS = range(4, 13)
SLACK = 1.5


@dataclass(frozen=True)
class UrdfFile:
    """A URDF whose names, numbers and tree are sound."""

    root: Element  # the whole file
    tree: str  # XML of links and joints only, for Pinocchio
    robot: Robot  # links and joints in the order of the file
    # Joints that give a link a second parent: they are no part of the tree
    second: tuple[Element, ...] = ()


def read_urdf_file(path: Path, root: Element | None = None) -> UrdfFile:
    """Read a URDF with yourdfpy; errors name the file, the element and the offending value.

    ``root`` is what the file says, where that is no URDF itself.
    """
    from yourdfpy import URDF  # here, as it takes 0.3 s to import

    with naming(path):
        root = urdf_root(path) if root is None else root
        # Numbers as Python writes them: Pinocchio's parser knows fewer spellings.
        name = " ".join(root.get("name", "").split())
        if not name.isprintable():
            raise RobotFileError(f"the name of <robot> must be printable, not {name!r:.60}")
        _warn_of_repetition(path, root)
        copy = etree.Element("robot", {"name": name})
        second, carried = list[Element](), set[str]()
        for element in root.iterchildren("link", "joint"):
            with naming(f"{element.tag!s} {required(element, 'name')}"):
                sound = _sound(element)
            link = "" if element.tag == "link" else required(child(sound, "child"), "link")
            if link in carried:
                second.append(element)
            else:
                copy.append(sound)
            carried |= {link} - {""}
        tree = etree.tostring(copy)
        robot = URDF.load(BytesIO(tree), build_scene_graph=False, load_meshes=False).robot
        if not robot.links:
            raise RobotFileError("not a valid URDF: it has no <link>")
        refuse_repetition("link", (link.name for link in robot.links))
        refuse_repetition("joint", (joint.name for joint in robot.joints))
        for joint in robot.joints:
            with naming(f"joint {joint.name}"):
                _check_joint(joint)
        for link in robot.links:
            if link.inertial is not None and link.inertial.mass < 0:
                mass = f"{link.inertial.mass:g} kg"
                raise RobotFileError(f"link {link.name}: mass must not be negative: {mass}")
        _check_tree(robot)
    return UrdfFile(root, tree.decode(), robot, tuple(second))


def urdf_root(path: Path) -> Element:
    """Root of a URDF; another root is refused."""
    root = read_xml(path)
    # Some simulators declare a default namespace.
    space = f"{{{root.nsmap.get(None)}}}"
    for element in root.iter(f"{space}*"):
        element.tag = str(element.tag).removeprefix(space)
    if root.tag != "robot":
        hint = ": let its name end in .sdf" if root.tag == "sdf" else ""
        raise RobotFileError(f"it is no URDF: the root is <{root.tag!s}>, not <robot>{hint}")
    return root


def _warn_of_repetition(path: Path, root: Element) -> None:
    """Warn of tags of joints that are written twice."""
    found = {tag: list[str]() for tag in (*TAGS["joint"], "dynamics") if tag not in REQUIRED}
    for joint in root.iterchildren("joint"):
        for tag, names in found.items():
            if len(joint.findall(tag)) > 1:
                names.append(joint.get("name", ""))
    for tag, names in found.items():
        if names:
            what = f"{path}: <{tag}> stands twice or more in joint {shortened(names)}"
            warn(f"{what}: the first counts, as for Pinocchio; keep one", ModelWarning)


def _sound(element: Element) -> Element:
    """What the tree needs of an element."""
    tag, kind = str(element.tag), element.get("type", "").strip()
    copy = etree.Element(tag, {"type": kind} if tag == "joint" else None)
    if tag in NAMES:
        copy.set(NAMES[tag], required(element, NAMES[tag]))
    for attribute, (count, default) in NUMBERS.get(tag, {}).items():
        copy.set(attribute, " ".join(map(repr, numbers(element, attribute, count, default))))
    for inner in TAGS.get(tag, ()):
        there = child(element, inner) if inner in REQUIRED else single(element, inner)
        if there is not None and not (inner == "axis" and kind in ("fixed", "floating")):
            copy.append(_sound(there))
    return copy


def _check_joint(joint: Joint) -> None:
    if joint.type not in JOINT_TYPES:
        listed = ", ".join(JOINT_TYPES)
        raise RobotFileError(f"unknown type {joint.type!r}: choose among {listed}")
    if np.abs(joint.axis).max() < LEAST_AXIS:
        raise RobotFileError("<axis> is zero")
    limit = joint.limit
    if limit is None:
        if joint.type in ("revolute", "prismatic"):
            raise RobotFileError(f"a {joint.type} joint needs a <limit>")
        return
    if limit.lower > limit.upper:
        raise RobotFileError(f"<limit> lower {limit.lower} exceeds upper {limit.upper}")
    for key in ("effort", "velocity"):
        if getattr(limit, key) < 0:
            raise RobotFileError(f"<limit> {key} must not be negative: {getattr(limit, key)}")


def _check_tree(robot: Robot) -> None:
    """Refuse joints between links that are not there, and links that do not form one tree."""
    links = {link.name for link in robot.links}
    for joint in robot.joints:
        for end in (joint.parent, joint.child):
            if end not in links:
                raise RobotFileError(f"joint {joint.name} names link {end!r}, which is not there")
    carriers = {joint.child for joint in robot.joints}
    roots = sorted(links - carriers)
    if len(roots) != 1:
        listed = ", ".join(roots) or "none"
        hint = (
            "" if roots else ": a joint closes a loop at the root: write it as a closure in a YAML"
        )
        raise RobotFileError(
            f"the links must form one tree with one root, but roots are: {listed}{hint}"
        )
    reached, more = set(roots), set(roots)
    while more:
        more = {joint.child for joint in robot.joints if joint.parent in more}
        reached |= more
    if reached != links:
        lost = ", ".join(sorted(links - reached))
        raise RobotFileError(f"links {lost} hang on a cycle of joints, not on root {roots[0]}")


def build_model(urdf: UrdfFile, floating_base: bool) -> pin.Model:
    """Pinocchio's model, with mimicking joints as joints of their own."""
    taken = {"universe": "the ground"}
    if floating_base:
        taken[ROOT_JOINT] = "the joint of the floating base"
    for joint in urdf.robot.joints:
        if joint.name in taken:
            what = f"joint {joint.name} must not be called like {taken[joint.name]}"
            raise RobotFileError(f"{what}: rename it")
    base = [pin.JointModelFreeFlyer()] if floating_base else []
    try:
        model = pin.buildModelFromXML(urdf.tree, *base)
    except (ValueError, RuntimeError) as error:
        reason = " ".join(str(error).split())
        raise RobotFileError(f"Pinocchio refuses it: {reason}") from error
    for joint in urdf.robot.joints:
        if joint.type == "planar" and (joint.axis != [0, 0, 1]).any():
            _turn_plane(model, model.getJointId(joint.name), joint.axis)
    return model


def _turn_plane(model: pin.Model, index: int, axis: FloatArray) -> None:
    """Turn the frame of a planar joint, whose xy plane Pinocchio takes, across its axis."""
    turn = pin.Quaternion.FromTwoVectors(np.array([0.0, 0.0, 1.0]), axis).matrix()
    there = pin.SE3(turn, np.zeros(3))
    model.jointPlacements[index] = model.jointPlacements[index] * there
    model.inertias[index] = there.actInv(model.inertias[index])
    for child in np.flatnonzero(np.array(model.parents) == index):
        model.jointPlacements[int(child)] = there.actInv(model.jointPlacements[int(child)])
    for frame in model.frames:
        if frame.parentJoint == index:
            frame.placement = there.actInv(frame.placement)


# XML: tags, names and numbers that are refused by name where they are not sound.


def read_xml(path: Path, whole: bool = False) -> Element:
    """Root of an XML file, without comments unless it is to be whole; entities are refused.

    Prefixes without a namespace are common, and harmless; other broken grammar is refused.
    """
    try:
        with path.open("rb") as stream:
            content = stream.read(MOST_BYTES + 1)
    except OSError as error:
        raise RobotFileError(f"cannot be read: {error.strerror}") from error
    return parsed_xml(content, whole)


def parsed_xml(content: bytes, whole: bool = False) -> Element:
    """Root of the text of an XML file; see ``read_xml``."""
    options: dict[str, Any] = dict.fromkeys(("remove_comments", "remove_pis"), not whole)
    options["resolve_entities"] = False
    if len(content) > MOST_BYTES:
        raise RobotFileError(f"it is longer than the {MOST_BYTES / 1e6:g} MB that are read")
    try:
        root: Element = etree.fromstring(content, etree.XMLParser(**options))
    except etree.XMLSyntaxError as error:
        if error.code != etree.ErrorTypes.NS_ERR_UNDEFINED_NAMESPACE:
            raise RobotFileError(f"it is no valid XML: {error.msg}") from error
        root = etree.fromstring(content, etree.XMLParser(recover=True, **options))
    declared = root.getroottree().docinfo.internalDTD
    names = [] if declared is None else [str(entity.name) for entity in declared.iterentities()]
    names += [str(entity.text)[1:-1] for entity in root.iter(etree.Entity)]
    if names:
        raise RobotFileError(
            f"XML entities are not read: write out what &{names[0]:.60}; stands for"
        )
    return root


def label(element: Element) -> str:
    """A tag with its name, for messages."""
    name = element.get("name")
    return f"<{element.tag!s}>" if name is None else f"<{element.tag!s} name={name!r}>"


def child(element: Element, tag: str) -> Element:
    """A tag that must be there."""
    found = single(element, tag)
    if found is None:
        raise RobotFileError(f"<{element.tag!s}> has no <{tag}>")
    return found


def single(element: Element, tag: str) -> Element | None:
    """A tag that may be there, once; of a joint's the first counts, as for Pinocchio."""
    found = element.findall(tag)
    if len(found) > 1 and (element.tag != "joint" or tag in REQUIRED):
        raise RobotFileError(f"<{element.tag!s}> has {len(found)} times <{tag}>: keep one")
    return found[0] if found else None


def required(element: Element, attribute: str) -> str:
    """Text of an attribute that must be there."""
    text = (element.get(attribute) or "").strip()
    if not text:
        raise RobotFileError(f"{label(element)} has no {attribute}")
    if not text.isprintable():
        raise RobotFileError(f"{label(element)}: {attribute} must be printable, not {text!r:.60}")
    return text


def numbers(
    element: Element, attribute: str, count: int = 1, default: str | None = None
) -> tuple[float, ...]:
    """Finite numbers of an attribute, which must be there unless it has a default."""
    text = element.get(attribute, default)
    if text is None:
        raise RobotFileError(f"<{element.tag!s}> has no {attribute}")
    # Limits are often the largest number there is.
    most = math.inf if element.tag == "limit" else LARGEST
    read = exact_angle if attribute == "rpy" else float
    return numbers_in(f"<{element.tag!s}> {attribute}", text, count, most=most, read=read)


def numbers_in(
    what: str,
    text: str,
    count: int = 1,
    *,
    most: float = LARGEST,
    read: Callable[[str], float] = float,
) -> tuple[float, ...]:
    """Finite numbers of a text."""
    # Python's 1_6 and digits of other scripts are no numbers.
    words = text.split() if text.isascii() and "_" not in text else []
    try:
        values = tuple(map(read, words))
    except ValueError:
        values = ()
    if len(values) != count or not all(map(math.isfinite, values)):
        raise RobotFileError(f"{what} must be {WORDS[count]}, not {text!r:.60}")
    if max(map(abs, values)) > most:
        raise RobotFileError(f"{what} is too large: {text}")
    return values


def exact_angle(text: str) -> float:
    """Angle in rad: the multiple of 5° that rounds, or is cut, to the text, else what it says.

    A quarter turn written as 1.5708 tilts an axis by 4e-6 rad. Redundant closures then contradict
    each other, and parameters that no motor feels seem to have an effect of 1e-11.
    """
    value = float(text)
    decimals = len(text.partition(".")[2])
    steps = round(value / STEP) if abs(value) < LARGEST else 0
    if steps == 0 or decimals not in DECIMALS or not text.lstrip("+-").replace(".", "").isdigit():
        return value
    exact = steps * STEP
    return exact if abs(exact - value) < SLACK * 10.0**-decimals else value


def placement(origin: Element | None) -> pin.SE3:
    """Placement of an ``<origin>``; the identity without one."""
    if origin is None:
        return pin.SE3.Identity()
    xyz, rpy = (np.array(numbers(origin, key, 3, "0 0 0")) for key in ("xyz", "rpy"))
    return pin.SE3(pin.rpy.rpyToMatrix(rpy), xyz)


def refuse_repetition(tag: str, names: Iterable[str]) -> None:
    """Refuse elements of one name."""
    for name, count in Counter(names).items():
        if count > 1:
            raise RobotFileError(f"<{tag} name={name!r}> appears {count} times")


def named_tags(root: Element, tag: str) -> list[Element]:
    """All tags of one kind below the root, each with a name of its own."""
    elements = root.findall(tag)
    refuse_repetition(tag, (required(element, "name") for element in elements))
    return elements


def inner_tags(element: Element, tags: Collection[str]) -> Iterator[Element]:
    """All tags of some kinds below an element, in any namespace."""
    return (found for found in element.iterdescendants("*") if local_name(found) in tags)


def local_name(element: Element) -> str:
    """A tag without its namespace or prefix."""
    return str(element.tag).rpartition("}")[2].rpartition(":")[2]


def said(element: Element, *tags: str) -> str:
    """The value, name or text of the first tag of some below an element, in any namespace."""
    for found in inner_tags(element, tags):
        return (found.get("value") or found.get("name") or found.text or "").strip()
    return ""
