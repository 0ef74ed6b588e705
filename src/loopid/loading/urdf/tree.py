"""Check everything of a URDF's tree that Pinocchio takes on trust."""

from __future__ import annotations

from collections import Counter

import numpy as np

from loopid.errors import RobotFileError
from loopid.loading.urdf.markup import Element
from loopid.loading.urdf.robot import Link, Robot, parse_robot
from loopid.loading.urdf.tags import check_tags


def read_robot(tree: Element) -> Robot:
    """Links and joints of a URDF, after all checks.

    Raises
    ------
    RobotFileError
        Naming the link or joint and the offending value.
    """
    check_tags(tree)
    robot = parse_robot(tree)
    if not robot.links:
        raise RobotFileError("not a valid URDF: it has no <link>")
    _check_names(robot)
    _check_tree(robot)
    for link in robot.links:
        _check_mass(link)
    return robot


def has_inertia(link: Link) -> bool:
    """Whether a link is a body: an ``<inertial>`` that is all zero counts as none."""
    inertial = link.inertial
    return inertial is not None and bool(inertial.mass != 0 or np.any(inertial.inertia))


def root_link(robot: Robot) -> str:
    """The link that no joint carries."""
    children = {joint.child for joint in robot.joints}
    return next(link.name for link in robot.links if link.name not in children)


def _check_names(robot: Robot) -> None:
    for tag, elements in (("link", robot.links), ("joint", robot.joints)):
        for name, count in Counter(element.name for element in elements).items():
            if count > 1:
                raise RobotFileError(f"<{tag} name={name!r}> appears {count} times")


def _check_tree(robot: Robot) -> None:
    links = {link.name for link in robot.links}
    for joint in robot.joints:
        for end in (joint.parent, joint.child):
            if end not in links:
                raise RobotFileError(f"joint {joint.name} names link {end!r}, which is not there")
    parents = Counter(joint.child for joint in robot.joints)
    for child, count in parents.items():
        if count > 1:
            raise RobotFileError(f"link {child} is the child of {count} joints: not a tree")
    roots = sorted(links - set(parents))
    if len(roots) != 1:
        listed = ", ".join(roots) or "none"
        raise RobotFileError(f"the links must form one tree with one root, but roots are: {listed}")
    _check_reachable(robot, roots[0], links)


def _check_reachable(robot: Robot, root: str, links: set[str]) -> None:
    reached, waiting = {root}, [root]
    while waiting:
        parent = waiting.pop()
        children = [joint.child for joint in robot.joints if joint.parent == parent]
        reached.update(children)
        waiting.extend(children)
    if reached != links:
        lost = ", ".join(sorted(links - reached))
        raise RobotFileError(f"links {lost} hang on a cycle of joints, not on root {root}")


def _check_mass(link: Link) -> None:
    if link.inertial is not None and link.inertial.mass < 0:
        raise RobotFileError(
            f"link {link.name}: mass must not be negative: {link.inertial.mass:g} kg"
        )
