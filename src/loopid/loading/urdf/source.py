"""Read a URDF: plain, with pairs of closing frames, or extended to URDF+."""

from __future__ import annotations

from pathlib import Path

import pinocchio as pin
from lxml import etree

from loopid.errors import RobotFileError
from loopid.loading.closure_description import ClosureDescription
from loopid.loading.description import Description
from loopid.loading.source import TreeSource
from loopid.loading.urdf.closing_frames import closing_frames
from loopid.loading.urdf.couplings import read_couplings
from loopid.loading.urdf.loops import read_loops
from loopid.loading.urdf.markup import Element, label, naming, parse_xml, tree_part
from loopid.loading.urdf.mimics import find_mimics
from loopid.loading.urdf.motors import find_motors
from loopid.loading.urdf.robot import Robot
from loopid.loading.urdf.tree import has_inertia, read_robot, root_link

ROOT_JOINT = "root_joint"
# Closures as drafts of URDF+ and simulators of their own write them.
UNREAD = ("constraint", "loop_constraint", "joint_constraint", "loop_joint")


def read_urdf_source(
    path: Path, floating_base: bool = False, free_mimics: bool = False
) -> TreeSource:
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
    with naming(path):
        return _read(path, parse_xml(path), floating_base, free_mimics)


def _read(path: Path, root: Element, floating_base: bool, free_mimics: bool) -> TreeSource:
    tree = tree_part(root)
    robot = read_robot(tree)
    _check_free_names(robot, floating_base)
    model = _build(tree, floating_base)
    mimics = [] if free_mimics else find_mimics(robot.joints)
    coupled = read_couplings(root, robot)
    loops = closing_frames([link.name for link in robot.links]) + read_loops(root, model)
    carried = {ROOT_JOINT: root_link(robot)} if floating_base else {}
    return TreeSource(
        name=robot.name or path.stem,
        file=path,
        model=model,
        inertial_links=tuple(link.name for link in robot.links if has_inertia(link)),
        child_links=carried | {joint.name: joint.child for joint in robot.joints},
        description=Description(
            closures=[*loops, *(coupling for _, coupling in (*coupled, *mimics))],
            name_mot=find_motors(root, robot, _names(mimics), _names(coupled), bool(loops)),
        ),
        notes=tuple(f"{label(tag)} is not read" for tag in root if tag.tag in UNREAD),
    )


def _names(couplings: list[tuple[str, ClosureDescription]]) -> set[str]:
    return {follower for follower, _ in couplings}


def _check_free_names(robot: Robot, floating_base: bool) -> None:
    """Refuse joints called like those that Pinocchio adds."""
    taken = ("universe", ROOT_JOINT) if floating_base else ("universe",)
    for joint in robot.joints:
        if joint.name in taken:
            what = "the joint of the floating base" if joint.name == ROOT_JOINT else "the ground"
            raise RobotFileError(f"joint {joint.name} must not be called like {what}: rename it")


def _build(tree: Element, floating_base: bool) -> pin.Model:
    """Pinocchio's model, with mimicking joints as joints of their own."""
    base = [pin.JointModelFreeFlyer()] if floating_base else []
    try:
        return pin.buildModelFromXML(etree.tostring(tree, encoding="unicode"), *base)
    except (ValueError, RuntimeError) as error:
        reason = " ".join(str(error).split())
        raise RobotFileError(f"Pinocchio refuses it: {reason}") from error
