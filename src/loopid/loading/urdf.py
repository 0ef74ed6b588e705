"""A URDF: Pinocchio's model of its tree, and what the file declares beyond that.

Damage passes silently elsewhere: yourdfpy reads a file that is cut off as a smaller robot and a
missing moment as 0 or 1; Pinocchio leaves out an ``<inertial>`` with a number that it cannot read.
So both get a copy of what the tree is made of, in which names and numbers are sound.

Closures are written in many ways: joints that ``<mimic>`` others, pairs of closing frames as
onshape-to-robot exports them, the ``<loop>`` and ``<coupling>`` tags of URDF+ [Chignoli2024], tags
of simulators, and joints that give a link a second parent.
"""

from __future__ import annotations

import math
import re
from collections import Counter
from collections.abc import Collection, Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from io import BytesIO
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pinocchio as pin
from lxml import etree
from pydantic import ValidationError

from loopid.arguments import number
from loopid.errors import RobotFileError
from loopid.loading.description import (
    ClosureDescription,
    Description,
    warn_of_size,
)
from loopid.loading.tree import (
    TreeSource,
    add_frame,
)
from loopid.robot.mechanism import (
    LeftOut,
    shortened,
)
from loopid.yaml_files import first_problem

if TYPE_CHECKING:
    from yourdfpy.urdf import Joint, Robot

Element = etree._Element
JOINT_TYPES = ("revolute", "continuous", "prismatic", "fixed", "floating", "planar")
SEVERAL = ("floating", "planar")  # types of joints with several coordinates
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
WORDS = {1: "a finite number", 3: "three finite numbers"}
LARGEST = 1e100  # so that no product of a few numbers overflows
LEAST_AXIS = 1e-9
# Far more than robots have.
MOST_BYTES = 20_000_000
MOST_LINKS = 2000
# Angles that lost digits in print: multiples of 5°, which people draw. Fewer decimals may be meant
# as they are written; with more, nothing is lost. In units of the last digit: 1.57079 is cut off,
# and 3.14158 is twice that.
STEP = math.pi / 36
DECIMALS = range(4, 13)
SLACK = 1.5

ROOT_JOINT = "root_joint"
PACKAGE = "package://"
CLOSING_FRAME = re.compile(r"closing_(.+)_([12])")
CLOSING_PLUGIN = re.compile("closed_?loop|attach_links")
Z = (0.0, 0.0, 1.0)
AXIAL = ("hinge", "cylindrical", "prismatic", "universal")
# Kinds of closures by the types of joints, of URDF+ and of others.
LOOPS = {kind: kind for kind in AXIAL[1:]}
LOOPS |= {"continuous": "hinge", "fixed": "6d", "revolute": "hinge", "spherical": "3d"}
ALSO = {"ball": "3d", "weld": "6d", "hinge": "hinge"}
TRUTH = {"true": True, "1": True, "false": False, "0": False}
UNREAD = ("loop_constraint", "joint_constraint")  # of drafts of URDF+
# Tags that name the ends of what closes a loop; others say parent and child.
ENDS = {
    "loop": ("predecessor", "successor"),
    "coupling": ("predecessor", "successor"),
    "loop_joint": ("link1", "link2"),
}
Couplings = dict[str, ClosureDescription]  # by the joint that follows the others


def read_urdf(path: Path, floating_base: bool = False, free_mimics: bool = False) -> TreeSource:
    """Read the tree of a URDF, and what the file says of closures, motors and forces.

    A root link that floats does so on a joint called ``root_joint``; free mimics move on their own.
    Errors name the file, the link, joint or tag and the offending value.
    """
    urdf = read_urdf_file(path)
    links, joints = urdf.robot.links, urdf.robot.joints
    for joint in joints:
        warn_of_size(f"{path}: joint {joint.name}", joint.axis)
    with naming(path):
        model = build_model(urdf, floating_base)
        mimics = {} if free_mimics else _mimics(joints)
        couplings = _couplings(urdf)
        closures = _closing_frames([link.name for link in links]) + _loops(urdf, model)
        motors = _motors(urdf, mimics, couplings, looped=bool(closures))
        terms, left_out = _joint_forces(urdf)
    children = {joint.child for joint in joints}
    root_link = next(link.name for link in links if link.name not in children)
    carried = {ROOT_JOINT: root_link} if floating_base else {}
    return TreeSource(
        name=urdf.robot.name or path.stem,
        file=path,
        model=model,
        # An <inertial> that is all zero counts as none.
        inertial_links=tuple(
            link.name
            for link in links
            if link.inertial is not None and (link.inertial.mass or link.inertial.inertia.any())
        ),
        child_links=carried | {joint.name: joint.child for joint in joints},
        description=Description(
            closures=[*closures, *(coupling for _, coupling in couplings), *mimics.values()],
            name_mot=motors,
            joint_terms=terms,
        ),
        left_out=tuple(left_out),
        notes=(
            *(
                f"{label(joint)} gives its link a second parent: it closes a loop"
                for joint in urdf.second
            ),
            *_unread_plugins(urdf),
        ),
    )


# The tree.


@dataclass(frozen=True)
class UrdfFile:
    """A URDF whose names, numbers and tree are sound."""

    root: Element  # the whole file
    tree: str  # XML of links and joints only, for Pinocchio
    robot: Robot  # links and joints in the order of the file
    # Joints that give a link a second parent: they are no part of the tree
    second: tuple[Element, ...] = ()


def read_urdf_file(path: Path) -> UrdfFile:
    """Read a URDF with yourdfpy; errors name the file, the element and the offending value."""
    from yourdfpy import URDF  # here, as it takes 0.3 s to import

    with naming(path):
        root = parse_xml(path)
        # Numbers as Python writes them: Pinocchio's parser knows fewer spellings.
        name = " ".join(root.get("name", "").split())
        if not name.isprintable():
            raise RobotFileError(f"the name of <robot> must be printable, not {name!r:.60}")
        copy = etree.Element("robot", {"name": name})
        if len(root.findall("link")) > MOST_LINKS:
            raise RobotFileError(f"it has more than the {MOST_LINKS} links that are read")
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


@contextmanager
def naming(what: str | Path) -> Iterator[None]:
    """Name a file or an element in front of whatever is refused inside."""
    try:
        yield
    except RobotFileError as error:
        raise RobotFileError(f"{what}: {error}") from error


def parse_xml(path: Path) -> Element:
    """Root of a URDF, without comments; entities are refused, as what they stand for is not read.

    Prefixes without a namespace are common, and harmless; other broken grammar is refused.
    """
    options: dict[str, Any] = dict.fromkeys(("remove_comments", "remove_pis"), True)
    options["resolve_entities"] = False
    try:
        with path.open("rb") as stream:
            content = stream.read(MOST_BYTES + 1)
    except OSError as error:
        raise RobotFileError(f"cannot be read: {error.strerror}") from error
    if len(content) > MOST_BYTES:
        raise RobotFileError(f"it is longer than the {MOST_BYTES / 1e6:g} MB that are read")
    try:
        root: Element = etree.fromstring(content, etree.XMLParser(**options))
    except etree.XMLSyntaxError as error:
        if error.code != etree.ErrorTypes.NS_ERR_UNDEFINED_NAMESPACE:
            raise RobotFileError(f"not a valid URDF: {error.msg}") from error
        root = etree.fromstring(content, etree.XMLParser(recover=True, **options))
    refuse_entities(root)
    # Some simulators declare a default namespace.
    space = f"{{{root.nsmap.get(None)}}}"
    for element in root.iter(f"{space}*"):
        element.tag = str(element.tag).removeprefix(space)
    if root.tag == "sdf":
        children = Counter((tag.text or "").strip() for tag in root.iterfind(".//joint/child"))
        second = ", ".join(name for name, count in children.items() if count > 1)
        loops = f" ({second} have two parents)" if second else ""
        raise RobotFileError(
            f"<sdf> is not read: convert it to a URDF, with one parent a link{loops} and the other "
            "joints as 'closures' in a YAML beside it"
        )
    if root.tag != "robot":
        raise RobotFileError(f"not a valid URDF: the root is <{root.tag!s}>, not <robot>")
    return root


def refuse_entities(root: Element) -> None:
    """Refuse entities that an XML file declares, or uses without."""
    declared = root.getroottree().docinfo.internalDTD
    names = [] if declared is None else [str(entity.name) for entity in declared.iterentities()]
    names += [str(entity.text)[1:-1] for entity in root.iter(etree.Entity)]
    if names:
        raise RobotFileError(
            f"XML entities are not read: write out what &{names[0]:.60}; stands for"
        )


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
    """A tag that may be there, once."""
    found = element.findall(tag)
    if len(found) > 1:
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
    what, text = f"<{element.tag!s}> {attribute}", element.get(attribute, default)
    if text is None:
        raise RobotFileError(f"<{element.tag!s}> has no {attribute}")
    values = tuple(map(exact_angle if attribute == "rpy" else number, text.split()))
    if len(values) != count or not all(map(math.isfinite, values)):
        raise RobotFileError(f"{what} must be {WORDS[count]}, not {text!r:.60}")
    # Limits are often the largest number there is.
    if element.tag != "limit" and max(map(abs, values)) > LARGEST:
        raise RobotFileError(f"{what} is too large: {text}")
    return values


def exact_angle(text: str) -> float:
    """Angle in rad: the multiple of 5° that rounds, or is cut, to the text, else what it says.

    A quarter turn written as 1.5708 tilts an axis by 4e-6 rad. Redundant closures then contradict
    each other, and parameters that no motor feels seem to have an effect of 1e-11.
    """
    value = number(text)
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


def refuse_repetition(tag: str, names: Iterable[str]) -> None:
    """Refuse elements of one name."""
    for name, count in Counter(names).items():
        if count > 1:
            raise RobotFileError(f"<{tag} name={name!r}> appears {count} times")


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
        return pin.buildModelFromXML(urdf.tree, *base)
    except (ValueError, RuntimeError) as error:
        reason = " ".join(str(error).split())
        raise RobotFileError(f"Pinocchio refuses it: {reason}") from error


def unread_mesh(file: Path) -> str:
    """Why a mesh of the collision geometry of a URDF is no file; nothing where all are."""
    try:
        for mesh in parse_xml(file).iterfind("link/collision/geometry/mesh"):
            name = required(mesh, "filename")
            places = [file.parent / name.removeprefix("file://")]
            if name.startswith(PACKAGE):
                package, *rest = Path(name.removeprefix(PACKAGE)).parts
                above = file.resolve().parents
                places = [folder.joinpath(*p) for folder in above for p in ((package, *rest), rest)]
            if not any(place.is_file() for place in places):
                return f"there is no mesh {places[0] if len(places) == 1 else name}"
    except RobotFileError as error:
        return str(error)
    return ""


# Closures: mimics, closing frames, and the tags of URDF+.


def _mimics(all_joints: Iterable[Joint]) -> Couplings:
    """Joints that follow another one: follower = multiplier · leader + offset.

    A follower may lead others. Fixed joints have nothing to follow with: their tag says nothing.
    """
    joints = {joint.name: joint for joint in all_joints}
    leaders = {
        name: joint.mimic.joint
        for name, joint in joints.items()
        if joint.mimic is not None and joint.type != "fixed"
    }
    for name, leading in leaders.items():
        what = f"joint {name} mimics {leading!r}"
        if leading not in joints:
            raise RobotFileError(f"{what}, which is not there: choose among {', '.join(joints)}")
        if joints[leading].type == "fixed":
            raise RobotFileError(f"{what}, which is fixed")
        for end in (joints[name], joints[leading]):
            if end.type in SEVERAL:
                raise RobotFileError(
                    f"{what}, but {end.name} is {end.type}: it has several coordinates"
                )
    for follower in leaders:
        chain = [follower]
        while chain[-1] in leaders and len(chain) <= len(leaders):
            chain.append(leaders[chain[-1]])
            if chain[-1] == follower:
                circle = " mimics ".join(chain)
                raise RobotFileError(f"joint {circle}: a circle, with no joint to lead it")
    found = {}
    for name, leading in leaders.items():
        factor, offset = joints[name].mimic.multiplier, joints[name].mimic.offset
        terms = {name: 1.0} | ({leading: -factor} if factor else {})
        found[name] = ClosureDescription(type="coupling", joints=terms, offset=offset)
    return found


def _closing_frames(links: Collection[str]) -> list[ClosureDescription]:
    """Closures of the links ``closing_NAME_1`` and ``closing_NAME_2``.

    The names say that two frames meet, not by which joint. Only beside a hinge, versions of the
    exporter add a second pair of frames further along its axis, ``closing_NAME_1_z`` and
    ``closing_NAME_2_z``; without them the origins meet, which the exporter's manual has one
    enforce.
    """
    closures = []
    for match in filter(None, map(CLOSING_FRAME.fullmatch, links)):
        name, side = match.groups()
        frames = (f"closing_{name}_1", f"closing_{name}_2")
        partner = frames[2 - int(side)]
        if partner not in links:
            raise RobotFileError(
                f"link {match[0]} closes a loop with link {partner!r}, which is missing"
            )
        if side == "2":
            continue
        if all(f"{frame}_z" in links for frame in frames):
            axial = ClosureDescription(type="hinge", name=name, frames=frames, axes=(Z, Z))
            closures.append(axial)
        else:
            closures.append(ClosureDescription(type="3d", name=name, frames=frames))
    return closures


# A tag that closes a loop, its links, and where in them its frames are.
Loop = tuple[Element, tuple[str, str], tuple[pin.SE3, pin.SE3]]


def _loops(urdf: UrdfFile, model: pin.Model) -> list[ClosureDescription]:
    """Closures of tags, their frames mounted in the model as ``NAME_SIDE``."""
    for element in _all(urdf.root, UNREAD):
        raise RobotFileError(
            f"{label(element)} is not read: remove it, and write its closure into a YAML beside it"
        )
    closures = []
    for element, links, places in (*_tags(urdf), *_as_drawn(urdf, model), *_balls(urdf)):
        with naming(label(element)):
            given, named = (element.get("type") or "").strip(), element.get("name", "").strip()
            kind = (LOOPS | ALSO).get(given)
            if kind is None:
                listed = ", ".join(sorted(LOOPS))
                raise RobotFileError(f"unknown type {given!r}: choose among {listed}")
            frames = [f"{named}_{side}" for side in _sides(element)]
            for frame, link, place in zip(frames, links, places, strict=True):
                if any(other.name == frame for other in model.frames):
                    raise RobotFileError(
                        f"its frame cannot be called {frame!r}, which is taken: rename the "
                        f"{element.tag!s}"
                    )
                add_frame(model, frame, link, place)
            content: dict[str, Any] = {"type": kind, "name": named, "frames": frames}
            content |= {"axes": _axes(element, kind)} if kind in AXIAL else {}
            try:
                closures.append(ClosureDescription.model_validate(content))
            except ValidationError as error:
                raise RobotFileError(first_problem(error)) from error
    return closures


def _tags(urdf: UrdfFile) -> Iterator[Loop]:
    """``<loop>`` of URDF+, ``<constraint>`` of urdfdom's pull request 264, ``<loop_joint>``."""
    places = {"loop": "{}/origin", "constraint": "{}_origin", "loop_joint": "{}"}
    for tag, place in places.items():
        for element in _named_tags(urdf.root, tag):
            for repeated in element.findall("link1")[1:]:
                repeated.tag = "link2"  # Isaac Sim's manual writes <link1> twice
            with naming(label(element)):
                first, second = (placement(element.find(place.format(s))) for s in _sides(element))
                yield element, _ends(element, urdf), (first, second)


def _as_drawn(urdf: UrdfFile, model: pin.Model) -> Iterator[Loop]:
    """Joints that give a link a second parent, and those of Gazebo, placed in their child."""
    for element in urdf.second:
        with naming(label(element)):
            here = placement(element.find("origin")), pin.SE3.Identity()
            yield element, _ends(element, urdf), here
    data = model.createData()
    pin.framesForwardKinematics(model, data, pin.neutral(model))
    for element in urdf.root.findall("gazebo/joint"):
        parent = (child(element, "parent").text or "").strip()
        if parent == "world" and all(link.name != "world" for link in urdf.robot.links):
            continue  # a mount, which a URDF has anyway
        with naming(label(element)):
            ends = _ends(element, urdf)
            first, second = (data.oMf[model.getFrameId(end, pin.FrameType.BODY)] for end in ends)
            words = (element.findtext("pose") or "0 0 0 0 0 0").split()
            pose = {"xyz": " ".join(words[:3]), "rpy": " ".join(words[3:])}
            place = placement(etree.Element("origin", pose))
            yield element, ends, (first.actInv(second * place), place)


def _balls(urdf: UrdfFile) -> Iterator[Loop]:
    """Ball constraints of Drake."""
    for k, element in enumerate(_all(urdf.root, ("ball_constraint",)), start=1):
        ball = etree.Element("ball_constraint", type="ball", name=f"ball_constraint_{k}")
        with naming(label(ball)):
            points = list[pin.SE3]()
            for side, body, point in (("parent", "body_A", "p_AP"), ("child", "body_B", "p_BQ")):
                link, xyz = (_said(element, (f"ball_constraint_{tag}",)) for tag in (body, point))
                if not (link and xyz):
                    raise RobotFileError(f"it needs ball_constraint_{body} and _{point}")
                end = etree.SubElement(ball, side, link=link, xyz=xyz)
                points.append(pin.SE3(np.eye(3), np.array(numbers(end, "xyz", 3))))
            yield ball, _ends(ball, urdf), (points[0], points[1])


def _axes(element: Element, kind: str) -> list[tuple[float, ...]]:
    """Axes of a closure in its two frames, which only a ``<constraint>`` gives one by one."""
    names = ("parent_axis", "child_axis") if element.tag == "constraint" else ("axis", "axis")
    tags = [tag for name in names if (tag := element.find(name)) is not None]
    if not tags and element.tag in ("loop", "loop_joint"):
        child(element, "axis")
    if kind == "universal" and (len(tags) < 2 or element.tag != "constraint"):
        raise RobotFileError("a universal joint needs <parent_axis> and <child_axis>")
    axes = []
    for tag in tags or [etree.Element("axis", xyz="1 0 0")]:
        text = tag.findtext("xyz")  # as SDF writes it
        axes.append(numbers(tag if text is None else etree.Element("axis", xyz=text), "xyz", 3))
        if max(map(abs, axes[-1])) < LEAST_AXIS:
            raise RobotFileError(f"<{tag.tag!s}> is zero")
    return [axes[0], axes[-1]]


def _sides(element: Element) -> tuple[str, str]:
    return ENDS.get(str(element.tag), ("parent", "child"))


def _couplings(urdf: UrdfFile) -> list[tuple[str, ClosureDescription]]:
    """``<coupling>`` tags: gears and belts between two links, each with the joint that follows.

    From the nearest link that carries both, joints lead to the predecessor and to the successor.
    The coordinates on the way to the successor add up to the ratio times those on the way to the
    predecessor.
    """
    found = []
    for element in _named_tags(urdf.root, "coupling"):
        with naming(label(element)):
            ends = _ends(element, urdf)
            to_predecessor, to_successor = _branches(urdf, ends)
            (ratio,) = numbers(child(element, "ratio"), "value")
            if ratio == 0:
                raise RobotFileError("<ratio> is zero")
        joints = dict.fromkeys(to_successor, 1.0) | dict.fromkeys(to_predecessor, -ratio)
        name = required(element, "name")
        coupling = ClosureDescription(type="coupling", name=name, joints=joints)
        found.append((to_successor[-1], coupling))
    return found


def _branches(urdf: UrdfFile, ends: tuple[str, str]) -> list[list[str]]:
    """Joints that move two links against the nearest link that carries both."""
    carriers = {joint.child: joint for joint in urdf.robot.joints}
    paths: list[list[Joint]] = [[], []]  # from the root to each link
    for path, link in zip(paths, ends, strict=True):
        while link in carriers:
            path.insert(0, carriers[link])
            link = carriers[link].parent
    shared = {joint.name for joint in paths[0]} & {joint.name for joint in paths[1]}
    branches = []
    for path, side, link in zip(paths, ENDS["coupling"], ends, strict=True):
        branch = [joint for joint in path if joint.name not in shared and joint.type != "fixed"]
        if not branch:
            raise RobotFileError(f"no joint moves its {side} {link!r} against the other link")
        for joint in branch:
            if joint.type in SEVERAL:
                what = f"joint {joint.name} on the way to its {side} is {joint.type}"
                raise RobotFileError(f"{what}: it has several coordinates")
        branches.append([joint.name for joint in branch])
    return branches


def _named_tags(root: Element, tag: str) -> list[Element]:
    """All tags of one kind, each with a name of its own."""
    elements = root.findall(tag)
    refuse_repetition(tag, (required(element, "name") for element in elements))
    return elements


def _ends(element: Element, urdf: UrdfFile) -> tuple[str, str]:
    """The two links that a tag names, by an attribute or, in SDF, by text."""
    links, found = [link.name for link in urdf.robot.links], []
    for side in _sides(element):
        tag = child(element, side)
        found.append((tag.get("link") or tag.text or "").strip())
        if found[-1] not in links:
            listed = ", ".join(links)
            raise RobotFileError(f"unknown link {found[-1]!r} in <{side}>: choose among {listed}")
    if found[0] == found[1]:
        raise RobotFileError(f"link {found[0]!r} is at both its ends")
    return found[0], found[1]


def _unread_plugins(urdf: UrdfFile) -> list[str]:
    """Sentences about plugins of Gazebo that couple joints, or close loops, which no tag tells."""
    followers, notes = {j.name for j in urdf.robot.joints if j.mimic is not None}, list[str]()
    for plugin in urdf.root.iterfind("gazebo//plugin"):
        file, follower = plugin.get("filename", ""), (plugin.findtext("mimicJoint") or "").strip()
        what = f"plugin {file!r:.80} is not read"
        if follower and follower not in followers:
            notes.append(f"{what}: give joint {follower!r:.60} a <mimic>")
        elif CLOSING_PLUGIN.search(file):
            notes.append(f"{what}: write its closure into a YAML beside it")
    return notes


# Forces in joints: <dynamics>, transmissions, and what simulators add.

# Attributes of <dynamics>, and tags of simulators, by the term that they are a coefficient of.
COEFFICIENTS = {"damping": "Fv", "friction": "Fc", "armature": "Ia"}
COEFFICIENTS |= {"springStiffness": "Ks", "spring_stiffness": "Ks"}
COEFFICIENTS |= {"springReference": "slack", "spring_reference": "slack"}
REDUCTIONS = ("gear_ratio", "mechanicalReduction", "mechanical_reduction")
ROTORS = ("rotor_inertia", "motorInertia", "motor_inertia")
WEIGHTLESS = {"turnGravityOff": True, "gravity": False}  # what each must say
# Tags of Drake that pull at links, and of Gazebo that slow them.
PULLING = ("linear_bushing_rpy", "linear_spring_damper", "dampingFactor", "velocity_decay")


def _joint_forces(urdf: UrdfFile) -> tuple[dict[str, dict[str, float]], list[LeftOut]]:
    """Terms of the joints that the file gives values of, and forces that no model has."""
    kinds = {joint.name: joint.type for joint in urdf.robot.joints}
    given: dict[str, dict[str, float]] = {name: {} for name in kinds}
    heavy = {link.name: link for link in urdf.robot.links if link.inertial is not None}
    left_out, others = list[LeftOut](), dict[str, list[str]]()
    for joint in urdf.root.findall("joint"):
        name = required(joint, "name")
        if name not in given:
            continue  # it closes a loop
        with naming(label(joint)):
            dynamics = single(joint, "dynamics")
            if dynamics is not None:
                for key in map(str, dynamics.attrib):
                    if key in COEFFICIENTS:
                        given[name][COEFFICIENTS[key]] = numbers(dynamics, key)[0]
                    else:
                        others.setdefault(key, []).append(name)
            given[name] |= _coefficients(joint)
    for extension in urdf.root.findall("gazebo"):
        name = (extension.get("reference") or "").strip()
        if name in given:
            given[name] |= _coefficients(extension)
        for tag, weightless in WEIGHTLESS.items() if name in heavy else ():
            if TRUTH.get(_said(extension, (tag,)).lower()) is weightless:
                weights = {name: _weight(heavy[name])}
                left_out.append(LeftOut(f"<{tag}>: {name} has no weight", weights))
    for transmission in urdf.root.iter("transmission", "{*}transmission"):
        _read_transmission(transmission, given, left_out)
    pulling = (str(element.tag).rpartition("}")[2] for element in _all(urdf.root, PULLING))
    left_out += [LeftOut(f"<{tag}>") for tag in pulling]
    for key, names in others.items():
        what = f"{key} in <dynamics> of {shortened(names)}: not known"
        left_out.append(LeftOut(what, is_force=False))
    terms = {}
    for name, values in given.items():
        if "slack" in values:  # Ks (q - q0) = Ks q + Fo
            values["Fo"] = -values.get("Ks", 0.0) * values.pop("slack")
        if kinds[name] in SEVERAL and any(values.values()):
            what = " and ".join(f"{kind} {value:g}" for kind, value in values.items() if value)
            left_out.append(LeftOut(f"{what} of the {kinds[name]} joint {name}"))
        elif kinds[name] != "fixed" and any(values.values()):
            terms[name] = values
    return terms, left_out


def _read_transmission(
    transmission: Element, given: dict[str, dict[str, float]], left_out: list[LeftOut]
) -> None:
    """Inertia of the rotor behind the reduction, of a transmission of one joint."""
    joints = [(joint.get("name") or "").strip() for joint in _all(transmission, ("joint",))]
    driven = [name for name in dict.fromkeys(joints) if name in given]
    texts = {
        what: _said(transmission, tags)
        for what, tags in (("reduction", REDUCTIONS), ("rotor inertia", ROTORS))
    }
    listed = ", ".join(f"{what} {text}" for what, text in texts.items() if text)
    if not driven or not listed:
        return
    try:
        ratio, rotor = (
            number(text) if text else default
            for text, default in zip(texts.values(), (1.0, 0.0), strict=True)
        )
        inertia = rotor * ratio**2
    except OverflowError:
        inertia = math.nan
    if len(driven) > 1 or not math.isfinite(inertia):
        what = f"{listed} of the transmission of {', '.join(driven)}"
        left_out.append(LeftOut(what, is_force=bool(texts["rotor inertia"])))
        return
    if inertia:
        given[driven[0]]["Ia"] = given[driven[0]].get("Ia", 0.0) + inertia
    if ratio != 1:
        what = f"reduction {ratio:g} of the transmission of {driven[0]}"
        left_out.append(LeftOut(f"{what}: logs count at the joint", is_force=False))


def _coefficients(element: Element) -> dict[str, float]:
    """Coefficients that simulators write as tags of their own inside an element."""
    found = {}
    for tag, kind in COEFFICIENTS.items():
        text = _said(element, (tag,))
        if text:
            found[kind] = number(text)
            if not math.isfinite(found[kind]):
                raise RobotFileError(f"<{tag}> must be a finite number, not {text!r:.60}")
    return found


def _said(element: Element, tags: Collection[str]) -> str:
    """The value, name or text of the first tag of some below an element, in any namespace."""
    for found in _all(element, tags):
        return (found.get("value") or found.get("name") or found.text or "").strip()
    return ""


def _all(element: Element, tags: Collection[str]) -> Iterator[Element]:
    return (found for found in element.iterdescendants("*") if _local(found) in tags)


def _local(element: Element) -> str:
    """A tag without its namespace or prefix."""
    return re.split("[}:]", str(element.tag))[-1]


def _weight(link: Any) -> tuple[float, ...]:
    """Mass and centre of mass of a link."""
    inertial = link.inertial
    centre = np.zeros(3) if inertial.origin is None else inertial.origin[:3, 3]
    return float(inertial.mass), *map(float, centre)


# Motors.


def _motors(
    urdf: UrdfFile, mimics: Couplings, couplings: Iterable[tuple[str, Any]], looped: bool
) -> list[str] | None:
    """Joints with motors, in the order of the file; none where the file does not tell.

    The attribute ``independent`` of URDF+ decides, where any joint has it. Otherwise joints that
    follow others have no motors. Of the rest, in a robot with closures, those have motors that
    ``<transmission>`` tags name, if there are any.
    """
    joints = {joint.name: joint.type for joint in urdf.robot.joints}
    moving = [name for name, kind in joints.items() if kind not in ("fixed", "floating")]
    independent = {}
    for joint in urdf.root.findall("joint[@independent]"):
        text = joint.get("independent", "")
        if text.strip().lower() not in TRUTH:
            raise RobotFileError(f"{label(joint)}: independent must be true or false, not {text!r}")
        independent[joint.get("name", "").strip()] = TRUTH[text.strip().lower()]
    if independent:
        return [name for name in moving if independent.get(name, True) and name not in mimics]
    followers, named = {*mimics, *(name for name, _ in couplings)}, []
    for transmission in urdf.root.findall("transmission") if looped else ():
        for joint in transmission.findall("joint"):
            named.append((joint.get("name") or "").strip())
            if named[-1] not in joints:
                what, listed = f"unknown joint {named[-1]!r}", ", ".join(joints)
                raise RobotFileError(f"{label(transmission)}: {what}: choose among {listed}")
    if not named and not followers:
        return None
    return [name for name in moving if name in (named or moving) and name not in followers]
