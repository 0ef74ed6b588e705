"""Dialects of URDF: what URDF+, Isaac Sim, onshape-to-robot, Drake, Gazebo say beyond the tree."""

from __future__ import annotations

import re
from collections.abc import Collection, Iterable, Iterator

import numpy as np
import pinocchio as pin
from lxml import etree

from loopid.border import validated
from loopid.errors import RobotFileError, naming, shown
from loopid.loading import xml_elements as xml
from loopid.loading.description import ClosureDescription
from loopid.loading.urdf import PARENT_CHILD, Dialect, closure_of, coefficients, linked, mounted
from loopid.loading.urdf_tree import UrdfFile
from loopid.robot.robot import LeftOut, shortened

ENDS = ("predecessor", "successor")
# Tags that name the links, where the place in a link stands, with {} for its side, and axes as of
# ``closure_of``.
LOOP_TAGS: dict[str, tuple[tuple[str, str], str, tuple[str, str] | str]] = {
    "loop": (ENDS, "{}/origin", "axis"),  # URDF+ [Chignoli2024]
    "loop_joint": (("link1", "link2"), "{}", "axis"),  # Isaac Sim
    "constraint": (PARENT_CHILD, "{}_origin", ("parent_axis", "child_axis")),  # urdfdom's 264
}
CLOSING_FRAME = re.compile(r"closing_(.+)_([12])")
Z = (0.0, 0.0, 1.0)
BALL = "ball_constraint"
PULLING = ("linear_bushing_rpy", "linear_spring_damper")
DRAFTS = ("loop_constraint", "joint_constraint")
TRUTH = {"true": True, "1": True, "false": False, "0": False}
# What names and files of plugins that close loops hold.
CLOSING_PLUGIN = re.compile("closed_?loop|attach_links|detachable_?-?joint", re.IGNORECASE)
WEIGHTLESS = {"turnGravityOff": ("true", "1"), "gravity": ("false", "0")}  # what each must say
SLOWING = ("dampingFactor", "velocity_decay")


def read_loop_tags(urdf: UrdfFile, model: pin.Model) -> Dialect:
    """Closures of tags with a type, and a placement in either link."""
    closures = []
    for tag, (sides, origin, axes) in LOOP_TAGS.items():
        for element in xml.named_tags(urdf.root, tag):
            for repeated in element.findall("link1")[1:]:
                repeated.tag = "link2"  # Isaac Sim's manual writes <link1> twice
            with naming(xml.label(element)):
                first, second = (xml.placement(element.find(origin.format(side))) for side in sides)
                links, places = linked(urdf, element, sides), (first, second)
                closures.append(closure_of(model, element, links, places, sides=sides, axes=axes))
    return Dialect(closures)


def read_closing_frames(urdf: UrdfFile, model: pin.Model) -> Dialect:
    """Closures of onshape-to-robot: the links ``closing_NAME_1`` and ``closing_NAME_2``.

    The names say that two frames meet, not by which joint. Only beside a hinge, versions of the
    exporter add a second pair of frames further along its axis, ``closing_NAME_1_z`` and
    ``closing_NAME_2_z``. Without them the origins meet, which the exporter's manual has one
    enforce.
    """
    links, closures = [link.name for link in urdf.links], []
    for match in filter(None, map(CLOSING_FRAME.fullmatch, links)):
        name, side = match.groups()
        frames = (f"closing_{name}_1", f"closing_{name}_2")
        partner = frames[2 - int(side)]
        if partner not in links:
            raise RobotFileError(f"link {match[0]} closes a loop with {partner!r}: add it")
        if side == "2":
            continue
        if all(f"{frame}_z" in links for frame in frames):
            axial = ClosureDescription(type="hinge", name=name, frames=frames, axes=(Z, Z))
            closures.append(axial)
        else:
            closures.append(ClosureDescription(type="3d", name=name, frames=frames))
    return Dialect(closures)


def read_drake(urdf: UrdfFile, model: pin.Model) -> Dialect:
    """Closures of Drake's ball constraints, and its forces that no model has."""
    closures = []
    for k, element in enumerate(xml.inner_tags(urdf.root, (BALL,)), start=1):
        name = f"{BALL}_{k}"
        with naming(f"<{BALL} name={name!r}>"):
            ball, points = etree.Element(BALL), list[pin.SE3]()
            for side, body, point in (("parent", "body_A", "p_AP"), ("child", "body_B", "p_BQ")):
                link, xyz = (xml.said(element, f"{BALL}_{tag}") for tag in (body, point))
                if not (link and xyz):
                    raise RobotFileError(f"it needs {BALL}_{body} and _{point}")
                end = etree.SubElement(ball, side, link=link, xyz=xyz)
                points.append(pin.SE3(np.eye(3), np.array(xml.numbers(end, "xyz", 3))))
            links = linked(urdf, ball)
            closures.append(mounted(model, "3d", name, links, (points[0], points[1])))
    pulling = xml.inner_tags(urdf.root, PULLING)
    left_out = [LeftOut(f"<{str(tag.tag).rpartition('}')[2]}>") for tag in pulling]
    return Dialect(closures, left_out=left_out)


def read_urdf_plus(urdf: UrdfFile, model: pin.Model) -> Dialect:
    """URDF+ [Chignoli2024]: couplings, and which joints have motors."""
    for element in xml.inner_tags(urdf.root, DRAFTS):
        do = "remove it, and write its closure into a YAML beside it"
        raise RobotFileError(f"{xml.label(element)} is not read: {do}")
    couplings = _couplings(urdf, model)
    return Dialect(
        closures=[*couplings.values()], followers=tuple(couplings), independent=_independent(urdf)
    )


def _couplings(urdf: UrdfFile, model: pin.Model) -> dict[str, ClosureDescription]:
    """``<coupling>`` tags: gears and belts between two links, by the joint that follows.

    From the nearest link that carries both, joints lead to the predecessor and to the successor.
    The coordinates on the way to the successor add up to the ratio times those on the way to the
    predecessor.
    """
    found = {}
    for element in xml.named_tags(urdf.root, "coupling"):
        with naming(xml.label(element)):
            to_predecessor, to_successor = _branches(model, linked(urdf, element, ENDS))
            (ratio,) = xml.numbers(xml.child(element, "ratio"), "value")
            if ratio == 0:
                raise RobotFileError("<ratio> is zero")
            joints = dict.fromkeys(to_successor, 1.0) | dict.fromkeys(to_predecessor, -ratio)
            content = {"type": "coupling", "name": xml.required(element, "name"), "joints": joints}
            found[to_successor[-1]] = validated(ClosureDescription, content)
    return found


def _branches(model: pin.Model, ends: tuple[str, str]) -> list[list[str]]:
    """Joints that move two links against the nearest link that carries both."""
    frames = [model.frames[model.getFrameId(link, pin.FrameType.BODY)] for link in ends]
    paths = [list(model.supports[frame.parentJoint]) for frame in frames]  # from the root on
    branches = []
    for path, other, side, link in zip(paths, paths[::-1], ENDS, ends, strict=True):
        branch = [joint for joint in path if joint not in other]
        if not branch:
            raise RobotFileError(f"no joint moves its {side} {link!r} against the other link")
        for joint in branch:
            if model.joints[joint].nv > 1:
                what = f"joint {model.names[joint]} on the way to its {side}"
                raise RobotFileError(f"{what} has several coordinates")
        branches.append([model.names[joint] for joint in branch])
    return branches


def _independent(urdf: UrdfFile) -> dict[str, bool]:
    """Which joints have motors, where they say so."""
    found = {}
    for joint in urdf.root.findall("joint[@independent]"):
        text = joint.get("independent", "").strip()
        if text.lower() not in TRUTH:
            raise RobotFileError(
                f"{xml.label(joint)}: independent must be true or false, not {text!r}"
            )
        found[joint.get("name", "").strip()] = TRUTH[text.lower()]
    return found


def read_gazebo(urdf: UrdfFile, model: pin.Model) -> Dialect:
    """What ``<gazebo>`` tags say of closures, forces and plugins."""
    terms, left_out = dict[str, dict[str, float]](), list[LeftOut]()
    joints = {joint.name for joint in urdf.joints}
    heavy = {link.name: link.inertial for link in urdf.links if link.inertial is not None}
    for extension in urdf.root.findall("gazebo"):
        name = (extension.get("reference") or "").strip()
        if name in joints:
            terms[name] = terms.get(name, {}) | coefficients(extension)
        for tag, words in WEIGHTLESS.items() if name in heavy else ():
            if xml.said(extension, tag).lower() in words:
                weight = heavy[name].mass, *map(float, heavy[name].centre)
                left_out.append(LeftOut(f"<{tag}>: {name} has no weight", {name: weight}))
        left_out += [
            LeftOut(f"<{xml.local_name(tag)}>") for tag in xml.inner_tags(extension, SLOWING)
        ]
    followers = {joint.name for joint in urdf.joints if joint.mimic is not None}
    notes = (*unread_plugins(urdf.root.iterfind("gazebo//plugin"), followers),)
    return Dialect(_loops(urdf, model), joint_terms=terms, left_out=left_out, notes=notes)


def _loops(urdf: UrdfFile, model: pin.Model) -> list[ClosureDescription]:
    """Closures of joints, placed in their child as the file is drawn."""
    closures, data = [], model.createData()
    pin.framesForwardKinematics(model, data, pin.neutral(model))
    for element in urdf.root.findall("gazebo/joint"):
        parent = xml.content(element, "parent")
        if parent == "world" and all(link.name != "world" for link in urdf.links):
            continue  # a mount, which a URDF has anyway
        with naming(xml.label(element)):
            links = linked(urdf, element)
            first, second = (data.oMf[model.getFrameId(k, pin.FrameType.BODY)] for k in links)
            words = (element.findtext("pose") or "0 0 0 0 0 0").split()
            pose = {"xyz": " ".join(words[:3]), "rpy": " ".join(words[3:])}
            place = xml.placement(etree.Element("origin", pose))
            places = first.actInv(second * place), place
            closures.append(closure_of(model, element, links, places))
    return closures


def unread_plugins(plugins: Iterable[xml.Element], followers: Collection[str]) -> Iterator[str]:
    """Sentences about plugins that close loops, or let others than the ``followers`` follow."""
    found: dict[str, list[str]] = {}  # which follow by a plugin, none by one that closes loops
    for plugin in plugins:
        file, name = plugin.get("filename", ""), plugin.get("name", "")
        follower = xml.text_at(plugin, "mimicJoint")
        if follower and follower not in followers:
            found.setdefault(file, []).append(follower)
        elif CLOSING_PLUGIN.search(file + name):
            found.setdefault(file or name, [])
    for file, joints in found.items():
        do = "where it closes a loop, write its closure into a YAML beside it"
        if joints:
            do = f"give a <mimic> to {shortened(joints)}"
        yield f"plugin {shown(file)} is not read: {do}"
