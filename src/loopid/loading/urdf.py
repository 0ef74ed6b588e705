"""From a URDF to the open tree, and to the closures and motors that the file itself declares.

Closures are written in three ways: joints that ``<mimic>`` others, pairs of closing frames as
onshape-to-robot exports them, and the ``<loop>`` and ``<coupling>`` tags of URDF+ [Chignoli2024].
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Collection, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pinocchio as pin

from loopid.errors import RobotFileError
from loopid.loading.closure_description import ClosureDescription
from loopid.loading.description import Description
from loopid.loading.tree import TreeSource, add_frame
from loopid.loading.urdf_file import (
    LEAST_AXIS,
    Element,
    UrdfFile,
    child,
    label,
    naming,
    numbers,
    read_urdf_file,
    required,
)

if TYPE_CHECKING:
    from yourdfpy.urdf import Joint

ROOT_JOINT = "root_joint"
SEVERAL = ("floating", "planar")  # types of joints with several coordinates
CLOSING_FRAME = re.compile(r"closing_(.+)_([12])")
Z = (0.0, 0.0, 1.0)
SIDES = ("predecessor", "successor")
LOOPS = {
    "continuous": "hinge",
    "cylindrical": "cylindrical",
    "fixed": "6d",
    "prismatic": "prismatic",
    "revolute": "hinge",
    "spherical": "3d",
}
AXIAL = ("hinge", "cylindrical", "prismatic")
TRUTH = {"true": True, "1": True, "false": False, "0": False}
# Closures as drafts of URDF+ and simulators of their own write them.
UNREAD = ("constraint", "loop_constraint", "joint_constraint", "loop_joint")
Couplings = list[tuple[str, ClosureDescription]]  # each with the joint that follows the others


def read_urdf(path: Path, floating_base: bool = False, free_mimics: bool = False) -> TreeSource:
    """Read the tree of a URDF, and what the file says of closures and motors.

    Parameters
    ----------
    path : Path
    floating_base : bool
        Whether the root link moves freely, on a joint called ``root_joint``.
    free_mimics : bool
        Whether joints that mimic others move on their own all the same.

    Raises
    ------
    RobotFileError
        Naming the file, the link, joint or tag and the offending value.
    """
    urdf = read_urdf_file(path)
    links, joints = urdf.robot.links, urdf.robot.joints
    with naming(path):
        model = _model(urdf, floating_base)
        mimics = [] if free_mimics else _mimics(urdf)
        couplings = _couplings(urdf)
        closures = _closing_frames([link.name for link in links]) + _loops(urdf.root, model)
        motors = _motors(urdf, dict(mimics), dict(couplings), looped=bool(closures))
    carried = {ROOT_JOINT: urdf.root_link} if floating_base else {}
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
            closures=[*closures, *(coupling for _, coupling in (*couplings, *mimics))],
            name_mot=motors,
        ),
        notes=tuple(f"{label(tag)} is not read" for tag in urdf.root if tag.tag in UNREAD),
    )


def _model(urdf: UrdfFile, floating_base: bool) -> pin.Model:
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


# Mimics.


def _mimics(urdf: UrdfFile) -> Couplings:
    """Joints that follow another one: follower = multiplier · leader + offset.

    A follower may lead others. Fixed joints have nothing to follow with: their tag says nothing.
    """
    joints = {joint.name: joint for joint in urdf.robot.joints}
    followers = {n: j for n, j in joints.items() if j.mimic is not None and j.type != "fixed"}
    leaders = {name: joint.mimic.joint for name, joint in followers.items()}
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
    _refuse_circles(leaders)
    found = []
    for name, joint in followers.items():
        factor, offset = joint.mimic.multiplier, joint.mimic.offset
        terms = {name: 1.0} | ({leaders[name]: -factor} if factor else {})
        found.append((name, ClosureDescription(type="coupling", joints=terms, offset=offset)))
    return found


def _refuse_circles(leaders: Mapping[str, str]) -> None:
    for follower in leaders:
        chain = [follower]
        while chain[-1] in leaders and len(chain) <= len(leaders):
            chain.append(leaders[chain[-1]])
            if chain[-1] == follower:
                raise RobotFileError(
                    f"joint {' mimics '.join(chain)}: a circle, with no joint to lead it"
                )


# Closing frames.


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
            closures.append(ClosureDescription(type="hinge", frames=frames, axes=(Z, Z)))
        else:
            closures.append(ClosureDescription(type="3d", frames=frames))
    return closures


# URDF+.


def _loops(root: Element, model: pin.Model) -> list[ClosureDescription]:
    """Closures of the ``<loop>`` tags, their frames mounted in the model.

    A loop ``x`` joins the frames ``x_predecessor`` and ``x_successor``, at the origins that it
    gives in its two links. Its axis has the same components in both.
    """
    closures = []
    for loop in _named_tags(root, "loop"):
        with naming(label(loop)):
            kind = LOOPS.get(loop.get("type", ""))
            if kind is None:
                listed = ", ".join(LOOPS)
                raise RobotFileError(
                    f"unknown type {loop.get('type', '')!r}: choose among {listed}"
                )
            links = [frame.name for frame in model.frames if frame.type == pin.FrameType.BODY]
            ends = zip(SIDES, _ends(loop, links), strict=True)
            content: dict[str, Any] = {"axes": (_axis(loop),) * 2} if kind in AXIAL else {}
            content |= {"type": kind, "frames": [_mount(loop, *end, model) for end in ends]}
        closures.append(ClosureDescription.model_validate(content))
    return closures


def _axis(loop: Element) -> tuple[float, ...]:
    values = numbers(child(loop, "axis"), "xyz", 3)
    if max(map(abs, values)) < LEAST_AXIS:
        raise RobotFileError("<axis> is zero")
    return values


def _mount(loop: Element, side: str, link: str, model: pin.Model) -> str:
    """Add the frame of one side to the model; gives its name."""
    name = f"{loop.get('name', '').strip()}_{side}"
    if any(frame.name == name for frame in model.frames):
        raise RobotFileError(
            f"its frame cannot be called {name!r}, which is taken: rename the loop"
        )
    add_frame(model, name, link, placement(loop.find(f"{side}/origin")))
    return name


def placement(origin: Element | None) -> pin.SE3:
    """Placement of an ``<origin>``; the identity without one."""
    if origin is None:
        return pin.SE3.Identity()
    xyz, rpy = (np.array(numbers(origin, key, 3, "0 0 0")) for key in ("xyz", "rpy"))
    return pin.SE3(pin.rpy.rpyToMatrix(rpy), xyz)


def _couplings(urdf: UrdfFile) -> Couplings:
    """``<coupling>`` tags: gears and belts between two links.

    From the nearest link that carries both, joints lead to the predecessor and to the successor.
    The coordinates on the way to the successor add up to the ratio times those on the way to the
    predecessor.
    """
    found = []
    for element in _named_tags(urdf.root, "coupling"):
        with naming(label(element)):
            ends = _ends(element, [link.name for link in urdf.robot.links])
            to_predecessor, to_successor = _branches(urdf, ends)
            (ratio,) = numbers(child(element, "ratio"), "value")
            if ratio == 0:
                raise RobotFileError("<ratio> is zero")
        joints = dict.fromkeys(to_successor, 1.0) | dict.fromkeys(to_predecessor, -ratio)
        found.append((to_successor[-1], ClosureDescription(type="coupling", joints=joints)))
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
    for path, side, link in zip(paths, SIDES, ends, strict=True):
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
    for name, count in Counter(required(element, "name") for element in elements).items():
        if count > 1:
            raise RobotFileError(f"<{tag} name={name!r}> appears {count} times")
    return elements


def _ends(element: Element, links: Collection[str]) -> tuple[str, str]:
    """Links of predecessor and successor."""
    found = []
    for side in SIDES:
        link = child(element, side).get("link", "").strip()
        if link not in links:
            listed = ", ".join(links)
            raise RobotFileError(f"unknown link {link!r} in <{side}>: choose among {listed}")
        found.append(link)
    predecessor, successor = found
    if predecessor == successor:
        raise RobotFileError(f"link {predecessor!r} is its predecessor and its successor")
    return predecessor, successor


# Motors.


def _motors(
    urdf: UrdfFile, mimics: Collection[str], coupled: Collection[str], looped: bool
) -> list[str] | None:
    """Joints with motors, in the order of the file; none where the file does not tell.

    The attribute ``independent`` of URDF+ decides, where any joint has it. Otherwise joints that
    follow others have no motors. Of the rest, in a robot with closures, those have motors that
    ``<transmission>`` tags name, if there are any.
    """
    moving = [j.name for j in urdf.robot.joints if j.type not in ("fixed", "floating")]
    independent = _independent(urdf.root)
    if independent:
        return [name for name in moving if independent.get(name, True) and name not in mimics]
    followers = {*mimics, *coupled}
    named = _named_by_transmissions(urdf) if looped else []
    if not named and not followers:
        return None
    return [name for name in moving if name in (named or moving) and name not in followers]


def _independent(root: Element) -> dict[str, bool]:
    """The attribute of the joints that have it."""
    declared = {}
    for joint in root.findall("joint[@independent]"):
        text = joint.get("independent", "")
        if text.strip().lower() not in TRUTH:
            raise RobotFileError(f"{label(joint)}: independent must be true or false, not {text!r}")
        declared[joint.get("name", "").strip()] = TRUTH[text.strip().lower()]
    return declared


def _named_by_transmissions(urdf: UrdfFile) -> list[str]:
    joints, named = [joint.name for joint in urdf.robot.joints], []
    for transmission in urdf.root.findall("transmission"):
        for joint in transmission.findall("joint"):
            name = (joint.get("name") or "").strip()
            if name not in joints:
                what, listed = f"{label(transmission)}: unknown joint {name!r}", ", ".join(joints)
                raise RobotFileError(f"{what}: choose among {listed}")
            named.append(name)
    return named
